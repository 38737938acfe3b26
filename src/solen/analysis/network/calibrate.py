"""Calibration of a network from recordings of its motions: a forward map through its states, and cross-validation.

All motions are calibrated together, from the stops of recordings that visit the network's states. For the
cross-validation, a tenth of the states at a time is held out and decoded with a calibration from the others. If the
derivatives and the noise of the map show that the readings do not determine the motions separately, the calibration is
rejected with an error that names these motions.

Public names: `calibrated_network` and `NetworkCalibrations`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen import __version__
from solen.analysis.calibration.decoder import MIN_TAIL_PROBABILITY
from solen.analysis.calibration.file import rows_as_tuples
from solen.analysis.network.decoder import NetworkDecoded, NetworkDecoder
from solen.analysis.network.file import MotionCheck, NetworkCalibration
from solen.analysis.network.forward import ForwardMap
from solen.analysis.network.recorded import NetworkReadings
from solen.analysis.network.states import States, clipped_in, missing_slots, states_of
from solen.arrays import BoolArray, FloatArray, joined_rows
from solen.errors import DataError
from solen.ranks import Caution, do_not_use, prefixed, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, in_unit, plain
from solen.sensor.network.motions import Determination, determined, undetermined_sentences

FOLDS, DECODED_ROWS = 10, 15
"""Number of parts of the states that are held out in turn, and number of rows of each stop that are then decoded."""
CHECKED_STATES = 200
"""Number of states in which it is checked whether the motions can be determined separately."""
BAND_WIDTH = 4.0
"""Width of a band, in standard deviations; a combination of motions is not determined if its band exceeds its range."""
MAX_UNSEPARATED, MAX_UNSEPARATED_NOTED = 0.5, 0.02
"""Fraction of the states in which motions cannot be separated above which the calibration is rejected, and above which
there is a warning.
"""
TAIL = 0.1
"""Fraction of the held-out states' distances that form the tail."""
MIN_WITHIN_95 = 0.88
"""Smallest fraction of readings within the 95 % bands for which the calibration may be used."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Readings of states that the calibration does not contain: true angles (n, motions), and decoded readings."""

    angle_deg: FloatArray
    decoded: NetworkDecoded

    @classmethod
    def joined(cls, parts: Sequence["HeldOut"]) -> "HeldOut":
        """Join several sets of held-out readings."""
        true = np.concatenate([part.angle_deg for part in parts])
        return cls(true, joined_rows([part.decoded for part in parts]))


class NetworkCalibrations(Result):
    """A network calibration.

    Attributes
    ----------
    calibration
        Content of the calibration file.
    states
        Number of distinct states used.
    unseparated
        Fraction of all states in which some motions cannot be determined separately.
    simulated
        Whether a recording is simulated.
    sources
        The recordings.
    warnings
        Warnings.
    """

    calibration: NetworkCalibration
    states: int
    unseparated: float
    simulated: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    held_out: HeldOut | None = field(default=None, metadata=HIDDEN)

    def to_dict(self) -> dict[str, object]:
        """Return the result as plain data; keys end in the unit of the readings instead of V."""
        return in_unit(super().to_dict(), self.calibration.unit)


def calibrated_network(recordings: Sequence[NetworkReadings]) -> NetworkCalibrations:
    """Calibrate a network from recordings of its states.

    Raises
    ------
    DataError
        If the recordings differ in their columns or have too few states, or the motions cannot be separated.
    """
    first = recordings[0]
    ordered = [first, *(_in_order_of(first, recording) for recording in recordings[1:])]
    stops = [states_of(recording) for recording in ordered]
    angle, signal = _joined(stops)
    _check_states(first, angle)
    noise = _noise(stops, ordered)
    forward = ForwardMap.through(angle, signal)
    decoder = NetworkDecoder(forward, noise, len(angle) - len(first.motions) - 1)
    unseparated, example = _unseparated(first.motions, forward, decoder)
    if unseparated > MAX_UNSEPARATED and example is not None:
        remedy = "add an emitter or a receiver that separates them; solen sensitivity shows what a design determines"
        raise DataError(first.provenance.name, limit=" and ".join(undetermined_sentences(example)), remedy=remedy)
    held_out = _held_out(ordered, stops, forward, noise)
    checks = () if held_out is None else checks_of(first.motions, held_out)
    warnings = [
        *(caution for recording in ordered for caution in (*recording.warnings, *missing_slots(recording))),
        *(caution for pair in zip(ordered, stops, strict=True) for caution in clipped_in(*pair)),
        *_cautions(checks, unseparated, example),
        *_grid_warnings(first.motions, angle),
    ]
    calibration = NetworkCalibration(
        solen=__version__,
        sensor=first.sensor,
        simulated=any(recording.provenance.simulated for recording in ordered),
        unit=first.unit,
        ambient=first.ambient,
        motions=first.motions,
        emitters=first.emitters,
        receivers=first.receivers,
        range_deg=tuple(zip(forward.low.tolist(), forward.high.tolist(), strict=True)),
        angle_deg=rows_as_tuples(angle),
        signal_V=rows_as_tuples(signal),
        noise_V2=rows_as_tuples(noise),
        reach=rows_as_tuples(forward.length),
        scatter=tuple(forward.scatter.tolist()),
        outside=_outside(held_out),
        checks=checks,
        words=tuple(map(_check_line, checks)),
        sources=tuple(plain(recording.provenance) for recording in ordered),
        warnings=tuple(warnings),
    )
    return NetworkCalibrations(
        calibration=calibration,
        states=len(angle),
        unseparated=unseparated,
        simulated=calibration.simulated,
        sources=tuple(recording.provenance for recording in ordered),
        warnings=tuple(warnings),
        held_out=held_out,
    )


def _in_order_of(first: NetworkReadings, other: NetworkReadings) -> NetworkReadings:
    """Return a recording with its columns in the order of the first recording; raise `DataError` if one is missing."""
    file = other.provenance.name
    ordered = other.ordered(first.motions, first.emitters, first.receivers)
    if not ordered.motions:
        limit = f"contains no angles for {', '.join(name for name in first.motions if name not in other.motions)}"
        raise DataError(file, limit=limit, remedy="calibrate with recordings of the same motions")
    if other.unit != first.unit:
        limit = f"contains readings in {other.unit}, but {first.provenance.name} in {first.unit}"
        raise DataError(file, limit=limit, remedy="calibrate with recordings in the same unit")
    return ordered


def _check_states(first: NetworkReadings, angle: FloatArray) -> None:
    """Raise `DataError` if there are too few states (n, motions), or a motion does not move."""
    minimum = len(first.motions) + 4
    stationary = [name for name, span in zip(first.motions, np.ptp(angle, axis=0), strict=True) if span <= 0.0]
    if len(angle) < minimum or stationary:
        limit = f"has {len(angle)} states, but at least {minimum} are required"
        if stationary:
            limit = f"{stationary[0]} does not move"
        remedy = "visit more states, e.g. with a [grid] in the protocol"
        raise DataError(first.provenance.name, limit=limit, remedy=remedy)


def _joined(stops: Sequence[States]) -> tuple[FloatArray, FloatArray]:
    """Return the distinct states in all recordings, and their readings."""
    everything = replace(
        stops[0],
        angle_deg=np.concatenate([states.angle_deg for states in stops]),
        signal=np.concatenate([states.signal for states in stops]),
        u_signal=np.concatenate([states.u_signal for states in stops]),
    )
    angle, signal, _ = everything.merged()
    return angle, signal


def _noise(stops: Sequence[States], recordings: Sequence[NetworkReadings]) -> FloatArray:
    """Return the covariance of a reading, pooled over the recordings, with the rounding of the readings added."""
    noise = np.mean([states.noise for states in stops], axis=0)
    values = np.concatenate([recording.signal.reshape(len(recording.signal), -1) for recording in recordings])
    differences = [np.diff(np.unique(column[np.isfinite(column)])) for column in values.T]
    steps = np.array([difference.min(initial=np.inf) for difference in differences])
    rounding = np.where(np.isfinite(steps), steps, 1e-9) ** 2 / 12.0
    return np.asarray(noise + np.diag(np.maximum(rounding, 1e-18)))


def _unseparated(
    motions: Sequence[str], forward: ForwardMap, decoder: NetworkDecoder
) -> tuple[float, Determination | None]:
    """Return the fraction of states in which motions cannot be separated, and an example.

    Random states within the ranges are used, so that the slopes of the map are also checked between recorded states.
    """
    angle = np.random.default_rng(0).uniform(forward.low, forward.high, (CHECKED_STATES, len(motions)))
    slopes, covariance = decoder.slopes(angle), decoder.covariance(angle)
    span = np.maximum(forward.high - forward.low, 1e-12)
    _, variance = forward.at(angle)
    u_slopes = np.sqrt(variance)[:, :, None] * np.sqrt(5.0 / 3.0) / (forward.length * span)
    rows = zip(slopes, u_slopes, covariance, strict=True)
    determinations = [_within_range(determined(motions, *row), span) for row in rows]
    unseparated = [state for state in determinations if not state.all_distinguished]
    fraction = len(unseparated) / len(determinations)
    return fraction, unseparated[len(unseparated) // 2] if unseparated else None


def _within_range(determination: Determination, span: FloatArray) -> Determination:
    """Return a copy in which combinations of motions whose band would exceed their range are not determined."""
    combinations = []
    for combination in determination.combinations:
        reach = float(np.sqrt(np.sum((np.array(list(combination.shares.values())) * span) ** 2)))
        minimum = BAND_WIDTH / (2.0 * reach)  # a combination is determined if it is at least twice its uncertainty
        combinations.append(replace(combination, u_singular_per_deg=max(combination.u_singular_per_deg, minimum)))
    kept = [combination for combination in combinations if combination.is_determined]
    rows = np.array([[*combination.shares.values()] for combination in kept]).reshape(len(kept), len(span))
    scaled = rows / np.array([[combination.singular_per_deg] for combination in kept]).reshape(-1, 1)
    return replace(determination, combinations=tuple(combinations), covariance_deg2=scaled.T @ scaled)


def _held_out(
    recordings: Sequence[NetworkReadings], stops: Sequence[States], forward: ForwardMap, noise: FloatArray
) -> HeldOut | None:
    """Return the readings of each state, decoded with a calibration from the other folds; None with too few states."""
    angle = np.concatenate([states.angle_deg for states in stops])
    signal = np.concatenate([states.signal for states in stops])
    span = np.maximum(forward.high - forward.low, 1e-12)
    _, state = np.unique(np.rint((angle - forward.low) / span * 250.0), axis=0, return_inverse=True)
    fold = np.random.default_rng(0).permutation(int(state.max()) + 1)[state] % FOLDS
    if np.unique(state).size < 2 * FOLDS:
        return None
    pairs = zip(recordings, stops, strict=True)
    rows = [_decoded_rows(recording, stop) for recording, states in pairs for stop in states.rows]
    ends = np.stack([forward.low, forward.high])
    parts = []
    for number in range(FOLDS):
        out: BoolArray = fold == number
        others = replace(stops[0], angle_deg=angle[~out], signal=signal[~out], u_signal=0.0 * signal[~out])
        kept, mean, _ = others.merged()
        fold_map = ForwardMap.through(kept, mean, ends_deg=ends, length=forward.length, scatter=forward.scatter)
        decoder = NetworkDecoder(fold_map, noise, len(kept) - len(span) - 1)
        indices = np.flatnonzero(out).tolist()
        true = np.concatenate([np.repeat(angle[index][None], len(rows[index]), axis=0) for index in indices])
        decoded = decoder.decode(np.concatenate([rows[index] for index in indices]))
        parts.append(HeldOut(np.clip(true, *ends), decoded))
    return HeldOut.joined(parts)


def _outside(held_out: HeldOut | None) -> float:
    """Return the squared distance that few true readings exceed, from the held-out states; 0 if there are none.

    Near a sharp bend of a response, the map error is larger than its variance indicates. The tail of the distances is
    assumed to be exponential, with a mean equal to the mean excess.
    """
    if held_out is None:
        return 0.0
    distance = held_out.decoded.distance
    begin = float(np.quantile(distance, 1.0 - TAIL))
    excess = float((distance[distance >= begin] - begin).mean())
    return begin + excess * math.log(TAIL / MIN_TAIL_PROBABILITY)


def _decoded_rows(recording: NetworkReadings, stop: slice) -> FloatArray:
    """Return evenly spaced rows from the complete rows of a stop."""
    flat = recording.signal[stop].reshape(stop.stop - stop.start, -1)
    complete = flat[np.isfinite(flat).all(axis=1)]
    return np.asarray(complete[np.unique(np.linspace(0, len(complete) - 1, DECODED_ROWS).astype(int))])


def checks_of(motions: Sequence[str], held_out: HeldOut) -> tuple[MotionCheck, ...]:
    """Return the errors and bands for each motion."""
    decoded, true = held_out.decoded, held_out.angle_deg
    error = decoded.angle_deg - true
    width = decoded.high_deg[..., 1] - decoded.low_deg[..., 1]
    within = [decoded.holds(true, level).mean(axis=0) for level in (0, 1)]
    return tuple(
        MotionCheck(
            motion=name,
            rms_deg=float(np.sqrt(np.mean(error[:, n] ** 2))),
            bias_deg=float(error[:, n].mean()),
            worst_deg=float(np.abs(error[:, n]).max()),
            band95_deg=float(np.median(width[:, n])),
            within_68=float(within[0][n]),
            within_95=float(within[1][n]),
        )
        for n, name in enumerate(motions)
    )


def _check_line(check: MotionCheck) -> str:
    return (
        f"{check.motion}: held-out states are decoded with an RMS error of {check.rms_deg:.2g}° (mean "
        f"{check.bias_deg:+.1g}°, largest {check.worst_deg:.2g}°); 95 % bands are {check.band95_deg:.2g}° wide; "
        f"{100 * check.within_68:.0f} % are within their 68 % bands, {100 * check.within_95:.0f} % within their 95 % "
        "bands"
    )


def _cautions(checks: Sequence[MotionCheck], unseparated: float, example: Determination | None) -> list[Caution]:
    warnings = []
    if not checks:
        text = f"fewer than {2 * FOLDS} states are too few to check the calibration on held-out states"
        warnings.append(warning(text))
    if unseparated > MAX_UNSEPARATED_NOTED and example is not None:
        warnings.append(
            warning(f"in {100 * unseparated:.2g} % of the states, {' and '.join(undetermined_sentences(example))}")
        )
    for check in checks:
        if check.within_95 < MIN_WITHIN_95:
            text = f"only {100 * check.within_95:.0f} % of the readings of held-out states are within their 95 % bands"
            warnings.append(prefixed(check.motion, do_not_use(text)))
    return warnings


def _grid_warnings(motions: Sequence[str], angle: FloatArray) -> list[Caution]:
    """Return a warning if all states are on a grid, because sharp bends between its points are then not detected."""
    span = np.maximum(np.ptp(angle, axis=0), 1e-9)
    counts = [len(np.unique(np.rint(column))) for column in (angle / span * 250.0).T]
    if len(motions) < 2 or len(angle) < np.prod(counts):
        return []
    text = (
        "all states are on a grid: the readings between the grid points are unknown, and the bands do not allow for "
        "this; add random states between them, e.g. scatter = 200 in [grid]"
    )
    return [warning(text)]
