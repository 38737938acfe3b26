"""Response and figures of merit of a sensor from its recordings, and the comparison of several sensors.

The first cycle of each recording is omitted, as in the paper, because material and stage settle during it. The
half-cycles of all recordings of a sensor are computed on one grid, so that they can be pooled. To compare sensors, each
sensor is one replicate: the mean and standard deviation of a group are those of its sensors' mean curves, and n is the
number of prints.

Public names: `sensor_response`, `group_of` and `SensorGroup`.
"""

import math
from collections.abc import Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any, Self, TypeVar

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
    omitted_speed_warnings,
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

R = TypeVar("R", bound=ReceiverResponse)


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
    """Receiver voltage without light, from which crosstalk and contrast of the light are computed."""
    every: int | None = Field(None, ge=2)
    """Show how response, null and noise change between groups of this many cycles."""

    @model_validator(mode="after")
    def _check_angle(self) -> Self:
        if self.angle_time is not None and not self.angle_file:
            limit = "names a column of a stage log, but no log is specified"
            raise refused("angle_time", limit, value=self.angle_time, remedy="name the log with --angle-file")
        if self.angle_rate_hz is not None and (not self.angle_file or self.angle_time is not None):
            limit = "applies only to a log without times"
            remedy = "use --angle-file without --angle-time"
            raise refused("angle_rate_hz", limit, value=self.angle_rate_hz, remedy=remedy)
        if self.amplitude_deg is not None and (self.angle_file or self.angle is not None):
            limit = "applies only to recordings without an angle"
            remedy = "omit it, or omit --angle and --angle-file"
            raise refused("amplitude_deg", limit, value=self.amplitude_deg, remedy=remedy)
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
    unit
        Unit of the receivers.
    receivers
        Response of each receiver, keyed by its name.
    left_minus_right
        Response of the difference; None if the names do not distinguish left and right.
    timing
        Contribution of timing to the hysteresis, and the hysteresis without it.
    runs
        Recordings of the sensor.
    passes
        Half-cycles of all recordings on a common grid.
    near_zero_deg
        Half-width of the range about 0 in which the sensitivity near zero is computed.
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
    """A group of sensors: labels, common angles (g,), and curves of the common receivers, keyed by name."""

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

    ``motions`` caches the motion detected in an angle, keyed by the identity of its array, for other sensors on the
    same stage.

    Raises
    ------
    DataError
        If a recording contains no complete cycle, no cycle remains, or the recordings have different receivers.
    """
    first = recordings[0]
    _check_alike(recordings)
    cache = {} if motions is None else motions
    runs = tuple(_run(signals, options, cache) for signals in recordings)
    timed = _pooled_passes(runs, options.step_deg, first.label)
    near_zero = first.stimulus.near_zero(float(np.abs(timed.angle_deg).max()))
    used = timed.rows(np.array([cycle in run.used for run in runs for cycle in run.timed]))
    noise = pooled_noise([_scatter(run) for run in runs]).tolist()
    receivers = {
        name: receiver_response(used.of(n), noise[n], sum(int(run.clipped[:, n].sum()) for run in runs), near_zero)
        for n, name in enumerate(first.receivers)
    }
    sides = left_right(first.receivers)
    pair = None
    if sides is not None:
        pair = pair_response(used, sides, (noise[sides[0]], noise[sides[1]]), options.dark_V, near_zero)
    warnings = [caution for run in runs for caution in (*run.motion.warnings, *run.warnings)]
    if first.lens is not False and first.stimulus is ANGLE:
        warnings += sign_warnings(receivers, sides, first.unit)
    warnings += cautions(receivers, used, runs)
    timing = _timing(runs, timed, receivers)
    warnings += [caution for run in runs for caution in omitted_speed_warnings(run)]
    warnings += timing_warnings(timing, receivers, first.stimulus.sign)
    ageing = None
    if options.every is not None:
        scatters = [scatter for run in runs for scatter in _cycle_scatters(run)]
        ageing = ageing_of(used, scatters, first.receivers, sides, options.every)
    cell = least_certain(signals.cell for signals in recordings)
    warnings += cell_warnings(first.stimulus, cell)
    if cell is not None:
        receivers = {name: _with_cell_errors(response, cell) for name, response in receivers.items()}
        pair = None if pair is None else _with_cell_errors(pair, cell)
    return SensorResponse(
        first.label, first.lens, first.unit, receivers, pair, timing, runs, used, near_zero, tuple(warnings), ageing
    )


def _check_alike(recordings: Sequence[Signals]) -> None:
    """Raise `DataError` if the recordings of a sensor have different receivers or units."""
    first = recordings[0]
    for other in recordings[1:]:
        name = f"{other.source} ({other.label})"
        if other.unit != first.unit:
            limit = f"is in {other.unit}, but {first.source} is in {first.unit}"
            raise DataError(name, limit=limit, remedy="analyse them separately")
        if other.receivers != first.receivers:
            limit = f"has receivers {', '.join(other.receivers)}, but {first.source} has {', '.join(first.receivers)}"
            raise DataError(name, limit=limit, remedy="use the same receiver names in both with --channel")


def _with_cell_errors(response: R, cell: LoadCell) -> R:
    """Return a response against force whose uncertainties include the load cell errors common to all readings."""
    u_slope = cell.u_slope or 0.0
    u: dict[str, Any] = {}
    for name in ("sensitivity_V_per_deg", "sensitivity_near_zero_V_per_deg"):
        u[f"u_{name}"] = math.hypot(getattr(response, f"u_{name}"), u_slope * getattr(response, name))
    if isinstance(response, PairResponse):
        u["u_balance_deg"] = math.hypot(response.u_balance_deg, u_slope * response.balance_deg, cell.u_line_N)
    return replace(response, **u)


def _scatter(run: Run, start_s: float = -math.inf, end_s: float = math.inf) -> Scatter:
    """Return the scatter of the readings in a run, or in one of its cycles."""
    time = run.signals.time_s
    begin, end = np.searchsorted(time, (start_s, end_s)).tolist()
    volts = np.where(run.clipped, np.nan, run.signals.volts)[begin:end]
    holds = [(start - begin, stop - begin) for start, stop in run.motion.holds if begin <= start and stop <= end]
    return noise_of(time[begin:end], volts, holds)


def _cycle_scatters(run: Run) -> list[Scatter]:
    """Return the scatter of each used cycle."""
    cycles = [run.motion.cycles[index] for index in run.used]
    return [_scatter(run, cycle.start_s, cycle.end_s) for cycle in cycles]


def _timing(runs: Sequence[Run], passes: Passes, receivers: dict[str, ReceiverResponse]) -> Timing:
    """Return the timing of all recordings from cycles at every speed, with the largest bound."""
    speeds, bounds = [], []
    for run in runs:
        signals = run.signals
        speeds.append(cycle_speeds(signals.time_s, signals.angle_deg, run.motion, run.timed))
        delay_s = angle_bound_s(signals.time_s, signals.angle_deg, run.motion)
        of_angle: tuple[float, Source] = (delay_s, signals.stimulus.name)
        bounds.append(signals.timing_bound_s or of_angle)
    return timing_of(passes, np.concatenate(speeds), max(bounds), receivers)


def _run(signals: Signals, options: AnalysisOptions, cache: dict[int, Motion]) -> Run:
    motion = cache.get(id(signals.angle_deg)) or find_motion(signals.time_s, signals.angle_deg, signals.stimulus)
    cache[id(signals.angle_deg)] = motion
    count = len(motion.cycles)
    if count <= options.drop:
        limit = f"contains {count} complete cycle{'s' * (count != 1)}, of which --drop {options.drop} omits all"
        raise DataError(signals.source or signals.label, limit=limit, remedy="use --drop 0, or record more cycles")
    moving = np.zeros(signals.time_s.size, dtype=bool)
    for ramp in motion.ramps:
        moving[ramp.start + 1 : ramp.stop - 1] = True  # the end samples belong to holds, in which values repeat
    marked = np.zeros(signals.volts.shape, dtype=bool)
    if not signals.ambient_subtracted:
        marked |= np.column_stack([clipped(column, moving, options.rails) for column in signals.volts.T])
    if signals.clipped is not None:
        marked |= signals.clipped
    timed = tuple(range(options.drop, count))
    main = at_main_speed(cycle_speeds(signals.time_s, signals.angle_deg, motion, timed))
    used = tuple(cycle for cycle, at_main in zip(timed, main.tolist(), strict=True) if at_main)
    return Run(signals, motion, used, timed, marked, tuple(clip_warnings(signals, marked)))


def _pooled_passes(runs: Sequence[Run], step_deg: float | None, label: str) -> Passes:
    """Return the half-cycles of all recordings on one grid."""
    stimulus = runs[0].signals.stimulus
    ranges = [common_range(run.signals.angle_deg, run.motion, run.timed) for run in runs]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if low >= high:
        sign = stimulus.sign
        limit = f"has no {stimulus.name} that all half-cycles reach: {low:.3g}{sign} to {high:.3g}{sign} is empty"
        raise DataError(f"sensor {label}", limit=limit, remedy="analyse its recordings separately")
    grid = grid_deg(low, high, step_deg or nice_step(high - low), stimulus.sign)
    parts = [passes(run.signals.angle_deg, run.signals.volts, run.motion, run.timed, grid, run.clipped) for run in runs]
    return Passes.joined(parts)


def group_of(sensors: Sequence[SensorResponse]) -> SensorGroup | None:
    """Return the mean and standard deviation over sensors; None without a common receiver and two common angles."""
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
