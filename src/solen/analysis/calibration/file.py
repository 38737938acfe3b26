"""Calibration file: curves and covariances, motion and circuit, sources and checks.

Public names: `CalibrationFile`, `load`, `text_of`, `Motion`, `Circuit` and `differences`.
"""

import json
import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.calibration.estimate import Calibration
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.files import read_text
from solen.ranks import Caution
from solen.recording.stimulus import ANGLE, STIMULI, Name, Stimulus
from solen.results import in_unit
from solen.spec.objects import parse_json
from solen.spec.strict import NotNegative, Number, Strict, Text, error_context, migrated, refused

SCHEMA = 1
SUFFIX = ".calibration.json"
KIND, OF_NETWORK = "calibration", "network calibration"
REMEDY = "create the file again with solen bench calibrate"

Ambient = Literal["subtracted", "not subtracted"]
Pair = tuple[Number, Number]
Covariance = tuple[Number, Number, Number]
"""Variance of the left receiver, covariance, variance of the right receiver."""
Column = Annotated[tuple[Number, ...], Field(min_length=5, max_length=100_000)]


class Motion(Strict):
    """Kind and range of the motion of the calibrated recording."""

    table: ClassVar[str] = "motion"
    error: ClassVar[type[DataError]] = DataError

    kind: Literal["rotation", "bend", "loaded"] | None = Field(
        None, description="rotation, bend or loaded; null if unknown."
    )
    drives: Text | None = Field(None, description="For a loaded sensor: the driven quantity, such as press.depth_mm.")
    pivot: Text | None = Field(None, description="Centre of rotation: stem-base, emitter, or x z in mm.")
    parts: tuple[Text, ...] | None = Field(None, description="Moving parts: lens, emitter, receivers, mirrors.")
    low_deg: Number | None = Field(None, description="Smallest angle of the motion.")
    high_deg: Number | None = Field(None, description="Largest angle of the motion.")
    speed_deg_per_s: Number | None = Field(None, description="Median ramp speed.")
    protocol: Text | None = Field(None, description="Protocol name.")


class Cell(Strict):
    """Load cell that measured the forces, and the errors common to all its readings."""

    table: ClassVar[str] = "load_cell"
    error: ClassVar[type[DataError]] = DataError

    name: Text = Field(description="Name of the load cell.")
    sensitivity_deg_per_V: Number = Field(description="Sensitivity in N/V.")
    u_sensitivity_deg_per_V: NotNegative | None = Field(
        None, description="Uncertainty of the sensitivity; null if unknown."
    )
    off_line_deg: NotNegative = Field(0.0, description="Standard uncertainty due to non-linearity.")

    @property
    def u_scale(self) -> float | None:
        """Relative standard uncertainty of the scale."""
        u = self.u_sensitivity_deg_per_V
        return None if u is None else u / abs(self.sensitivity_deg_per_V)

    @property
    def shared(self) -> str:
        """Sentence about the errors common to all readings."""
        line = f" and {self.off_line_deg:.1g} N" if self.off_line_deg else ""
        return (
            f"all readings of the load cell share an error with a standard uncertainty of "
            f"{100.0 * (self.u_scale or 0.0):.2g} %{line}, which errors relative to the load cell do not include but "
            "the bands of decoded forces do"
        )


class Circuit(Strict):
    """Circuit with which the voltages were measured."""

    table: ClassVar[str] = "circuit"
    error: ClassVar[type[DataError]] = DataError

    ambient: Ambient | None = Field(None, description="Whether ambient light was subtracted from the voltages.")
    emitter_current_mA: Number | None = Field(None, description="Emitter current, from the design.")
    load_ohm: Number | None = Field(None, description="Receiver load resistance, from the design.")
    design_sha256: Text | None = Field(None, description="Checksum of the design file text.")


class Curves(Strict):
    """Voltages at each angle; each pair is (left, right)."""

    table: ClassVar[str] = "curves"
    error: ClassVar[type[DataError]] = DataError

    angle_deg: Column = Field(description="Angles, ascending, in degrees.")
    rising_V: tuple[Pair, ...] = Field(description="Mean of the rising half-cycles.")
    falling_V: tuple[Pair, ...] = Field(description="Mean of the falling half-cycles.")
    noise_V2: tuple[Covariance, ...] = Field(description="Covariance due to the noise of a reading.")
    repeat_V2: tuple[Covariance, ...] = Field(
        description="Covariance due to a new cycle, including the error of the mean."
    )
    between_V2: tuple[Covariance, ...] = Field(description="Covariance due to a new print; zero for a single print.")
    samples: tuple[NotNegative, ...] = Field(description="Number of samples used for the covariances at each angle.")

    @model_validator(mode="after")
    def _check_consistent(self) -> Self:
        size = len(self.angle_deg)
        for name in ("rising_V", "falling_V", "noise_V2", "repeat_V2", "between_V2", "samples"):
            if len(getattr(self, name)) != size:
                limit = f"has {len(getattr(self, name))} entries, but must have {size}, one for each angle"
                raise refused(name, limit, remedy=REMEDY)
        if not (np.diff(self.angle_deg) > 0.0).all():
            raise refused("angle_deg", "must be in ascending order", remedy=REMEDY)
        for name in ("noise_V2", "repeat_V2", "between_V2"):
            left, covariance, right = np.array(getattr(self, name)).T
            negative = (left < 0.0).any() or (right < 0.0).any()
            if negative or (covariance**2 > left * right * (1.0 + 1e-9) + 1e-300).any():
                raise refused(name, "must be covariance matrices, i.e. positive semidefinite", remedy=REMEDY)
        return self


class Part(Strict):
    """Result of a check; errors are decoded minus true angles."""

    error: ClassVar[type[DataError]] = DataError

    name: Text = Field(description="Held-out cycles or print.")
    readings: Annotated[int, Field(ge=0)] = Field(description="Number of readings decoded.")
    rms_deg: NotNegative = Field(description="RMS error.")
    bias_deg: Number = Field(description="Mean error.")
    worst_deg: NotNegative = Field(description="Largest error.")
    within_68: NotNegative = Field(description="Fraction of the readings within their 68 % bands.")
    within_95: NotNegative = Field(description="Fraction of the readings within their 95 % bands.")
    outside: NotNegative = Field(description="Fraction of the readings that match no point on the curve.")
    ambiguous: NotNegative = Field(description="Fraction of the readings that match several points.")


class Checked(Strict):
    """Result of a check, in total and for each part."""

    error: ClassVar[type[DataError]] = DataError

    whole: Part = Field(description="All readings.")
    parts: tuple[Part, ...] = Field(description="Results for each held-out cycle or print.")


class CalibrationFile(Strict):
    """A calibration of one sensor, or of several prints pooled into one."""

    error: ClassVar[type[DataError]] = DataError

    kind: Literal["calibration"] = Field("calibration", description="File type.")
    solen: Text = Field(description="solen version that wrote the file.")
    sensor: Text = Field(description="Name of the sensor, or of the pooled prints.")
    prints: tuple[Text, ...] = Field(description="Calibrated sensors.")
    simulated: bool = Field(description="Whether any recording was simulated.")
    cycles: Annotated[int, Field(ge=2)] = Field(description="Number of cycles used, summed over all prints.")
    unit: Text = Field("V", description="Unit of the receiver readings, which replaces V in the keys.")
    stimulus: Name = Field(
        "angle", description="Decoded quantity; for a force or depth, keys end in N or mm instead of deg."
    )
    load_cell: Cell | None = Field(None, description="Load cell that measured the forces; null if unknown.")
    range_deg: Pair = Field(description="Lowest and highest calibrated angle.")
    freedom_repeat: Annotated[int, Field(ge=1)] = Field(description="Degrees of freedom of repeat_V2.")
    rails_V: tuple[tuple[Number | None, Number | None], tuple[Number | None, Number | None]] = Field(
        description="Lowest and highest left and right voltages at which readings were clipped; "
        "null if none were clipped."
    )
    dark_V: Number | None = Field(None, description="Voltage without light; null if unknown.")
    motion: Motion = Field(description="Moving parts, and range of motion.")
    circuit: Circuit = Field(description="Circuit with which the voltages were measured.")
    curves: Curves = Field(exclude=True, description="Voltages at each angle, and their covariances.")
    leave_one_cycle_out: Checked | None = Field(
        description="Each cycle decoded with a calibration from the other cycles; null with two cycles."
    )
    leave_one_sensor_out: Checked | None = Field(
        description="Each print decoded with a calibration from the other prints; null with fewer than three prints."
    )
    words: tuple[str, ...] = Field(description="Check results in words.")
    sources: tuple[dict[str, Any], ...] = Field(description="The recordings.")
    warnings: tuple[Caution, ...] = Field(description="Limits of the calibration.")

    @property
    def stimulus_of(self) -> Stimulus:
        """The decoded quantity."""
        return STIMULI[self.stimulus]

    @property
    def calibration(self) -> Calibration:
        """The calibration as arrays."""
        curves, cell = self.curves, self.load_cell
        return Calibration(
            angle_deg=np.array(curves.angle_deg),
            curves_V=np.array([curves.rising_V, curves.falling_V]),
            noise=_matrices(curves.noise_V2),
            repeat=_matrices(curves.repeat_V2),
            between=_matrices(curves.between_V2),
            samples=np.array(curves.samples),
            cycles=self.cycles,
            prints=len(self.prints),
            freedom=(self.freedom_repeat, len(self.prints) - 1),
            rails_V=np.array(self.rails_V, dtype=np.float64),
            u_scale=0.0 if cell is None else cell.u_scale or 0.0,
            u_line_deg=0.0 if cell is None else cell.off_line_deg,
        )

    def keyed(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return the plain data of the file; the keys end in the file's units."""
        return self.stimulus_of.keyed(in_unit(data, self.unit))


def curves_of(calibration: Calibration) -> Curves:
    """Return the curves and covariances in the form stored in the file."""
    return Curves(
        angle_deg=tuple(calibration.angle_deg.tolist()),
        rising_V=rows_as_tuples(calibration.curves_V[0]),
        falling_V=rows_as_tuples(calibration.curves_V[1]),
        noise_V2=_triples(calibration.noise),
        repeat_V2=_triples(calibration.repeat),
        between_V2=_triples(calibration.between),
        samples=tuple(calibration.samples.tolist()),
    )


def rails_of(calibration: Calibration) -> tuple[tuple[float | None, ...], ...]:
    """Return the lowest and highest recordable voltages, with None for unknown values."""
    return tuple(tuple(v if math.isfinite(v) else None for v in row) for row in calibration.rails_V.tolist())


def rows_as_tuples(values: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Return the rows of a matrix in the form stored in a file."""
    return tuple(tuple(row) for row in values.tolist())


def _triples(matrices: FloatArray) -> tuple[tuple[float, ...], ...]:
    return rows_as_tuples(matrices.reshape(-1, 4)[:, [0, 1, 3]])


def _matrices(rows: tuple[Covariance, ...]) -> FloatArray:
    return np.array(rows)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def text_of(file: CalibrationFile) -> str:
    """Return the text of the calibration file."""
    data = {"schema": SCHEMA, **file.model_dump(mode="json"), "curves": file.curves.model_dump(mode="json")}
    return json.dumps(file.keyed(data), indent=1, allow_nan=False) + "\n"


def calibration_data(path: Path) -> Any:
    """Read the JSON data of a sensor or network calibration file; raise `DataError` if the file cannot be read."""
    return parse_json(read_text(path, DataError, maker="solen bench calibrate"), str(path), remedy=REMEDY)


def data_of_kind(path: Path, kind: str, limit: str) -> dict[str, Any]:
    """Read the JSON data of a calibration file; raise `DataError` with the ``limit`` if it is of another kind."""
    data = calibration_data(path)
    file_kind = data.get("kind") if isinstance(data, dict) else None
    if file_kind != kind:
        remedy = "create one with solen bench calibrate"
        if file_kind == OF_NETWORK:
            remedy = "use solen bench decode, or in Python solen.analysis.network.load_network(FILE).decoder"
        raise DataError(str(path), value=file_kind, limit=limit, remedy=remedy)
    return migrated(data, str(path), current=SCHEMA, migrations={}, error=DataError)


def load(path: Path) -> CalibrationFile:
    """Load a calibration from a file; raise `DataError` if it cannot be read or is not a calibration."""
    data = data_of_kind(path, KIND, "is not the calibration of a sensor")
    with error_context(str(path)):
        stimulus = STIMULI.get(str(data.get("stimulus")), ANGLE)
        return CalibrationFile(**tuples(stimulus.unkeyed(in_unit(data, "V", data.get("unit", "V")))))


def tuples(value: Any) -> Any:
    """Convert lists to the tuples that strict fields require."""
    if isinstance(value, dict):
        return {key: tuples(item) for key, item in value.items()}
    return tuple(tuples(item) for item in value) if isinstance(value, list) else value


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the file."""
    schema = CalibrationFile.model_json_schema()
    schema["properties"]["schema"] = {"const": SCHEMA, "description": "File format version.", "type": "integer"}
    schema["required"] = ["schema", *schema["required"]]
    return schema


def differences(file: CalibrationFile, motion: Motion, circuit: Circuit) -> tuple[list[str], list[str]]:
    """Return phrases for the differences of a recording from the calibration, and names of unknown conditions."""
    different, unknown = [], []
    kinds = {file.motion.kind, motion.kind}
    for name, calibrated, recorded in (
        ("kind of motion", file.motion.kind, motion.kind),
        ("pivot", file.motion.pivot, motion.pivot),
        ("moving parts", file.motion.parts, motion.parts),
    ):
        if (name == "pivot" and "bend" in kinds) or (name != "kind of motion" and "loaded" in kinds):
            continue
        if calibrated is None or recorded is None:
            unknown.append(name)
        elif _text(calibrated) != _text(recorded):
            different.append(f"{name} {_text(recorded)} instead of {_text(calibrated)}")
    calibrated_load, recorded_load = _driven_load(file.motion.drives), _driven_load(motion.drives)
    if calibrated_load and recorded_load and calibrated_load != recorded_load:
        different.append(f"load at {recorded_load} instead of {calibrated_load}")
    for name, before, now, unit in (
        ("ambient light", file.circuit.ambient, circuit.ambient, ""),
        ("emitter current", file.circuit.emitter_current_mA, circuit.emitter_current_mA, " mA"),
        ("load resistor", file.circuit.load_ohm, circuit.load_ohm, " ohm"),
    ):
        if before is not None and now is not None and before != now:
            different.append(f"{name} {_text(now)}{unit} instead of {_text(before)}{unit}")
    return different, unknown


def _driven_load(drives: str | None) -> str | None:
    """Return the name of the driven finger, pull or clamp, without whether its depth or its force is driven."""
    return None if drives is None else drives.rpartition(".")[0]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return " and ".join(sorted(value)) if isinstance(value, tuple) else str(value)
