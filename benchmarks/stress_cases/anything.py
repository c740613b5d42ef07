"""Random walkers with random initial states, and environments with random actions."""

from __future__ import annotations

import numpy as np

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.extremes import ended, random_throws
from benchmarks.stress_cases.flight import Flock, flock, random_shapes
from gym_passive_walker import WALKERS
from gym_passive_walker.envs.interface import OUTCOMES
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.rules import ENERGIES
from gym_passive_walker.gaits.scenes.scene import CONTROLS
from gym_passive_walker.models.model import bodies

TOPIC = "Anything at all"
_SHAPES, _THROWS = 200, 50  # shapes of a portion; initial states of each shape
_TOLERANCES = (1e-4, 1e-8, 1e-12)


def random_flock(rng: np.random.Generator, kind: int) -> Flock:
    """Walkers of random shapes with knees (0) or straight legs (1), or simplest walkers (2)."""
    if kind == 2:
        return flock(WALKERS["D"])
    walkers = random_shapes(rng, _SHAPES, knees=kind == 0)
    return Flock(walkers[0].equations(), np.repeat(bodies(*walkers), _THROWS, axis=0))


@case(
    TOPIC,
    "Walkers of random shapes, thrown any way, pushed by any torque: each stride has an outcome, "
    "finite numbers, and an energy balance that closes as well as it is integrated",
    quick=60_000, long=10_000_000, bound=1000.0, unit="tolerance × energy of its angles and rates",
)  # fmt: skip
def any_walker(count: int, rng: np.random.Generator) -> Finding:
    """Test walkers with knees, with straight legs and with massless legs, in turn."""
    tried, failed, worst = 0, 0, 0.0
    portion = _SHAPES * _THROWS
    for turn in range(max(3, count // portion)):
        kind = turn % 3
        mine = random_flock(rng, kind)
        states, slope, torque = random_throws(rng, portion, kind != 0)
        tolerance = float(rng.choice(_TOLERANCES))
        walks = mine.follow(
            states, slope=slope, torque=torque, tolerance=tolerance, end_on_toe_stub=bool(turn % 2)
        )
        known = ended(walks)
        tried += portion
        failed += int((~known).sum())
        if mine.works:
            share = mine.error_over_tolerance(states, walks, tolerance)
            worst = max(worst, float(share[known].max()))
    return Finding(tried, failed, worst)


def any_scene(rng: np.random.Generator, kind: int) -> PassiveWalkerEnv:
    """An environment with a random walker and random options."""
    knees = kind == 0
    walker = WALKERS["D"] if kind == 2 else random_shapes(rng, 1, knees=knees)[0]
    drawn = {} if kind == 2 else {"hip_mass": 0.3, "shank_com": 0.1}
    return PassiveWalkerEnv(
        walker=walker,
        slope=float(rng.uniform(-0.2, 0.3)),
        control=str(rng.choice(CONTROLS)),
        tick=float(10.0 ** rng.uniform(-2.0, 0.5)),
        max_hip_torque=float(10.0 ** rng.uniform(-3.0, 1.0)),
        energy=str(rng.choice(ENERGIES)),
        energy_weight=float(10.0 ** rng.uniform(-1.0, 2.0)),
        end_on_toe_stub=knees and bool(rng.random() < 0.5),
        domain_randomization=drawn if rng.random() < 0.3 else {},
        start=(0.3, -0.3, -0.3, *(0.5 * rng.normal(size=3) - [0.8, 0.3, 0.6])),
        tolerance=float(rng.choice([1e-4, 1e-8])),
    )


@case(
    TOPIC,
    "Steps of single environments of random walkers in random scenes, with any actions: "
    "observations in their box, rewards that are distance less energy, sums that add up, endings "
    "with a name",
    quick=3_000, long=1_000_000, bound=1e-9, unit="largest sum of an episode",
)  # fmt: skip
def any_step(count: int, rng: np.random.Generator) -> Finding:
    """Test each environment for some episodes, with actions also far outside the action space."""
    tried, failed, worst = 0, 0, 0.0
    while tried < count:
        env = any_scene(rng, int(rng.integers(3)))
        weight, space = env.scene.energy_weight, env.observation_space
        env.reset(seed=int(rng.integers(2**31)))
        sums, largest = np.zeros(3), 1.0
        for _ in range(min(200, count - tried)):
            action = rng.normal(scale=2.0, size=1).astype(np.float32)
            observation, reward, over, _, info = env.step(action)
            tried += 1
            terms = np.array([info["distance"], info["energy"], reward])
            sums += terms
            largest = max(largest, float(np.abs(sums).max()))
            total = np.array([info["episode_distance"], info["episode_energy"]])
            off = [reward - (terms[0] - weight * terms[1]), *(sums[:2] - total)]
            worst = max(worst, float(np.abs(off).max()) / largest)
            sound = space.contains(observation) and np.isfinite([*terms, *total]).all()
            failed += not (sound and _named(info, over))
            if over:
                env.reset()
                sums[:] = 0.0
    return Finding(tried, failed, worst)


def _named(info: dict[str, object], over: bool) -> bool:
    """Whether the outcome in `info` is valid: a name at an end, else empty or a heelstrike."""
    outcome = info["outcome"]
    if over:
        return outcome in OUTCOMES[1:] and outcome not in ("heelstrike", "diverged")
    return outcome in ("", "heelstrike")
