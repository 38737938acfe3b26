"""Cross-validation of a calibration on held-out cycles or prints.

The calibration is computed from the remaining data, as if the held-out part had never been recorded. This part is then
decoded and compared with the stage angle. The fraction of readings within their bands shows whether the bands can be
trusted. Because errors within a cycle are correlated, this fraction scatters more than the number of readings suggests.

`leave_one_cycle_out` and `leave_one_sensor_out` return a `Check` with a `Part` for each held-out cycle or print.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.analysis.calibration.decoder import Decoded, Decoder
from solen.analysis.calibration.estimate import Calibration, calibrated, pooled
from solen.analysis.calibration.file import Part
from solen.analysis.calibration.training import Samples, Training
from solen.arrays import FloatArray, rows_of

_MAX_FOLDS = 20
_MAX_READINGS = 40_000


@dataclass(frozen=True, eq=False)
class Check:
    """Result of a cross-validation, in total and for each held-out part.

    ``true_deg`` and ``angle_deg`` are the true and the decoded angles of all held-out readings, (n,); ``low_deg`` and
    ``high_deg`` are the limits of their 68 and 95 % bands, (n, 2).
    """

    total: Part
    parts: tuple[Part, ...]
    true_deg: FloatArray = field(repr=False)
    angle_deg: FloatArray = field(repr=False)
    low_deg: FloatArray = field(repr=False)
    high_deg: FloatArray = field(repr=False)


def leave_one_cycle_out(training: Training) -> Check | None:
    """Decode each cycle with a calibration from the other cycles; None for fewer than three cycles.

    More than twenty cycles are held out in twenty groups.
    """
    if training.cycles < 3:
        return None
    folds = np.array_split(np.arange(training.cycles), min(training.cycles, _MAX_FOLDS))
    names, results = [], []
    for fold in folds:
        held_out = np.isin(np.arange(training.cycles), fold)
        names.append(f"cycle {fold[0] + 1}" if fold.size == 1 else f"cycles {fold[0] + 1} to {fold[-1] + 1}")
        samples = rows_of(training.samples, held_out[training.samples.cycle])
        results.append(_decoded(calibrated(training.selected(~held_out)), _thinned(samples, len(folds))))
    return _check(names, results)


def leave_one_sensor_out(trainings: Sequence[Training], calibrations: Sequence[Calibration]) -> Check | None:
    """Decode each print with a calibration from the other prints; None for fewer than three prints."""
    if len(calibrations) < 3:
        return None
    results = []
    for index, training in enumerate(trainings):
        others = [*calibrations[:index], *calibrations[index + 1 :]]
        results.append(_decoded(pooled(others), _thinned(training.samples, len(calibrations))))
    return _check([training.label for training in trainings], results)


def _thinned(samples: Samples, folds: int) -> Samples:
    every = -(-samples.angle_deg.size * folds // _MAX_READINGS)
    return rows_of(samples, np.arange(samples.angle_deg.size) % max(every, 1) == 0)


def _decoded(calibration: Calibration, samples: Samples) -> tuple[FloatArray, Decoded]:
    """Return the true angles of the samples in the calibrated range, and their decoded voltages."""
    low, high = calibration.angle_deg[[0, -1]]
    inside = rows_of(samples, (samples.angle_deg >= low) & (samples.angle_deg <= high))
    return inside.angle_deg, Decoder(calibration).decode(inside.volts)


def _check(names: Sequence[str], results: Sequence[tuple[FloatArray, Decoded]]) -> Check:
    parts = tuple(part_of(name, true, decoded) for name, (true, decoded) in zip(names, results, strict=True))
    columns = [
        np.concatenate([getattr(decoded, name) for _, decoded in results])
        for name in ("angle_deg", "low_deg", "high_deg")
    ]
    return Check(merged("all", parts), parts, np.concatenate([true for true, _ in results]), *columns)


def merged(name: str, parts: Sequence[Part]) -> Part:
    """Return the check results of several parts taken together; at least one part must contain a reading."""
    weight = np.array([part.readings for part in parts], dtype=float)
    weight /= max(weight.sum(), 1.0)

    def mean(name: str, power: int = 1) -> float:
        return float(weight @ np.array([getattr(part, name) ** power for part in parts]))

    return Part(
        name=name,
        readings=sum(part.readings for part in parts),
        rms_deg=math.sqrt(mean("rms_deg", 2)),
        bias_deg=mean("bias_deg"),
        worst_deg=max(part.worst_deg for part in parts),
        within_68=mean("within_68"),
        within_95=mean("within_95"),
        outside=mean("outside"),
        ambiguous=mean("ambiguous"),
    )


def part_of(name: str, true_deg: FloatArray, decoded: Decoded) -> Part:
    """Return the errors of decoded angles, and the fractions of the bands that contain the true angles."""
    errors = decoded.angle_deg - true_deg
    return Part(
        name=name,
        readings=errors.size,
        rms_deg=float(np.sqrt(np.mean(errors**2))),
        bias_deg=float(errors.mean()),
        worst_deg=float(np.abs(errors).max()),
        within_68=float(decoded.holds(true_deg, 0).mean()),
        within_95=float(decoded.holds(true_deg, 1).mean()),
        outside=float(decoded.outside.mean()),
        ambiguous=float(decoded.ambiguous.mean()),
    )
