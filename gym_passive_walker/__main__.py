"""The command line: walkers, their gaits and figures, without writing Python."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gym_passive_walker.gaits.fixed_point import find_gaits
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.walkers import WALKERS, WalkerError, as_walker, tune, tuning_errors


def _describe(gait: Gait) -> str:
    """A gait's measures, a line each."""
    multipliers = ", ".join(
        f"{value.real:.6g}" if value.imag == 0.0 else f"{value.real:.6g}{value.imag:+.6g}i"
        for value in gait.multipliers
    )
    rows = {
        "stance angle (rad)": f"{gait.stance_angle:.10g}",
        "section state": "  ".join(f"{value:.10g}" for value in gait.state),
        "step period": f"{gait.step_period:.8g}",
        "step length": f"{gait.step_length:.8g}",
        "speed": f"{gait.speed:.8g}",
        "speed / sqrt(g l)": f"{gait.froude_speed:.8g}",
        "cost of transport": f"{gait.cost_of_transport:.8g}",
        "multipliers": multipliers,
        "stable": "yes" if gait.stable else "no",
    }
    lines = [f"{gait.kind}-step gait, period {gait.period}"]
    return "\n".join(lines + [f"  {name:<20} {value}" for name, value in rows.items()])


def _walkers(_: argparse.Namespace) -> int:
    for name, walker in WALKERS.items():
        errors = tuning_errors(walker)
        legs = "no mass in the legs" if walker.massless_legs else f"foot {walker.foot_radius:g}"
        knees = "knees" if walker.knees else "straight legs"
        tuned = max(abs(errors.collinearity), abs(errors.shank_under_knee))
        print(f"{name:<14}{knees:<15}{legs:<21}off tuning by {tuned:.2g} leg lengths")
    return 0


def _gait(arguments: argparse.Namespace) -> int:
    walker = as_walker(arguments.walker)
    if arguments.tune:
        walker = tune(walker)
    gaits = find_gaits(walker, arguments.slope, period=arguments.period)
    if not gaits:
        print(
            f"no gait of period {arguments.period} found at slope {arguments.slope} rad",
            file=sys.stderr,
        )
        return 1
    print("\n\n".join(_describe(gait) for gait in gaits))
    return 0


def _figures(arguments: argparse.Namespace) -> int:
    from gym_passive_walker.render.figures import FIGURES, draw

    for name in arguments.names or FIGURES:
        print(draw(name, arguments.out), flush=True)
    return 0


def parser() -> argparse.ArgumentParser:
    """What the command line understands."""
    top = argparse.ArgumentParser(prog="python -m gym_passive_walker", description=__doc__)
    commands = top.add_subparsers(required=True, metavar="command")

    command = commands.add_parser("walkers", help="list the walkers of the source document")
    command.set_defaults(run=_walkers)

    command = commands.add_parser("gait", help="find every gait of a walker at a slope")
    command.add_argument("walker", help=f"one of {', '.join(WALKERS)}")
    command.add_argument("slope", type=float, help="slope in rad, downhill")
    command.add_argument("--period", type=int, default=1, help="strides until it repeats")
    command.add_argument("--tune", action="store_true", help="meet Fig. 4.7's conditions exactly")
    command.set_defaults(run=_gait)

    command = commands.add_parser("figures", help="draw the source document's figures")
    command.add_argument("names", nargs="*", help="figure numbers, such as 4.6; all if none")
    command.add_argument("--out", default="figures", help="folder for the PNG files")
    command.set_defaults(run=_figures)
    return top


def main(words: Sequence[str] | None = None) -> int:
    """Run a command; bad input ends with a sentence, not a traceback."""
    arguments = parser().parse_args(words)
    try:
        return arguments.run(arguments)
    except (WalkerError, ValueError, ImportError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
