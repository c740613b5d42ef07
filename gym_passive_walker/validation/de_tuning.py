"""Fig. 4.8: the tuned kneed walker's gaits as it is changed into the laboratory's walker."""

from __future__ import annotations

import numpy as np

from gym_passive_walker.gaits.ends import BOUND, KNEE_MEETS_HEEL
from gym_passive_walker.gaits.gait import GaitKind
from gym_passive_walker.validation.rows import Row, claim, family, tuned
from gym_passive_walker.walkers import WALKERS, Walker, blend

_KINDS: tuple[GaitKind, GaitKind] = ("long", "short")


def de_tuned(fraction: float) -> Walker:
    """The tuned kneed walker, a fraction of the way to the laboratory's."""
    return blend(tuned("C"), WALKERS["lab"], fraction)


def de_tuning() -> list[Row]:
    """Fig. 4.8."""
    few = (0.05, 0.2, 0.4)
    long = [family(de_tuned(fraction), 1e-4, 0.12) for fraction in few]
    short = [family(de_tuned(fraction), 1e-4, 0.12, "short") for fraction in few]
    apart, together = 0.70, 0.75
    while together - apart > 5e-4:
        middle = 0.5 * (apart + together)
        merged = family(de_tuned(middle), 0.05, 0.16, "long", 0.1).slope.max() < 0.15
        apart, together = (apart, middle) if merged else (middle, together)
    lower = family(de_tuned(together), 0.05, 0.16, "long", 0.1)
    above = family("lab", 0.1, 0.3)
    separate = all(
        family(
            blend(tuned("A"), WALKERS["lab-straight"], fraction), 0.07, 0.3, kind, 0.1
        ).ends[1].reason == BOUND
        for fraction in (0.0, 0.25, 0.5, 0.75, 1.0)
        for kind in _KINDS
    )  # fmt: skip
    slopes = {
        "folds": [found.folds[0] for found in long],
        "ends": [found.ends[0].value for found in short],
    }
    # Families run from their slow end on, which is unstable up to the fold.
    unstable = [float(found.froude_speed[np.argmax(found.stable)]) for found in long]
    return [
        claim(
            "Fig. 4.8 (1)",
            "slope below which there is no long step, at 5, 20, 40 % de-tuned",
            "moves right",
            ", ".join(f"{slope:.6f}" for slope in slopes["folds"]),
            bool(np.all(np.diff([0.0, *slopes["folds"]]) > 0.0)),
        ),
        claim(
            "Fig. 4.8 (1)",
            "an unstable region at very low speeds: v/√(g l) up to which it goes",
            "appears",
            ", ".join(f"{speed:.4f}" for speed in unstable),
            bool(np.all(np.diff([0.0, *unstable]) > 0.0)),
        ),
        claim(
            "Fig. 4.8 (2)",
            "slope where the short step's curve ends, at 5, 20, 40 %",
            "moves right and up",
            ", ".join(f"{slope:.6f}" for slope in slopes["ends"]),
            bool(np.all(np.diff([0.0, *slopes["ends"]]) > 0.0)),
        ),
        claim(
            "Fig. 4.8 (2)",
            "how it ends there",
            KNEE_MEETS_HEEL,
            "; ".join(found.ends[0].reason for found in short),
            all(found.ends[0].reason == KNEE_MEETS_HEEL for found in short),
            expected=False,
            remark="Hardly de-tuned, the curve ends sooner: its heelstrike becomes tangential.",
        ),
        claim(
            "Fig. 4.8 (3)",
            "long and short step meet and part anew",
            "between (d) and (f)",
            f"at {100.0 * apart:.1f} % and slope {max(lower.folds):.4f}",
            0.722 < apart < 0.726 and abs(max(lower.folds) - 0.099) < 3e-3,
        ),
        claim(
            "Fig. 4.8 (3)",
            "gaits of the lab walker at higher slopes, not visible in (f)",
            "presumably",
            f"from {above.folds[0]:.8f} on",
            abs(above.folds[0] - 0.16372248) < 1e-7,
        ),
        claim(
            "Fig. 4.8 (3)",
            "straight legs do not do this: both steps of A reach slope 0.3 at 0, 25, 50, 75, 100 %",
            "does not occur",
            "does not" if separate else "does",
            separate,
        ),
    ]
