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

Ambient = Literal["subtracted", "not subtracted"]
Pair = tuple[Number, Number]
Three = tuple[Number, Number, Number]
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
    low_deg: Number | None = Field(None, description="Lowest angle visited.")
    high_deg: Number | None = Field(None, description="Highest angle.")
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
        return (
            None
            if self.u_sensitivity_deg_per_V is None
            else self.u_sensitivity_deg_per_V / abs(self.sensitivity_deg_per_V)
        )

    @property
    def shared(self) -> str:
        """Sentence about the error common to all readings."""
        line = f" and {self.off_line_deg:.1g} N" if self.off_line_deg else ""
        return (
            f"all readings of the load cell have a common error of {100.0 * (self.u_scale or 0.0):.2g} "
            f"%{line} (standard uncertainty); errors relative to its readings do not show this "
            "error, but the bands of decoded forces include it"
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
    noise_V2: tuple[Three, ...] = Field(description="Covariance of a reading due to noise.")
    repeat_V2: tuple[Three, ...] = Field(description="Covariance of a new cycle, including the error of the mean.")
    between_V2: tuple[Three, ...] = Field(description="Covariance of a new print; zero for a single print.")
    samples: tuple[NotNegative, ...] = Field(description="Number of samples used for the covariances at each angle.")

    @model_validator(mode="after")
    def _check_consistent(self) -> Self:
        size = len(self.angle_deg)
        for name in ("rising_V", "falling_V", "noise_V2", "repeat_V2", "between_V2", "samples"):
            if len(getattr(self, name)) != size:
                raise refused(name, f"must have {size} entries, one for each angle", value=len(getattr(self, name)))
        if not (np.diff(self.angle_deg) > 0.0).all():
            raise refused("angle_deg", "must ascend")
        for name in ("noise_V2", "repeat_V2", "between_V2"):
            a, b, c = np.array(getattr(self, name)).T
            if (a < 0.0).any() or (c < 0.0).any() or (b * b > a * c * (1.0 + 1e-9) + 1e-300).any():
                raise refused(name, "is not a covariance")
        return self


class Part(Strict):
    """Result of a check; errors are decoded minus true angles."""

    error: ClassVar[type[DataError]] = DataError

    name: Text = Field(description="Held-out cycles or print.")
    readings: Annotated[int, Field(ge=0)] = Field(description="Readings decoded.")
    rms_deg: NotNegative = Field(description="Root mean square error.")
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
    circuit: Circuit = Field(description="Meaning of the voltages.")
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
            noise=_square(curves.noise_V2),
            repeat=_square(curves.repeat_V2),
            between=_square(curves.between_V2),
            samples=np.array(curves.samples),
            cycles=self.cycles,
            prints=len(self.prints),
            freedom=(self.freedom_repeat, len(self.prints) - 1),
            rails_V=np.array(self.rails_V, dtype=np.float64),
            u_scale=0.0 if cell is None else cell.u_scale or 0.0,
            u_line_deg=0.0 if cell is None else cell.off_line_deg,
        )

    def keyed(self, data: dict[str, Any]) -> dict[str, Any]:
        """Plain data of the file; the keys end in the file's units."""
        return self.stimulus_of.keyed(in_unit(data, self.unit))


def curves_of(calibration: Calibration) -> Curves:
    """Curves and covariances in the form stored in the file."""
    return Curves(
        angle_deg=tuple(calibration.angle_deg.tolist()),
        rising_V=rows_as_tuples(calibration.curves_V[0]),
        falling_V=rows_as_tuples(calibration.curves_V[1]),
        noise_V2=_three(calibration.noise),
        repeat_V2=_three(calibration.repeat),
        between_V2=_three(calibration.between),
        samples=tuple(calibration.samples.tolist()),
    )


def rails_of(calibration: Calibration) -> tuple[tuple[float | None, ...], ...]:
    """Lowest and highest recordable voltages, with None for unknown values."""
    return tuple(tuple(v if math.isfinite(v) else None for v in row) for row in calibration.rails_V.tolist())


def rows_as_tuples(values: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Rows of a matrix in the form stored in a file."""
    return tuple(tuple(row) for row in values.tolist())


def _three(matrices: FloatArray) -> tuple[tuple[float, ...], ...]:
    return rows_as_tuples(matrices.reshape(-1, 4)[:, [0, 1, 3]])


def _square(rows: tuple[Three, ...]) -> FloatArray:
    return np.array(rows)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def text_of(file: CalibrationFile) -> str:
    """Text of the calibration file."""
    data = {"schema": SCHEMA, **file.model_dump(mode="json"), "curves": file.curves.model_dump(mode="json")}
    return json.dumps(file.keyed(data), indent=1, allow_nan=False) + "\n"


def calibration_data(path: Path) -> Any:
    """Read the JSON data of a sensor or network calibration file; `DataError` if the file cannot be read."""
    text = read_text(path, DataError, maker="solen bench calibrate")
    return parse_json(text, str(path), remedy="create it again with solen bench calibrate")


def data_of_kind(path: Path, kind: str, limit: str) -> dict[str, Any]:
    """Read the JSON data of a calibration file; `DataError` with the ``limit`` if its kind is not ``kind``."""
    data = calibration_data(path)
    found = data.get("kind") if isinstance(data, dict) else None
    if found != kind:
        remedy = "create one with solen bench calibrate"
        if found == OF_NETWORK:
            remedy = (
                "decode with solen bench decode, or in Python with solen.analysis.network.load_network(FILE).decoder"
            )
        raise DataError(str(path), value=found, limit=limit, remedy=remedy)
    return migrated(data, str(path), current=SCHEMA, migrations={}, error=DataError)


def load(path: Path) -> CalibrationFile:
    """Load a calibration from a file; `DataError` if it cannot be read or is not a calibration."""
    data = data_of_kind(path, KIND, "is not the calibration of a sensor")
    with error_context(str(path)):
        stimulus = STIMULI.get(str(data.get("stimulus")), ANGLE)
        return CalibrationFile(**tuples(stimulus.unkeyed(in_unit(data, "V", data.get("unit", "V")))))


def tuples(value: Any) -> Any:
    """Convert lists to the tuples that strict fields require."""
    if isinstance(value, dict):
        return {key: tuples(one) for key, one in value.items()}
    return tuple(tuples(one) for one in value) if isinstance(value, list) else value


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file."""
    found = CalibrationFile.model_json_schema()
    found["properties"]["schema"] = {"const": SCHEMA, "description": "File format version.", "type": "integer"}
    found["required"] = ["schema", *found["required"]]
    return found


def differences(ours: CalibrationFile, motion: Motion, circuit: Circuit) -> tuple[list[str], list[str]]:
    """Phrases for differences between a recording and the calibrated recording, and names of unknown conditions."""
    other, unknown = [], []
    for name, mine, theirs in (
        ("kind of motion", ours.motion.kind, motion.kind),
        ("pivot", ours.motion.pivot, motion.pivot),
        ("moving parts", ours.motion.parts, motion.parts),
    ):
        kinds = {ours.motion.kind, motion.kind}
        if (name == "pivot" and "bend" in kinds) or (name != "kind of motion" and "loaded" in kinds):
            continue
        if mine is None or theirs is None:
            unknown.append(name)
        elif _text(mine) != _text(theirs):
            other.append(f"{name} {_text(theirs)} instead of {_text(mine)}")
    press = (_pressed(ours.motion.drives), _pressed(motion.drives))
    if all(press) and press[0] != press[1]:
        other.append(f"load at {press[1]} instead of {press[0]}")
    for name, before, now, unit in (
        ("ambient light", ours.circuit.ambient, circuit.ambient, ""),
        ("emitter current", ours.circuit.emitter_current_mA, circuit.emitter_current_mA, " mA"),
        ("load resistor", ours.circuit.load_ohm, circuit.load_ohm, " ohm"),
    ):
        if before is not None and now is not None and before != now:
            other.append(f"{name} {_text(now)}{unit} instead of {_text(before)}{unit}")
    return other, unknown


def _pressed(drives: str | None) -> str | None:
    """Name of the finger, pull or clamp that is driven; depth and force of the same finger are the same motion."""
    return None if drives is None else drives.rpartition(".")[0]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return " and ".join(sorted(value)) if isinstance(value, tuple) else str(value)
