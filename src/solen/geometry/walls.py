"""Division of faces at the limits of the design's wall tables, and receivers behind an air gap."""

import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import pairwise

from solen.curve import ArcLength, Segment
from solen.errors import DesignError
from solen.geometry.body import Face
from solen.spec import Wall

MIN_LENGTH_MM = 1e-6
"""Minimum length of a segment of a divided face, and of the range of a wall table."""
DARK = ("receiver", "mirror", "black")
"""Parts whose faces are not walls."""


def behind_gap(faces: tuple[Face, ...], gap_mm: float | None) -> tuple[tuple[Face, ...], tuple[Face, ...]]:
    """Return the faces with a bare ``end`` in place of each receiver, and the receivers ``gap_mm`` in front of them.

    A receiver is as wide as its end, which its left side faces. If ``gap_mm`` is None, the faces are unchanged.
    """
    if gap_mm is None:
        return faces, ()
    receivers = [face for face in faces if face.part == "receiver"]
    bare = [
        replace(face, name=face.name.replace("receiver", "end", 1)) if face in receivers else face for face in faces
    ]
    return tuple(bare), tuple(replace(face, curve=_across_gap(face, gap_mm)) for face in receivers)


def _across_gap(face: Face, gap_mm: float) -> Segment:
    end = face.curve
    if not isinstance(end, Segment):
        limit = f"requires straight receivers, but {face.name} is curved"
        remedy = 'draw it in air, next to the outline, and set receivers.coupling = "matched"'
        raise DesignError("receivers.coupling", value="air-gap", limit=limit, remedy=remedy)
    nx, nz = end.normal_at(end.start)

    def shifted(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] - gap_mm * nx, point[1] - gap_mm * nz)

    return Segment(shifted(end.start), shifted(end.end))


def with_walls(
    outlines: Sequence[tuple[Face, ...]], walls: Sequence[Wall], elsewhere: Sequence[str] = ()
) -> tuple[tuple[Face, ...], ...]:
    """Return outlines divided at the limits of wall tables, each face with the index of the last table that applies.

    A table may name a face that the body has ``elsewhere``, at other angles of its motion.

    Raises
    ------
    DesignError
        If a table names no wall of the body, or begins beyond the end of all faces that it names.
    """
    faces = tuple(face for outline in outlines for face in outline)
    for number, wall in enumerate(walls):
        if any(is_wall_of(face, wall) for face in faces) or not any(fnmatchcase(name, wall.face) for name in elsewhere):
            _check_table(faces, number, wall)
    return tuple(tuple(piece for face in outline for piece in _divided(face, walls)) for outline in outlines)


def is_wall_of(face: Face, wall: Wall) -> bool:
    """Return whether a face is a wall to which a wall table applies, named with or without its segment number."""
    return face.part not in DARK and has_name(face, wall.face)


def has_name(face: Face, pattern: str) -> bool:
    """Return whether a pattern matches a face name, with or without the segment number."""
    return any(fnmatchcase(name, pattern) for name in (face.name, re.sub(r"\.\d+$", "", face.name)))


def _check_table(faces: tuple[Face, ...], number: int, wall: Wall) -> None:
    named = [face for face in faces if is_wall_of(face, wall)]
    if not named:
        known = ", ".join(face.name for face in faces if face.part not in DARK)
        raise DesignError(f"wall[{number}].face", value=wall.face, limit=f"matches no wall; the walls are {known}")
    longest_mm = max(face.begins_mm + ArcLength(face.curve).length_mm for face in named)
    if wall.from_mm >= longest_mm - MIN_LENGTH_MM:
        limit = f"must be below {longest_mm:.4g} mm, the length of {wall.face}"
        raise DesignError(f"wall[{number}].from_mm", value=wall.from_mm, limit=limit)
    if wall.to_mm is not None and wall.to_mm - wall.from_mm < MIN_LENGTH_MM:
        limit = f"must exceed from_mm = {wall.from_mm:g} by at least {MIN_LENGTH_MM:g} mm"
        raise DesignError(f"wall[{number}].to_mm", value=wall.to_mm, limit=limit, remedy="increase to_mm")
    if wall.to_mm is not None and wall.to_mm > longest_mm + MIN_LENGTH_MM:
        limit = f"must be at most {longest_mm:.4g} mm, the length of {wall.face}"
        raise DesignError(f"wall[{number}].to_mm", value=wall.to_mm, limit=limit, remedy="omit to_mm to reach the end")


def _divided(face: Face, walls: Sequence[Wall]) -> list[Face]:
    """Return the segments of a face in the order of the outline; the face itself if no table divides it."""
    tables = [(number, wall) for number, wall in enumerate(walls) if is_wall_of(face, wall)]
    if not tables:
        return [face]
    measure = ArcLength(face.curve)
    begins, ends = face.begins_mm, face.begins_mm + measure.length_mm
    limits = {length_mm for _, wall in tables for length_mm in (wall.from_mm, wall.to_mm) if length_mm is not None}
    cuts = [begins]
    for length_mm in sorted(limits):  # limits closer than the minimum length are merged
        if cuts[-1] + MIN_LENGTH_MM < length_mm < ends - MIN_LENGTH_MM:
            cuts.append(length_mm)
    cuts.append(ends)
    pieces = []
    for low, high in pairwise(cuts):
        middle = 0.5 * (low + high)
        applicable = [n for n, wall in tables if wall.from_mm < middle < (ends if wall.to_mm is None else wall.to_mm)]
        lengths = (ends - high, ends - low) if face.from_end else (low - begins, high - begins)
        u_from, u_to = (measure.u_at(length) for length in lengths)
        curve = face.curve if (u_from, u_to) == (0.0, 1.0) else face.curve.part(u_from, u_to)
        pieces.append(replace(face, curve=curve, wall=applicable[-1] if applicable else None, begins_mm=low))
    if len(pieces) == 1:
        return pieces
    numbered = [replace(piece, name=f"{face.name}.{i}") for i, piece in enumerate(pieces, start=1)]
    return numbered[::-1] if face.from_end else numbered
