"""The soft body of a design: its tables, its states under load, and its walls for the ray tracer.

The design's holds, fingers and pulls become supports and loads of the finite elements, with the same names. Each state
of the driven quantity is solved once and stored. The displaced walls become exact curves (`solen.geometry.displaced`).
If a finger that is not dry touches a wall, the contact has a separate wall table: light continues into the finger.

Public names: `LoadedBody` and `LoadedState`.
"""

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from solen.errors import DesignError
from solen.geometry import Body, Displaced, Touch, body_of, displaced
from solen.geometry.outline import undecentred
from solen.geometry.walls import DARK
from solen.lens import Lens
from solen.material.resin import resin_of
from solen.material.stiffness.models import model
from solen.mechanics.deformed import Contact, Deformed
from solen.mechanics.load import Hold, Load, Press, Pull, Stretch, Turn
from solen.mechanics.material import Material
from solen.mechanics.mesh import MeshOptions
from solen.mechanics.soft import SoftBody
from solen.plane import Point, heading
from solen.ranks import Caution
from solen.spec import Design, Wall
from solen.spec import soft as tables

FINGER_MM = 0.5
"""Largest depth in mm of a finger that light enters; the far end is black."""
OF_RADIUS = 0.25
"""Largest depth of a finger that light enters, as a fraction of its radius."""


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
        The design with wall tables for the parts that touch the body in this state.
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
        return self.displaced.carried.angle_deg

    @property
    def lens_turn_deg(self) -> float:
        """Rotation angle of the lens; if no face is called ``lens``, that of the part that carries the emitter."""
        return (self.displaced.lens or self.displaced.carried).angle_deg


@dataclass(frozen=True)
class LoadedBody:
    """The soft body of a loaded design, and its states by value."""

    design: Design
    rest: Body
    soft: SoftBody
    known: dict[float, LoadedState] = field(default_factory=dict, compare=False, repr=False)
    solving: Any = field(default_factory=threading.RLock, compare=False, repr=False)

    @classmethod
    def of(cls, design: Design, lens: Lens | None) -> "LoadedBody":
        """Create the soft body of a design.

        Raises
        ------
        DesignError
            If no stiffness is known.
        OutputError
            If the finite elements are not installed.
        """
        rest = body_of(design, lens)
        soft = SoftBody(
            replace(rest, front=None),  # for a lens in space, its middle section, which remains rigid
            material_of(design),
            (*_holds(design, rest), *_backings(design)),
            design.body.thickness_mm,
            design.mechanics.plane,
            MeshOptions(size_mm=design.mechanics.mesh_mm),
        )
        return cls(design, rest, soft)

    def state(self, value: float) -> LoadedState:
        """Return the state at a value of the driven quantity; raises the errors of `SoftBody.states`."""
        return self.states([value])[0]

    def states(self, values: Sequence[float]) -> list[LoadedState]:
        """Return the states at several values; states not yet stored are solved in the given order."""
        with self.solving:
            missing = [value for value in dict.fromkeys(values) if value not in self.known]
            for value, deformed in zip(missing, self.soft.states([self.loads(v) for v in missing]), strict=True):
                self.known[value] = self._lit(value, deformed)
            return [self.known[value] for value in values]

    def loads(self, value: float) -> list[Load]:
        """Return the loads at a value of the driven quantity."""
        design = self.design
        return [
            *_clamps(design, self.rest, value),
            *(_press(design, press, value) for press in design.press),
            *(_pull(design, pull, value) for pull in design.pull),
        ]

    def _lit(self, value: float, deformed: Deformed) -> LoadedState:
        """Return the state with its optical walls."""
        walls: list[Wall] = []
        touches: list[Touch] = []
        fingers = {press.name: press for press in self.design.press}
        for contact in deformed.contacts:
            wall = self._touched(fingers[contact.name], contact)
            if wall is not None:
                touches.append(Touch(contact.face, contact.u_from, contact.u_to, len(self.design.wall) + len(walls)))
                walls.append(wall)
        design = self.design.model_copy(update={"wall": (*self.design.wall, *walls)}) if walls else self.design
        moved = displaced(self.rest, deformed.walls, self.design.motion.emitter_on, touches)
        return LoadedState(value, deformed, moved, design.in_folder(self.design.folder))

    def _touched(self, finger: tables.Press, contact: Contact) -> Wall | None:
        """Return the wall table of a contact with a finger, or None if no light enters the finger."""
        face = self.rest.face(contact.face)
        own = Wall(face=face.name) if face.wall is None else self.design.wall[face.wall]
        is_dark = face.part in DARK or own.finish in ("mirror", "black")
        if finger.index is None or is_dark or not contact.u_from < contact.u_to:
            return None
        if own.finish_is_added or own.outside != "air":
            there = f'finish = "{own.finish}"' if own.finish_is_added else f'outside = "{own.outside}"'
            limit = (
                f"touches {face.name}, whose wall[{face.wall}] states {there}: the medium behind "
                "the contact is ambiguous"
            )
            remedy = "omit the index, or move the finger or the part of the wall"
            raise DesignError(f"{finger.name}.index", value=finger.index, limit=limit, remedy=remedy)
        medium = {"outside": finger.name, "index": finger.index, "absorption_per_mm": finger.absorption_per_mm}
        depth_mm = min(FINGER_MM, OF_RADIUS * finger.radius_mm)
        return own.model_copy(update={**medium, "face": face.name, "depth_mm": depth_mm, "beyond": "black"})


def material_of(design: Design) -> Material:
    """Return the soft material of a design: from its own modulus, otherwise from its resin's model or modulus.

    Raises
    ------
    DesignError
        If neither states a stiffness.
    """
    stated = design.mechanics
    if stated.modulus_MPa is not None:
        return _neo_hookean(stated.modulus_MPa, stated.poisson)
    name = design.material.resin
    stiffness = None if name is None else resin_of(name, design.resin_file).stiffness
    if stiffness is None:
        limit = "missing: a soft body needs its stiffness" + (f", and {name} states none" if name else "")
        remedy = "add modulus_MPa = 3.0, or use a resin with [stiffness], from solen resin stiffness"
        raise DesignError("mechanics.modulus_MPa", limit=limit, remedy=remedy)
    names = model(stiffness.model).names if stiffness.model else ()
    if names and set(names) <= set(stiffness.parameters):
        return Material(stiffness.model, tuple(stiffness.parameters[name] for name in names), stated.poisson)
    return _neo_hookean(stiffness.modulus_MPa, stated.poisson)


def stiffness_cautions(design: Design) -> tuple[Caution, ...]:
    """Return warnings about the stiffness of a design's resin; there are none if the design gives its own modulus."""
    name = design.material.resin
    if name is None or design.mechanics.modulus_MPa is not None:
        return ()
    return resin_of(name, design.resin_file).cautions("stiffness")


def _neo_hookean(modulus_MPa: float, poisson: float) -> Material:
    return Material.neo_hookean(modulus_MPa / (2.0 * (1.0 + poisson)), poisson)


def _holds(design: Design, rest: Body) -> Iterable[Hold]:
    """Yield the supports that do not drive the body."""
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
    """Return the driven amount of a finger or a pull by its key, or an empty dictionary if it is not driven."""
    _, driven, key = tables.driven(design)
    return {key: value} if name == driven else {}


def _supports(design: Design) -> dict[str, list[tables.Hold]]:
    """Yield the tables of each support by its name."""
    found: dict[str, list[tables.Hold]] = {}
    for hold in design.hold:
        found.setdefault(hold.name, []).append(hold)
    return found


def _is_clamp(design: Design, hold: tables.Hold) -> bool:
    return hold.kind == "turning" and (hold.angle_deg is not None or hold.name == tables.driven(design)[1])


def _stretch(row: tables.Hold | tables.Pull) -> Stretch:
    return Stretch(row.face, row.from_mm, row.to_mm)


def _pivot(design: Design, rest: Body, about: str | Point) -> Point:
    if about == "stem-base":
        return rest.marks["stem-base"]
    return undecentred(design, rest.emitter) if isinstance(about, str) else about
