"""Positions of stretches on a body: parameters on its faces, and nodes of its mesh."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.curve import ArcLength
from solen.errors import DesignError
from solen.geometry import Body, Face, has_name
from solen.mechanics.load import Hold, Load, Press, Stretch
from solen.mechanics.mesh import BodyMesh

MIN_LENGTH_MM = 1e-6
"""Smallest length of a stretch."""
U_TOLERANCE = 1e-9


class Part(NamedTuple):
    """Part of one face's curve between two parameters."""

    face: Face
    u_from: float
    u_to: float


def parts_of(body: Body, stretch: Stretch, what: str) -> list[Part]:
    """Return the parts of faces that a stretch covers.

    Raises
    ------
    DesignError
        If the stretch names no face of an outline, or lies outside all faces that it names.
    """
    named = [face for face in body.all_faces if has_name(face, stretch.face)]
    if not named:
        raise _unknown_face(body, stretch.face, what)
    longest_mm = max(face.begins_mm + ArcLength(face.curve).length_mm for face in named)
    if stretch.to_mm is not None and stretch.to_mm > longest_mm + MIN_LENGTH_MM:
        limit = f"must be at most {longest_mm:.4g} mm, the length of {stretch.face}"
        raise DesignError(f"{what}.to_mm", value=stretch.to_mm, limit=limit, remedy="omit to_mm to reach the end")
    parts = [part for face in named if (part := _covered(face, stretch)) is not None]
    if not parts:
        limit = f"covers no part of {stretch.face}, which is {longest_mm:.4g} mm long"
        raise DesignError(f"{what}.from_mm", value=stretch.from_mm, limit=limit)
    return parts


def contact_position(body: Body, press: Press) -> tuple[Face, float]:
    """Return the face and parameter of a finger's first contact; raise `DesignError` if there is none."""
    named = [face for face in body.all_faces if has_name(face, press.face)]
    if not named:
        raise _unknown_face(body, press.face, press.name)
    ends = []
    for face in named:
        measure = ArcLength(face.curve)
        length_mm = press.at_mm - face.begins_mm
        ends.append(face.begins_mm + measure.length_mm)
        if 0.0 <= length_mm <= measure.length_mm:
            return face, measure.u_at(measure.length_mm - length_mm if face.from_end else length_mm)
    limit = f"must be from 0 to {max(ends):.4g} mm, the length of {press.face}"
    raise DesignError(f"{press.name}.at_mm", value=press.at_mm, limit=limit)


def cuts_of(body: Body, holds: Sequence[Hold], loads: Sequence[Load]) -> dict[str, list[float]]:
    """Return the parameters at which elements must end, keyed by face: ends of stretches and finger contacts."""
    cuts: dict[str, list[float]] = defaultdict(list)
    for constraint in (*holds, *loads):
        if isinstance(constraint, Press):
            face, u = contact_position(body, constraint)
            cuts[face.name].append(u)
            continue
        for stretch in constraint.stretches:
            for part in parts_of(body, stretch, constraint.name):
                cuts[part.face.name] += [u for u in (part.u_from, part.u_to) if 0.0 < u < 1.0]
    return dict(cuts)


def nodes_on(body: Body, mesh: BodyMesh, stretches: Iterable[Stretch], what: str) -> list[tuple[Face, IndexArray]]:
    """Return the nodes on the parts covered by stretches, in order along each; every second is an edge midpoint."""
    nodes = []
    for stretch in stretches:
        for part in parts_of(body, stretch, what):
            edges = mesh.faces[part.face.name]
            low, high = (int(np.argmin(np.abs(edges.u[::2] - u))) for u in (part.u_from, part.u_to))
            nodes.append((part.face, edges.nodes[2 * low : 2 * high + 1]))
    return nodes


def nodal_lengths(points: FloatArray, nodes: IndexArray) -> FloatArray:
    """Return the length (N,) that each node along a face represents, with Simpson weights 1/6, 4/6, 1/6 per edge."""
    edges_mm = np.hypot(*np.diff(points[nodes[::2]], axis=0).T)
    lengths = np.zeros(len(nodes))
    lengths[1::2] = 4.0 / 6.0 * edges_mm
    lengths[:-1:2] += edges_mm / 6.0
    lengths[2::2] += edges_mm / 6.0
    return lengths


def _covered(face: Face, stretch: Stretch) -> Part | None:
    measure = ArcLength(face.curve)
    low = max(0.0, stretch.from_mm - face.begins_mm)
    high = measure.length_mm if stretch.to_mm is None else min(measure.length_mm, stretch.to_mm - face.begins_mm)
    if high - low < MIN_LENGTH_MM:
        return None
    ends = (measure.length_mm - high, measure.length_mm - low) if face.from_end else (low, high)
    u_from, u_to = (0.0 if u < U_TOLERANCE else 1.0 if u > 1.0 - U_TOLERANCE else u for u in map(measure.u_at, ends))
    return Part(face, u_from, u_to)


def _unknown_face(body: Body, name: str, what: str) -> DesignError:
    names = ", ".join(face.name for face in body.all_faces)
    return DesignError(f"{what}.face", value=name, limit=f"is not a face; the faces are {names}")
