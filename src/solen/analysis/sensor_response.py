"""Response and figures of merit of a sensor from its recordings, and the comparison of several sensors.

Each recording supplies its cycles. The first cycle is omitted, as in the paper, because the material and the stage
settle during it. All recordings of a sensor are on one grid, so their half-cycles can be pooled. Sensors are the
replicates: the group's mean and standard deviation are those of the sensors' mean curves, and n is the number of
prints.

Public names: `sensor_response`, `group_of` and `SensorGroup`.
"""

import math
from collections.abc import Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.ageing import Ageing, ageing_of
from solen.analysis.clipping import clipped
from solen.analysis.figures_of_merit import ReceiverResponse, receiver_response
from solen.analysis.load_cell import LoadCell, least_certain
from solen.analysis.motion import Motion, find_motion
from solen.analysis.noise import Scatter, noise_of, pooled_noise
from solen.analysis.protocol_angle import Protocol
from solen.analysis.receiver_pair import PairResponse, pair_response, sign_warnings
from solen.analysis.response import Passes, common_range, grid_deg, nice_step, passes
from solen.analysis.response_warnings import (
    cautions,
    cell_warnings,
    clip_warnings,
    other_speeds_left_out,
    timing_warnings,
)
from solen.analysis.run import Run
from solen.analysis.signals import SignalOptions, Signals
from solen.analysis.timing import Source, Timing, angle_bound_s, at_main_speed, cycle_speeds, timing_of
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import Caution
from solen.recording.column_roles import left_right
from solen.recording.stimulus import ANGLE, Stimulus
from solen.results import HIDDEN, Result, reported
from solen.spec.strict import Finite, refused


class AnalysisOptions(SignalOptions):
    """Options for analysing recordings of a motion."""

    angle_file: tuple[Path, ...] = ()
    """Stage log with its own clock, one for all files or one for each; --angle then names a column of the log. The lag
    between the clocks is determined from the voltages.
    """
    angle_time: str | None = None
    """Time column of that log."""
    angle_rate_hz: Finite | None = Field(None, gt=0)
    """Log entries per second, if the log contains no times."""
    amplitude_deg: Finite | None = Field(None, gt=0)
    """Commanded amplitude to each side, if no angle was recorded; cycles are then detected in the voltages."""
    speed_deg_per_s: Finite = Field(15.0, gt=0)
    """Commanded speed, with --amplitude-deg."""
    hold_s: Finite = Field(0.8, ge=0)
    """Commanded hold at each end, with --amplitude-deg."""
    pattern: str | None = None
    """Pattern of the file names, as in "{sensor}_{lens}_{run}.csv"."""
    control: tuple[str, ...] = ()
    """Labels of the sensors without a lens."""
    drop: int = Field(1, ge=0)
    """Number of cycles to omit at the beginning of each recording."""
    step_deg: Finite | None = Field(None, gt=0)
    """Step of the angle grid; default: a round number that suits the range."""
    dark_V: Finite | None = None
    """Receiver voltage without light, for crosstalk and contrast of the light itself."""
    every: int | None = Field(None, ge=2)
    """Show how response, null and noise change between groups of this many cycles."""

    @model_validator(mode="after")
    def _check_angle(self) -> Self:
        if self.angle_time is not None and not self.angle_file:
            limit = "names a column of a stage log"
            raise refused("angle_time", limit, value=self.angle_time, remedy="name the log with --angle-file")
        if self.angle_rate_hz is not None and (not self.angle_file or self.angle_time is not None):
            limit = "applies to a log without times"
            raise refused(
                "angle_rate_hz", limit, value=self.angle_rate_hz, remedy="use --angle-file without --angle-time"
            )
        if self.amplitude_deg is not None and (self.angle_file or self.angle is not None):
            limit = "applies to recordings without an angle"
            raise refused("amplitude_deg", limit, value=self.amplitude_deg, remedy="omit the other option")
        return self

    @property
    def protocol(self) -> Protocol | None:
        """Commanded motion, if no angle was recorded."""
        if self.amplitude_deg is None:
            return None
        return Protocol(self.amplitude_deg, self.speed_deg_per_s, self.hold_s)


class SensorResponse(Result):
    """Response of a sensor.

    Attributes
    ----------
    label
        Name of the sensor.
    lens
        Whether the sensor has a lens; None if unknown.
    receivers
        Response of each receiver, by receiver name.
    left_minus_right
        Response of the difference; None if the names do not distinguish left and right.
    timing
        Contribution of timing to the hysteresis, and the hysteresis without it.
    runs
        Recordings of the sensor.
    passes
        Half-cycles of all recordings on a common grid.
    near_zero_deg
        Values about 0 for which the sensitivity near zero is computed.
    warnings
        Warnings.
    ageing
        Change of the sensor over its cycles; None unless ``every`` is specified.
    """

    label: str
    lens: bool | None
    unit: str
    receivers: dict[str, ReceiverResponse]
    left_minus_right: PairResponse | None
    timing: Timing
    runs: tuple[Run, ...]
    passes: Passes = field(metadata=HIDDEN)
    near_zero_deg: float
    warnings: tuple[Caution, ...] = field(metadata=HIDDEN)
    ageing: Ageing | None = None

    @property
    def stimulus(self) -> Stimulus:
        """Quantity against which the response is measured."""
        return self.runs[0].signals.stimulus

    @property
    def cell(self) -> LoadCell | None:
        """Load cell of the forces (the cell with the largest uncertainty); its errors are included in every u."""
        return least_certain(run.signals.cell for run in self.runs)

    @reported
    def cycles_used(self) -> int:
        """Number of cycles of all recordings used for the figures."""
        return self.passes.cycles


class GroupCurve(Result):
    """Mean and standard deviation over sensors of a receiver's mean curve (g,) and swing; NaN for a single sensor."""

    mean_V: FloatArray
    sd_V: FloatArray
    swing_V: float
    sd_swing_V: float


class SensorGroup(Result):
    """A group of sensors: labels, common angles (g,), and curves of the common receivers, by name."""

    labels: tuple[str, ...]
    angle_deg: FloatArray
    receivers: dict[str, GroupCurve]

    @reported
    def n(self) -> int:
        """Number of sensors."""
        return len(self.labels)


def sensor_response(
    recordings: Sequence[Signals], options: AnalysisOptions, motions: dict[int, Motion] | None = None
) -> SensorResponse:
    """Compute the response and figures of merit of a sensor.

    ``motions`` caches the motion detected in an angle, by array identity, for other sensors on the same stage.

    Raises
    ------
    DataError
        If a recording contains no complete cycle, no cycle remains, or the recordings have different receivers.
    """
    first = recordings[0]
    for other in recordings[1:]:
        if other.unit != first.unit:
            limit = f"is in {other.unit}, but {first.source} is in {first.unit}"
            raise DataError(f"{other.source} ({other.label})", limit=limit, remedy="analyse them separately")
        if other.receivers != first.receivers:
            limit = f"has receivers {', '.join(other.receivers)}, but {first.source} has {', '.join(first.receivers)}"
            raise DataError(
                f"{other.source} ({other.label})",
                limit=limit,
                remedy="use the same receiver names in both with --channel",
            )
    known = {} if motions is None else motions
    runs = tuple(_run(signals, options, known) for signals in recordings)
    every = _pooled_passes(runs, options.step_deg, first.label)
    near_zero = first.stimulus.near_zero(float(np.abs(every.angle_deg).max()))
    ways = every.rows(np.array([place in run.used for run in runs for place in run.timed]))
    noise = pooled_noise([_scatter(run) for run in runs]).tolist()
    receivers = {
        name: receiver_response(ways.of(n), noise[n], sum(int(run.clipped[:, n].sum()) for run in runs), near_zero)
        for n, name in enumerate(first.receivers)
    }
    sides = left_right(first.receivers)
    pair = None
    if sides is not None:
        pair = pair_response(ways, sides, (noise[sides[0]], noise[sides[1]]), options.dark_V, near_zero)
    warnings = [warning for run in runs for warning in (*run.motion.warnings, *run.warnings)]
    warnings += (
        [] if first.lens is False or first.stimulus is not ANGLE else sign_warnings(receivers, sides, first.unit)
    )
    warnings += cautions(receivers, ways, runs)
    timing = _timing(runs, every, receivers)
    warnings += [line for run in runs for line in other_speeds_left_out(run)]
    warnings += timing_warnings(timing, receivers, first.stimulus.sign)
    ageing = None
    if options.every is not None:
        ageing = ageing_of(
            ways, [scatter for run in runs for scatter in _cycle_scatters(run)], first.receivers, sides, options.every
        )
    cell = least_certain(signals.cell for signals in recordings)
    warnings += cell_warnings(first.stimulus, cell)
    if cell is not None:
        receivers = {name: replace(own, **_u_by_cell(own, cell)) for name, own in receivers.items()}
        pair = None if pair is None else replace(pair, **_u_by_cell(pair, cell))
    return SensorResponse(
        first.label, first.lens, first.unit, receivers, pair, timing, runs, ways, near_zero, tuple(warnings), ageing
    )


def _u_by_cell(own: ReceiverResponse, cell: LoadCell) -> dict[str, Any]:
    """Add the load cell errors common to all readings to the uncertainties of a response against a force."""
    share = cell.u_slope or 0.0
    names = ("sensitivity_V_per_deg", "sensitivity_near_zero_V_per_deg")
    wider = {f"u_{name}": math.hypot(getattr(own, f"u_{name}"), share * getattr(own, name)) for name in names}
    if isinstance(own, PairResponse):
        wider["u_balance_deg"] = math.hypot(own.u_balance_deg, share * own.balance_deg, cell.u_line_N)
    return wider


def _scatter(run: Run, start_s: float = -math.inf, end_s: float = math.inf) -> Scatter:
    """Scatter of the readings in a run, or in one of its cycles."""
    time = run.signals.time_s
    begin, end = np.searchsorted(time, (start_s, end_s)).tolist()
    volts = np.where(run.clipped, np.nan, run.signals.volts)[begin:end]
    holds = [(start - begin, stop - begin) for start, stop in run.motion.holds if begin <= start and stop <= end]
    return noise_of(time[begin:end], volts, holds)


def _cycle_scatters(run: Run) -> list[Scatter]:
    """Scatter of each used cycle."""
    cycles = [run.motion.cycles[place] for place in run.used]
    return [_scatter(run, cycle.start_s, cycle.end_s) for cycle in cycles]


def _timing(runs: Sequence[Run], every: Passes, receivers: dict[str, ReceiverResponse]) -> Timing:
    """Timing of all recordings from cycles at every speed, with the largest of their bounds."""
    speeds, bounds = [], []
    for run in runs:
        signals = run.signals
        speeds.append(cycle_speeds(signals.time_s, signals.angle_deg, run.motion, run.timed))
        late_s = angle_bound_s(signals.time_s, signals.angle_deg, run.motion)
        own: tuple[float, Source] = (late_s, signals.stimulus.name)
        bounds.append(signals.timing_bound_s or own)
    return timing_of(every, np.concatenate(speeds), max(bounds), receivers)


def _run(signals: Signals, options: AnalysisOptions, known: dict[int, Motion]) -> Run:
    motion = known.get(id(signals.angle_deg)) or find_motion(signals.time_s, signals.angle_deg, signals.stimulus)
    known[id(signals.angle_deg)] = motion
    count = len(motion.cycles)
    if count <= options.drop:
        limit = f"contains {count} complete cycle{'s' * (count != 1)}, of which --drop {options.drop} omits all"
        raise DataError(signals.source or signals.label, limit=limit, remedy="use --drop 0, or record more cycles")
    moving = np.zeros(signals.time_s.size, dtype=bool)
    for ramp in motion.ramps:
        moving[ramp.start + 1 : ramp.stop - 1] = True  # the ends belong to holds, in which a value repeats
    marked = np.zeros(signals.volts.shape, dtype=bool)
    if not signals.ambient_subtracted:
        marked |= np.column_stack([clipped(column, moving, options.rails) for column in signals.volts.T])
    if signals.clipped is not None:
        marked |= signals.clipped
    timed = tuple(range(options.drop, count))
    main = at_main_speed(cycle_speeds(signals.time_s, signals.angle_deg, motion, timed))
    used = tuple(place for place, at_main in zip(timed, main.tolist(), strict=True) if at_main)
    return Run(signals, motion, used, timed, marked, tuple(clip_warnings(signals, marked)))


def _pooled_passes(runs: Sequence[Run], step_deg: float | None, label: str) -> Passes:
    """Half-cycles of all recordings on one grid."""
    stimulus = runs[0].signals.stimulus
    ranges = [common_range(run.signals.angle_deg, run.motion, run.timed) for run in runs]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if low >= high:
        limit = (
            f"has no {stimulus.name} that all half-cycles reach ({low:.3g}{stimulus.sign} to {high:.3g}{stimulus.sign})"
        )
        raise DataError(f"sensor {label}", limit=limit, remedy="analyse its recordings separately")
    grid = grid_deg(low, high, step_deg or nice_step(high - low), stimulus.sign)
    parts = [passes(run.signals.angle_deg, run.signals.volts, run.motion, run.timed, grid, run.clipped) for run in runs]
    return Passes.joined(parts)


def group_of(sensors: Sequence[SensorResponse]) -> SensorGroup | None:
    """Mean and standard deviation over sensors; None if they have no receivers or angles in common."""
    names = [name for name in sensors[0].receivers if all(name in sensor.receivers for sensor in sensors)]
    grids = [{round(float(angle), 9) for angle in sensor.passes.angle_deg} for sensor in sensors]
    common = np.array(sorted(set.intersection(*grids)))
    if not names or common.size < 2:
        return None
    return SensorGroup(
        tuple(sensor.label for sensor in sensors),
        common,
        {name: _group_curve([sensor.receivers[name] for sensor in sensors], common) for name in names},
    )


def _group_curve(receivers: Sequence[ReceiverResponse], angles: FloatArray) -> GroupCurve:
    rows = np.array([receiver.mean_V[np.searchsorted(receiver.angle_deg, angles - 1e-6)] for receiver in receivers])
    swings = np.array([receiver.swing_V for receiver in receivers])
    if len(receivers) == 1:
        return GroupCurve(rows[0], np.full(angles.size, np.nan), float(swings[0]), math.nan)
    return GroupCurve(rows.mean(axis=0), rows.std(axis=0, ddof=1), float(swings.mean()), float(swings.std(ddof=1)))
