"""A soft sensor under load: its response to an angle, a depth or a force, compared with that of a rigid sensor.

Every value of the driven quantity defines a state of the body (`solen.mechanics.design`), which is traced like an angle
of any other motion. Two responses are computed for comparison: that of a rigid body whose lens rotates by the same
angle, and that of the soft body in the other plane model. A real part is between plane strain and plane stress, so the
difference between these two models indicates the model uncertainty.

Public names: `loaded_study`, `LoadedStudy`, `deform`, `Deformation` and `force_of`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError
from solen.geometry.body import point_text
from solen.geometry.notches import ClosedNotch
from solen.mechanics.deformed import Contact, Reaction
from solen.mechanics.design import LoadedState, stiffness_cautions
from solen.mechanics.outcome import MAX_FITTED_STRAIN
from solen.progress import Progress
from solen.ranks import Caution, warning
from solen.results import HIDDEN, Result, reported
from solen.sensor.readings import readings_from
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.sensor.traced import check_value, range_cautions
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design, Motion
from solen.spec.soft import Mechanics, driven

COMPARED_VALUES = 3
"""Number of values at which the plane models are compared."""
MAX_PLANE_DIFFERENCE = 0.02
"""Largest contrast difference between the plane models that causes no warning."""
MAX_WALL_ERROR_MM = 2e-3
"""Largest distance between an optical wall and the finite elements that causes no warning: about 0.001 of contrast."""
MAX_OVERLAP_MM = 1e-4
"""Largest overlap of the walls of a closed notch that causes no warning."""
LARGE_STRAIN = 0.3
"""Strain above which a modulus alone (the neo-Hookean model) is unreliable."""


@dataclass(frozen=True)
class PlaneSpread:
    """Contrast in plane strain and in plane stress at the values of a motion, and the largest difference."""

    values: FloatArray
    strain: FloatArray
    stress: FloatArray

    @reported
    def apart(self) -> float | None:
        """Largest difference between the contrasts of the two plane models.

        None if, at every value, one of the models predicts no light at the receivers.
        """
        difference = np.abs(self.strain - self.stress)
        return float(np.nanmax(difference)) if np.isfinite(difference).any() else None


class Deformation(Result):
    """A soft body in one load state.

    Attributes
    ----------
    name, drives
        Name of the design, and the quantity that its motion drives.
    angle_deg, depth_mm, force_N
        Value of that quantity; the other two are None.
    turn_deg, shift_mm
        Counter-clockwise rotation of the part that carries the emitter, and displacement of the centre of the stem's
        base.
    strain_largest
        Largest principal strain, ln λ, in magnitude.
    reactions
        Force and moment of each hold and load on the body.
    contacts
        Contacts between fingers and the body.
    off_mm
        Largest distance between an optical wall and the finite elements, between their nodes.
    bulge_mm
        Largest bulge of the walls at mid-height, if the body is free along y; rays are traced with vertical walls.
    warnings
        Reasons for uncertainty.
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
    """Response of a soft sensor to the quantity that its motion drives; arrays are (N,) over its values.

    Attributes
    ----------
    design
        The design studied.
    drives
        Key of the number that is driven.
    angle_deg, depth_mm, force_N
        Values of the driven angle, depth or force, and for a finger both depth and force; the others are None.
    moment_Nmm
        Moment of a driven clamp, about its pivot; None otherwise.
    turn_deg, lens_turn_deg
        Rotation of the part that carries the emitter, 0 if the emitter is on the ground, and rotation of the lens.
    rigid_contrast, rigid_refused
        Contrast of the rigid sensor with the lens rotated by the same angle; None with the reason if there is none.
    receivers, voltage_V
        Names of the receivers, and their voltages (N, 2) in the circuit of ``[readout]``.
    strain_largest, off_mm
        Largest principal strain, and largest distance between an optical wall and the finite elements.
    planes
        Contrast in both plane models at a few of the values; None if one of the models has no solution.
    reactions
        For every value, the force and moment of each hold and load on the body.
    warnings
        Reasons for uncertainty.
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
        """Power (N,) at the right receiver, as a fraction of the emitted power."""
        return self.response.right

    @reported
    def left(self) -> FloatArray:
        """Power (N,) at the left receiver, as a fraction of the emitted power."""
        return self.response.left

    @reported
    def u_power(self) -> FloatArray:
        """Uncertainty of both powers due to the trace alone."""
        return self.response.u_power

    @reported
    def contrast(self) -> FloatArray:
        """Contrast (R − L)/(R + L)."""
        return self.response.contrast

    @reported
    def u_contrast(self) -> FloatArray:
        """Uncertainty of the contrast due to the trace alone."""
        return self.response.u_contrast

    @property
    def values(self) -> FloatArray:
        """Values (N,) of the driven quantity, in its unit."""
        return self.response.angle_deg


def deform(sensor: Sensor, value: float | None = None) -> Deformation:
    """Return a soft body at a value of the quantity that its motion drives, by default the last value of the motion.

    Raises
    ------
    SpecError
        If the value is invalid.
    DesignError
        If the design is not loaded, or the body cannot bear the load.
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
        **motion.keyed(state.value),
        turn_deg=state.turn_deg,
        shift_mm=(after[0] - before[0], after[1] - before[1]),
        strain_largest=state.deformed.strain_largest,
        reactions=state.deformed.reactions,
        contacts=state.deformed.contacts,
        off_mm=state.displaced.deviation_mm,
        bulge_mm=state.deformed.bulge_mm,
        warnings=(*range_cautions(sensor, value), *stiffness_cautions(sensor.design), *_cautions([state])),
    )


def loaded_study(sensor: Sensor, progress: Progress | None = None) -> LoadedStudy:
    """Return the response of a soft sensor over its motion, in power; raise the errors of `deform`."""
    sensor.check_pair()
    values = sensor.design.motion.values()
    states = tuple(sensor.loaded.states(values))
    response = sensor.power(values, progress)
    rigid, reason = _rigid(sensor, [state.lens_turn_deg for state in states])
    planes = _planes(sensor, response)
    readings = readings_from(sensor, response)
    warnings = [
        *sensor.warnings,
        *stiffness_cautions(sensor.design),
        *keys_without_effect(sensor),
        *_cautions(states),
        *_plane_cautions(sensor, planes),
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
        rigid_refused=reason,
        receivers=readings.circuit.names,
        voltage_V=readings.voltage_V,
        strain_largest=np.array([state.deformed.strain_largest for state in states]),
        off_mm=np.array([state.displaced.deviation_mm for state in states]),
        planes=planes,
        reactions=tuple(state.deformed.reactions for state in states),
        warnings=tuple(dict.fromkeys(warnings)),
    )


def rigid_design(design: Design) -> Design:
    """Return the design with a rigid body, on which the lens rotates."""
    pivots = [hold.about for hold in design.hold if hold.name == driven(design)[1] and hold.about is not None]
    moves = ("lens",) if design.motion.emitter_on == "ground" else ("lens", "emitter")
    motion = Motion(pivot=pivots[0] if pivots else "stem-base", moves=moves)
    plain = {"motion": motion, "hold": (), "press": (), "pull": (), "mechanics": Mechanics()}
    return design.model_copy(update=plain).in_folder(design.folder)


def _rigid(sensor: Sensor, turns_deg: Sequence[float]) -> tuple[FloatArray | None, str | None]:
    """Return the contrast of the rigid sensor for rotations of its lens, or the reason why there is none."""
    if sensor.is_drawn:
        return None, "the body is drawn: its lens is part of it and cannot rotate separately"
    rigid = replace(sensor, design=rigid_design(sensor.design))
    try:
        return rigid.power(turns_deg).contrast, None
    except SolenError as error:
        return None, str(error)


def _planes(sensor: Sensor, response: Response) -> PlaneSpread | None:
    """Return the contrast at a few values in the design's plane model and, for an incompressible body, the other."""
    design = sensor.design
    other = "stress" if design.mechanics.plane == "strain" else "strain"
    indices = sorted({round(i) for i in np.linspace(0, len(response.angle_deg) - 1, COMPARED_VALUES)})
    values = response.angle_deg[indices]
    changed = design.mechanics.model_copy(update={"plane": other, "poisson": 0.5})
    other_sensor = replace(sensor, design=design.model_copy(update={"mechanics": changed}).in_folder(design.folder))
    try:
        other_contrast = other_sensor.power(values.tolist()).contrast
    except SolenError:
        return None
    contrast = response.contrast[indices]
    return PlaneSpread(values, *((contrast, other_contrast) if other == "stress" else (other_contrast, contrast)))


def _array(states: Sequence[LoadedState], key: str) -> FloatArray | None:
    """Return the angle, depth, force or moment of the driven part in every state; None if it has none."""
    values = [_number(state, key) for state in states]
    return None if None in values else np.array(values, dtype=float)


def _number(state: LoadedState, key: str) -> float | None:
    table, name, driven_key = driven(state.design)
    if key == driven_key:
        return state.value
    if table == "hold" and key == "moment_Nmm":
        return next(reaction.moment_Nmm for reaction in state.deformed.reactions if reaction.name == name)
    contacts = [contact for contact in state.deformed.contacts if contact.name == name]
    if table == "press" and key == "force_N":
        return sum(contact.force_N for contact in contacts)
    if table == "press" and key == "depth_mm":
        return max((contact.depth_mm for contact in contacts), default=0.0)
    return None


def force_of(sensor: Sensor, value: float) -> float:
    """Return the force in N on the driven finger or pull at a value of the motion; 0 for a clamp."""
    return _number(sensor.loaded.state(value), "force_N") or 0.0


def _cautions(states: Sequence[LoadedState]) -> list[Caution | str]:
    """Return the warnings of several states, without duplicates."""
    cautions: list[Caution | str] = list(dict.fromkeys(text for state in states for text in state.deformed.warnings))
    strain = max(abs(state.deformed.strain_largest) for state in states)
    if LARGE_STRAIN < strain <= MAX_FITTED_STRAIN:  # larger strains are among the warnings of the states
        text = f"strains reach {strain:.2f}, at which a modulus alone does not determine the deformation of a rubber"
        cautions.append(warning(text))
    off_mm = max(state.displaced.deviation_mm for state in states)
    if off_mm > MAX_WALL_ERROR_MM:
        text = f"the optical walls deviate from the finite elements by up to {off_mm:.1g} mm between the nodes"
        cautions.append(warning(f"{text}; set a smaller mechanics.mesh_mm"))
    notches = [
        notch for state in states for notch in state.displaced.closed_notches if notch.overlap_mm > MAX_OVERLAP_MM
    ]
    return [*cautions, *([_notch_caution(max(notches, key=lambda notch: notch.overlap_mm))] if notches else [])]


def _notch_caution(notch: ClosedNotch) -> Caution:
    return warning(
        f"{' and '.join(notch.faces)} close the notch between them as far as {point_text(notch.at_mm)}, over "
        f"{notch.length_mm:.2g} mm, and would overlap by {1e3 * notch.overlap_mm:.2g} µm: light passes between them as "
        "in one body, and their contact force is neglected"
    )


def _plane_cautions(sensor: Sensor, planes: PlaneSpread | None) -> list[Caution]:
    if planes is None or planes.apart is None or planes.apart <= MAX_PLANE_DIFFERENCE:
        return []
    return [
        warning(
            f"the contrasts in plane strain and in plane stress differ by up to {planes.apart:.2f}: a part with a "
            f"thickness of {sensor.design.body.thickness_mm:g} mm is between the two, and only a three-dimensional "
            "model could predict its response"
        )
    ]
