"""The soft body of a design: its tables, its states under load, and its walls for the ray tracer.

The design's holds, fingers and pulls become supports and loads of the finite elements, with the same names. The state
at each value of the driven quantity is solved once and stored. The displaced walls become exact curves
(`solen.geometry.displaced`). If a finger in optical contact touches a wall, the touched part gets its own wall table,
through which light enters the finger.

Public names: `LoadedBody` and `LoadedState`.
"""

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from solen.errors import DesignError
from solen.geometry import Body, ContactSegment, Displaced, body_of, displaced
from solen.geometry.outline import centred_position
from solen.geometry.walls import DARK
from solen.lens import Lens
from solen.material.resin import resin_of
from solen.material.stiffness.models import model
from solen.mechanics.deformed import Contact, Deformed
from solen.mechanics.load import Hold, Load, Press, Pull, Stretch, Turn
from solen.mechanics.material import Material
from solen.mechanics.mesh import MeshOptions
from solen.mechanics.soft_body import SoftBody
from solen.plane import Point, heading
from solen.ranks import Caution
from solen.spec import Design, Wall
from solen.spec import soft as tables

MAX_FINGER_DEPTH_MM = 0.5
"""Largest depth in mm of the layer of a finger that light enters; the far side of the layer is black."""
MAX_FINGER_DEPTH_RADII = 0.25
"""Largest depth of this layer, as a fraction of the finger's radius."""


@dataclass(frozen=True)
class LoadedState:
    """A design's body in one state of its load.

    Attributes
    ----------
    value
        Value of the driven quantity: an angle in degrees, a depth in mm or a force in N.
    deformed
        Result of the finite elements: reactions, contacts, strain.
    displaced
        The body with walls as exact curves and the emitter carried along.
    design
        The design, with further wall tables for the parts of walls that fingers touch in this state.
    """

    value: float
    deformed: Deformed
    displaced: Displaced
    design: Design

    @property
    def body(self) -> Body:
        """The displaced body."""
        return self.displaced.body

    @property
    def turn_deg(self) -> float:
        """Angle by which the part that carries the emitter has rotated."""
        return self.displaced.emitter_motion.angle_deg

    @property
    def lens_turn_deg(self) -> float:
        """Rotation angle of the lens; if no face is called ``lens``, that of the part that carries the emitter."""
        return (self.displaced.lens_motion or self.displaced.emitter_motion).angle_deg


@dataclass(frozen=True)
class LoadedBody:
    """The soft body of a loaded design, and its solved states, keyed by the value of the driven quantity."""

    design: Design
    rest: Body
    soft: SoftBody
    solved: dict[float, LoadedState] = field(default_factory=dict, compare=False, repr=False)
    lock: Any = field(default_factory=threading.RLock, compare=False, repr=False)

    @classmethod
    def of(cls, design: Design, lens: Lens | None) -> "LoadedBody":
        """Create the soft body of a design.

        Raises
        ------
        DesignError
            If the design has no stiffness, or scikit-fem is not installed.
        """
        rest = body_of(design, lens)
        soft = SoftBody(
            replace(rest, front=None),  # of a lens in space, the middle section, which remains rigid
            material_of(design),
            (*_holds(design, rest), *_backings(design)),
            design.body.thickness_mm,
            design.mechanics.plane,
            MeshOptions(size_mm=design.mechanics.mesh_mm),
        )
        return cls(design, rest, soft)

    def state(self, value: float) -> LoadedState:
        """Return the state at a value of the driven quantity; raise the errors of `SoftBody.states`."""
        return self.states([value])[0]

    def states(self, values: Sequence[float]) -> list[LoadedState]:
        """Return the states at several values; the values not yet solved are solved in this order."""
        with self.lock:
            missing = [value for value in dict.fromkeys(values) if value not in self.solved]
            for value, deformed in zip(missing, self.soft.states([self.loads(v) for v in missing]), strict=True):
                self.solved[value] = self._with_walls(value, deformed)
            return [self.solved[value] for value in values]

    def loads(self, value: float) -> list[Load]:
        """Return the loads at a value of the driven quantity."""
        design = self.design
        return [
            *_clamps(design, self.rest, value),
            *(_press(design, press, value) for press in design.press),
            *(_pull(design, pull, value) for pull in design.pull),
        ]

    def _with_walls(self, value: float, deformed: Deformed) -> LoadedState:
        """Return the state with its displaced walls and the wall tables of its contacts."""
        walls: list[Wall] = []
        contacts: list[ContactSegment] = []
        fingers = {press.name: press for press in self.design.press}
        for contact in deformed.contacts:
            wall = self._contact_wall(fingers[contact.name], contact)
            if wall is not None:
                index = len(self.design.wall) + len(walls)
                contacts.append(ContactSegment(contact.face, contact.u_from, contact.u_to, index))
                walls.append(wall)
        design = self.design.model_copy(update={"wall": (*self.design.wall, *walls)}) if walls else self.design
        moved = displaced(self.rest, deformed.walls, self.design.motion.emitter_on, contacts)
        return LoadedState(value, deformed, moved, design.in_folder(self.design.folder))

    def _contact_wall(self, finger: tables.Press, contact: Contact) -> Wall | None:
        """Return the wall table of a contact with a finger, or None if no light enters the finger."""
        face = self.rest.face(contact.face)
        wall = Wall(face=face.name) if face.wall is None else self.design.wall[face.wall]
        is_dark = face.part in DARK or wall.finish in ("mirror", "black")
        if finger.index is None or is_dark or not contact.u_from < contact.u_to:
            return None
        if wall.has_plugin_finish or wall.outside != "air":
            setting = f'finish = "{wall.finish}"' if wall.has_plugin_finish else f'outside = "{wall.outside}"'
            limit = (
                f"the finger touches {face.name}, for which wall[{face.wall}] sets {setting}: the medium behind "
                "the contact is ambiguous"
            )
            remedy = "omit the index, or move the finger or this part of the wall"
            raise DesignError(f"{finger.name}.index", value=finger.index, limit=limit, remedy=remedy)
        medium = {"outside": finger.name, "index": finger.index, "absorption_per_mm": finger.absorption_per_mm}
        depth_mm = min(MAX_FINGER_DEPTH_MM, MAX_FINGER_DEPTH_RADII * finger.radius_mm)
        return wall.model_copy(update={**medium, "face": face.name, "depth_mm": depth_mm, "beyond": "black"})


def material_of(design: Design) -> Material:
    """Return the soft material of a design: from the design's modulus, otherwise from its resin's model or modulus.

    Raises
    ------
    DesignError
        If neither the design nor its resin gives a stiffness.
    """
    mechanics = design.mechanics
    if mechanics.modulus_MPa is not None:
        return _neo_hookean(mechanics.modulus_MPa, mechanics.poisson)
    resin = design.material.resin
    stiffness = None if resin is None else resin_of(resin, design.resin_file).stiffness
    if stiffness is None:
        limit = "missing: a soft body needs a stiffness" + (f", and the resin {resin} has none" if resin else "")
        remedy = "add modulus_MPa, or use a resin with [stiffness], as written by solen resin stiffness"
        raise DesignError("mechanics.modulus_MPa", limit=limit, remedy=remedy)
    names = model(stiffness.model).names if stiffness.model else ()
    if names and set(names) <= set(stiffness.parameters):
        return Material(stiffness.model, tuple(stiffness.parameters[name] for name in names), mechanics.poisson)
    return _neo_hookean(stiffness.modulus_MPa, mechanics.poisson)


def stiffness_cautions(design: Design) -> tuple[Caution, ...]:
    """Return warnings about the stiffness of a design's resin; none if the design sets the modulus itself."""
    resin = design.material.resin
    if resin is None or design.mechanics.modulus_MPa is not None:
        return ()
    return resin_of(resin, design.resin_file).cautions("stiffness")


def _neo_hookean(modulus_MPa: float, poisson: float) -> Material:
    return Material.neo_hookean(modulus_MPa / (2.0 * (1.0 + poisson)), poisson)


def _holds(design: Design, rest: Body) -> Iterable[Hold]:
    """Yield the supports that do not move."""
    for name, rows in _supports(design).items():
        first = rows[0]
        if not _is_clamp(design, first):
            pivot = None if first.about is None else _pivot(design, rest, first.about)
            yield Hold(tuple(map(_stretch, rows)), first.kind, pivot, any(row.solid for row in rows), name)


def _backings(design: Design) -> Iterable[Hold]:
    """Yield the supports behind fingers."""
    for press in design.press:
        if press.backing is not None:
            yield Hold((Stretch(press.backing),), "sliding", name=f"backing of {press.name}")


def _clamps(design: Design, rest: Body, value: float) -> Iterable[Turn]:
    for name, rows in _supports(design).items():
        first = rows[0]
        if _is_clamp(design, first) and first.about is not None:
            angle_deg = value if first.angle_deg is None else first.angle_deg
            pivot = _pivot(design, rest, first.about)
            yield Turn(tuple(map(_stretch, rows)), pivot, angle_deg, any(row.solid for row in rows), name)


def _press(design: Design, press: tables.Press, value: float) -> Press:
    driven = _driven(design, press.name, value)
    depth_mm, force_N = (driven.get(key, getattr(press, key)) for key in ("depth_mm", "force_N"))
    return Press(press.face, press.at_mm, press.radius_mm, depth_mm, force_N, press.direction_deg, press.name)


def _pull(design: Design, pull: tables.Pull, value: float) -> Pull:
    force_N = _driven(design, pull.name, value).get("force_N", pull.force_N or 0.0)
    x, z = heading(pull.direction_deg)
    return Pull((_stretch(pull),), (force_N * x, force_N * z), pull.name)


def _driven(design: Design, name: str, value: float) -> dict[str, float]:
    """Return the driven amount of a finger or a pull, keyed by its TOML key; empty if it is not driven."""
    _, driven, key = tables.driven(design)
    return {key: value} if name == driven else {}


def _supports(design: Design) -> dict[str, list[tables.Hold]]:
    """Return the tables of each support, keyed by its name."""
    supports: dict[str, list[tables.Hold]] = {}
    for hold in design.hold:
        supports.setdefault(hold.name, []).append(hold)
    return supports


def _is_clamp(design: Design, hold: tables.Hold) -> bool:
    return hold.kind == "turning" and (hold.angle_deg is not None or hold.name == tables.driven(design)[1])


def _stretch(row: tables.Hold | tables.Pull) -> Stretch:
    return Stretch(row.face, row.from_mm, row.to_mm)


def _pivot(design: Design, rest: Body, about: str | Point) -> Point:
    if about == "stem-base":
        return rest.marks["stem-base"]
    return centred_position(design, rest.emitter) if isinstance(about, str) else about
