"""Base class of the stream decoders: counts of readings and their flags, and warnings about the flags.

Public name: `CountedStream`.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Generic, Protocol, TypeVar

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.files import SIMULATED_DATA
from solen.ranks import DO_NOT_USE, Caution, rank_of, warning
from solen.recording import Provenance

_MAX_RATIO = 100.0  # ratio to the largest calibrated reading above which readings must be in another unit
_MIN_PERCENT = 0.5  # smallest percentage of the readings with a flag that causes a warning


class _AnyCalibration(Protocol):
    """Attributes common to the calibrations of sensors and networks."""

    @property
    def simulated(self) -> bool: ...

    @property
    def unit(self) -> str: ...


C = TypeVar("C", bound=_AnyCalibration)


class CountedStream(Generic[C]):
    """Counts of a stream's readings, decoded with a calibration.

    Parameters
    ----------
    calibration, file
        The calibration, and the name of its file.
    source, provenance
        Name of the stream in error messages, and its file; None if lines are read.
    largest
        Largest calibrated reading.
    flags
        Names of the flags that are counted.
    """

    warnings: tuple[Caution, ...]

    def __init__(
        self,
        calibration: C,
        file: str,
        source: str,
        provenance: Provenance | None,
        largest: float,
        flags: tuple[str, ...],
    ) -> None:
        self._calibration, self._file, self._source = calibration, file, source
        self._provenance, self._largest = provenance, largest
        self._times_s = (math.nan, math.nan)
        self.counts = dict.fromkeys(("readings", "missing", *flags), 0)

    @property
    def header(self) -> str:
        """Header line with the column names."""
        raise NotImplementedError

    @property
    def heading(self) -> str:
        """First lines of an output file: comments on simulated or unusable data, and the header."""
        reasons = dict.fromkeys(caution for caution in self.warnings if rank_of(caution) == DO_NOT_USE)
        return SIMULATED_DATA * self._simulated + "".join(f"# {reason}\n" for reason in reasons) + self.header

    @property
    def _simulated(self) -> bool:
        return self._calibration.simulated or (self._provenance is not None and self._provenance.simulated)

    def _check_scale(self, readings: FloatArray, example: str) -> None:
        """Raise `DataError` if readings (n, ...) are so large that they must be in another unit."""
        largest = np.abs(readings).max(axis=tuple(range(1, readings.ndim)))
        typical = float(np.median(largest[np.isfinite(largest)])) if np.isfinite(largest).any() else 0.0
        if typical > _MAX_RATIO * self._largest:
            unit = self._calibration.unit
            limit = f"reads {typical:.4g} {unit}, but the calibration only reaches {self._largest:.3g} {unit}"
            raise DataError(self._source, limit=limit, remedy=f"specify the unit in the header, as in {example}")

    def _count_readings(self, time_s: FloatArray, complete: BoolArray, flags: Mapping[str, BoolArray]) -> None:
        self.counts["readings"] += int(complete.sum())
        self.counts["missing"] += int((~complete).sum())
        for name, flag in flags.items():
            self.counts[name] += int(flag.sum())
        if complete.any():
            times, first = time_s[complete], self._times_s[0]
            self._times_s = (first if math.isfinite(first) else float(times[0])), float(times[-1])

    def _flag_warnings(self, meanings: Mapping[str, str], always: tuple[str, ...]) -> Iterator[Caution]:
        """Yield a warning for each flag that many readings have, or for a flag in ``always`` if any reading has it."""
        for name, meaning in meanings.items():
            count = self.counts[name]
            percent = 100.0 * count / max(self.counts["readings"], 1)
            if count and (name in always or percent >= _MIN_PERCENT):
                yield warning(f"{count} readings ({percent:.3g} %) {meaning}")
