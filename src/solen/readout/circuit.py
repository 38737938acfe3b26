"""The complete circuit of a design: the emitter, a phototransistor and a load for each receiver, and the ADC.

Parts have typical values and tolerances. A `Circuit` is one set of parts; `cases_of` returns the set with typical parts
and the sets with the weakest and the strongest emitter and receivers, and `Circuit.drawn` a random set.

Assumptions: the irradiance is uniform over a receiver's face, so the position of the receiver on the face does not
matter; and the receiver responds as if it were in air.

Public names: `circuit_of`, `cases_of`, `face_areas_mm2` and `Circuit`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from solen.arrays import FloatArray
from solen.curve import ArcLength
from solen.errors import DataError, SpecError
from solen.geometry import Body
from solen.parts import AdcPart, EmitterPart, Part, ReceiverPart, TrimmerPart, library_part, light_of, load_part
from solen.readout.adc import Adc
from solen.readout.emitter import REFERENCE_C, Drive
from solen.readout.transistor import LoadLine, Phototransistor, load_line
from solen.results import reported
from solen.spec import Design

Floats = float | FloatArray

Case = Literal["dimmest", "typical", "brightest"]
MM2_PER_CM2 = 100.0
NOISE_PER_CORNER = 0.5 * np.pi
"""Noise bandwidth of a first-order filter relative to its 3 dB frequency."""
DEFAULT_EMITTER = "VSMY1850"

_P = TypeVar("_P", bound=Part)


@dataclass(frozen=True)
class Circuit:
    """An emitter and R receivers.

    Attributes
    ----------
    names
        Receiver names.
    area_mm2
        Areas of the receiver faces; power fractions refer to all light through a face.
    drive, transistor, adc
        The emitter at its current, the receiver type, and the ADC.
    sensitivity_uA
        Current of each receiver at 1 mW/cm² of the datasheet's wavelength.
    load_ohm
        Load resistance of each receiver.
    supply_V
        Supply voltage of the loads.
    samples
        Number of samples averaged in a reading.
    rate_hz
        Readings per second from one emitter.
    """

    names: tuple[str, ...]
    area_mm2: tuple[float, ...]
    drive: Drive
    transistor: Phototransistor
    adc: Adc
    sensitivity_uA: tuple[float, ...]
    load_ohm: tuple[float, ...]
    supply_V: float
    samples: int = 1
    rate_hz: float = 200.0

    def __post_init__(self) -> None:
        for name in ("area_mm2", "sensitivity_uA", "load_ohm"):
            values = getattr(self, name)
            if len(values) != len(self.names) or not all(0.0 < value < np.inf for value in values):
                limit = f"must be {len(self.names)} positive numbers, one for each receiver"
                raise SpecError(name, value=list(values), limit=limit)

    def irradiance_mW_cm2(self, power_fraction: FloatArray, temperature_C: Floats = REFERENCE_C) -> FloatArray:
        """Return the mean irradiance of the faces (..., R) for fractions (..., R) of the emitted power."""
        per_fraction = _column(self.drive.power_mW(temperature_C), power_fraction)
        return np.asarray(power_fraction * per_fraction / (np.array(self.area_mm2) / MM2_PER_CM2))

    def current_mA(
        self,
        power_fraction: FloatArray,
        ambient_mW_cm2: Floats = 0.0,
        temperature_C: Floats = REFERENCE_C,
    ) -> FloatArray:
        """Return the currents (..., R) that the light generates, including dark current.

        ``ambient_mW_cm2`` is the equivalent irradiance at the wavelength for which the sensitivity is specified; it and
        ``temperature_C`` are a single number, one per row (...,), or one per reading (..., R).
        """
        light = self.transistor.response * self.irradiance_mW_cm2(power_fraction, temperature_C)
        ambient, temperature = _column(ambient_mW_cm2, power_fraction), _column(temperature_C, power_fraction)
        return self.transistor.current_mA(light + ambient, np.array(self.sensitivity_uA), temperature)

    def load_line(self, current_mA: FloatArray) -> LoadLine:
        """Return the operating points (..., R) for photocurrents (..., R)."""
        transistor, loads = self.transistor, np.array(self.load_ohm)
        return load_line(current_mA, loads, self.supply_V, transistor.saturation_V, transistor.knee_V)

    def slope_V(
        self, power_fraction: FloatArray, ambient_mW_cm2: Floats = 0.0, temperature_C: Floats = REFERENCE_C
    ) -> FloatArray:
        """Return the change of the voltages (..., R) per fraction of the emitted power; negative for all receivers."""
        ends = (np.ones_like(power_fraction), np.zeros_like(power_fraction))
        lit, dark = (self.current_mA(end, ambient_mW_cm2, temperature_C) for end in ends)
        line = self.load_line(self.current_mA(power_fraction, ambient_mW_cm2, temperature_C))
        return np.asarray(-1e-3 * (lit - dark) * line.drive_ohm)

    @reported
    def time_constant_us(self) -> FloatArray:
        """Time constant of each receiver (R,), in µs."""
        return self.transistor.time_constant_us(np.array(self.load_ohm))

    @reported
    def noise_bandwidth_hz(self) -> FloatArray:
        """Noise bandwidth (R,) of receiver and load, or of the ADC input if that is lower."""
        corner_hz = 1e6 / (2.0 * np.pi * self.time_constant_us)
        return np.asarray(NOISE_PER_CORNER * np.minimum(corner_hz, 1e3 * self.adc.bandwidth_kHz))

    def drawn(self, rng: np.random.Generator) -> "Circuit":
        """Return a copy with random parts.

        Each sensitivity and the emitter power are uniformly distributed between their datasheet limits.
        """
        part, drive = self.transistor, self.drive
        sensitivities = rng.uniform(part.min_uA, part.max_uA, len(self.names))
        power = float(rng.uniform(drive.min_mW, drive.max_mW))
        return replace(self, sensitivity_uA=tuple(sensitivities.tolist()), drive=replace(drive, typical_mW=power))

    def with_load(self, load_ohm: float) -> "Circuit":
        """Return a copy with a new load, the same at every receiver."""
        return replace(self, load_ohm=(load_ohm,) * len(self.names))


def circuit_of(design: Design, area_mm2: Mapping[str, float]) -> Circuit:
    """Return the circuit of a design with typical parts.

    Parameters
    ----------
    design
        Design with its ``[readout]`` and its emitter's light.
    area_mm2
        Face area of each receiver, keyed by name, from `face_areas_mm2`.

    Raises
    ------
    DataError
        If a part is not found, cannot be read or is of the wrong kind.
    SpecError
        If the ADC does not have the requested range.
    """
    readout = design.readout
    part = named_part(design, "part", ReceiverPart)
    transistor = Phototransistor.of(part, light_of(design))
    return Circuit(
        names=tuple(area_mm2),
        area_mm2=tuple(area_mm2.values()),
        drive=Drive.of(emitter_part(design), readout.emitter_current_ma),
        transistor=transistor,
        adc=Adc.of(named_part(design, "adc", AdcPart), readout.supply_v, readout.adc_range_v),
        sensitivity_uA=(transistor.typical_uA,) * len(area_mm2),
        load_ohm=(readout.load_ohm,) * len(area_mm2),
        supply_V=readout.supply_v,
        samples=readout.samples,
        rate_hz=readout.rate_hz,
    )


def cases_of(circuit: Circuit) -> dict[Case, Circuit]:
    """Return the circuits with the weakest, typical and strongest emitter and receivers, keyed by `Case`."""
    part, drive, count = circuit.transistor, circuit.drive, len(circuit.names)
    ends: dict[Case, tuple[float, float]] = {
        "dimmest": (part.min_uA, drive.min_mW),
        "brightest": (part.max_uA, drive.max_mW),
    }
    cases = {
        case: replace(circuit, sensitivity_uA=(uA,) * count, drive=replace(drive, typical_mW=mW))
        for case, (uA, mW) in ends.items()
    }
    return {"dimmest": cases["dimmest"], "typical": circuit, "brightest": cases["brightest"]}


def emitter_part(design: Design) -> EmitterPart:
    """Return the emitter that determines the power: of the readout, otherwise of the light source or the paper."""
    if design.readout.emitter_part is not None:
        return named_part(design, "emitter_part", EmitterPart)
    name = design.emitter.part or DEFAULT_EMITTER
    path = design.named_file(name)
    return _of_kind("emitter.part", library_part(name) if path is None else load_part(path), EmitterPart)


def trimmer_part(design: Design) -> TrimmerPart:
    """Return the trimmer that sets the loads."""
    return named_part(design, "trimmer", TrimmerPart)


def named_part(design: Design, key: str, kind: type[_P]) -> _P:
    """Return the part that a readout key names; raise `DataError` if it is of the wrong kind."""
    name = getattr(design.readout, key)
    path = design.named_file(name)
    return _of_kind(f"readout.{key}", library_part(name) if path is None else load_part(path), kind)


def _of_kind(key: str, part: Part, kind: type[_P]) -> _P:
    if not isinstance(part, kind):
        required = kind.__name__.removesuffix("Part").lower()
        article = "an" if required[0] in "aeiou" else "a"
        raise DataError(key, value=part.name, limit=f"is of kind {part.kind}, but {article} {required} is required")
    return part


def face_areas_mm2(design: Design, body: Body) -> dict[str, float]:
    """Return the face area of each receiver: its length in the plane times its height (default: the body's)."""
    height = design.receivers.height_mm or design.body.thickness_mm
    areas: dict[str, float] = {}
    for face in (*body.all_faces, *body.separate):
        if face.part == "receiver":
            areas[face.label] = areas.get(face.label, 0.0) + ArcLength(face.curve).length_mm * height
    return dict(sorted(areas.items(), reverse=True))


def _column(values: Floats, readings: FloatArray) -> FloatArray:
    """Return numbers per row as a column that broadcasts with readings (..., R); other shapes are unchanged."""
    column = np.asarray(values, dtype=float)
    return column[..., None] if 0 < column.ndim < np.ndim(readings) else column
