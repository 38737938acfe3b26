"""Contact of the outline with rigid, frictionless round fingers.

Nodes in contact with a finger lie on its circle, and the finger can only push. The contact is solved together with the
displacements: a node is in contact while the finger pushes on it, and as soon as it would be inside the circle
(primal-dual active set; Hintermüller, Ito & Kunisch 2003).

Public names: `Finger`, `finger_of`, `Pairs`, `pairs_of`, `Touch`, `touch_of`, `tributary_lengths` and `contact_sizes`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.errors import DesignError
from solen.geometry import Body, material
from solen.geometry.body import point_text
from solen.mechanics.load import Press
from solen.mechanics.material import Material
from solen.mechanics.mesh import BodyMesh
from solen.mechanics.stretches import contact_position, nodal_lengths
from solen.plane import heading

MIN_COSINE = 0.1
"""Smallest cosine between the direction of a finger and the wall's inward normal."""
CHORD_MM = 1e-4
"""Tolerance of the polygon from which the depth of the body is found."""
PENETRATION_TOLERANCE_MM = 1e-6
"""Depth to which a finger may enter a supported region, a tolerance for rounding errors."""
ELEMENTS_PER_HALF_WIDTH = 6
"""Number of elements across half the contact width."""
MIN_DEPTH_RADII = 1e-3
"""Smallest depth for which the mesh resolves the contact, as a fraction of the finger's radius."""


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
    direction
        Unit vector (2,) of the finger's movement.
    body_depth_mm
        Depth of the body along this direction, from the point of first contact.
    """

    press: Press
    face: str
    start_mm: FloatArray
    direction: FloatArray
    body_depth_mm: float

    @property
    def by_force(self) -> bool:
        """Whether the force of the finger is prescribed and its depth is computed."""
        return self.press.force_N is not None

    def check(self, depth_mm: float, push: float, supported: FloatArray) -> None:
        """Raise `DesignError` if a finger hits supported points (N, 2), passes through the body or loses contact."""
        centre = self.start_mm + depth_mm * self.direction
        x, z = centre + self.press.radius_mm * self.direction
        tip = point_text((float(x), float(z)))
        inside = np.hypot(*(supported - centre).T) < self.press.radius_mm - PENETRATION_TOLERANCE_MM
        if inside.any():
            hit_x, hit_z = supported[inside][0]
            limit = f"the finger reaches a supported point, {point_text((float(hit_x), float(hit_z)))}"
            raise DesignError(self.press.name, limit=limit, remedy="press elsewhere, or shorten the hold")
        if self.by_force and depth_mm >= self.body_depth_mm:
            limit = f"pushes the finger {depth_mm:.3g} mm, to {tip}, but the body is {self.body_depth_mm:.3g} mm deep"
            remedy = "reduce the force"
            raise DesignError(f"{self.press.name}.force_N", value=self.press.force_N, limit=limit, remedy=remedy)
        if depth_mm > 0.0 and not push > 0.0:
            limit = f"lost contact: the body has moved away from the finger, whose tip is at {tip}"
            raise DesignError(self.press.name, limit=limit, remedy="move or remove the finger")


def finger_of(body: Body, press: Press) -> Finger:
    """Return the finger of a press.

    Raises
    ------
    DesignError
        If the values of the press are invalid, the finger does not move into the wall, or it passes through the body.
    """
    _check_values(press)
    face, u = contact_position(body, press)
    at = np.array(face.curve.point_at(u))
    normal = np.array(face.curve.normal_at((float(at[0]), float(at[1]))))
    direction = normal if press.direction_deg is None else np.array(heading(press.direction_deg))
    if direction @ normal < MIN_COSINE:
        limit = f"does not point into {face.name} at {point_text((at[0], at[1]))}"
        raise DesignError(f"{press.name}.direction_deg", value=press.direction_deg, limit=limit)
    finger = Finger(press, face.name, at - press.radius_mm * normal, direction, _body_depth_mm(body, at, direction))
    if press.depth_mm is not None and press.depth_mm >= finger.body_depth_mm:
        limit = f"must be below {finger.body_depth_mm:.4g} mm, the depth of the body at {point_text((at[0], at[1]))}"
        raise DesignError(f"{press.name}.depth_mm", value=press.depth_mm, limit=limit)
    return finger


def _check_values(press: Press) -> None:
    if (press.depth_mm is None) == (press.force_N is None):
        raise DesignError(press.name, limit="requires either depth_mm or force_N")
    for key in ("radius_mm", "depth_mm", "force_N"):
        value = getattr(press, key)
        if value is None or (math.isfinite(value) and (value > 0.0 or (value == 0.0 and key != "radius_mm"))):
            continue
        raise DesignError(f"{press.name}.{key}", value=value, limit="must be finite and above 0")


def _body_depth_mm(body: Body, at: FloatArray, direction: FloatArray) -> float:
    import shapely

    area = material(body, CHORD_MM)
    x_low, z_low, x_high, z_high = area.bounds
    reach = math.hypot(x_high - x_low, z_high - z_low)
    line = shapely.LineString([at + 10.0 * CHORD_MM * direction, at + reach * direction])
    inside = area.intersection(line)
    first = min(getattr(inside, "geoms", [inside]), key=lambda part: part.distance(shapely.Point(at)))
    return float(first.length) + 10.0 * CHORD_MM


class Pairs(NamedTuple):
    """All pairs of a finger and a node that it may touch, as index arrays (M,)."""

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
        Unit vectors (M, 2) from the finger's centre to the node.
    distance_mm
        Distances (M,) between the finger's centre and the node.
    gap_mm
        Distances (M,) of the node from the finger's circle, negative inside.
    """

    pairs: Pairs
    normal: FloatArray
    distance_mm: FloatArray
    gap_mm: FloatArray

    def active(self, force: FloatArray, stiffness: float, forced: BoolArray) -> BoolArray:
        """Return a mask of the pairs (M,) in contact; a ``forced`` finger (K,) touches at least the nearest node."""
        active = force > stiffness * self.gap_mm
        for k in np.flatnonzero(forced):
            pairs = np.flatnonzero(self.pairs.finger == k)
            if not active[pairs].any():
                active[pairs[np.argmin(self.gap_mm[pairs])]] = True
        return active


def touch_of(fingers: Sequence[Finger], pairs: Pairs, points: FloatArray, depth: FloatArray) -> Touch:
    """Return the contact geometry of displaced nodes (N, 2) and fingers at depths (K,)."""
    centres = np.array([f.start_mm + d * f.direction for f, d in zip(fingers, depth, strict=True)]).reshape(-1, 2)
    radii = np.array([f.press.radius_mm for f in fingers])
    offset = points[pairs.node] - centres[pairs.finger]
    distance = np.maximum(np.hypot(*offset.T), 1e-12)
    return Touch(pairs, offset / distance[:, None], distance, distance - radii[pairs.finger])


def pairs_of(mesh: BodyMesh, count: int, free: BoolArray) -> Pairs:
    """Return all pairs of a finger and a free node of the outlines."""
    nodes = np.unique(np.concatenate([edges.nodes for edges in mesh.faces.values()]))
    nodes = nodes[free[nodes]]
    return Pairs(np.repeat(np.arange(count), len(nodes)), np.tile(nodes, count))


def tributary_lengths(mesh: BodyMesh, points: FloatArray) -> FloatArray:
    """Return the length (N,) of the outline that each node represents, which is 0 for inner nodes."""
    lengths = np.zeros(len(points))
    for edges in mesh.faces.values():
        np.add.at(lengths, edges.nodes, nodal_lengths(points, edges.nodes))
    return lengths


def contact_sizes(
    body: Body, finger: Finger, soft_material: Material, thickness_mm: float
) -> list[tuple[float, float, float]]:
    """Return element sizes that resolve a contact: (x, z, size in mm) at points along the wall."""
    face, u = contact_position(body, finger.press)
    half_mm = _half_width_mm(finger, soft_material, thickness_mm)
    speed = math.hypot(*face.curve.velocity_at(u))
    steps = np.linspace(-1.0, 1.0, 2 * ELEMENTS_PER_HALF_WIDTH + 1) * half_mm / speed
    at = face.curve.points(np.clip(u + steps, 0.0, 1.0))
    return [(float(x), float(z), half_mm / ELEMENTS_PER_HALF_WIDTH) for x, z in at]


def _half_width_mm(finger: Finger, soft_material: Material, thickness_mm: float) -> float:
    """Estimate half the contact width: Hertz's for a given force, three quarters of half the chord for a given depth.

    The result is rounded to a power of √2, so that a slightly different finger or modulus gives the same mesh.
    """
    press = finger.press
    if press.force_N:
        stiffness = 4.0 * soft_material.shear_modulus_MPa
        half_mm = math.sqrt(4.0 * press.force_N / thickness_mm * press.radius_mm / (math.pi * stiffness))
    else:
        depth_mm = max(press.depth_mm or 0.0, MIN_DEPTH_RADII * press.radius_mm)
        half_mm = 0.75 * math.sqrt(2.0 * press.radius_mm * depth_mm)
    return float(2.0 ** (round(2.0 * math.log2(half_mm)) / 2.0))
