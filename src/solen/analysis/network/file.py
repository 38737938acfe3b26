"""Network calibration file: the recorded states, the noise of a reading, and the parameters of the forward map.

Public names: `NetworkCalibration`, `load_network`, `is_network_file` and `text_of`.
"""

import json
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.calibration.file import OF_NETWORK, REMEDY, SCHEMA, Ambient, calibration_data, data_of_kind, tuples
from solen.analysis.network.decoder import NetworkDecoder
from solen.analysis.network.forward import ForwardMap
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import Caution
from solen.results import in_unit
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, error_context, refused

Row = tuple[Number, ...]


class MotionCheck(Strict):
    """Errors of one motion for held-out states, decoded with a calibration from the other states."""

    table: ClassVar[str] = "check"
    error: ClassVar[type[DataError]] = DataError

    motion: Text = Field(description="Name of the motion.")
    rms_deg: NotNegative = Field(description="RMS error.")
    bias_deg: Number = Field(description="Mean error.")
    worst_deg: NotNegative = Field(description="Largest error.")
    band95_deg: NotNegative = Field(description="Median width of the 95 % bands.")
    within_68: NotNegative = Field(description="Fraction of the readings within their 68 % bands.")
    within_95: NotNegative = Field(description="Fraction of the readings within their 95 % bands.")


class NetworkCalibration(Strict):
    """A calibration of a network for all its motions at once."""

    error: ClassVar[type[DataError]] = DataError

    kind: Literal["network calibration"] = Field("network calibration", description="File type.")
    solen: Text = Field(description="solen version that wrote the file.")
    sensor: str = Field(description="Network name; empty if the recording contains none.")
    simulated: bool = Field(description="Whether any recording was simulated.")
    unit: Text = Field("V", description="Unit of the readings, which replaces V in the keys.")
    ambient: Ambient | None = Field(None, description="Whether ambient light was subtracted; null if unknown.")
    motions: Annotated[tuple[Text, ...], Field(min_length=1)] = Field(description="Motion names.")
    emitters: Annotated[tuple[Text, ...], Field(min_length=1)] = Field(description="Emitter names.")
    receivers: Annotated[tuple[Text, ...], Field(min_length=1)] = Field(description="Receiver names.")
    range_deg: tuple[tuple[Number, Number], ...] = Field(description="Lowest and highest angle of each motion.")
    angle_deg: tuple[Row, ...] = Field(description="Recorded states, each a row of angles.")
    signal_V: tuple[Row, ...] = Field(
        description="Readings in each state: all receivers with the first emitter on, then with the second, and so on."
    )
    noise_V2: tuple[Row, ...] = Field(description="Covariance due to the noise of a reading.")
    reach: tuple[tuple[Positive, ...], ...] = Field(
        description="Correlation lengths of each reading's map, as fractions of the motion ranges."
    )
    scatter: tuple[Positive, ...] = Field(
        description="Variance of a state about the map, relative to the map's variance."
    )
    outside: NotNegative = Field(
        0.0, description="Squared distance from the map above which a reading is outside the map."
    )
    checks: tuple[MotionCheck, ...] = Field(
        description="Check of held-out states, decoded with a calibration from the others; empty with too few states."
    )
    words: tuple[str, ...] = Field(description="Check results in words.")
    sources: tuple[dict[str, Any], ...] = Field(description="The recordings.")
    warnings: tuple[Caution, ...] = Field(description="Limits of the calibration.")

    @model_validator(mode="after")
    def _check_consistent(self) -> Self:
        motions, readings = len(self.motions), len(self.emitters) * len(self.receivers)
        states = len(self.angle_deg)
        for name, shape in (
            ("range_deg", (motions, 2)),
            ("angle_deg", (states, motions)),
            ("signal_V", (states, readings)),
            ("noise_V2", (readings, readings)),
            ("reach", (readings, motions)),
            ("scatter", (readings,)),
        ):
            rows = getattr(self, name)
            file_shape = (len(rows), *({len(row) for row in rows} if len(shape) == 2 else ()))
            if file_shape != shape:
                raise refused(name, f"must have the shape {' x '.join(map(str, shape))}", remedy=REMEDY)
        if states < motions + 3:
            limit = f"has {states} states, but must have at least {motions + 3}"
            raise refused("angle_deg", limit, remedy=REMEDY)
        noise = np.array(self.noise_V2)
        if not np.allclose(noise, noise.T) or np.linalg.eigvalsh(noise).min() <= 0.0:
            raise refused(
                "noise_V2", "must be a covariance matrix, i.e. symmetric and positive definite", remedy=REMEDY
            )
        return self

    @cached_property
    def decoder(self) -> NetworkDecoder:
        """Decoder for readings in the order of `emitters` and `receivers`."""
        freedom = len(self.angle_deg) - len(self.motions) - 1
        return NetworkDecoder(self._map(), np.array(self.noise_V2), freedom, self.outside)

    def _map(self) -> ForwardMap:
        states, signal = np.array(self.angle_deg), np.array(self.signal_V)
        ends: FloatArray = np.array(self.range_deg).T
        return ForwardMap.through(
            states, signal, ends_deg=ends, length=np.array(self.reach), scatter=np.array(self.scatter)
        )


def text_of(file: NetworkCalibration) -> str:
    """Return the text of the calibration file."""
    data = in_unit({"schema": SCHEMA, **file.model_dump(mode="json")}, file.unit)
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def is_network_file(path: Path) -> bool:
    """Return whether a file is a network calibration; raise `DataError` if it cannot be read."""
    data = calibration_data(path)
    return isinstance(data, dict) and data.get("kind") == OF_NETWORK


def load_network(path: Path) -> NetworkCalibration:
    """Load a network calibration from a file; raise `DataError` if it cannot be read or is of another kind."""
    data = data_of_kind(path, OF_NETWORK, "is not a network calibration")
    with error_context(str(path)):
        return NetworkCalibration(**tuples(in_unit(data, "V", data.get("unit", "V"))))
