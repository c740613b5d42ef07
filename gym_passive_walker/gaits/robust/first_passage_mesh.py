"""Mean first-passage time on random ground, too long to be sampled: a mesh and weighted ensembles.

Falls are absorbing states of the Markov chain of strides (see `foothold_chain`). Once the chain has
forgotten its start, it survives a stride with the probability lambda, its leading eigenvalue. The
mean first-passage time is 1 / (1 - lambda) (Byl and Tedrake 2009).

A mesh of states estimates how near each state is to a fall. Its states are reached from the gait
by series of heights, found breadth-first. Coordinates are balanced coordinates of the linearized
chain: distances count by how strongly heights excite a direction and by how strongly it acts on
the strides that follow. On the mesh, the probability u of a fall within some strides is found by
iteration. It varies by many powers of ten, but sqrt(-2 ln u) is almost linear in the state: it is
the distance to a fall in standard deviations.

The eigenvalue of the mesh's transition matrix errs where the mesh is coarse. So the mesh only
guides a simulation: weighted ensembles of walkers (Huber and Kim 1996). After each stride, walkers
are binned by their distance to a fall. Each bin is resampled to as many walkers as any other, with
its weight conserved. Heights are drawn from a wider distribution, and weights corrected. So falls
are frequent in the simulation, however rare they are. The mean share of weight that falls in a
stride is 1 - lambda, whatever the mesh: a worse one only takes more strides.

References:
    K. Byl, R. Tedrake, Metastable walking machines, Int. J. Robotics Research 28 (2009).
    C. O. Saglam, K. Byl, Robust policies via meshing for metastable rough terrain walking,
    Robotics: Science and Systems (2014).
    G. A. Huber, S. Kim, Weighted-ensemble Brownian dynamics simulations for protein association
    reactions, Biophysical Journal 70 (1996).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from scipy.special import ndtri

from gym_passive_walker._tools.arguments import number, seed_number
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.robust.first_passage import confidence_interval
from gym_passive_walker.gaits.robust.foothold_chain import Chain
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import Terrain

MOST_AHEAD = 2
"""Largest `terrain_lookahead` of a controller: each foothold ahead is one more coordinate."""

_STATES = 1000  # of a mesh, at least
_HEIGHTS = 0.5 * np.arange(-16, 17)  # over which it grows; 1e-15 of heights lie beyond
_RARE = 7.0  # how much rarer than a fall, as a natural logarithm, the rarest states of the mesh are
_EASIER = 0.5  # by how much likelier a way to a known state must be, as a logarithm
_REACHES = 18.0, 25.0, 32.0  # how rare states of the first mesh are: 6 to 8 standard deviations
_NEIGHBOURS = 8  # states of the mesh between which a distance is interpolated
_LEAST = 1e-40  # probability of a fall; no distance is larger

_ENSEMBLES, _WALKERS = 16, 16  # independent ensembles, and walkers in each bin
_BIN = 0.15  # standard deviations of distance
_WIDER = 2.5  # standard deviation of the heights that are drawn
_BLOCK = 30  # strides of all walkers between two looks at the error; two must be small enough
_MOST = 2_000_000  # strides after which no block begins
_CONFIDENT = 2.131449545559323  # standard errors on both sides of 95 of 100, by 16 ensembles


class MeshPassage(NamedTuple):
    """Strides to a fall, computed by weighted ensembles over a mesh of states.

    Attributes:
        mean: Strides to a fall on average; infinite if no state of the mesh is near a fall.
        error: Standard error of the mean.
        states: States of the mesh.
        strides: Strides that were computed.
    """

    mean: float
    error: float
    states: int
    strides: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the mean."""
        if math.isinf(self.mean):
            return self.mean, self.mean
        low, high = confidence_interval(self.mean, self.error, _CONFIDENT)
        return max(low, 1.0), high

    def survivors(self, strides: int) -> NDArray[np.float64]:
        """Share of walkers that are left after each stride, (strides,): it decays exponentially."""
        return np.power(1.0 - 1.0 / self.mean, np.arange(1, strides + 1), dtype=float)

    def __str__(self) -> str:
        if math.isinf(self.mean):
            return f"none of {self.states} states of the mesh is near a fall"
        low, high = self.interval
        return f"{self.mean:.4g} strides ({low:.4g} to {high:.4g})"


def mesh_passage(
    strides: StrideMap,
    state: ArrayLike,
    terrain: Terrain,
    *,
    error: float = 0.02,
    seed: int = 0,
) -> MeshPassage:
    """Compute the mean first-passage time on footholds of random heights.

    Args:
        strides: The stride map on smooth ground, of one slope.
        state: State of a stable gait just after heelstrike, (6,), in the walker's own units.
        terrain: Footholds with normally distributed heights, from `rough(height_std)`.
        error: Standard error of the mean, as a share of it, at which the computation ends, once it
            has been so twice. It also ends after two million strides.
        seed: Seed of the heights.

    Raises:
        ValueError: if the ground has other than random heights, the controller observes too many
            footholds, the gait is not stable, or all walkers fall in one stride.
    """
    if strides.terrain is not None:
        raise ValueError("a mesh has ground of its own: give a map of smooth ground")
    if terrain.height_std == 0.0 or terrain.slope_std or any(terrain.rises) or any(terrain.slopes):
        raise ValueError(
            "a mesh of states needs random heights alone, rough(height_std): slopes and rises of "
            "footholds are for the sampled first passage"
        )
    if strides.terrain_lookahead > MOST_AHEAD:
        raise ValueError(
            f"a mesh of states is for controllers that observe at most {MOST_AHEAD} footholds "
            f"ahead, not {strides.terrain_lookahead}: sample the first passage"
        )
    if not 0.0 < number(error, "error") < 1.0:
        raise ValueError(f"error must be a share between 0 and 1, not {error!r}")
    seed = seed_number(seed)
    chain = Chain(strides, np.asarray(state, float), terrain.height_std, strides.chosen(None))
    return _passage(chain, error, seed)


def _passage(chain: Chain, error: float, seed: int) -> MeshPassage:
    """The mean first-passage time of a chain."""
    with progress("meshes of states", 2) as done:
        spacing, guess = 2.0, math.inf
        for reach in _REACHES:  # until falls are among the states of the mesh
            mesh, spacing = _mesh(chain, _STATES // 4, reach, spacing)
            guess = mesh.guess
            if guess < math.exp(reach):
                break
        done()
        if math.isinf(guess):
            return MeshPassage(guess, guess, mesh.size, chain.strides)
        reach = min(math.log(guess), _REACHES[-1]) + _RARE
        mesh, _ = _mesh(chain, _STATES, reach, spacing)
        done()
    rate, rate_error = _rate_of_falls(chain, mesh, error, seed)
    if rate == 0.0:
        return MeshPassage(math.inf, math.inf, mesh.size, chain.strides)
    return MeshPassage(1.0 / rate, rate_error / rate**2, mesh.size, chain.strides)


def _mesh(chain: Chain, count: int, reach: float, spacing: float) -> tuple[_Mesh, float]:
    """A mesh of at least `count` states, if the chain reaches so many, and its spacing."""
    while True:
        grown = _grown(chain, spacing, reach, 4 * count)
        if len(grown[0]) >= count or spacing < 1e-3:
            return _Mesh(chain, *grown), spacing
        spacing *= 0.85


def _grown(
    chain: Chain, spacing: float, reach: float, most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """States that are reached from the gait, no two nearer than `spacing`, and their strides.

    Args:
        chain: The chain.
        spacing: Least distance of states, in balanced coordinates.
        reach: Largest rarity of the heights on the way to a state, as a logarithm of density.
        most: Growth ends once there are so many.

    Returns:
        States (n, k), the next ones over all `_HEIGHTS` (n, heights, k), and which walk on there.
    """
    count = len(_HEIGHTS)
    nodes, rare, front = chain.gait[None], np.zeros(1), np.zeros(1, np.intp)
    ends, walks = np.empty((0, count, len(chain.gait))), np.empty((0, count), bool)
    while True:
        added = nodes[len(ends) :]
        tried = np.repeat(added, count, axis=0), np.tile(_HEIGHTS, len(added))
        reached, struck = chain.step(*tried)
        ends = np.concatenate([ends, reached.reshape(len(added), *ends.shape[1:])])
        walks = np.concatenate([walks, struck.reshape(len(added), count)])
        if not len(front) or len(nodes) >= most:
            return nodes, ends, walks
        cost = rare[front, None] + 0.5 * _HEIGHTS**2
        allowed = (cost < reach) & walks[front]
        found, cost = ends[front][allowed], cost[allowed]
        order = np.argsort(cost, kind="stable")
        found, cost = found[order], cost[order]
        places = chain.place(found)
        nearest: NDArray[np.intp]
        away, nearest = KDTree(chain.place(nodes)).query(places)  # type: ignore[assignment]
        # A longer way with smaller heights may be the likelier one: go on from there once more.
        known = away < 0.5 * spacing
        before = rare.copy()
        np.minimum.at(rare, nearest[known], cost[known])
        likelier, new = np.flatnonzero(rare < before - _EASIER), away > spacing
        found, cost, places = found[new], cost[new], places[new]
        taken, covered = [], np.zeros(len(places), bool)
        tree = KDTree(places) if len(places) else None
        for i in range(len(places)):
            if not covered[i]:
                taken.append(i)
                covered[tree.query_ball_point(places[i], spacing)] = True  # type: ignore[union-attr]
        front = np.concatenate([likelier, np.arange(len(nodes), len(nodes) + len(taken))])
        nodes = np.concatenate([nodes, found[taken]])
        rare = np.concatenate([rare, cost[taken]])


class _Mesh:
    """States that are reached from the gait, and how near each of them is to a fall.

    Args:
        chain: The chain.
        nodes: States, (n, k).
        ends: Next states over all `_HEIGHTS`, (n, heights, k).
        walks: Whether the walker goes on, (n, heights).

    Attributes:
        size: Number of states.
        horizon: Strides after which the chain has forgotten its start, to a few thousandths.
        guess: A guess of the mean first-passage time; infinite if no fall is reached.
    """

    def __init__(self, chain: Chain, nodes: NDArray, ends: NDArray, walks: NDArray) -> None:
        self._chain = chain
        self.size = len(nodes)
        self.horizon = 2 * math.ceil(math.log(0.05) / math.log(max(chain.memory, 0.5)))
        self._tree = KDTree(chain.place(nodes))
        density = np.exp(-0.5 * _HEIGHTS**2)
        density /= density.sum()
        falls = chances = ~walks @ density
        weights, nearest = self._between(ends.reshape(-1, ends.shape[-1]))
        for _ in range(self.horizon):
            self._distances = _distance(chances)
            later = _chance((weights * self._distances[nearest]).sum(axis=1)).reshape(walks.shape)
            chances = np.minimum(falls + (later * walks) @ density, 1.0)
        self.guess = self.horizon / chances[0] if chances[0] > _LEAST else math.inf

    def distance(self, states: NDArray) -> NDArray[np.float64]:
        """Distance (n,) of states (n, k) to a fall, in standard deviations.

        Probabilities are interpolated, not distances: beside a cliff a state counts as near it.
        """
        weights, nearest = self._between(states)
        chances = (weights * _chance(self._distances[nearest])).sum(axis=1)
        return _distance(chances)

    def _between(self, states: NDArray) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Nearest states of the mesh, (n, m): weights by inverse square distance, and indices."""
        ranks = [*range(1, 1 + min(_NEIGHBOURS, self.size))]
        away, nearest = self._tree.query(self._chain.place(states), k=ranks)  # type: ignore[arg-type]
        weights = 1.0 / (away + 1e-9) ** 2
        return weights / weights.sum(axis=1, keepdims=True), nearest  # type: ignore[return-value]


def _distance(chances: NDArray) -> NDArray[np.float64]:
    """The distance to a fall in standard deviations, for a probability of it."""
    return np.sqrt(-2.0 * np.log(np.clip(chances, _LEAST, 1.0)))


def _chance(distances: NDArray) -> NDArray[np.float64]:
    """The inverse of `_distance`."""
    return np.exp(-0.5 * distances**2)


def _rate_of_falls(chain: Chain, mesh: _Mesh, error: float, seed: int) -> tuple[float, float]:
    """Share of walkers that fall in a stride, once the start is forgotten, and its standard error.

    Walkers of one bin and ensemble lie side by side, and draw their heights stratified.
    """
    rng, shape = np.random.default_rng(seed), (_ENSEMBLES, _WALKERS)
    states = np.repeat(chain.gait[None], math.prod(shape), axis=0)
    ensemble, weights = np.repeat(np.arange(_ENSEMBLES), _WALKERS), np.ones(math.prod(shape))
    enough, shares = 0, list[NDArray]()  # of the weight that falls, and of all, by ensemble
    with progress("strides of weighted ensembles", None) as done:
        while True:
            strata = np.tile(np.arange(_WALKERS), (len(states) // _WALKERS, 1))
            strata = rng.permuted(strata, axis=1) + rng.random(strata.shape)
            heights = _WIDER * ndtri(strata.ravel() / _WALKERS)
            weights = weights * np.exp(-0.5 * heights**2 * (1.0 - 1.0 / _WIDER**2))
            weights /= weights.sum()  # of all: scaled one by one, small ensembles would be biased
            ends, walks = chain.step(states, heights)
            falls = np.bincount(ensemble, weights * ~walks, _ENSEMBLES)
            shares.append(np.stack([falls, np.bincount(ensemble, weights, _ENSEMBLES)]))
            done(len(states))
            states, ensemble, weights = ends[walks], ensemble[walks], weights[walks]
            if not len(states):
                raise ValueError("all walkers fall in one stride: sample the first passage")
            # Resample: the same number of walkers in each bin of each ensemble.
            bins = (mesh.distance(states) / _BIN).astype(np.intp)
            bins += ensemble * (bins.max() + 1)
            order = np.argsort(bins, kind="stable")
            states, ensemble, weights = states[order], ensemble[order], weights[order]
            _, bins = np.unique(bins[order], return_inverse=True)
            total = np.bincount(bins, weights)
            wanted = np.arange(len(total) * _WALKERS) + np.repeat(rng.random(len(total)), _WALKERS)
            chosen = np.searchsorted(np.cumsum(weights / total[bins]), wanted / _WALKERS)
            chosen = np.minimum(chosen, len(states) - 1)  # a sum of ones may end below by rounding
            states, ensemble = states[chosen], ensemble[chosen]
            weights = np.repeat(total / _WALKERS, _WALKERS)
            counted = len(shares) - mesh.horizon
            if counted > 0 and counted % _BLOCK == 0:
                falls, of = np.sum(shares[mesh.horizon :], axis=0)
                rate = float(falls.sum() / of.sum())
                others = (falls.sum() - falls) / (of.sum() - of)  # rates without each, a jackknife
                rate_error = math.sqrt((_ENSEMBLES - 1) * others.var())
                enough = enough + 1 if 0.0 < rate_error <= error * rate else 0
                if enough == 2 or chain.strides > _MOST:
                    return rate, rate_error
