"""States of a network in a recording: the stops of its motions, and the mean readings at each stop.

The readings of a switching cycle belong to a single state only while all motions are stationary. A stop is a run of
rows in which no angle changes. The noise of a reading is the covariance of the rows of a stop, pooled over the stops: a
covariance, because ambient light or the supply of an ADC affects several readings together. If the means of the
segments of a stop differ by more than the noise explains, the uncertainty of the stop's mean follows from them.

Public names: `states_of`, `States`, `analysed_network` and `NetworkStates`.
"""

from dataclasses import dataclass, field

import numpy as np

from solen.analysis.network.recorded import NetworkReadings
from solen.arrays import BoolArray, FloatArray, flag_runs
from solen.errors import DataError
from solen.ranks import Caution, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, in_unit

REST_ROWS = 5
"""Number of rows over which the movement of a motion is measured."""
MAX_MOVEMENT, MAX_NOISES = 1e-3, 5.0
"""Largest movement at rest, as a fraction of the motion's range, or relative to the noise of its angle."""
MIN_STOP_ROWS, SETTLING_ROWS = 8, 2
"""Smallest number of rows in a stop, and number of rows omitted at both ends."""
SEGMENTS = 6
"""Number of segments of a stop whose means show the correlation between its rows."""


@dataclass(frozen=True, eq=False)
class States:
    """Stops in a recording, with the angles and the mean readings at each stop.

    Attributes
    ----------
    angle_deg
        Angles (stops, motions).
    signal, u_signal
        Means (stops, emitters × receivers) and their standard uncertainties.
    noise
        Covariance of a row (emitters × receivers, emitters × receivers), pooled over stops.
    rows
        Rows of the readings that belong to each stop.
    clipped
        Fraction of the rows in which a reading was clipped, (stops, emitters × receivers).
    """

    angle_deg: FloatArray
    signal: FloatArray
    u_signal: FloatArray
    noise: FloatArray
    rows: tuple[slice, ...]
    clipped: FloatArray

    def merged(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the distinct states (n, motions), and the mean readings in each and their variances, both (n, K)."""
        span = np.maximum(np.ptp(self.angle_deg, axis=0), 1e-9)
        rounded = np.rint(self.angle_deg / (2.0 * MAX_MOVEMENT * span))
        _, state = np.unique(rounded, axis=0, return_inverse=True)
        count = np.bincount(state).astype(float)

        def mean(values: FloatArray) -> FloatArray:
            return np.asarray(np.stack([np.bincount(state, column) for column in values.T], axis=1) / count[:, None])

        return mean(self.angle_deg), mean(self.signal), mean(self.u_signal**2) / count[:, None]


class NetworkStates(Result):
    """Response of a recorded network: signals of each emitter and receiver in each state.

    Attributes
    ----------
    sensor
        Name of the network.
    motions, emitters, receivers
        Names of the motions, emitters and receivers.
    unit
        Unit of the signals; keys end in it instead of V.
    angle_deg
        Angles (stops, motions).
    signal_V, u_signal_V
        Means over each stop, (stops, emitters, receivers), and their standard uncertainties.
    noise_V
        Standard deviation of a single reading (emitters, receivers).
    readings, missing
        Number of emitter switching cycles, and number of those that lack a reading.
    simulated
        Whether the recording is simulated.
    sources
        The file.
    warnings
        Warnings.
    """

    sensor: str
    motions: tuple[str, ...]
    emitters: tuple[str, ...]
    receivers: tuple[str, ...]
    unit: str
    angle_deg: FloatArray
    signal_V: FloatArray
    u_signal_V: FloatArray
    noise_V: FloatArray
    readings: int
    missing: int
    simulated: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    states: States = field(metadata=HIDDEN)

    def to_dict(self) -> dict[str, object]:
        """Return the result as plain data; keys end in the unit of the readings instead of V."""
        return in_unit(super().to_dict(), self.unit)


def analysed_network(readings: NetworkReadings) -> NetworkStates:
    """Return the response of a network at the stops of a recording; raise `DataError` without angles or stops."""
    states, shape = states_of(readings), readings.signal.shape[1:]
    missing = int(np.isnan(readings.signal).any(axis=(1, 2)).sum())
    return NetworkStates(
        sensor=readings.sensor,
        motions=readings.motions,
        emitters=readings.emitters,
        receivers=readings.receivers,
        unit=readings.unit,
        angle_deg=states.angle_deg,
        signal_V=states.signal.reshape(-1, *shape),
        u_signal_V=states.u_signal.reshape(-1, *shape),
        noise_V=np.sqrt(np.diag(states.noise)).reshape(shape),
        readings=len(readings.time_s),
        missing=missing,
        simulated=readings.provenance.simulated,
        sources=(readings.provenance,),
        warnings=(*readings.warnings, *missing_slots(readings), *clipped_in(readings, states)),
        states=states,
    )


def states_of(readings: NetworkReadings) -> States:
    """Find the stops of a recording; raise `DataError` if it contains no angles or no stops."""
    file = readings.provenance.name
    if not readings.motions:
        limit = "contains no motion angles"
        raise DataError(file, limit=limit, remedy="add a column for each motion, such as index-bends_deg")
    flat = readings.signal.reshape(len(readings.signal), -1)
    complete = np.asarray(np.isfinite(flat).all(axis=1))
    stops = [stop for stop in _stops(readings.angle_deg) if complete[stop].sum() >= MIN_STOP_ROWS]
    if not stops:
        limit = f"has no stop with {MIN_STOP_ROWS} complete switching cycles of the emitters"
        raise DataError(file, limit=limit, remedy="hold each state for longer")
    rows_of_stops = [flat[stop][complete[stop]] for stop in stops]
    deviations = np.concatenate([rows - rows.mean(axis=0) for rows in rows_of_stops])
    noise = deviations.T @ deviations / (len(deviations) - len(stops))
    clipped = readings.clipped.reshape(len(flat), -1)
    return States(
        angle_deg=np.array([readings.angle_deg[stop].mean(axis=0) for stop in stops]),
        signal=np.array([rows.mean(axis=0) for rows in rows_of_stops]),
        u_signal=np.array([_u_mean(rows, noise) for rows in rows_of_stops]),
        noise=noise,
        rows=tuple(stops),
        clipped=np.array([clipped[stop].mean(axis=0) for stop in stops]),
    )


def at_rest(angle_deg: FloatArray) -> BoolArray:
    """Return whether each row of angles (n, motions) belongs to a stop."""
    flags = np.zeros(len(angle_deg), bool)
    for stop in _stops(angle_deg):
        flags[stop] = True
    return flags


def missing_slots(readings: NetworkReadings) -> list[Caution]:
    """Return a warning with the number of switching cycles in which each emitter's reading is missing."""
    counts = np.isnan(readings.signal).any(axis=2).sum(axis=0).tolist()
    missing = [f"{name} {count}" for name, count in zip(readings.emitters, counts, strict=True) if count]
    if not missing:
        return []
    text = f"readings are missing: {', '.join(missing)} of {len(readings.signal)}; these switching cycles are omitted"
    return [warning(text)]


def clipped_in(readings: NetworkReadings, states: States) -> list[Caution]:
    """Return a warning about powers that are at a limit of the recorder's range in some states."""
    names = [f"{emitter}.{receiver}" for emitter in readings.emitters for receiver in readings.receivers]
    fractions = states.clipped.mean(axis=0).tolist()
    clipped = [f"{name} {100 * part:.2g} %" for name, part in zip(names, fractions, strict=True) if part > 0.0]
    if not clipped:
        return []
    text = f"readings are at a limit of the recorder's range, which hides changes outside it: {', '.join(clipped)}"
    return [warning(text)]


def _stops(angle_deg: FloatArray) -> list[slice]:
    """Return the runs of rows in which nothing moves, without a few rows at both ends."""
    if len(angle_deg) <= REST_ROWS:
        return []
    span, noise = np.ptp(angle_deg, axis=0), _noise_deg(angle_deg)
    limit = np.maximum(MAX_MOVEMENT * span, MAX_NOISES * noise)
    stationary: BoolArray = (np.abs(angle_deg[REST_ROWS:] - angle_deg[:-REST_ROWS]) <= limit + 1e-9).all(axis=1)
    runs = [slice(begin + SETTLING_ROWS, end + REST_ROWS - SETTLING_ROWS) for begin, end in flag_runs(stationary)]
    return [run for run in runs if run.stop - run.start >= MIN_STOP_ROWS]


def _noise_deg(angle_deg: FloatArray) -> FloatArray:
    """Return the noise of the angles, from second differences, which cancel a motion at constant speed."""
    differences = np.abs(angle_deg[2:] - 2.0 * angle_deg[1:-1] + angle_deg[:-2])
    return np.asarray(np.median(differences, axis=0) / (0.6745 * np.sqrt(6.0)))


def _u_mean(rows: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the standard uncertainty of the mean of a stop's rows, (K,)."""
    white = np.sqrt(np.diag(noise) / len(rows))
    means = np.array([segment.mean(axis=0) for segment in np.array_split(rows, SEGMENTS)])
    return np.asarray(np.maximum(white, means.std(axis=0, ddof=1) / np.sqrt(SEGMENTS)))
