"""Integrals over a cell of two angles: a product of two rules, at whose nodes paths are integrated.

Neighbouring cells, and a cell and its halves, share nodes on their boundaries. The result at each node is stored, so
none is computed twice.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.compiled import called, compiled, linked
from solen.trace.kernel.family import FamilyInSpace, at_angles
from solen.trace.kernel.nearest import Walls
from solen.trace.kernel.paths import FIRST_ANGLE_INTERVALS, FIRST_INTERVALS, PathBuffers, integrate_path
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.surface import scrambled

STORED_NODES, SLOTS = 1 << 16, 1 << 17
MIN_FRACTION = 0.05
"""Minimum error estimate, as a fraction of the difference between the two coarser rules: the finer two may agree by
chance.
"""


class Rule(NamedTuple):
    """Nodes (N,) in [−1, 1] and weights (3, N) of three rules on these nodes, from the finest to the coarsest."""

    nodes: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, *halves: Sequence[float]) -> "Rule":
        """Return the rule with an odd number of nodes, from the right halves of its columns, centre first."""
        nodes, *weights = (np.array([*half[:0:-1], *half]) for half in halves)
        nodes[: len(nodes) // 2] *= -1.0
        return cls(nodes, np.array(weights))


class Light(NamedTuple):
    """The integrand over the angles of an emitter at one wavelength."""

    family: FamilyInSpace
    ends: FloatArray
    """(2, E) x and z of the curve ends"""
    cosine: float
    """cosine of half the cone angle"""
    sine: float
    """largest sine of the out-of-plane angle"""
    point: bool
    """whether the path covers the projected angle, for an emitter of zero width"""
    scale: float
    density: float
    """for this field and the next two see `solen.trace.kernel.paths.integrate_path`"""
    narrow: float
    soft: float


class Nodes(NamedTuple):
    """Nodes: their coordinates q, t (N, 2), and the integrated powers followed by their error (N, D + 6)."""

    slots: NDArray[np.int32]
    """index of a node by its hash, −1 for none"""
    at: FloatArray
    value: FloatArray
    used: IntArray
    """(1,) number of nodes used"""
    sums: FloatArray
    """(2, N, D + 5) integrals over q and over t"""


def new_nodes(columns: int, max_nodes: int) -> Nodes:
    """Allocate nodes for rules with ``max_nodes`` nodes; unused pages do not occupy physical memory."""
    return Nodes(
        np.full(SLOTS, -1, np.int32),
        np.empty((STORED_NODES, 2)),
        np.empty((STORED_NODES, columns + 1)),
        np.zeros(1, np.int64),
        np.empty((2, max_nodes, columns)),
    )


@compiled
def node_between(rule: Rule, low: float, high: float, n: int) -> float:
    """Return a node of an interval; the first and last nodes are exactly its ends."""
    inner: float = 0.5 * (low + high) + 0.5 * (high - low) * rule.nodes[n]
    return low if n == 0 else high if n == len(rule.nodes) - 1 else inner


@linked
def node_index(k: Precision, walls: Walls, light: Light, buffers: PathBuffers, nodes: Nodes, q: float, t: float) -> int:
    """Return the index of the node (q, t); if it is new, evaluate the path integral there and store it.

    The out-of-plane angle is asin(s sin t), where s is ``light.sine``. The projected angle is q times the largest
    projected angle within the cone at that out-of-plane angle; q is ignored for a point emitter.
    """
    key = scrambled(np.uint64(np.int64(1e15 * q)) ^ scrambled(np.uint64(np.int64(1e15 * t))))
    slot = np.int64(key & np.uint64(SLOTS - 1))
    while nodes.slots[slot] >= 0:
        row = int(nodes.slots[slot])
        if nodes.at[row, 0] == q and nodes.at[row, 1] == t:
            return row
        slot = (slot + 1) & (SLOTS - 1)
    if nodes.used[0] == STORED_NODES:  # forget all nodes
        nodes.used[0] = 0
        for other in range(SLOTS):
            nodes.slots[other] = -1
    row = int(nodes.used[0])
    nodes.used[0] += 1
    nodes.slots[slot], nodes.at[row, 0], nodes.at[row, 1] = row, q, t
    family, value = light.family, nodes.value[row]
    rise = light.sine * math.sin(t)
    max_angle = math.acos(min(max(light.cosine / math.sqrt(1.0 - rise * rise), -1.0), 1.0))
    weight = (1.0 if light.point else max_angle) * light.sine * math.cos(t)
    if light.point:
        path_family, first = at_angles(family, 0.0, 1.0, rise, -max_angle, max_angle), FIRST_ANGLE_INTERVALS
    else:
        path_family, first = at_angles(family, max_angle * q, 0.0, rise, family.low, family.high), FIRST_INTERVALS
    last = len(value) - 1
    value[last] = integrate_path(
        k, walls, path_family, buffers, light.ends, first, light.density, light.narrow, light.soft, value[:last]
    )
    for d in range(len(value)):
        value[d] *= weight
    return row


@compiled
def rule_difference(rule: Rule, grid: FloatArray, scale: float, value: FloatArray, difference: FloatArray) -> float:
    """Compute the integrals (D,) of values (N, D) and the differences of the two finest rules; return the largest."""
    largest = largest_rough = 0.0
    for d in range(len(value)):
        fine, coarse, coarsest = 0.0, 0.0, 0.0
        for n in range(len(rule.nodes)):
            fine += rule.weights[0, n] * grid[n, d]
            coarse += rule.weights[1, n] * grid[n, d]
            coarsest += rule.weights[2, n] * grid[n, d]
        value[d], difference[d] = scale * fine, scale * (fine - coarse)
        largest, largest_rough = max(largest, abs(difference[d])), max(largest_rough, abs(scale * (coarse - coarsest)))
    return max(largest, MIN_FRACTION * largest_rough)


@called
def integrate_cells(
    k: Precision,
    walls: Walls,
    light: Light,
    buffers: PathBuffers,
    nodes: Nodes,
    across: Rule,
    along: Rule,
    bounds: FloatArray,
    sums: FloatArray,
    errors: FloatArray,
) -> None:
    """Integrate over cells ``bounds`` (N, 4), the ends of q and t, with rule ``across`` in q and ``along`` in t.

    ``sums`` (N, 3, D + 5) receives the powers and the differences of two rules in q and in t; ``errors`` (N, 3)
    receives the largest difference in q, the largest difference in t, and the path error.
    """
    nq, nt, columns = len(across.nodes), len(along.nodes), sums.shape[2]
    over_t, over_q = nodes.sums[0, :nq], nodes.sums[1, :nt]
    for c in range(len(bounds)):
        path_error2 = 0.0
        over_t[:], over_q[:] = 0.0, 0.0
        for i in range(nt):
            t = node_between(along, bounds[c, 2], bounds[c, 3], i)
            for j in range(nq):
                row = node_index(
                    k, walls, light, buffers, nodes, node_between(across, bounds[c, 0], bounds[c, 1], j), t
                )
                value = nodes.value[row]
                for d in range(columns):
                    over_t[j, d] += along.weights[0, i] * value[d]
                    over_q[i, d] += across.weights[0, j] * value[d]
                path_error2 += value[columns] * value[columns]
        scale = 0.25 * (bounds[c, 1] - bounds[c, 0]) * (bounds[c, 3] - bounds[c, 2]) * light.scale
        errors[c, 0] = rule_difference(across, over_t, scale, sums[c, 0], sums[c, 1])
        errors[c, 1] = rule_difference(along, over_q, scale, sums[c, 0], sums[c, 2])
        errors[c, 2] = scale * 4.0 / (nq * nt) * math.sqrt(path_error2)
