"""Warnings about the response of a sensor: clipping, rest, reach, drift, speeds and what a load cell leaves unknown.

The interface: `cautions` of a sensor's receivers, and the other functions for what they are named after.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from solen.analysis.figures_of_merit import ReceiverResponse
from solen.analysis.load_cell import LoadCell
from solen.analysis.response import Passes
from solen.analysis.run import Run
from solen.analysis.signals import Signals
from solen.analysis.timing import Timing, cycle_speeds, same_speed
from solen.arrays import BoolArray
from solen.ranks import Caution, do_not_use, look_at, note, of
from solen.recording.stimulus import ANGLE, FORCE, Stimulus

_TENTH = 0.1
_ROUNDING_V = 1e-9


def cell_warnings(stimulus: Stimulus, cell: LoadCell | None) -> list[Caution]:
    """Whether it is unknown how well forces are known."""
    if stimulus is not FORCE or (cell is not None and cell.u_slope is not None):
        return []
    unknown = "how well the load cell is known is not stated: uncertainties and bands hold for the force by its reading"
    return [note(f"{unknown}; u_sensitivity_percent of [load_cell] states it")]


def timing_warnings(timing: Timing, receivers: dict[str, ReceiverResponse], sign: str) -> list[Caution]:
    """Whether a hysteresis may be timing."""
    speed, adds = max(timing.speeds_deg_per_s), timing.timing_deg
    if timing.separated or timing.timing_deg == 0.0:
        return []
    if not any(one.hysteresis_V > 3.0 * one.u_hysteresis_V for one in receivers.values()):
        return []
    speeds = " and ".join(f"{one:.3g}" for one in timing.speeds_deg_per_s)
    known, remedy = (
        f"at one speed ({speed:.3g}{sign}/s)",
        "record cycles at a second speed, twice as slow or as fast, too",
    )
    if len(timing.speeds_deg_per_s) > 1:
        known, remedy = f"with so few cycles at {speeds}{sign}/s", "record more cycles at each speed"
    bound = (
        f"{known} a hysteresis cannot be separated from a lag; clocks and readings of the stage are known to "
        f"±{1e3 * timing.bound_s:.2g} ms, up to {adds:.2g}{sign} between both directions: {remedy}"
    )
    return [look_at(bound)]


def other_speeds_left_out(run: Run) -> Iterator[Caution]:
    """Whether cycles that are left out at the beginning are all there is at another speed."""
    signals, motion, sign = run.signals, run.motion, run.signals.stimulus.sign
    speeds = cycle_speeds(signals.time_s, signals.angle_deg, motion, range(len(motion.cycles)))
    timed = speeds[list(run.timed)]
    lost = [one for one in speeds[: run.timed[0]].tolist() if not same_speed(timed, one).any()]
    if lost:
        used = float(np.median(speeds[list(run.used)]))
        yield look_at(
            f"{len(lost)} cycle{'s' * (len(lost) != 1)} at {lost[0]:.3g}{sign}/s came first and are left out (--drop "
            f"{run.timed[0]}): too few at that speed; all figures are of {used:.3g}{sign}/s: record more at each speed"
        )


def clip_warnings(signals: Signals, marked: BoolArray) -> list[Caution]:
    """How many samples (n, m) of each receiver are clipped."""
    warnings = []
    for name, column, flags in zip(signals.receivers, signals.volts.T, marked.T, strict=True):
        if flags.any():
            ends = sorted({float(value) for value in (column[flags].min(), column[flags].max())})
            where = " and ".join(f"{value:.4g} {signals.unit}" for value in ends)
            what = "readings hold samples" if signals.ambient_subtracted else "samples"
            at = "at a limit of the recorder" if signals.ambient_subtracted else f"clipped at {where}"
            marks = (
                f"{int(flags.sum())} {what} {at} ({100.0 * flags.mean():.2g} %); angles at which a cycle is "
                "clipped have no mean, and the figures of merit rest on the others"
            )
            warnings.append(of(name, look_at(marks)))
    return warnings


def _rest_warnings(runs: Sequence[Run]) -> list[Caution]:
    """Whether the angle rests elsewhere than at 0, where numbers near zero are not what they are called."""
    for run in runs:
        motion, stimulus = run.motion, run.signals.stimulus
        if (
            abs(motion.rest_deg) > _TENTH * (motion.high_deg - motion.low_deg)
            and not motion.low_deg < 0 < motion.high_deg
        ):
            zero = f"--zero-deg {motion.rest_deg:.4g}" if stimulus is ANGLE else "--tare-s"
            rests = (
                f"the {stimulus.name} rests at {motion.rest_deg:.4g}{stimulus.sign} and never passes 0, so there are "
                f"no numbers near zero; {zero} counts from there"
            )
            return [look_at(rests)]
    return []


def _reach_warnings(ways: Passes, runs: Sequence[Run]) -> list[Caution]:
    """Whether some ways go much farther than others, so that only part of the range is common to all."""
    low, high = min(run.motion.low_deg for run in runs), max(run.motion.high_deg for run in runs)
    first, last = float(ways.angle_deg[0]), float(ways.angle_deg[-1])
    if last - first > (1.0 - _TENTH) * (high - low):
        return []
    stimulus = runs[0].signals.stimulus
    sign = stimulus.sign
    part = (
        f"the {stimulus.name} goes from {low:.3g}{sign} to {high:.3g}{sign}, but all used half-cycles cover only "
        f"{first:.3g}{sign} to {last:.3g}{sign}: curves and numbers refer to that range"
    )
    return [look_at(part)]


def _drift_warnings(name: str, own: ReceiverResponse, runs: Sequence[Run]) -> list[Caution]:
    """Whether drift alone, over up to half a cycle, explains half of the hysteresis."""
    drift, unit = own.drift_V_per_min, runs[0].signals.unit
    lasts = [run.motion.cycles[place].end_s - run.motion.cycles[place].start_s for run in runs for place in run.used]
    apart = abs(drift) / 60.0 * 0.5 * float(np.median(lasts))
    if not (abs(drift) > 3.0 * own.u_drift_V_per_min and apart > 0.5 * own.hysteresis_V > 0.5 * _ROUNDING_V):
        return []
    part = (
        f"a drift of {drift:+.2g} {unit}/min separates rising and falling half-cycles by up to {apart:.2g} "
        f"{unit}, included in the hysteresis of {own.hysteresis_V:.2g} {unit}"
    )
    return [of(name, look_at(part))]


def cautions(receivers: dict[str, ReceiverResponse], ways: Passes, runs: Sequence[Run]) -> list[Caution]:
    """Warnings about the numbers of a sensor."""
    warnings, unit = _rest_warnings(runs) + _reach_warnings(ways, runs), runs[0].signals.unit
    if ways.cycles < 3:
        count = "one cycle is" if ways.cycles == 1 else "two cycles are"
        warnings.append(look_at(f"{count} used: repeatability and drift cannot be judged"))
    for place, (name, own) in enumerate(receivers.items()):
        size, u = own.hysteresis_V, own.u_hysteresis_V
        if abs(own.swing_V) <= max(3.0 * own.u_swing_V, _ROUNDING_V):
            driven = runs[0].signals.stimulus.name
            swing = f"does not respond to the {driven} beyond its noise (swing {own.swing_V:.2g} {unit})"
            warnings.append(of(name, do_not_use(swing)))
        if math.isfinite(u) and 1e-9 * own.range_V < size <= 3.0 * u:
            bound = (
                f"the hysteresis of {size:.2g} {unit} is within 3 of its uncertainties ({u:.2g} {unit}); it is a bound"
            )
            warnings.append(of(name, note(bound)))
        warnings += _drift_warnings(name, own, runs)
        if not np.isfinite(ways.volts[..., place]).any():
            warnings.append(of(name, do_not_use("has no reading in the cycles that are used")))
    return warnings
