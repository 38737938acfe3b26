"""A body under load: wall displacements, support forces, and contacts with fingers."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from solen.arrays import FloatArray, IndexArray
from solen.geometry import Body
from solen.plane import Point
from solen.results import HIDDEN, Result


@dataclass(frozen=True, eq=False)
class Wall:
    """Displacement of a face at the nodes of the elements along it.

    Attributes
    ----------
    u
        Parameters (N,) of the nodes on the face's curve, from 0 to 1, ascending; every second node is the midpoint of
        an element edge, at half the edge length.
    points_mm
        Positions (N, 2) of the nodes at rest, exactly on the curve.
    displacement_mm
        Displacements (N, 2) of these nodes, without interpolation.
    """

    u: FloatArray
    points_mm: FloatArray
    displacement_mm: FloatArray


class Reaction(Result):
    """Force and moment that a hold, a clamp, a finger or a pull exerts on the body.

    Attributes
    ----------
    name
        Name of the hold, clamp, finger or pull.
    force_N
        Components along x and z, over the entire thickness.
    moment_Nmm
        Counter-clockwise, about ``about_mm``.
    about_mm
        Pivot of the hold or clamp; centre of the finger; midpoint of the pulled part.
    """

    name: str
    force_N: Point
    moment_Nmm: float
    about_mm: Point


class Contact(Result):
    """Contact of a finger with one part of a face; a finger that touches several parts has a contact on each.

    Attributes
    ----------
    name
        Name of the press.
    face
        Name of the face.
    u_from, u_to
        Parameters of the face's curve at the ends of the part in contact; omitted from JSON.
    from_mm, to_mm
        Ends of this part as lengths along the face, measured as in wall tables.
    depth_mm
        Distance that the finger has moved since it first touched the body.
    force_N
        Force on this part, along the finger's direction; the force on a corner is assigned to one of its two faces.
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
        Positions (N, 2) of the triangle corners at rest, and their displacements.
    triangles
        Indices (M, 3) of the corners of each triangle.
    strain
        Absolute value of the largest principal strain, ln λ, at each corner (N,).
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
        The body at rest.
    walls
        Displaced nodes of each face, keyed by the face's name.
    reactions
        Force and moment of each hold and load on the body; their sum is zero.
    contacts
        Contacts of fingers with the body.
    picture
        Mesh and strain.
    strain_largest
        Largest magnitude of a principal strain, ln λ.
    bulge_mm
        Largest bulge or hollow of the walls at mid-height, relative to top and bottom, if the body is free along y; the
        tenth of the body with the largest bulge is excluded. Rays are traced with vertical walls.
    warnings
        Warnings, one sentence each.
    """

    body: Body
    walls: Mapping[str, Wall]
    reactions: tuple[Reaction, ...]
    contacts: tuple[Contact, ...]
    picture: Picture
    strain_largest: float
    bulge_mm: float
    warnings: tuple[str, ...] = ()
