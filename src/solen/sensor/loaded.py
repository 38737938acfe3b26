"""A soft sensor under load: its response against an angle, a depth or a force, beside that of a rigid one.

The idea: every value that the motion drives is a state of the body (`solen.mechanics.design`), and its light is traced
as at an angle of any other motion. Beside it stands the rigid answer, the lens turned by as much on a body that stays
as it is, and the response in the other plane: a part lies between plane strain and plane stress, and how far they are
apart is the uncertainty of the model.

The interface: `loaded_study` of a design, `deform` for one state.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError
from solen.geometry.body import place_text
from solen.geometry.notches import Closed
from solen.mechanics.deformed import Contact, Reaction
from solen.mechanics.design import LoadedState, stiffness_cautions
from solen.mechanics.outcome import LARGE
from solen.progress import Progress
from solen.ranks import Caution, look_at
from solen.results import HIDDEN, Result, reported
from solen.sensor.readings import readings_from
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.sensor.traced import beyond, check_value
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design, Motion
from solen.spec.soft import Mechanics, driven

FEW = 3
"""Values at which the planes are compared."""
APART = 0.02
"""Contrast by which the planes may differ without a warning."""
OFF_MM = 2e-3
"""How far a wall of the light may lie from the finite elements without a warning: about 0.001 of contrast."""
SLIGHT_MM = 1e-4
"""How far walls of a closed notch may lie in each other without a warning."""
LARGE_STRAIN = 0.3
"""Strain from which on a neo-Hookean body is a guess."""


@dataclass(frozen=True)
class PlaneSpread:
    """Contrast in both planes at some values, and how far they are apart at most."""

    values: FloatArray
    strain: FloatArray
    stress: FloatArray

    @reported
    def apart(self) -> float | None:
        """Largest difference; None where every value is dark in one of the planes."""
        off = np.abs(self.strain - self.stress)
        return float(np.nanmax(off)) if np.isfinite(off).any() else None


class Deformation(Result):
    """A soft body in one state of its load.

    Attributes
    ----------
    name, drives
        Name of the design, and what its motion drives.
    angle_deg, depth_mm, force_N
        Value of that; the other two are None.
    turn_deg, shift_mm
        Turn of what carries the emitter, counter-clockwise, and where it moves the centre of the stem's base.
    strain_largest
        Largest principal strain, ln λ, in magnitude.
    reactions
        What each hold and load exerts on the body.
    contacts
        Where fingers touch it.
    off_mm
        How far a wall of the light may lie from the finite elements between their nodes.
    bulge_mm
        How far walls would lie from upright at mid-height, were the body free along y; the light meets upright ones.
    warnings
        Reasons to doubt a value.
    simulated
        Always true.
    """

    state: LoadedState = field(metadata=HIDDEN)
    sensor: Sensor = field(metadata=HIDDEN)
    name: str
    drives: str
    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None
    turn_deg: float
    shift_mm: tuple[float, float]
    strain_largest: float
    reactions: tuple[Reaction, ...]
    contacts: tuple[Contact, ...]
    off_mm: float
    bulge_mm: float
    warnings: tuple[str, ...]
    simulated: bool = True


class LoadedStudy(Result):
    """Response of a soft sensor against what its motion drives; arrays are (N,) over the values.

    Attributes
    ----------
    design
        The design studied.
    drives
        Number of the design that is driven.
    angle_deg, depth_mm, force_N
        Values of an angle, a depth and a force; of a finger both of the latter, None where the motion has none.
    moment_Nmm
        Moment of a driven clamp, about its pivot; None otherwise.
    turn_deg, lens_turn_deg
        Turn of what carries the emitter, 0 where that is the ground, and of the lens.
    rigid_contrast, rigid_refused
        Contrast of the rigid sensor whose lens has turned by as much; None where it cannot be, and why.
    receivers, voltage_V
        Names of the receivers, and what the circuit of ``[readout]`` gives at each (N, 2).
    strain_largest, off_mm
        Largest principal strain, and how far a wall of the light may lie from the finite elements.
    planes
        Contrast in both planes at some values; None where one of them has no solution.
    reactions
        Of every value, what each hold and load exerts on the body.
    warnings
        Reasons to doubt a value.
    simulated
        Always true.
    """

    sensor: Sensor = field(metadata=HIDDEN)
    response: Response = field(metadata=HIDDEN)
    states: tuple[LoadedState, ...] = field(metadata=HIDDEN)
    design: Design
    drives: str
    angle_deg: FloatArray | None
    depth_mm: FloatArray | None
    force_N: FloatArray | None
    moment_Nmm: FloatArray | None
    turn_deg: FloatArray
    lens_turn_deg: FloatArray
    rigid_contrast: FloatArray | None
    rigid_refused: str | None
    receivers: tuple[str, ...]
    voltage_V: FloatArray
    strain_largest: FloatArray
    off_mm: FloatArray
    planes: PlaneSpread | None
    reactions: tuple[tuple[Reaction, ...], ...]
    warnings: tuple[str, ...]
    simulated: bool = True

    @reported
    def right(self) -> FloatArray:
        """Power at the right receiver, as a share of the emitted power."""
        return self.response.right

    @reported
    def left(self) -> FloatArray:
        """Power at the left receiver."""
        return self.response.left

    @reported
    def u_power(self) -> FloatArray:
        """Uncertainty of both powers, of the trace alone."""
        return self.response.u_power

    @reported
    def contrast(self) -> FloatArray:
        """(R − L)/(R + L)."""
        return self.response.contrast

    @reported
    def u_contrast(self) -> FloatArray:
        """Its uncertainty, of the trace alone."""
        return self.response.u_contrast

    @property
    def values(self) -> FloatArray:
        """Values of what is driven, in its own unit."""
        return self.response.angle_deg


def deform(sensor: Sensor, value: float | None = None) -> Deformation:
    """A soft body at a value of what its motion drives, by default the last of the motion.

    Raises
    ------
    SpecError
        Where the value is none.
    DesignError
        Where the design is no loaded one, or the load is beyond what the body bears.
    """
    loaded, motion = sensor.loaded, sensor.design.motion
    value = motion.values()[-1] if value is None else value
    check_value(sensor, value)
    state = loaded.state(value)
    before, after = loaded.rest.marks["stem-base"], state.body.marks["stem-base"]
    return Deformation(
        state=state,
        sensor=sensor,
        name=sensor.design.name,
        drives=motion.drives or "",
        **motion.named(state.value),
        turn_deg=state.turn_deg,
        shift_mm=(after[0] - before[0], after[1] - before[1]),
        strain_largest=state.deformed.strain_largest,
        reactions=state.deformed.reactions,
        contacts=state.deformed.contacts,
        off_mm=state.displaced.off_mm,
        bulge_mm=state.deformed.bulge_mm,
        warnings=(*beyond(sensor, value), *stiffness_cautions(sensor.design), *_cautions([state])),
    )


def loaded_study(sensor: Sensor, progress: Progress | None = None) -> LoadedStudy:
    """Response of a soft sensor over its motion, in power; errors as of `deform`."""
    sensor.check_pair()
    values = sensor.design.motion.values()
    states = tuple(sensor.loaded.states(values))
    response = sensor.power(values, progress)
    rigid, refused = _rigid(sensor, [state.lens_turn_deg for state in states])
    planes = _planes(sensor, response)
    volts = readings_from(sensor, response)
    warnings = [
        *sensor.warnings,
        *stiffness_cautions(sensor.design),
        *keys_without_effect(sensor),
        *_cautions(states),
        *_of_planes(sensor, planes),
    ]
    return LoadedStudy(
        sensor=sensor,
        response=response,
        states=states,
        design=sensor.design,
        drives=sensor.design.motion.drives or "",
        angle_deg=_array(states, "angle_deg"),
        depth_mm=_array(states, "depth_mm"),
        force_N=_array(states, "force_N"),
        moment_Nmm=_array(states, "moment_Nmm"),
        turn_deg=np.array([state.turn_deg for state in states]),
        lens_turn_deg=np.array([state.lens_turn_deg for state in states]),
        rigid_contrast=rigid,
        rigid_refused=refused,
        receivers=volts.circuit.names,
        voltage_V=volts.voltage_V,
        strain_largest=np.array([state.deformed.strain_largest for state in states]),
        off_mm=np.array([state.displaced.off_mm for state in states]),
        planes=planes,
        reactions=tuple(state.deformed.reactions for state in states),
        warnings=tuple(dict.fromkeys(warnings)),
    )


def rigid_design(design: Design) -> Design:
    """The same design with a rigid lens that turns on a rigid body, as far as its light is concerned."""
    pivots = [hold.about for hold in design.hold if hold.name == driven(design)[1] and hold.about is not None]
    moves = ("lens",) if design.motion.emitter_on == "ground" else ("lens", "emitter")
    motion = Motion(pivot=pivots[0] if pivots else "stem-base", moves=moves)
    plain = {"motion": motion, "hold": (), "press": (), "pull": (), "mechanics": Mechanics()}
    return design.model_copy(update=plain).in_folder(design.folder)


def _rigid(sensor: Sensor, turns_deg: Sequence[float]) -> tuple[FloatArray | None, str | None]:
    """Contrast of the rigid sensor at turns of its lens, or why there is none."""
    if sensor.is_drawn:
        return None, "the body is drawn: its lens is part of it and does not turn by itself"
    rigid = replace(sensor, design=rigid_design(sensor.design))
    try:
        return rigid.power(turns_deg).contrast, None
    except SolenError as bad:
        return None, str(bad)


def _planes(sensor: Sensor, response: Response) -> PlaneSpread | None:
    """Contrast in both planes at a few values; plane stress keeps the volume."""
    design = sensor.design
    other = "stress" if design.mechanics.plane == "strain" else "strain"
    places = sorted({round(i) for i in np.linspace(0, len(response.angle_deg) - 1, FEW)})
    values = response.angle_deg[places]
    changed = design.mechanics.model_copy(update={"plane": other, "poisson": 0.5})
    there = replace(sensor, design=design.model_copy(update={"mechanics": changed}).in_folder(design.folder))
    try:
        contrast = there.power(values.tolist()).contrast
    except SolenError:
        return None
    own = response.contrast[places]
    return PlaneSpread(values, *((own, contrast) if other == "stress" else (contrast, own)))


def _array(states: Sequence[LoadedState], what: str) -> FloatArray | None:
    """Angle, depth, force or moment of what is driven in every state; None where it has none."""
    found = [_number(state, what) for state in states]
    return None if None in found else np.array(found, dtype=float)


def _number(state: LoadedState, what: str) -> float | None:
    table, name, key = driven(state.design)
    if what == key:
        return state.value
    if table == "hold" and what == "moment_Nmm":
        return next(one.moment_Nmm for one in state.deformed.reactions if one.name == name)
    touches = [one for one in state.deformed.contacts if one.name == name]
    if table == "press" and what == "force_N":
        return sum(one.force_N for one in touches)
    if table == "press" and what == "depth_mm":
        return max((one.depth_mm for one in touches), default=0.0)
    return None


def force_of(sensor: Sensor, value: float) -> float:
    """Force in N on the driven finger or pull of a soft body at a value of what its motion drives; 0 of a clamp."""
    return _number(sensor.loaded.state(value), "force_N") or 0.0


def _cautions(states: Sequence[LoadedState]) -> list[Caution | str]:
    """Warnings of the given states, each once."""
    found: list[Caution | str] = list(dict.fromkeys(text for state in states for text in state.deformed.warnings))
    strain = max(abs(state.deformed.strain_largest) for state in states)
    if LARGE_STRAIN < strain <= LARGE:  # beyond it the body says so
        found.append(look_at(f"strains reach {strain:.2f}: a modulus alone does not say how a rubber gives there"))
    off_mm = max(state.displaced.off_mm for state in states)
    if off_mm > OFF_MM:
        limit = "a wall of the light may lie that far from the finite elements between their nodes"
        found.append(look_at(f"{limit}: {off_mm:.1g} mm; set a smaller mechanics.mesh_mm"))
    notches = [one for state in states for one in state.displaced.closed if one.overlap_mm > SLIGHT_MM]
    return [*found, *([_of_notch(max(notches, key=lambda notch: notch.overlap_mm))] if notches else [])]


def _of_notch(notch: Closed) -> Caution:
    where = f"{' and '.join(notch.faces)} close their notch to {place_text(notch.at_mm)}, over {notch.length_mm:.2g} mm"
    deep = f"would lie {1e3 * notch.overlap_mm:.2g} µm in each other"
    return look_at(f"{where}, and {deep}: light meets them as one piece, and what they exert on each other is left out")


def _of_planes(sensor: Sensor, planes: PlaneSpread | None) -> list[Caution]:
    if planes is None or planes.apart is None or planes.apart <= APART:
        return []
    return [
        look_at(
            f"plane strain and plane stress differ by up to {planes.apart:.2f} in the contrast: a part of "
            f"{sensor.design.body.thickness_mm:g} mm lies in between; only a model in three dimensions could say where"
        )
    ]
