"""Displacements of a body that its holds and clamps leave free.

U = given + T q, with one column of T for every free displacement: both components of a free node, the component along
the wall of a sliding node, and one for all nodes of a part that rotates about a point. The columns of rotating parts
depend on the rotation angle.

Public names: `supports_of` and `Supports`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.geometry.body import place_text
from solen.mechanics.load import Hold, Turn
from solen.mechanics.mesh import BodyMesh
from solen.mechanics.stretches import nodes_on
from solen.plane import Point

CORNERED = (0.0, 0.0)
"""Direction stored for a node that slides along two walls and so cannot move."""
PARALLEL = 1e-6
"""The sliding directions at a corner count as parallel if their vector product is below this value."""
FREE = 1e-6
"""A rigid motion is free if all its constraints are below this fraction of the largest constraint."""


class Group(NamedTuple):
    """Nodes of a hold or clamp, and the reference point of its moment."""

    name: str
    nodes: IndexArray
    pivot: Point


class _Piece(NamedTuple):
    """Nodes that move as one rigid part, and its pivot."""

    nodes: IndexArray
    pivot: FloatArray


@dataclass(frozen=True, eq=False)
class Supports:
    """Constraints on the nodes of a mesh.

    Attributes
    ----------
    points_mm
        Positions (N, 2) of all nodes at rest.
    groups
        Nodes of every hold, then of every clamp.
    fixed
        Nodes with a given position.
    driven
        Nodes and pivot of every clamp.
    sliding, ways
        Nodes that move along a line, and its unit direction (M, 2).
    hinges
        Pieces that turn freely.
    """

    points_mm: FloatArray
    groups: tuple[Group, ...]
    fixed: IndexArray
    driven: tuple[_Piece, ...]
    sliding: IndexArray
    ways: FloatArray
    hinges: tuple[_Piece, ...]

    @cached_property
    def _free(self) -> IndexArray:
        """Nodes without a hold."""
        held = np.zeros(len(self.points_mm), dtype=bool)
        for nodes in (self.fixed, self.sliding, *(hinge.nodes for hinge in self.hinges)):
            held[nodes] = True
        return np.flatnonzero(~held)

    @cached_property
    def _constant(self) -> Any:
        """Columns of T that do not depend on the deformation."""
        from scipy.sparse import csc_array

        free, sliding = self._free, self.sliding
        first = 2 * len(free)
        rows = np.concatenate([2 * free, 2 * free + 1, 2 * sliding, 2 * sliding + 1])
        along = first + np.arange(len(sliding))
        columns = np.concatenate([np.arange(len(free)), len(free) + np.arange(len(free)), along, along])
        data = np.concatenate([np.ones(first), self.ways[:, 0], self.ways[:, 1]])
        return csc_array((data, (rows, columns)), shape=(2 * len(self.points_mm), first + len(sliding)))

    def matrix(self, angles: FloatArray) -> Any:
        """Return the sparse matrix T for angles of the hinges in radians."""
        from scipy.sparse import csc_array, hstack

        if not self.hinges:
            return self._constant
        columns = np.zeros((2 * len(self.points_mm), len(self.hinges)))
        for k, hinge in enumerate(self.hinges):
            arm = _turned(self.points_mm[hinge.nodes] - hinge.pivot, angles[k])
            columns[2 * hinge.nodes, k], columns[2 * hinge.nodes + 1, k] = -arm[:, 1], arm[:, 0]
        return csc_array(hstack([self._constant, csc_array(columns)]))

    def hinge_stiffness(self, angles: FloatArray, forces: FloatArray) -> FloatArray:
        """Return the stiffness that forces (2 N,) at the nodes add to every hinge's angle as its columns turn."""
        pairs = forces.reshape(-1, 2)
        arms = [_turned(self.points_mm[h.nodes] - h.pivot, angle) for h, angle in zip(self.hinges, angles, strict=True)]
        return np.array([-np.sum(pairs[h.nodes] * arm) for h, arm in zip(self.hinges, arms, strict=True)])

    def given(self, angles_deg: Sequence[float]) -> FloatArray:
        """Return the displacements (N, 2) of nodes with prescribed positions, at the clamp angles; 0 elsewhere."""
        found = np.zeros_like(self.points_mm)
        for clamp, angle_deg in zip(self.driven, angles_deg, strict=True):
            found[clamp.nodes] = _turn_less_one(self.points_mm[clamp.nodes] - clamp.pivot, math.radians(angle_deg))
        return found

    def moved(self, displacement: FloatArray, steps: FloatArray, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return displacements (N, 2) and angles of the hinges after steps of the free displacements."""
        count = self._constant.shape[1]
        after = displacement + (self._constant @ steps[:count]).reshape(-1, 2)
        angles = angles + steps[count:]
        for hinge, angle in zip(self.hinges, angles, strict=True):
            after[hinge.nodes] = _turn_less_one(self.points_mm[hinge.nodes] - hinge.pivot, angle)
        return after, angles


def supports_of(body: Body, mesh: BodyMesh, holds: Sequence[Hold], turns: Sequence[Turn]) -> Supports:
    """Return the constraints of holds and clamps.

    Raises
    ------
    DesignError
        If the body is not held sufficiently (the error gives the free motion), or if two supports hold the same place.
    """
    held: dict[int, Hold | Turn] = {}
    lines: dict[int, Point] = {}
    groups: list[Group] = []
    rigid: list[Hold | Turn] = [*turns]
    rigid += [hold for hold in holds if hold.kind != "sliding"]
    sliding = [hold for hold in holds if hold.kind == "sliding"]
    for one in rigid:
        groups.append(_apart(_group(body, mesh, one), held, one, mesh.points_mm))
        held.update(dict.fromkeys(groups[-1].nodes.tolist(), one))
    for one in sliding:
        group = _group(body, mesh, one)
        own = [n for n in group.nodes.tolist() if n not in held and n not in lines]
        groups.append(group._replace(nodes=np.array(own, dtype=np.intp)))
        lines |= {n: way for n, way in _lines(lines, body, mesh, one).items() if n not in held}
    pieces = [_Piece(group.nodes, np.asarray(group.pivot)) for group in groups[: len(rigid)]]
    kinds = ["driven" if isinstance(one, Turn) else one.kind for one in rigid]
    along = np.array([n for n, way in lines.items() if way != CORNERED], dtype=np.intp)
    supports = Supports(
        mesh.points_mm,
        tuple(groups),
        np.array(
            [n for n, one in held.items() if isinstance(one, Turn) or one.kind == "fixed"]
            + [n for n, way in lines.items() if way == CORNERED],
            dtype=np.intp,
        ),
        tuple(piece for piece, kind in zip(pieces, kinds, strict=True) if kind == "driven"),
        along,
        np.array([lines[n] for n in along.tolist()]).reshape(-1, 2),
        tuple(piece for piece, kind in zip(pieces, kinds, strict=True) if kind == "turning"),
    )
    _refuse_unheld(mesh, supports)
    return supports


def _apart(group: Group, held: dict[int, Hold | Turn], one: Hold | Turn, points: FloatArray) -> Group:
    """Return the group without nodes that another group fixes; raise `DesignError` if either group moves."""
    twice = [n for n in group.nodes.tolist() if n in held]
    for n in twice:
        if any(isinstance(other, Turn) or other.kind == "turning" for other in (held[n], one)):
            x, z = points[n]
            limit = f"{held[n].name} holds the same place, {place_text((float(x), float(z)))}, and one of them moves"
            raise DesignError(one.name, limit=limit, remedy="leave a free stretch between the two")
    return group._replace(nodes=np.setdiff1d(group.nodes, np.array(twice, dtype=np.intp)))


def _group(body: Body, mesh: BodyMesh, one: Hold | Turn) -> Group:
    parts = nodes_on(body, mesh, one.stretches, one.name)
    nodes = np.unique(np.concatenate([nodes for _, nodes in parts]))
    if one.solid:
        nodes = _enclosed(mesh, nodes)
    x, z = mesh.points_mm[nodes].mean(axis=0)
    return Group(one.name, nodes, one.pivot_mm if one.pivot_mm is not None else (float(x), float(z)))


def _enclosed(mesh: BodyMesh, nodes: IndexArray) -> IndexArray:
    """Return all nodes in the convex hull of the given nodes."""
    import shapely

    hull = shapely.MultiPoint(mesh.points_mm[nodes]).convex_hull.buffer(1e-9)
    return np.union1d(nodes, np.flatnonzero(shapely.contains_xy(hull, mesh.points_mm)))


def _lines(known: dict[int, Point], body: Body, mesh: BodyMesh, hold: Hold) -> dict[int, Point]:
    """Return the directions in which nodes on a sliding stretch move, by node."""
    lines = dict(known)
    for face, nodes in nodes_on(body, mesh, hold.stretches, hold.name):
        edges = mesh.faces[face.name]
        for index in np.flatnonzero(np.isin(edges.nodes, nodes)).tolist():
            way = _direction(face, float(edges.u[index]))
            other = lines.get(int(edges.nodes[index]), way)
            straight = abs(other[0] * way[1] - other[1] * way[0]) < PARALLEL
            lines[int(edges.nodes[index])] = way if straight and other != CORNERED else CORNERED
    return lines


def _direction(face: Face, u: float) -> Point:
    x, z = face.curve.velocity_at(u)
    length = math.hypot(x, z)
    return (x / length, z / length)


def _refuse_unheld(mesh: BodyMesh, supports: Supports) -> None:
    """Raise `DesignError` if a connected part of the body can still move as a rigid body."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    t = mesh.mesh.t
    n = mesh.corners
    links = coo_array((np.ones(2 * t.shape[1]), (np.r_[t[0], t[1]], np.r_[t[1], t[2]])), shape=(n, n))
    count, label = connected_components(links, directed=False)
    facets = mesh.mesh.facets[0]
    piece = np.concatenate([label, label[facets]])
    for k in range(count):
        _refuse_free(supports, piece == k)


def _refuse_free(supports: Supports, own: Any) -> None:
    points = supports.points_mm
    centre = points[own].mean(axis=0)
    size = float(np.ptp(points[own], axis=0).max())
    rows = []
    for nodes, ways in ((supports.fixed, None), (supports.sliding, supports.ways)):
        chosen = own[nodes]
        rows.append(_rows((points[nodes[chosen]] - centre) / size, None if ways is None else ways[chosen]))
    pivots = [hinge.pivot for hinge in supports.hinges if own[hinge.nodes].any()]
    rows.append(_rows((np.array(pivots).reshape(-1, 2) - centre) / size, None))
    matrix = np.vstack([*rows, np.zeros((3, 3))])
    _, values, ways = np.linalg.svd(matrix, full_matrices=False)
    if values[2] > FREE * values[0] and values[0] > 0.0:
        return
    shift_x, shift_z, turn = ways[2]
    if values[0] == 0.0:
        free = "nothing holds it"
    elif abs(turn) > FREE:
        x, z = centre + size * np.array([-shift_z, shift_x]) / turn
        free = f"it can turn about {place_text((float(x), float(z)))}"
    else:
        free = f"it can shift in the direction ({shift_x:.2g}, {shift_z:.2g})"
    known = ", ".join(group.name for group in supports.groups) or "no holds"
    remedy = 'hold more of it: a hold is "fixed", "sliding" or "turning"'
    place = place_text((float(centre[0]), float(centre[1])))
    raise DesignError("hold", value=known, limit=f"{free} (body at {place})", remedy=remedy)


def _rows(arms: FloatArray, ways: FloatArray | None) -> FloatArray:
    """Return the movement (M, 3) of points in the held directions, per unit translation in x, z and rotation."""
    one, zero = np.ones(len(arms)), np.zeros(len(arms))
    along_x, along_z = np.column_stack([one, zero, -arms[:, 1]]), np.column_stack([zero, one, arms[:, 0]])
    if ways is None:
        return np.vstack([along_x, along_z])
    return np.asarray(-ways[:, 1:] * along_x + ways[:, :1] * along_z)


def _turned(arms: FloatArray, angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(arms @ np.array([[c, s], [-s, c]]))


def _turn_less_one(arms: FloatArray, angle: float) -> FloatArray:
    """Return the displacements (N, 2) of points at arms from a pivot in a rotation, accurate even for tiny angles."""
    s, less = math.sin(angle), -2.0 * math.sin(0.5 * angle) ** 2
    return np.asarray(arms @ np.array([[less, s], [-s, less]]))
