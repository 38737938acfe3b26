"""Constraints of holds and clamps on the displacements of a body.

The displacements are u = g + T q, with g prescribed and one column of T for every free displacement in q: both
components of a free node, the component along the wall of a sliding node, and one for all nodes of a part that rotates
about a point. The columns of rotating parts depend on the rotation angle.

Public names: `supports_of`, `Supports` and `Group`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.geometry.body import point_text
from solen.mechanics.load import Hold, Turn
from solen.mechanics.mesh import BodyMesh
from solen.mechanics.stretches import nodes_on
from solen.plane import Point

IMMOBILE = (0.0, 0.0)
"""Direction stored for a node that cannot move because it would have to slide along two walls at once."""
PARALLEL = 1e-6
"""Sliding directions at a corner are treated as parallel if their cross product is below this value."""
MIN_CONSTRAINT = 1e-6
"""A rigid motion is free if its singular value is below this fraction of the largest."""


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
        Nodes of every clamp and rigid hold, then of every sliding hold.
    fixed
        Nodes with prescribed displacements.
    driven
        Nodes and pivot of every clamp.
    sliding, directions
        Nodes that move along a line, and its unit direction (M, 2).
    hinges
        Parts that rotate freely about a pivot.
    """

    points_mm: FloatArray
    groups: tuple[Group, ...]
    fixed: IndexArray
    driven: tuple[_Piece, ...]
    sliding: IndexArray
    directions: FloatArray
    hinges: tuple[_Piece, ...]

    @cached_property
    def _free(self) -> IndexArray:
        """Unconstrained nodes."""
        constrained = np.zeros(len(self.points_mm), dtype=bool)
        for nodes in (self.fixed, self.sliding, *(hinge.nodes for hinge in self.hinges)):
            constrained[nodes] = True
        return np.flatnonzero(~constrained)

    @cached_property
    def _constant(self) -> Any:
        """Columns of T that do not depend on hinge angles."""
        from scipy.sparse import csc_array

        free, sliding = self._free, self.sliding
        first = 2 * len(free)
        rows = np.concatenate([2 * free, 2 * free + 1, 2 * sliding, 2 * sliding + 1])
        along = first + np.arange(len(sliding))
        columns = np.concatenate([np.arange(len(free)), len(free) + np.arange(len(free)), along, along])
        data = np.concatenate([np.ones(first), self.directions[:, 0], self.directions[:, 1]])
        return csc_array((data, (rows, columns)), shape=(2 * len(self.points_mm), first + len(sliding)))

    def matrix(self, angles: FloatArray) -> Any:
        """Return the sparse matrix T for angles of the hinges in radians."""
        from scipy.sparse import csc_array, hstack

        if not self.hinges:
            return self._constant
        columns = np.zeros((2 * len(self.points_mm), len(self.hinges)))
        for k, hinge in enumerate(self.hinges):
            arm = _rotated(self.points_mm[hinge.nodes] - hinge.pivot, angles[k])
            columns[2 * hinge.nodes, k], columns[2 * hinge.nodes + 1, k] = -arm[:, 1], arm[:, 0]
        return csc_array(hstack([self._constant, csc_array(columns)]))

    def hinge_stiffness(self, angles: FloatArray, forces: FloatArray) -> FloatArray:
        """Return the stiffness (hinges,) that nodal forces (2 N,) add to the angles of the hinges."""
        pairs = forces.reshape(-1, 2)
        arms = [
            _rotated(self.points_mm[h.nodes] - h.pivot, angle) for h, angle in zip(self.hinges, angles, strict=True)
        ]
        return np.array([-np.sum(pairs[h.nodes] * arm) for h, arm in zip(self.hinges, arms, strict=True)])

    def prescribed(self, angles_deg: Sequence[float]) -> FloatArray:
        """Return the displacements (N, 2) that clamps at these angles prescribe; 0 for all other nodes."""
        displacements = np.zeros_like(self.points_mm)
        for clamp, angle_deg in zip(self.driven, angles_deg, strict=True):
            arms = self.points_mm[clamp.nodes] - clamp.pivot
            displacements[clamp.nodes] = _rotation_displacements(arms, math.radians(angle_deg))
        return displacements

    def moved(self, displacement: FloatArray, steps: FloatArray, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the displacements (N, 2) and hinge angles after a step of the free displacements and hinge angles."""
        count = self._constant.shape[1]
        after = displacement + (self._constant @ steps[:count]).reshape(-1, 2)
        angles = angles + steps[count:]
        for hinge, angle in zip(self.hinges, angles, strict=True):
            after[hinge.nodes] = _rotation_displacements(self.points_mm[hinge.nodes] - hinge.pivot, angle)
        return after, angles


def supports_of(body: Body, mesh: BodyMesh, holds: Sequence[Hold], turns: Sequence[Turn]) -> Supports:
    """Return the constraints of holds and clamps.

    Raises
    ------
    DesignError
        If the body is not sufficiently supported (the error gives the free motion), or if two supports, one of which
        moves, share a point.
    """
    owners: dict[int, Hold | Turn] = {}
    lines: dict[int, Point] = {}
    groups: list[Group] = []
    rigid: list[Hold | Turn] = [*turns]
    rigid += [hold for hold in holds if hold.kind != "sliding"]
    for support in rigid:
        groups.append(_without_shared(_group(body, mesh, support), owners, support, mesh.points_mm))
        owners.update(dict.fromkeys(groups[-1].nodes.tolist(), support))
    for hold in holds:
        if hold.kind == "sliding":
            group = _group(body, mesh, hold)
            nodes = [n for n in group.nodes.tolist() if n not in owners and n not in lines]
            groups.append(group._replace(nodes=np.array(nodes, dtype=np.intp)))
            lines |= {n: line for n, line in _lines(lines, body, mesh, hold).items() if n not in owners}
    pieces = [_Piece(group.nodes, np.asarray(group.pivot)) for group in groups[: len(rigid)]]
    kinds = ["driven" if isinstance(support, Turn) else support.kind for support in rigid]
    fixed = [n for n, owner in owners.items() if isinstance(owner, Turn) or owner.kind == "fixed"]
    fixed += [n for n, line in lines.items() if line == IMMOBILE]
    sliding = [n for n, line in lines.items() if line != IMMOBILE]
    supports = Supports(
        mesh.points_mm,
        tuple(groups),
        np.array(fixed, dtype=np.intp),
        tuple(piece for piece, kind in zip(pieces, kinds, strict=True) if kind == "driven"),
        np.array(sliding, dtype=np.intp),
        np.array([lines[n] for n in sliding]).reshape(-1, 2),
        tuple(piece for piece, kind in zip(pieces, kinds, strict=True) if kind == "turning"),
    )
    _check_supported(mesh, supports)
    return supports


def _without_shared(group: Group, owners: dict[int, Hold | Turn], support: Hold | Turn, points: FloatArray) -> Group:
    """Return the group without nodes that another support constrains; raise `DesignError` if one of the two moves."""
    shared = [n for n in group.nodes.tolist() if n in owners]
    for n in shared:
        if any(isinstance(owner, Turn) or owner.kind == "turning" for owner in (owners[n], support)):
            x, z = points[n]
            limit = f"shares a point, {point_text((float(x), float(z)))}, with {owners[n].name}, and one of them moves"
            raise DesignError(support.name, limit=limit, remedy="leave a free stretch between the two")
    return group._replace(nodes=np.setdiff1d(group.nodes, np.array(shared, dtype=np.intp)))


def _group(body: Body, mesh: BodyMesh, support: Hold | Turn) -> Group:
    parts = nodes_on(body, mesh, support.stretches, support.name)
    nodes = np.unique(np.concatenate([nodes for _, nodes in parts]))
    if support.solid:
        nodes = _enclosed(mesh, nodes)
    x, z = mesh.points_mm[nodes].mean(axis=0)
    return Group(support.name, nodes, support.pivot_mm if support.pivot_mm is not None else (float(x), float(z)))


def _enclosed(mesh: BodyMesh, nodes: IndexArray) -> IndexArray:
    """Return all nodes in the convex hull of the given nodes."""
    import shapely

    hull = shapely.MultiPoint(mesh.points_mm[nodes]).convex_hull.buffer(1e-9)
    return np.union1d(nodes, np.flatnonzero(shapely.contains_xy(hull, mesh.points_mm)))


def _lines(known: dict[int, Point], body: Body, mesh: BodyMesh, hold: Hold) -> dict[int, Point]:
    """Return the sliding directions in ``known`` and those that a hold prescribes, keyed by node."""
    lines = dict(known)
    for face, nodes in nodes_on(body, mesh, hold.stretches, hold.name):
        edges = mesh.faces[face.name]
        for index in np.flatnonzero(np.isin(edges.nodes, nodes)).tolist():
            node = int(edges.nodes[index])
            direction = _direction(face, float(edges.u[index]))
            other = lines.get(node, direction)
            is_parallel = abs(other[0] * direction[1] - other[1] * direction[0]) < PARALLEL
            lines[node] = direction if is_parallel and other != IMMOBILE else IMMOBILE
    return lines


def _direction(face: Face, u: float) -> Point:
    x, z = face.curve.velocity_at(u)
    length = math.hypot(x, z)
    return (x / length, z / length)


def _check_supported(mesh: BodyMesh, supports: Supports) -> None:
    """Raise `DesignError` if a connected part of the body can still move as a rigid body."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    triangles = mesh.mesh.t
    links = (np.r_[triangles[0], triangles[1]], np.r_[triangles[1], triangles[2]])
    graph = coo_array((np.ones(2 * triangles.shape[1]), links), shape=(mesh.corners, mesh.corners))
    count, label = connected_components(graph, directed=False)
    piece = np.concatenate([label, label[mesh.mesh.facets[0]]])
    for k in range(count):
        _check_piece(supports, piece == k)


def _check_piece(supports: Supports, mask: BoolArray) -> None:
    """Raise `DesignError` if the nodes selected by a mask (N,) can move as a rigid body."""
    points = supports.points_mm
    centre = points[mask].mean(axis=0)
    size = float(np.ptp(points[mask], axis=0).max())
    fixed, chosen = supports.fixed[mask[supports.fixed]], mask[supports.sliding]
    pivots = [hinge.pivot for hinge in supports.hinges if mask[hinge.nodes].any()]
    constraints = [
        _constraints((points[fixed] - centre) / size, None),
        _constraints((points[supports.sliding[chosen]] - centre) / size, supports.directions[chosen]),
        _constraints((np.array(pivots).reshape(-1, 2) - centre) / size, None),
        np.zeros((3, 3)),
    ]
    _, values, motions = np.linalg.svd(np.vstack(constraints), full_matrices=False)
    if values[2] > MIN_CONSTRAINT * values[0]:
        return
    shift_x, shift_z, turn = motions[2]
    if values[0] == 0.0:
        motion = "it is not supported"
    elif abs(turn) > MIN_CONSTRAINT:
        x, z = centre + size * np.array([-shift_z, shift_x]) / turn
        motion = f"it can turn about {point_text((float(x), float(z)))}"
    else:
        motion = f"it can shift in the direction ({shift_x:.2g}, {shift_z:.2g})"
    names = ", ".join(group.name for group in supports.groups) or "no holds"
    remedy = 'support more of the body: the kind of a hold is "fixed", "sliding" or "turning"'
    body_text = point_text((float(centre[0]), float(centre[1])))
    raise DesignError("hold", value=names, limit=f"{motion} (the body at {body_text})", remedy=remedy)


def _constraints(arms: FloatArray, directions: FloatArray | None) -> FloatArray:
    """Return the movement (M, 3) of points in constrained directions, per unit of shift along x, along z and rotation.

    Points at ``arms`` are fixed if ``directions`` is None, and otherwise slide along their directions.
    """
    one, zero = np.ones(len(arms)), np.zeros(len(arms))
    along_x, along_z = np.column_stack([one, zero, -arms[:, 1]]), np.column_stack([zero, one, arms[:, 0]])
    if directions is None:
        return np.vstack([along_x, along_z])
    return np.asarray(-directions[:, 1:] * along_x + directions[:, :1] * along_z)


def _rotated(arms: FloatArray, angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(arms @ np.array([[c, s], [-s, c]]))


def _rotation_displacements(arms: FloatArray, angle: float) -> FloatArray:
    """Return the displacements (N, 2) of points at arms from a pivot in a rotation, accurate even for tiny angles."""
    s, cos_less_one = math.sin(angle), -2.0 * math.sin(0.5 * angle) ** 2
    return np.asarray(arms @ np.array([[cos_less_one, s], [-s, cos_less_one]]))
