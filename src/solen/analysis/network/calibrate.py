"""Calibration of a network from recordings of its motions: a forward map through its states, and cross-validation.

All motions are calibrated together, from the stops of recordings that visit the network's states. A tenth of the states
at a time is held out and decoded with a calibration from the others. If the readings cannot separate the motions,
according to the derivatives and noise of the map, the calibration is rejected with an error that names the motions.

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
from solen.ranks import Caution, do_not_use, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, in_unit, plain
from solen.sensor.network.motions import Determination, determined, undetermined_sentences

FOLDS, ROWS = 10, 15
"""Number of parts of the states that are held out in turn, and number of rows from each stop that are then decoded."""
CHECKED_STATES = 200
"""Number of states in which the separation of the motions is checked."""
WIDE = 4.0
"""A combination of motions is not separated if this many of its standard deviations exceed its range."""
MAX_LOST, SOME_LOST = 0.5, 0.02
"""Fraction of the states with unseparated motions above which the calibration is rejected, and above which a warning is
given.
"""
TAIL = 0.1
"""Fraction of the held-out states' distances that form the tail."""
FEW = 0.88
"""Smallest fraction of readings within the 95 % bands without a warning."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Readings of states that a calibration does not contain: true angles (n, motions), and the decoded readings."""

    angle_deg: FloatArray
    decoded: NetworkDecoded

    @classmethod
    def joined(cls, parts: Sequence["LeftOut"]) -> "LeftOut":
        """Join several sets of held-out readings into one."""
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
        Fraction of all states in which some motions cannot be separated.
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
    left_out: LeftOut | None = field(default=None, metadata=HIDDEN)

    def to_dict(self) -> dict[str, object]:
        """Return the result as plain data; keys end in the unit of the readings instead of V."""
        return in_unit(super().to_dict(), self.calibration.unit)


def calibrated_network(recordings: Sequence[NetworkReadings]) -> NetworkCalibrations:
    """Calibrate a network from recordings of its states.

    Raises
    ------
    DataError
        If the recordings differ in their columns, have too few states, or the readings cannot separate the motions.
    """
    first = recordings[0]
    alike = [first, *(_as(first, recording) for recording in recordings[1:])]
    each = [states_of(one) for one in alike]
    file = first.provenance.name
    angle, signal = _joined(each)
    least = len(first.motions) + 4
    if len(angle) < least or (np.ptp(angle, axis=0) <= 0.0).any():
        still = [name for name, span in zip(first.motions, np.ptp(angle, axis=0), strict=True) if span <= 0.0]
        limit = (
            f"{still[0]} does not move" if still else (f"has {len(angle)} states, but at least {least} are required")
        )
        raise DataError(file, limit=limit, remedy="visit more states, e.g. with a [grid] in the protocol")
    noise = _noise(each, alike)
    forward = ForwardMap.through(angle, signal)
    decoder = NetworkDecoder(forward, noise, len(angle) - len(first.motions) - 1)
    lost, worst = _lost(first.motions, forward, decoder)
    if lost > MAX_LOST and worst is not None:
        remedy = "add an emitter or a receiver that separates them; solen sensitivity shows what a design determines"
        raise DataError(file, limit=" and ".join(undetermined_sentences(worst)), remedy=remedy)
    left_out = _left_out(alike, each, forward, noise)
    checks = () if left_out is None else checks_of(first.motions, left_out)
    warnings = [
        *(line for one in alike for line in (*one.warnings, *missing_slots(one))),
        *(line for one, states in zip(alike, each, strict=True) for line in clipped_in(one, states)),
        *_cautions(checks, lost, worst),
        *_on_a_grid(first.motions, angle),
    ]
    calibration = NetworkCalibration(
        solen=__version__,
        sensor=first.sensor,
        simulated=any(one.provenance.simulated for one in alike),
        unit=first.unit,
        ambient=first.ambient,
        motions=first.motions,
        emitters=first.emitters,
        receivers=first.receivers,
        range_deg=tuple(zip(forward.low.tolist(), forward.high.tolist(), strict=True)),
        angle_deg=rows_as_tuples(angle),
        signal_V=rows_as_tuples(signal),
        noise_V2=rows_as_tuples(noise),
        reach=rows_as_tuples(forward.reach),
        scatter=tuple(forward.scatter.tolist()),
        outside=_outside(left_out),
        checks=checks,
        words=tuple(map(_words, checks)),
        sources=tuple(plain(one.provenance) for one in alike),
        warnings=tuple(warnings),
    )
    return NetworkCalibrations(
        calibration=calibration,
        states=len(angle),
        unseparated=lost,
        simulated=calibration.simulated,
        sources=tuple(one.provenance for one in alike),
        warnings=tuple(warnings),
        left_out=left_out,
    )


def _as(first: NetworkReadings, other: NetworkReadings) -> NetworkReadings:
    """Return another recording with its columns in the order of the first recording; raise `DataError` if a column is missing."""
    file = other.provenance.name
    found = other.ordered(first.motions, first.emitters, first.receivers)
    if not found.motions:
        limit = f"contains no angles for {', '.join(name for name in first.motions if name not in other.motions)}"
        raise DataError(file, limit=limit, remedy="calibrate with recordings of the same motions")
    if other.unit != first.unit:
        raise DataError(file, value=other.unit, limit=f"has a unit other than {first.unit}")
    return found


def _joined(each: Sequence[States]) -> tuple[FloatArray, FloatArray]:
    """Return the distinct states in all recordings, and their readings."""
    whole = replace(
        each[0],
        angle_deg=np.concatenate([one.angle_deg for one in each]),
        signal=np.concatenate([one.signal for one in each]),
        u_signal=np.concatenate([one.u_signal for one in each]),
    )
    angle, signal, _ = whole.merged()
    return angle, signal


def _noise(each: Sequence[States], recordings: Sequence[NetworkReadings]) -> FloatArray:
    """Return the noise of all recordings, at least the noise of a uniform distribution over the smallest step of a reading."""
    noise = np.mean([one.noise for one in each], axis=0)
    values = np.concatenate([recording.signal.reshape(len(recording.signal), -1) for recording in recordings])
    steps = [np.diff(np.unique(column[np.isfinite(column)])) for column in values.T]
    least = np.array([step.min(initial=np.inf) if len(step) else np.inf for step in steps])
    floor = np.where(np.isfinite(least), least, 1e-9) ** 2 / 12.0
    return np.asarray(noise + np.diag(np.maximum(floor, 1e-18)))


def _lost(motions: Sequence[str], forward: ForwardMap, decoder: NetworkDecoder) -> tuple[float, Determination | None]:
    """Return the fraction of the states within the ranges in which motions are not separated, and the combinations concerned.

    The states are between the recorded states, where the slopes are those of the map.
    """
    angle = np.random.default_rng(0).uniform(forward.low, forward.high, (CHECKED_STATES, len(motions)))
    slopes, covariance = decoder.slopes(angle), decoder.covariance(angle)
    span = np.maximum(forward.high - forward.low, 1e-12)
    _, variance = forward.at(angle)
    u_slopes = np.sqrt(variance)[:, :, None] * np.sqrt(5.0 / 3.0) / (forward.reach * span)
    found = [_with_range(determined(motions, *one), span) for one in zip(slopes, u_slopes, covariance, strict=True)]
    lost = [one for one in found if not one.all_distinguished]
    return len(lost) / len(found), lost[len(lost) // 2] if lost else None


def _with_range(found: Determination, span: FloatArray) -> Determination:
    """Copy in which a combination of motions counts as not determined if its band would contain its entire range."""
    combinations = []
    for combination in found.combinations:
        reach = float(np.sqrt(np.sum((np.array(list(combination.shares.values())) * span) ** 2)))
        least = WIDE / (2.0 * reach)  # a combination is determined if it is at least twice its uncertainty
        combinations.append(replace(combination, u_singular_per_deg=max(combination.u_singular_per_deg, least)))
    kept = [combination for combination in combinations if combination.is_determined]
    rows = np.array([[*one.shares.values()] for one in kept]).reshape(len(kept), len(span))
    scaled = rows / np.array([[one.singular_per_deg] for one in kept]).reshape(-1, 1)
    return replace(found, combinations=tuple(combinations), covariance_deg2=scaled.T @ scaled)


def _left_out(
    recordings: Sequence[NetworkReadings], each: Sequence[States], forward: ForwardMap, noise: FloatArray
) -> LeftOut | None:
    """Return the readings of each state, decoded with a calibration from the other parts, or None if there are too few states."""
    angle = np.concatenate([one.angle_deg for one in each])
    signal = np.concatenate([one.signal for one in each])
    span = np.maximum(forward.high - forward.low, 1e-12)
    _, state = np.unique(np.rint((angle - forward.low) / span * 250.0), axis=0, return_inverse=True)
    fold = np.random.default_rng(0).permutation(int(state.max()) + 1)[state] % FOLDS
    if np.unique(state).size < 2 * FOLDS:
        return None
    rows = [_some(recording, stop) for recording, states in zip(recordings, each, strict=True) for stop in states.rows]
    ends = np.stack([forward.low, forward.high])
    parts = []
    for number in range(FOLDS):
        out: BoolArray = fold == number
        inside = replace(each[0], angle_deg=angle[~out], signal=signal[~out], u_signal=0.0 * signal[~out])
        kept, mean, _ = inside.merged()
        made = ForwardMap.through(kept, mean, ends_deg=ends, reach=forward.reach, scatter=forward.scatter)
        decoder = NetworkDecoder(made, noise, len(kept) - len(span) - 1)
        held = np.flatnonzero(out).tolist()
        true = np.concatenate([np.repeat(angle[one][None], len(rows[one]), axis=0) for one in held])
        parts.append(LeftOut(np.clip(true, *ends), decoder.decode(np.concatenate([rows[one] for one in held]))))
    return LeftOut.joined(parts)


def _outside(left_out: LeftOut | None) -> float:
    """Return the squared distance that few true readings exceed, from the tail for held-out states, or 0 without such states.

    Where a response has a sharp bend, the map error is larger than its variance indicates. The tail is assumed to be
    exponential, with a mean equal to the mean excess.
    """
    if left_out is None:
        return 0.0
    distance = left_out.decoded.distance
    begin = float(np.quantile(distance, 1.0 - TAIL))
    excess = float((distance[distance >= begin] - begin).mean())
    return begin + excess * math.log(TAIL / MIN_TAIL_PROBABILITY)


def _some(recording: NetworkReadings, stop: slice) -> FloatArray:
    """Return the evenly spaced rows from the complete rows of a stop."""
    flat = recording.signal[stop].reshape(stop.stop - stop.start, -1)
    whole = flat[np.isfinite(flat).all(axis=1)]
    return np.asarray(whole[np.unique(np.linspace(0, len(whole) - 1, ROWS).astype(int))])


def checks_of(motions: Sequence[str], left_out: LeftOut) -> tuple[MotionCheck, ...]:
    """Return the errors and bands for each motion."""
    decoded, true = left_out.decoded, left_out.angle_deg
    error = decoded.angle_deg - true
    width = decoded.high_deg[..., 1] - decoded.low_deg[..., 1]
    within = [decoded.holds(true, level).mean(axis=0) for level in (0, 1)]
    return tuple(
        MotionCheck(
            motion=name,
            rms_deg=float(np.sqrt(np.mean(error[:, place] ** 2))),
            bias_deg=float(error[:, place].mean()),
            worst_deg=float(np.abs(error[:, place]).max()),
            band95_deg=float(np.median(width[:, place])),
            within_68=float(within[0][place]),
            within_95=float(within[1][place]),
        )
        for place, name in enumerate(motions)
    )


def _words(check: MotionCheck) -> str:
    return (
        f"{check.motion}: held-out states are decoded to {check.rms_deg:.2g}° (rms; mean error "
        f"{check.bias_deg:+.1g}°, worst {check.worst_deg:.2g}°); 95 % bands are {check.band95_deg:.2g}° wide; "
        f"{100 * check.within_68:.0f} % lie within the 68 % bands, {100 * check.within_95:.0f} % within the 95 % bands"
    )


def _cautions(checks: Sequence[MotionCheck], lost: float, worst: Determination | None) -> list[Caution]:
    found = []
    if not checks:
        found.append(warning(f"fewer than {2 * FOLDS} states, too few to check the calibration on held-out states"))
    if lost > SOME_LOST and worst is not None:
        found.append(warning(f"in {100 * lost:.2g} % of the states, {' and '.join(undetermined_sentences(worst))}"))
    found += [
        do_not_use(
            f"{check.motion}: only {100 * check.within_95:.0f} % of the held-out states lie within the 95 % bands"
        )
        for check in checks
        if check.within_95 < FEW
    ]
    return found


def _on_a_grid(motions: Sequence[str], angle: FloatArray) -> list[Caution]:
    """Return a warning if all states are on a grid, because sharp bends between the grid points then remain undetected."""
    span = np.maximum(np.ptp(angle, axis=0), 1e-9)
    places = [len(np.unique(np.rint(column))) for column in (angle / span * 250.0).T]
    if len(motions) < 2 or len(angle) < np.prod(places):
        return []
    unseen = "the behaviour of the readings between the grid points is unknown, and the bands do not cover it"
    return [
        warning(f"all states are on a grid: {unseen}; add random states between them, e.g. scatter = 200 in [grid]")
    ]
