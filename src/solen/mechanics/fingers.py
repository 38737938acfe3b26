"""Contact of the outline with rigid, frictionless round fingers.

Nodes touched by a finger are on its circle, and the finger can only push. The contact is solved together with the
displacements: a node is in contact while its force pushes, or as soon as it would be inside the circle (primal-dual
active set; Hintermüller, Ito & Kunisch 2003).

Public name: `Touch`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.errors import DesignError
from solen.geometry import Body, material
from solen.geometry.body import place_text
from solen.mechanics.load import Press
from solen.mechanics.material import Material
from solen.mechanics.mesh import BodyMesh
from solen.mechanics.stretches import edge_shares, place_of
from solen.plane import heading

MIN_SLOPE = 0.1
"""Smallest cosine between the direction of a finger and the wall's inward normal."""
OUTLINE_MM = 1e-4
INTO_HELD_MM = 1e-6
"""Depth in mm to which a finger may enter a held region, a tolerance for rounding errors."""
ACROSS_CONTACT = 6
"""Number of elements across half the contact width."""
SHALLOW = 1e-3
"""Smallest depth, in radii, for which a contact is resolved."""


@dataclass(frozen=True, eq=False)
class Finger:
    """A press on a mesh.

    Attributes
    ----------
    press
        The load that describes the finger.
    face
        Name of the face that the finger touches first.
    start_mm
        Centre (2,) of the finger at first contact.
    way
        Unit vector (2,) of the finger's movement.
    through_mm
        Length of the body along this direction from the first contact.
    """

    press: Press
    face: str
    start_mm: FloatArray
    way: FloatArray
    through_mm: float

    @property
    def by_force(self) -> bool:
        """Whether the force of the finger is given and its depth is computed."""
        return self.press.force_N is not None

    def check(self, depth_mm: float, push: float, held: FloatArray) -> None:
        """Raise `DesignError` if the finger passed through the body, meets held points (N, 2) or lost contact."""
        centre = self.start_mm + depth_mm * self.way
        x, z = centre + self.press.radius_mm * self.way
        place = place_text((float(x), float(z)))
        inside = np.hypot(*(held - centre).T) < self.press.radius_mm - INTO_HELD_MM
        if inside.any():
            hit_x, hit_z = held[inside][0]
            limit = f"runs into a held point, {place_text((float(hit_x), float(hit_z)))}"
            raise DesignError(self.press.name, limit=limit, remedy="press at another place, or hold less of the body")
        if self.by_force and depth_mm >= self.through_mm:
            limit = f"pushes the finger {depth_mm:.3g} mm into a body of {self.through_mm:.3g} mm there, to {place}"
            raise DesignError(f"{self.press.name}.force_N", value=self.press.force_N, limit=limit, remedy="push less")
        if depth_mm > 0.0 and not push > 0.0:
            limit = f"the body has moved away from the finger, whose tip is at {place}"
            raise DesignError(self.press.name, value="contact lost", limit=limit, remedy="move it there, or omit it")


def finger_of(body: Body, press: Press) -> Finger:
    """Return the finger of a press.

    Raises
    ------
    DesignError
        If the values of the press are invalid, the finger does not move into the wall, or it passes through the body.
    """
    if (press.depth_mm is None) == (press.force_N is None):
        raise DesignError(press.name, limit="requires either depth_mm or force_N")
    for key in ("radius_mm", "depth_mm", "force_N"):
        value = getattr(press, key)
        if value is not None and not (math.isfinite(value) and (value > 0.0 or (value == 0.0 and key != "radius_mm"))):
            raise DesignError(f"{press.name}.{key}", value=value, limit="must be above 0")
    face, u = place_of(body, press)
    at = np.array(face.curve.point_at(u))
    normal = np.array(face.curve.normal_at((float(at[0]), float(at[1]))))
    way = normal if press.direction_deg is None else np.array(heading(press.direction_deg))
    if way @ normal < MIN_SLOPE:
        limit = f"does not point into {face.name} at {place_text((at[0], at[1]))}"
        raise DesignError(f"{press.name}.direction_deg", value=press.direction_deg, limit=limit)
    finger = Finger(press, face.name, at - press.radius_mm * normal, way, _through(body, at, way))
    if press.depth_mm is not None and press.depth_mm >= finger.through_mm:
        limit = f"must be below {finger.through_mm:.4g} mm, the body's own depth at {place_text((at[0], at[1]))}"
        raise DesignError(f"{press.name}.depth_mm", value=press.depth_mm, limit=limit)
    return finger


def _through(body: Body, at: FloatArray, way: FloatArray) -> float:
    import shapely

    area = material(body, OUTLINE_MM)
    x_low, z_low, x_high, z_high = area.bounds
    reach = math.hypot(x_high - x_low, z_high - z_low)
    line = shapely.LineString([at + 10.0 * OUTLINE_MM * way, at + reach * way])
    inside = area.intersection(line)
    first = min(getattr(inside, "geoms", [inside]), key=lambda part: part.distance(shapely.Point(at)))
    return float(first.length) + 10.0 * OUTLINE_MM


class Pairs(NamedTuple):
    """Every finger with every node that it may touch, as index arrays (M,)."""

    finger: IndexArray
    node: IndexArray


@dataclass(frozen=True, eq=False)
class Touch:
    """Positions of nodes relative to fingers in one state.

    Attributes
    ----------
    pairs
        Fingers and nodes.
    normal
        Unit vector (M, 2) from the finger's centre to the node.
    distance_mm
        Distance (M,) between them.
    gap_mm
        Distance (M,) from the finger's circle, negative inside.
    """

    pairs: Pairs
    normal: FloatArray
    distance_mm: FloatArray
    gap_mm: FloatArray

    def active(self, force: FloatArray, stiffness: float, forced: BoolArray) -> BoolArray:
        """Return a mask of pairs (M,) that touch; for fingers (K,) that are ``forced``, at least the nearest node."""
        found = force > stiffness * self.gap_mm
        for k in np.flatnonzero(forced):
            own = np.flatnonzero(self.pairs.finger == k)
            if not found[own].any():
                found[own[np.argmin(self.gap_mm[own])]] = True
        return found


def touch_of(fingers: Sequence[Finger], pairs: Pairs, points: FloatArray, depth: FloatArray) -> Touch:
    """Return the contact geometry of displaced nodes (N, 2) and fingers at depths (K,)."""
    centres = np.array([f.start_mm + d * f.way for f, d in zip(fingers, depth, strict=True)]).reshape(-1, 2)
    radii = np.array([f.press.radius_mm for f in fingers])
    apart = points[pairs.node] - centres[pairs.finger]
    distance = np.maximum(np.hypot(*apart.T), 1e-12)
    return Touch(pairs, apart / distance[:, None], distance, distance - radii[pairs.finger])


def pairs_of(mesh: BodyMesh, count: int, free: BoolArray) -> Pairs:
    """Return every finger with every free node of the outlines."""
    nodes = np.unique(np.concatenate([edges.nodes for edges in mesh.faces.values()]))
    nodes = nodes[free[nodes]]
    return Pairs(np.repeat(np.arange(count), len(nodes)), np.tile(nodes, count))


def shares_of(mesh: BodyMesh, points: FloatArray) -> FloatArray:
    """Return the length (N,) of the outline that each node represents, or 0 for inner nodes."""
    shares = np.zeros(len(points))
    for edges in mesh.faces.values():
        np.add.at(shares, edges.nodes, edge_shares(points, edges.nodes))
    return shares


def contact_sizes(body: Body, finger: Finger, stuff: Material, thickness_mm: float) -> list[tuple[float, float, float]]:
    """Return element sizes that resolve a contact: (x, z, size in mm) along the wall, from Hertz's half width."""
    face, u = place_of(body, finger.press)
    half_mm = _half_width_mm(finger, stuff, thickness_mm)
    speed = math.hypot(*face.curve.velocity_at(u))
    steps = np.linspace(-1.0, 1.0, 2 * ACROSS_CONTACT + 1) * half_mm / speed
    at = face.curve.points(np.clip(u + steps, 0.0, 1.0))
    return [(float(x), float(z), half_mm / ACROSS_CONTACT) for x, z in at]


def _half_width_mm(finger: Finger, stuff: Material, thickness_mm: float) -> float:
    """Return about half the width of the contact: Hertz's for a force, three quarters of the chord for a depth.

    It is rounded to steps of a factor of 2^½, so that a slightly different finger or modulus leads to the same mesh.
    """
    press = finger.press
    if press.force_N:
        stiffness = 4.0 * stuff.shear_modulus_MPa
        half_mm = math.sqrt(4.0 * press.force_N / thickness_mm * press.radius_mm / (math.pi * stiffness))
    else:
        depth_mm = max(press.depth_mm or 0.0, SHALLOW * press.radius_mm)
        half_mm = 0.75 * math.sqrt(2.0 * press.radius_mm * depth_mm)
    return float(2.0 ** (round(2.0 * math.log2(half_mm)) / 2.0))
