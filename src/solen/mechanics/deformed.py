"""A body under load: where its walls went, what holds it, where a finger touches it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from solen.arrays import FloatArray, IndexArray
from solen.geometry import Body
from solen.plane import Point
from solen.results import HIDDEN, Result


@dataclass(frozen=True, eq=False)
class Wall:
    """Displacement of one face at the nodes of the elements along it.

    Attributes
    ----------
    u
        Parameters (N,) of the nodes on the face's curve, from 0 to 1, ascending; every second one is the middle of an
        element's edge, at half of its length.
    points_mm
        The same points (N, 2) at rest, exactly on the curve.
    displacement_mm
        Their displacements (N, 2), of the elements' own accuracy: no interpolation.
    """

    u: FloatArray
    points_mm: FloatArray
    displacement_mm: FloatArray


class Reaction(Result):
    """What a hold, a clamp, a finger or a pull exerts on the body.

    Attributes
    ----------
    name
        Its own.
    force_N
        Components along x and z, for the whole thickness.
    moment_Nmm
        Counter-clockwise, about ``about_mm``.
    about_mm
        Pivot of the hold or clamp; centre of the finger; middle of the pulled stretch.
    """

    name: str
    force_N: Point
    moment_Nmm: float
    about_mm: Point


class Contact(Result):
    """Where a finger touches a face; one that touches several stretches has a contact on each.

    Attributes
    ----------
    name
        Name of the press.
    face
        Of the body.
    u_from, u_to
        Part of the face's curve that it touches, in its parameter; not in JSON.
    from_mm, to_mm
        The same along the face, as wall tables count.
    depth_mm
        How far the finger moved on since it first touched.
    force_N
        Of this stretch, along the finger's way; a corner counts once.
    pressure_MPa
        Largest pressure.
    """

    name: str
    face: str
    u_from: float = field(metadata=HIDDEN)
    u_to: float = field(metadata=HIDDEN)
    from_mm: float
    to_mm: float
    depth_mm: float
    force_N: float
    pressure_MPa: float


@dataclass(frozen=True, eq=False)
class Picture:
    """The mesh for figures.

    Attributes
    ----------
    points_mm, displacement_mm
        Corners of the triangles (N, 2) at rest, and their displacements.
    triangles
        Numbers of their corners (M, 3).
    strain
        Size of the largest principal strain, ln λ, at each corner (N,).
    """

    points_mm: FloatArray
    displacement_mm: FloatArray
    triangles: IndexArray
    strain: FloatArray


@dataclass(frozen=True, eq=False)
class Deformed:
    """A body in one state of load.

    Attributes
    ----------
    body
        At rest.
    walls
        Displaced nodes of each face by its name.
    reactions
        What each hold and load exerts on the body; they add up to nothing.
    contacts
        Where fingers touch it.
    picture
        Mesh and strain.
    strain_largest
        Largest principal strain, ln λ, in magnitude.
    bulge_mm
        How far walls are from upright: by how much the wall of a body that is free along y lies further out, or in,
        halfway up than at its faces, in nine tenths of the body. The walls that light meets are upright.
    warnings
        Sentences.
    """

    body: Body
    walls: Mapping[str, Wall]
    reactions: tuple[Reaction, ...]
    contacts: tuple[Contact, ...]
    picture: Picture
    strain_largest: float
    bulge_mm: float
    warnings: tuple[str, ...] = ()
