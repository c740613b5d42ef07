"""Simulation of a walk over many strides, sampled at many instants."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import (
    KEPT,
    check_state,
    check_tolerance,
    one_slope,
    real_array,
    whole,
)
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.actuation import Actuation, one_actuation, to_dimensionless
from gym_passive_walker.gaits.find.fixed_point import state_on
from gym_passive_walker.gaits.given import GaitLike, walk_of
from gym_passive_walker.gaits.look.series import OverTime, look_at
from gym_passive_walker.gaits.stride import stride, together
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import TerrainLike, contacts, ground_of, terrain_from
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.model import check_heights_only
from gym_passive_walker.models.walkers import name_of

COARSEST_SAMPLES = 1e-4
"""Largest tolerance at which samples just before an impact differ from the impact itself."""


@dataclass(frozen=True, repr=False)
class Trajectory(OverTime, Table):
    """A walk at n instants, in the walker's own units.

    Two samples lie at nearly the time of a heelstrike: the last sample of one stride, just before
    the impact, and the first sample of the next stride, where the legs have changed roles.

    Forces, energies, powers and the centre of mass are attributes and columns too. They are
    computed when they are asked for. `strikes` is a table of the impacts. The sum of kinetic,
    potential and spring energy changes by the powers less the friction power, and by the losses.

    Attributes:
        walker: The walker.
        slope: Slope in rad.
        times: Time since the start, shape (n,).
        states: [stance, thigh, shank] angles in rad, then their angular velocities, shape (n, 6).
        contact_x: Contact point along the slope, positive downhill, shape (n,).
        contact_y: Height of the contact point over the slope, shape (n,).
        tilts: Slope of the foothold beyond `slope`, in rad, shape (n,); angles are from the
            foothold's normal.
        stride_index: Number of the stride that each sample belongs to, from 0, shape (n,).
        phases: `Stage` of the swing leg, shape (n,).
        torques: Hip and ankle torque that act up to each sample, shape (n, 2); of a `System`, its
            controls, shape (n, controls).
        taken: The strides: a `Stride` of arrays, (strides made,), with works, losses and states
            after them.
        terrain: Terrain; None for smooth ground.
        terrain_seed: Seed of the terrain.
    """

    def __len__(self) -> int:
        return len(self.times)

    @property
    def outcomes(self) -> NDArray[np.int64]:
        """`Outcome` of each stride, (strides made,); all but the last are HEELSTRIKE."""
        return self.taken.outcome

    @property
    def struck(self) -> NDArray[np.int64]:
        """Indices of the samples that are the first after a kneestrike or a heelstrike."""
        return np.flatnonzero((np.diff(self.stride_index) != 0) | (np.diff(self.phases) != 0)) + 1

    def facts(self) -> dict[str, str]:
        """Duration and distance of the walk, and how the walk ended."""
        units = self.walker.units
        return {
            "walker": name_of(self.walker),
            "slope": f"{self.slope:.6g} rad",
            "strides": f"{len(self.outcomes)}, the last ends {self.ending}",
            "samples": str(len(self)),
            "time": f"{self.times[-1] / units.time:.6g} √(l/g)",
            "distance": f"{(self.contact_x[-1] - self.contact_x[0]) / units.length:.6g} l",
        }

    @property
    def ending(self) -> str:
        """Outcome of the last stride, in words."""
        return str(Outcome(int(self.outcomes[-1])))

    def columns(self) -> dict[str, NDArray]:
        """One row for each instant, with the quantities over time."""
        names = self.walker.state_names
        return {
            "time": self.times,
            "stride": self.stride_index,
            "phase": self.phases,
            **dict(zip(names, self.states.T, strict=True)),
            "contact_x": self.contact_x,
            "contact_y": self.contact_y,
            "tilt": self.tilts,
            **dict(zip(self.walker.controls, self.torques.T, strict=True)),
            **self.series(),
        }

    def plot(self, what: Any = None, /, ax: Any = None, **options: Any) -> Any:
        """Draw the walk with matplotlib.

        Args:
            what: "angles", "forces", "torques", "path", "hodograph", "energy", "power" or
                "clearance", as the option `of`; or the axes.
            ax: Axes of the plot. None makes a new figure of pyplot.
            **options: `of`, "angles" by default.

        Returns:
            The axes; of angles without `ax`, two, with the phase portrait beside them.

        Example:
            >>> import gym_passive_walker as gpw
            >>> ax = gpw.simulate("C", 0.02, strides=2).plot("forces")

        Raises:
            ImportError: if matplotlib is not installed.
            ValueError: if there is no such plot of this walk.
        """
        if isinstance(what, str):
            options["of"] = what
        elif what is not None:
            ax = what
        return super().plot(ax, **options)


def simulate(
    walker: GaitLike,
    slope: float | None = None,
    state: ArrayLike | None = None,
    strides: int = 1,
    *,
    samples: int = 100,
    hip_torque: ArrayLike | None = None,
    ankle_torque: ArrayLike | None = None,
    push_off: ArrayLike | None = None,
    terrain: TerrainLike | None = None,
    terrain_seed: int = 0,
    tolerance: float = 1e-10,
) -> Trajectory:
    """Simulate one walker for some strides and sample its trajectory.

    Example:
        >>> import gym_passive_walker as gpw
        >>> gait = gpw.find_gait("lab", 0.036)
        >>> walk = gpw.simulate("lab", 0.036, 1.02 * gait.state, 20)  # a little off its gait
        >>> walk.ending, len(walk)
        ('heelstrike', 2000)

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, which
            supplies slope, state and actuation where they are not given.
        slope: Slope in rad, positive downhill.
        state: Initial state, just after heelstrike, shape (6,); that of the gait when None.
        strides: Number of strides; fewer are made if the walker falls.
        samples: Number of samples in each stride, evenly spaced, at least 2. The first is just
            after heelstrike, the last just before the event that ends the stride.
        hip_torque: Torque, as for `stride`: a number, or one for each stride. 0 by default, or the
            gait's own.
        ankle_torque: Torque, as for `stride`: a number, or one for each stride. 0 by default, or
            the gait's own.
        push_off: Impulse at the end of a stride, as for `stride`: a number, or one for each stride.
            0 by default, or the gait's own.
        terrain: Terrain, in a form that `terrain_from` takes; smooth ground when None.
        terrain_seed: Seed of a random terrain: any whole number from 0 to 2^64 - 1.
        tolerance: Error relative to the largest angle or angular velocity, as for `stride`; at
            most 1e-4.

    Returns:
        The `Trajectory`, with `samples` instants for each stride made.

    Raises:
        GaitNotFound: if no state is given, and the walker has no gait.
        ValueError: if a number is not finite or out of its range, or a shape does not fit.
    """
    walker, slope, state, motors, _, controlled = walk_of(
        walker, slope, state, hip_torque, ankle_torque, push_off
    )
    size, slope = walker.size, one_slope(slope)
    if state is None:
        held = one_actuation(walker, motors)
        state = state_on(controlled or StrideMap.of(walker, controller=held), slope, None)
    state = check_state(state, of=walker)
    if state.shape != (size,):
        raise ValueError(f"simulate follows one walker: state must be ({size},), not {state.shape}")
    strides, samples = whole(strides, "strides", 1, KEPT), whole(samples, "samples", 2, KEPT)
    if check_tolerance(tolerance) > COARSEST_SAMPLES:
        raise ValueError(f"tolerance must be at most {COARSEST_SAMPLES}, not {tolerance}")
    allowed = f"a number, or one for each of the {strides} strides"
    parts = []
    for name, part in zip(Actuation._fields, motors, strict=True):
        values = real_array(part, name, allowed)
        if values.shape not in ((), (1,), (strides,)):
            raise ValueError(f"{name} must be {allowed}, not of shape {values.shape}")
        parts.append(np.broadcast_to(values, (strides,)))
    strides_of: StrideMap = (controlled or StrideMap.of(walker)).with_tolerance(tolerance)
    footholds = strides_of.terrain if terrain is None else terrain_from(terrain)
    seen_ahead = strides_of.terrain_lookahead
    ground = ground_of(footholds, terrain_seed, strides + seen_ahead)
    check_heights_only(walker, ground[:, [0, 2]])
    rises = ground[:strides, 1] * walker.leg_length
    starts, walks = [state], []
    for k, held in enumerate(map(Actuation._make, np.stack(parts, axis=1).tolist())):
        here = slope + ground[k, 0], starts[-1]
        foothold = {"height_change": float(rises[k]), "slope_change": float(ground[k, 2])}
        if controlled is None:
            own = walker.in_stride(k)
            walks.append(stride(own, *here, tolerance=tolerance, **foothold, **held._asdict()))
        else:
            now = strides_of.swapped if k % 2 else strides_of
            ahead = ground[k : k + seen_ahead, 1:].ravel()
            walks.append(now.stride(*here[::-1], **foothold, ahead=ahead))
        if walks[-1].outcome != Outcome.HEELSTRIKE:
            break
        starts.append(walks[-1].state)
    made, taken = len(walks), together(walks)
    durations, lengths = taken.duration, taken.step_length
    first, tilts = np.array(starts[:made]), ground[:made, 0]
    # Impact times of the two integrations differ by the tolerance: end earlier by more than that.
    instants = np.linspace(0.0, 1.0 - 10.0 * tolerance - 1e-12, samples) * durations[:, None]
    units = walker.units
    if controlled is None:
        held = to_dimensionless(units, Actuation(*(part[:made] for part in parts)))
        strides_of = replace(strides_of, actuation=held)
    seen = look_at(strides_of, slope, first, ground[: made + seen_ahead], instants)
    states = units.to_own(seen.states)
    began = np.cumsum([0.0, *durations[:-1]])[:, None]
    rolled = walker.foot_radius * (first[:, :1] - states[:, :, 0])
    places = contacts(walker, ground[:made], lengths)[:, None]
    places = places + rolled * np.exp(-1j * tilts)[:, None]
    return Trajectory(
        walker=walker,
        slope=slope,
        times=(began + instants).ravel(),
        states=states.reshape(-1, size),
        contact_x=places.real.ravel(),
        contact_y=places.imag.ravel(),
        tilts=np.repeat(tilts, samples),
        stride_index=np.repeat(np.arange(made), samples),
        phases=seen.stages.ravel(),
        torques=(seen.controls[..., : len(walker.controls)] * walker.control_units).reshape(
            len(first) * samples, -1
        ),
        taken=taken,
        terrain=footholds,
        terrain_seed=terrain_seed,
        _map=strides_of,
    )
