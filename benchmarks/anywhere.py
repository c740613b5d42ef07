"""One policy for many bodies, beside the optimum of each body.

    python -m benchmarks.anywhere [train | walk | optima | show ...] [--bodies N] [--minutes M]

`train` trains on pools of 10 to 10,000 bodies and on new bodies at each reset. `walk` lets the
policies walk with held-out bodies, each on a slope and at a commanded speed of its own. `optima`
finds the least cost of each body at the speed walked. `show` prints the tables, writes them into
docs/anywhere.md, and draws docs/images/anywhere.png. All of it is kept in `--out`, and continues
where it stopped.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import gym_passive_walker as gpw
from benchmarks.report import machine, seconds, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, simulate_episodes
from gym_passive_walker.gaits.actuation import to_own
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.optimum import OptimalGait
from gym_passive_walker.gaits.control.policy import Policy
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.models.model import bodies

POOLS = (10, 100, 1000, 10_000, 0)
"""Numbers of training bodies; 0 is a new body at each reset."""

STEPS = 16_000_000
"""Steps of each training on a pool."""

SHIPPED = "anywhere-ppo"
HELD_OUT = 1999_000_000
"""Seed of the first held-out episode; training, evaluations and pools have others."""

BODIES, LIMIT = 1000, 4000
_NEAREST = 5  # known gaits from which the search of an optimum starts
_TURN = 25  # bodies of one policy, before those of the next
_SLOPE, _SPEED = 100.0, 30.0  # of slope and speed, in the distance between two gaits
_RESAMPLES = 10_000  # of the bodies, for an interval
_KEPT = 128  # control steps at the end of a walk that hold its last stride


class Watched:
    """A policy that keeps its last observations and actions."""

    def __init__(self, policy: Policy) -> None:
        self.policy, self.last = policy, []

    def predict(self, observation: Any, *rest: Any, **named: Any) -> tuple[Any, Any]:
        """Return the policy's actions and memory, and record them."""
        actions, state = self.policy.predict(observation, *rest, **named)
        self.last = [*self.last[1 - _KEPT :], (observation[:, :6].copy(), actions[:, 0].copy())]
        return actions, state

    def stride(self, lane: int, largest: float) -> tuple[list[float], list[float]]:
        """Point of the section and torques of a walker's last whole stride; empty without one."""
        states = np.array([seen[lane] for seen, _ in self.last], dtype=float)
        torques = largest * np.array([actions[lane] for _, actions in self.last], dtype=float)
        begun = 1 + np.flatnonzero(np.diff(states[:, 0]) > 0.0)  # else the angle decreases
        if len(begun) < 2:
            return [], []
        first, last = begun[-2:]
        return states[first, [0, 3, 4, 5]].tolist(), torques[first:last].tolist()


def pool_name(count: int) -> str:
    """Name of the training on a pool."""
    return f"pool-{count}" if count else "new"


NAMES = [SHIPPED, *map(pool_name, POOLS)]
"""The policy of the package, and the trainings."""


def train(out: Path, _: argparse.Namespace) -> None:
    """Train on all pools."""
    from agents.config import configure
    from agents.training import Run

    for count in POOLS:
        folder = out / pool_name(count)
        folder.mkdir(parents=True, exist_ok=True)
        env = {"randomization_pool": count or None}
        config = configure("ppo-fast", "anywhere", env=env, steps=STEPS, every=STEPS // 10)
        Run(config, folder).train()


def policies(out: Path) -> Iterator[tuple[str, Policy]]:
    """The policy of the package and those of the pools, as far as they exist."""
    from agents.learner import learned, on_numpy

    with suppress(gpw.PolicyError):
        yield SHIPPED, gpw.load_policy(SHIPPED)
    for count in POOLS:
        folder = out / pool_name(count)
        if (folder / "model.zip").is_file():
            config, policy = learned(folder)
            yield folder.name, on_numpy(policy, config)


def arena(count: int) -> Any:
    """The held-out episodes."""
    return gymnasium.make_vec("PassiveWalker-v0", num_envs=count, scene="anywhere")


def held_out(count: int) -> list[Scene]:
    """Held-out bodies, each in a scene of its own slope and commanded speed."""
    envs: Any = arena(count)
    envs.reset(seed=HELD_OUT)
    commands = envs.batch.disturbances.states["command"].tolist()
    known: dict[str, Any] = {"domain_randomization": {}}
    return [
        make_scene("anywhere", walker=walker, slope=slope, command=command, **known)
        for walker, slope, command in zip(
            envs.batch.walkers, envs.slopes.tolist(), commands, strict=True
        )
    ]


def walk(out: Path, args: argparse.Namespace) -> None:
    """Let every policy walk with all held-out bodies."""
    scenes = held_out(args.bodies)
    for name, policy in policies(out):
        watched = Watched(policy)
        walks = simulate_episodes(watched, arena(args.bodies), seed=HELD_OUT)
        rows = []
        for i, ending in enumerate(walks.endings):
            speed, (point, torques) = float(scenes[i].command), ([], [])  # type: ignore[arg-type]
            if ending == TIME_LIMIT:
                speed = float(walks.speed[i])
                point, torques = watched.stride(i, scenes[i].max_hip_torque)
            rows.append({
                "speed": speed, "cost": float(walks.cost_of_transport[i]), "ending": ending,
                "point": point, "torques": torques,
            })  # fmt: skip
        walks_of(out, name).write_text(json.dumps(rows), encoding="utf-8")
        print(f"{name}: {walks.endings.count(TIME_LIMIT)} of {len(walks)} walk to the end")


def best_of(scene: Scene, speed: float, starts: list[OptimalGait | None]) -> OptimalGait | None:
    """The cheapest of the gaits of a body at a speed that are found from some starts, or None.

    The last start is of use only where all others fail: to search from None is slow.
    """
    alone, best = make_scene(scene, command=None, observe_body=()), None
    for start in starts:
        if start is None and best is not None:
            break
        with suppress(GaitNotFound, np.linalg.LinAlgError):
            gait = optimal.optimal_gait(alone, speed, start=start)
            if best is None or gait.charged_cost < best.charged_cost:
                best = gait
    return best


def optima(out: Path, args: argparse.Namespace) -> None:
    """Find the optimum of each body at the speed at which each policy walks with it."""
    until, found = time.monotonic() + 60.0 * args.minutes, read(out)
    walks = {name: walked(out, name) for name in NAMES if walks_of(out, name).is_file()}
    # Where a policy falls, a search shows whether the body has a gait. Another's walk does so too.
    walkable = {
        i for rows in walks.values() for i, row in enumerate(rows) if row["ending"] == TIME_LIMIT
    }
    walks = {name: rows for name, rows in walks.items() if name in args.only}
    todo = [
        (name, i)
        for first in range(0, args.bodies, _TURN)
        for name, rows in walks.items()
        for i in range(first, min(first + _TURN, len(rows), args.bodies))
        if args.again or (name, i, rows[i]["speed"]) not in found
        if rows[i]["ending"] == TIME_LIMIT or i not in walkable
    ]
    todo.sort(key=lambda each: walks[each[0]][each[1]]["ending"] == TIME_LIMIT)  # falls first
    scenes = held_out(args.bodies)
    places = [place(scene) for scene in scenes]
    known = [
        (np.array([*places[i], _SPEED * gait.froude_speed]), gait)
        for (_, i, _), gait in found.items()
        if gait is not None and i < args.bodies
    ]
    stored = optimal.load("level")
    with (out / "optima.jsonl").open("a", encoding="utf-8") as file:
        for name, i in todo:
            if time.monotonic() > until:
                return
            row, scene, speed = walks[name][i], scenes[i], walks[name][i]["speed"]
            here = np.array([*places[i], _SPEED * speed])
            apart = [float(np.sum((there - here) ** 2)) for there, _ in known]
            near = [known[k][1] for k in np.argsort(apart)[:_NEAREST]]
            near = near or [min(stored, key=lambda gait, v=speed: abs(gait.froude_speed - v))]
            starts: list[OptimalGait | None] = [*near, None]
            if row["point"]:
                starts.insert(0, begun(near[0], row, scene.tick))
            gait, before = best_of(scene, speed, starts), found.get((name, i, speed))
            if before and (gait is None or gait.charged_cost > before.charged_cost):
                gait = before
            if gait is not None:
                known.append((here, gait))
            line = {"policy": name, "body": i, "speed": speed, "gait": gait and gait.to_json()}
            file.write(json.dumps(line) + "\n")
            file.flush()


def begun(gait: OptimalGait, row: dict[str, Any], tick: float) -> OptimalGait:
    """Return a gait with the initial state and the torques of a policy's stride."""
    held, duration = np.array(row["torques"]), len(row["torques"]) * tick * gait.units.time
    return replace(
        gait,
        state=gait.point.section.states_at(np.array([row["point"]]))[0],
        controller=to_own(gait.units, gpw.Actuation(held, np.zeros(len(held)))),
        mean=gait.mean._replace(duration=duration),
    )


def place(scene: Scene) -> list[float]:
    """Return coordinates of a body and its slope, each from about -1 to 1."""
    nominal = make_scene("anywhere")
    ratios = [
        (getattr(scene.walker, name) / getattr(nominal.walker, name) - 1.0) / share
        for name, share in nominal.domain_randomization.items()
    ]
    return [*ratios, _SLOPE * float(scene.slope)]  # type: ignore[arg-type]


def read(out: Path) -> dict[tuple[str, int, float], OptimalGait | None]:
    """The optima found so far, by policy, body and speed; None where no gait was found."""
    path, found = out / "optima.jsonl", {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else []:
        with suppress(ValueError):  # the last line may have been cut off
            entry = json.loads(line)
            gait = entry["gait"]
            key = entry["policy"], entry["body"], entry["speed"]
            found[key] = OptimalGait.from_json(gait) if gait else None
    return found


def walks_of(out: Path, name: str) -> Path:
    """The file of a policy's walks."""
    return out / f"{name}-walks.json"


def walked(out: Path, name: str) -> list[dict[str, Any]]:
    """A policy's walks with the held-out bodies."""
    return json.loads(walks_of(out, name).read_text(encoding="utf-8"))


def show(out: Path, _: argparse.Namespace) -> None:
    """Print the tables, and draw the curve."""
    found, lines, curve = read(out), [], []
    for name in NAMES:
        if not walks_of(out, name).is_file():
            continue
        rows = walked(out, name)
        lasts = np.array([row["ending"] == TIME_LIMIT for row in rows])
        cost = np.array([row["cost"] for row in rows])
        keys = [(name, i, row["speed"]) for i, row in enumerate(rows)]
        searched = np.array([key in found for key in keys])
        gaits = (found.get(key) for key in keys)
        least = np.array([np.nan if gait is None else optimal.charged(gait) for gait in gaits])
        # A body that walks to the end has a gait; one that falls counts unless a search finds none.
        counted = lasts | ~searched | np.isfinite(least)
        gaps = (cost / least - 1.0)[lasts & np.isfinite(least)]
        middle, most = np.percentile(gaps, [50, 95]) if len(gaps) else (np.nan, np.nan)
        lines.append((
            name, f"{lasts.sum()} of {counted.sum()}", int((~counted).sum()), len(gaps),
            f"{middle:.1%}{interval(gaps, 50)}", f"{most:.1%}{interval(gaps, 95)}",
            int((lasts & searched & ~np.isfinite(least)).sum()),
        ))  # fmt: skip
        print(name, Counter(rows[i]["ending"] for i in np.flatnonzero(counted & ~lasts)))
        if name != SHIPPED:
            curve.append((name, 100.0 * middle, 100.0 * most))
    heads = ["policy", "walk to the end", "dropped: no gait found", "optima found",
             "median gap, 95 % interval", "95th percentile, 95 % interval",
             "optimum not found"]  # fmt: skip
    text = table(heads, lines)
    drew = [
        f"{run.name} {bodies_drawn(run):,}"
        for run in sorted(out.iterdir())
        if (run / "checkpoints").is_dir() and not run.name.startswith("pool-")
    ]
    text += f"\n\nBodies drawn in training: {', '.join(drew)}."
    begins = f"Drawing a body and computing its constants takes {1e6 * drawing():.0f} µs."
    keep("anywhere", f"{text}\n\n{begins} {machine()}.", DOCS / "anywhere.md")
    if curve:
        draw(curve)


def interval(gaps: NDArray, percent: float) -> str:
    """The 95 % bootstrap interval of a percentile over bodies, as text; empty without bodies."""
    if not len(gaps):
        return ""
    again = np.random.default_rng(0).choice(gaps, (_RESAMPLES, len(gaps)))
    low, high = np.percentile(np.percentile(again, percent, axis=1), [2.5, 97.5])
    return f" ({low:.1%} to {high:.1%})"


def bodies_drawn(run: Path) -> int:
    """Return the number of bodies that a training without a pool drew, from its last checkpoint.

    A state of its environments has the number of episodes of each.
    """
    newest = max((run / "checkpoints").iterdir())
    with np.load(newest / "envs.npz") as arrays:
        return int(arrays["draw_episodes"].sum())


def drawing() -> float:
    """Seconds in which a new body is drawn and the constants of its equations are computed."""
    drawing, keys = Starts(make_scene("anywhere")).randomization, itertools.count()
    assert drawing is not None
    return seconds(lambda: bodies(drawing.draw(next(keys)).walker))


def draw(curve: list[tuple[str, float, float]]) -> None:
    """Draw the gap over the number of training bodies."""
    from gym_passive_walker.pictures.axes import legend, panels, save, series

    figure, (axes,) = panels(size=(6.0, 4.2))
    across = range(len(curve))
    for index, label in enumerate(("median", "95th percentile")):
        axes.plot(across, [row[1 + index] for row in curve], label=label, **series(index))
    axes.set_xticks(list(across), [row[0].removeprefix("pool-") for row in curve])
    axes.set(xlabel="bodies in training", ylabel="cost above each body's optimum in %")
    axes.set_ylim(0.0, None)
    legend(axes)
    save(figure, DOCS / "images" / "anywhere.png")


PARTS = {"train": train, "walk": walk, "optima": optima, "show": show}


def main() -> None:
    """Run the parts that are asked for."""
    shape = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=shape)
    add = parser.add_argument
    add("parts", nargs="*", choices=[*PARTS, []], help="parts; all if none is given")
    add("--bodies", type=int, default=BODIES, help="held-out bodies (%(default)s)")
    add("--only", nargs="+", choices=NAMES, default=NAMES, help="policies to find optima for")
    add("--again", action="store_true", help="search again, from gaits found since then")
    add("--minutes", type=float, default=np.inf, help="time for the search of optima")
    add("--out", type=Path, default=Path("runs/anywhere"), help="folder (%(default)s)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.parts or PARTS:
        PARTS[name](args.out, args)


if __name__ == "__main__":
    raise SystemExit(console.run(main))
