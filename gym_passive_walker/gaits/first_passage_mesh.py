"""Mean first-passage time on random ground, computed by a mesh of states instead of sampled.

Falls are absorbing states of the Markov chain of strides (see `foothold_chain`). Once the chain has
forgotten its start, it survives a stride with the probability lambda, its leading eigenvalue. The
mean first-passage time is 1 / (1 - lambda) (Byl and Tedrake 2009; Saglam and Byl 2014).

States of the mesh are states that are reached from the gait, found breadth-first over a set of
heights. Coordinates are balanced coordinates of the linearized chain: distances count by how
strongly heights excite a direction and by how strongly it acts on the strides that follow. The next
height is integrated by Gauss-Legendre quadrature between the heights at which the walker falls.

Linear interpolation of probabilities needs a fine mesh: the probability u of a fall within some
strides varies by many powers of ten. But sqrt(-2 ln u) is almost linear in the state, the distance
to a fall in standard deviations. It is interpolated by cubic radial functions. The result gives the
shape of the eigenfunction; a factor that varies slowly remains and is found from the eigenproblem.

References:
    K. Byl, R. Tedrake, Metastable walking machines, Int. J. Robotics Research 28 (2009).
    C. O. Saglam, K. Byl, Robust policies via meshing for metastable rough terrain walking,
    Robotics: Science and Systems (2014).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from scipy.special import ndtr

from gym_passive_walker.arguments import number, whole
from gym_passive_walker.gaits.foothold_chain import Chain
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.progress import progress

MOST_AHEAD = 2
"""Largest `terrain_lookahead` of a controller: each foothold ahead is one more coordinate."""

_STEP = 0.5  # standard deviations between the heights over which a mesh grows
_HIGHEST = 8.0  # standard deviations of a height; 1e-15 of heights lie beyond
_CELLS, _POINTS, _HALVINGS = 16, 3, 9  # of the quadrature over the next height
_RARE = 7.0  # how much rarer than a fall, as a natural logarithm, the rarest states of the mesh are
_EASIER = 0.5  # by how much likelier a way to a known state must be, as a logarithm
_REACHES = 18.0, 25.0, 32.0  # how rare states of the first mesh are: 6 to 8 standard deviations
_CHUNK = 8192  # interpolations at once


class MeshPassage(NamedTuple):
    """Strides to a fall, computed by a mesh of states.

    Attributes:
        mean: Strides to a fall on average; infinite if no state of the mesh is near a fall.
        error: Discretization error: the difference from a mesh of half as many states.
        states: States of the mesh.
        strides: Strides that were computed.
    """

    mean: float
    error: float
    states: int
    strides: int

    @property
    def interval(self) -> tuple[float, float]:
        """The mean less and plus its discretization error."""
        if math.isinf(self.mean):
            return self.mean, self.mean
        return max(self.mean - self.error, 1.0), self.mean + self.error

    def survivors(self, strides: int) -> NDArray[np.float64]:
        """Share of walkers that are left after each stride, (strides,): it decays exponentially."""
        return np.power(1.0 - 1.0 / self.mean, np.arange(1, strides + 1), dtype=float)

    def __str__(self) -> str:
        if math.isinf(self.mean):
            return f"none of {self.states} states of the mesh is near a fall"
        return f"{self.mean:.4g} ± {self.error:.2g} strides, by a mesh of {self.states} states"


def mesh_passage(
    strides: StrideMap,
    state: ArrayLike,
    terrain: Terrain,
    *,
    states: int = 1000,
) -> MeshPassage:
    """Compute the mean first-passage time on footholds of random heights.

    Args:
        strides: The stride map on smooth ground, of one slope.
        state: State of a stable gait just after heelstrike, (6,), in the walker's own units.
        terrain: Footholds with normally distributed heights, from `rough(height_std)`.
        states: Least number of states of the mesh, from 100 to 4000.

    Raises:
        ValueError: if the ground has other than random heights, the controller observes too many
            footholds, the gait is not stable, or the mesh finds no eigenvalue.
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
    states = whole(states, "states", 100, 4000)
    height_std, slope = number(terrain.height_std, "height_std"), strides.chosen(None)
    chain = Chain(strides, np.asarray(state, float), height_std, slope)
    with progress("meshes of states", 3) as done:
        for reach in _REACHES:  # until falls are among the states of the mesh
            guess, count = _mean(chain, states // 4, reach)
            if 1.0 <= guess < math.exp(reach):
                break
        done()
        if math.isinf(guess):
            return MeshPassage(guess, guess, count, chain.strides)
        reach = math.log(guess) + _RARE if guess >= 1.0 else _REACHES[-1]
        coarse, _ = _mean(chain, states // 2, reach)
        done()
        fine, count = _mean(chain, states, reach)
        done()
    if not (fine >= 1.0 and coarse >= 1.0):
        raise ValueError(
            f"the mesh of {count} states has no leading eigenvalue between 0 and 1: give more "
            "states, or sample the first passage"
        )
    return MeshPassage(fine, abs(fine - coarse), count, chain.strides)


def _mean(chain: Chain, count: int, reach: float) -> tuple[float, int]:
    """The mean first-passage time by a mesh of at least `count` states, and how many it has.

    The mean is infinite if no state is near a fall, and NaN if no eigenvalue is found.
    """
    while True:
        nodes = _grown(chain, chain.spacing, reach, 4 * count)
        if len(nodes) >= count or chain.spacing < 1e-3:
            break
        chain.spacing *= 0.9
    return _eigenvalue(chain, nodes, chain.spacing), len(nodes)


def _grown(chain: Chain, spacing: float, reach: float, most: int) -> NDArray[np.float64]:
    """States that are reached from the gait, no two nearer than `spacing`, (n, k).

    Args:
        chain: The chain.
        spacing: Least distance of states, in balanced coordinates.
        reach: Largest rarity of the heights on the way to a state, as a logarithm of density.
        most: Growth ends once there are so many.
    """
    count = math.floor(math.sqrt(2.0 * reach) / _STEP)
    heights = _STEP * np.arange(-count, count + 1)
    nodes, rare, front = chain.gait[None], np.zeros(1), np.zeros(1, np.intp)
    while len(front) and len(nodes) < most:
        from_each, drawn = np.repeat(front, len(heights)), np.tile(heights, len(front))
        cost = rare[from_each] + 0.5 * drawn**2
        allowed = cost < reach
        ends, struck = chain.step(nodes[from_each[allowed]], drawn[allowed])
        ends, cost = ends[struck], cost[allowed][struck]
        order = np.argsort(cost, kind="stable")
        ends, cost = ends[order], cost[order]
        places = chain.place(ends)
        nearest: NDArray[np.intp]
        away, nearest = KDTree(chain.place(nodes)).query(places)  # type: ignore[assignment]
        # A longer way with smaller heights may be the likelier one: go on from there once more.
        known = away < 0.5 * spacing
        before = rare.copy()
        np.minimum.at(rare, nearest[known], cost[known])
        nearer, new = np.flatnonzero(rare < before - _EASIER), away > spacing
        ends, cost, places = ends[new], cost[new], places[new]
        taken, covered = [], np.zeros(len(places), bool)
        tree = KDTree(places) if len(places) else None
        for i in range(len(places)):
            if not covered[i]:
                taken.append(i)
                covered[tree.query_ball_point(places[i], spacing)] = True  # type: ignore[union-attr]
        front = np.concatenate([nearer, np.arange(len(nodes), len(nodes) + len(taken))])
        nodes, rare = np.concatenate([nodes, ends[taken]]), np.concatenate([rare, cost[taken]])
    return nodes


def _mass(low: NDArray, high: NDArray) -> NDArray[np.float64]:
    """Probability that a standard normal number lies between two, exact in both tails."""
    return np.where(low > 0.0, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))


def _strides(chain: Chain, nodes: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Integrate over the next height, cell by cell, between the heights at which walkers fall.

    Returns:
        Of q strides from n states of a mesh to Gauss points of the height: index of the initial
        state (q,), final state (q, k), and probability (q,). Then the probability of a fall in the
        stride from each state, (n,).
    """
    edges, count = np.linspace(-_HIGHEST, _HIGHEST, _CELLS + 1), len(nodes)
    _, struck = chain.step(np.repeat(nodes, len(edges), axis=0), np.tile(edges, count))
    walks = struck.reshape(count, -1)
    row, cell = np.nonzero(walks[:, 1:] != walks[:, :-1])
    low, high, below = edges[cell], edges[cell + 1], walks[row, cell]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = chain.step(nodes[row], middle)[1] == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    limit = 0.5 * (low + high)
    low, high = (np.repeat(side[None], count, axis=0) for side in (edges[:-1], edges[1:]))
    fallen = np.where(walks[:, 1:] | walks[:, :-1], 0.0, _mass(low, high))
    fallen[row, cell] = np.where(below, _mass(limit, edges[cell + 1]), _mass(edges[cell], limit))
    high[row[below], cell[below]] = limit[below]
    low[row[~below], cell[~below]] = limit[~below]
    falls = fallen.sum(axis=1) + ndtr(-_HIGHEST) * (2.0 - walks[:, 0] - walks[:, -1])
    rows, cells = np.nonzero(walks[:, 1:] | walks[:, :-1])
    low, high = low[rows, cells, None], high[rows, cells, None]
    points, parts = np.polynomial.legendre.leggauss(_POINTS)
    heights = low + 0.5 * (high - low) * (points + 1.0)
    weights = parts * np.exp(-0.5 * heights**2)
    weights *= _mass(low, high) / weights.sum(axis=1, keepdims=True)
    rows, heights, weights = np.repeat(rows, _POINTS), heights.ravel(), weights.ravel()
    ends, struck = chain.step(nodes[rows], heights)
    np.add.at(falls, rows[~struck], weights[~struck])
    return rows[struck], ends[struck], weights[struck], falls


class _Interpolation:
    """Cubic radial interpolation with a linear part, from n to q places.

    Args:
        nodes: Places of the mesh, (n, d).
        places: Places at which functions are wanted, (q, d).
        spacing: Functions further than this from the mesh are those at this distance.
    """

    def __init__(self, nodes: NDArray, places: NDArray, spacing: float) -> None:
        away, nearest = KDTree(nodes).query(places)
        share = np.minimum(1.0, spacing / np.maximum(away, spacing))[:, None]
        places = nodes[nearest] + share * (places - nodes[nearest])
        self._count, linear = len(nodes), self._linear(nodes)
        size = self._count + linear.shape[1]
        system = np.zeros((size, size))
        system[: self._count, : self._count] = cdist(nodes, nodes) ** 3
        system[: self._count, self._count :] = linear
        system[self._count :, : self._count] = linear.T
        self._system = lu_factor(system)
        self._basis = np.empty((len(places), size), np.float32)
        for first in range(0, len(places), _CHUNK):
            some = slice(first, first + _CHUNK)
            self._basis[some, : self._count] = cdist(places[some], nodes) ** 3
            self._basis[some, self._count :] = self._linear(places[some])

    @staticmethod
    def _linear(places: NDArray) -> NDArray[np.float64]:
        return np.column_stack([np.ones(len(places)), places])

    def __call__(self, values: NDArray) -> NDArray[np.float64]:
        """The interpolated function, (q,), from its values at the mesh, (n,)."""
        right = np.zeros(self._system[0].shape[0])
        right[: self._count] = values
        found = self._basis @ lu_solve(self._system, right).astype(np.float32)
        return found.astype(float)

    def weighted(self, rows: NDArray, weights: NDArray) -> NDArray[np.float64]:
        """The matrix (n, n) that sums the function over places, with weights, row by row."""
        sums = csr_array((weights, (rows, np.arange(len(rows)))), shape=(self._count, len(rows)))
        return lu_solve(self._system, (sums @ self._basis).T, trans=1).T[:, : self._count]


def _distance(chances: NDArray) -> NDArray[np.float64]:
    """The distance to a fall in standard deviations, for a probability of it."""
    return np.sqrt(-2.0 * np.log(np.clip(chances, 1e-40, 1.0)))


def _chance(distances: NDArray) -> NDArray[np.float64]:
    """The inverse of `_distance`."""
    return np.exp(-0.5 * np.maximum(distances, 0.0) ** 2)


def _eigenvalue(chain: Chain, nodes: NDArray, spacing: float) -> float:
    """The mean first-passage time by a mesh.

    The eigenfunction is 1 - u f. Here u is the probability of a fall within some strides and f is
    interpolated; f is 0 on the gait, which is the first state of the mesh. With the matrix K of
    strides, (1 - K)(a - u f) = (1 - lambda)(a - u f).
    """
    rows, ends, weights, falls = _strides(chain, nodes)
    if not falls.any():
        return math.inf
    between = _Interpolation(chain.place(nodes), chain.place(ends), spacing)
    forgotten = math.ceil(math.log(0.05) / math.log(max(chain.memory, 0.5)))
    chances = falls
    for _ in range(min(2 * forgotten, 60)):
        later = weights * _chance(between(_distance(chances)))
        chances = falls + np.bincount(rows, later, len(nodes))
    shape = _chance(_distance(chances))
    ahead = weights * _chance(between(_distance(shape)))
    passing = between.weighted(rows, ahead) - np.diag(shape)
    states = -np.diag(shape)
    passing[:, 0], states[:, 0] = falls, 1.0
    factors, size = lu_factor(passing), len(nodes)
    inverse = LinearOperator((size, size), matvec=lambda x: lu_solve(factors, states @ x))  # type: ignore[call-arg]
    start = np.zeros(size)
    start[0] = 1.0
    try:
        means: NDArray[np.complex128] = eigs(inverse, k=1, v0=start, return_eigenvectors=False)  # type: ignore[assignment]
        return float(means.real[0])
    except ArpackNoConvergence:
        return math.nan
