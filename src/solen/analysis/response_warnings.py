"""Warnings about the response of a sensor: clipping, rest, range, drift, speeds and unknown load cell errors.

Public name: `cautions`.
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
from solen.ranks import Caution, do_not_use, note, prefixed, warning
from solen.recording.stimulus import ANGLE, FORCE, Stimulus

_TENTH = 0.1
_ROUNDING_V = 1e-9


def cell_warnings(stimulus: Stimulus, cell: LoadCell | None) -> list[Caution]:
    """Warning if the uncertainty of the forces is unknown."""
    if stimulus is not FORCE or (cell is not None and cell.u_slope is not None):
        return []
    unknown = (
        "the uncertainty of the load cell is not specified, so uncertainties and bands are "
        "relative to the force that it reads"
    )
    return [note(f"{unknown}; specify it with u_sensitivity_percent in [load_cell]")]


def timing_warnings(timing: Timing, receivers: dict[str, ReceiverResponse], sign: str) -> list[Caution]:
    """Warning if timing may explain a hysteresis."""
    speed, adds = max(timing.speeds_deg_per_s), timing.timing_deg
    if timing.separated or timing.timing_deg == 0.0:
        return []
    if not any(receiver.hysteresis_V > 3.0 * receiver.u_hysteresis_V for receiver in receivers.values()):
        return []
    speeds = " and ".join(f"{one:.3g}" for one in timing.speeds_deg_per_s)
    known, remedy = (
        f"at a single speed ({speed:.3g}{sign}/s),",
        "also record cycles at a second speed, half or twice as fast",
    )
    if len(timing.speeds_deg_per_s) > 1:
        known, remedy = f"with so few cycles at {speeds}{sign}/s,", "record more cycles at each speed"
    bound = (
        f"{known} hysteresis cannot be separated from lag; the timing of the stage clocks and readings is known to "
        f"±{1e3 * timing.bound_s:.2g} ms, which may add up to {adds:.2g}{sign} between the directions: {remedy}"
    )
    return [warning(bound)]


def other_speeds_left_out(run: Run) -> Iterator[Caution]:
    """Warning if the omitted cycles at the beginning are the only cycles at another speed."""
    signals, motion, sign = run.signals, run.motion, run.signals.stimulus.sign
    speeds = cycle_speeds(signals.time_s, signals.angle_deg, motion, range(len(motion.cycles)))
    timed = speeds[list(run.timed)]
    lost = [one for one in speeds[: run.timed[0]].tolist() if not same_speed(timed, one).any()]
    if lost:
        used = float(np.median(speeds[list(run.used)]))
        yield warning(
            f"--drop {run.timed[0]} omits {len(lost)} cycle{'s' * (len(lost) != 1)} at {lost[0]:.3g}{sign}/s from the "
            f"beginning, which leaves too few at that speed; all figures are for {used:.3g}{sign}/s: "
            "record more cycles at each speed"
        )


def clip_warnings(signals: Signals, marked: BoolArray) -> list[Caution]:
    """Warnings with the number of clipped samples (n, m) of each receiver."""
    warnings = []
    for name, column, flags in zip(signals.receivers, signals.volts.T, marked.T, strict=True):
        if flags.any():
            ends = sorted({float(value) for value in (column[flags].min(), column[flags].max())})
            where = " and ".join(f"{value:.4g} {signals.unit}" for value in ends)
            what = "readings contain samples" if signals.ambient_subtracted else "samples"
            at = "at a limit of the recorder" if signals.ambient_subtracted else f"clipped at {where}"
            marks = (
                f"{int(flags.sum())} {what} {at} ({100.0 * flags.mean():.2g} %); angles at which a cycle is "
                "clipped have no mean, and the figures of merit are computed from the other angles"
            )
            warnings.append(prefixed(name, warning(marks)))
    return warnings


def _rest_warnings(runs: Sequence[Run]) -> list[Caution]:
    """Warning if the angle does not rest at 0, so that figures near zero do not describe the response near zero."""
    for run in runs:
        motion, stimulus = run.motion, run.signals.stimulus
        if (
            abs(motion.rest_deg) > _TENTH * (motion.high_deg - motion.low_deg)
            and not motion.low_deg < 0 < motion.high_deg
        ):
            zero = f"--zero-deg {motion.rest_deg:.4g}" if stimulus is ANGLE else "--tare-s"
            rests = (
                f"the {stimulus.name} rests at {motion.rest_deg:.4g}{stimulus.sign} and never passes 0, so there are "
                f"no figures near zero; {zero} sets the zero there"
            )
            return [warning(rests)]
    return []


def _reach_warnings(ways: Passes, runs: Sequence[Run]) -> list[Caution]:
    """Warning if some half-cycles extend much farther than others, so that only part of the range is common to all."""
    low, high = min(run.motion.low_deg for run in runs), max(run.motion.high_deg for run in runs)
    first, last = float(ways.angle_deg[0]), float(ways.angle_deg[-1])
    if last - first > (1.0 - _TENTH) * (high - low):
        return []
    stimulus = runs[0].signals.stimulus
    sign = stimulus.sign
    part = (
        f"the {stimulus.name} ranges from {low:.3g}{sign} to {high:.3g}{sign}, but the range common to all "
        f"used half-cycles is {first:.3g}{sign} to {last:.3g}{sign}: curves and figures refer to this range"
    )
    return [warning(part)]


def _drift_warnings(name: str, own: ReceiverResponse, runs: Sequence[Run]) -> list[Caution]:
    """Warning if drift over up to half a cycle accounts for half of the hysteresis."""
    drift, unit = own.drift_V_per_min, runs[0].signals.unit
    lasts = [run.motion.cycles[place].end_s - run.motion.cycles[place].start_s for run in runs for place in run.used]
    apart = abs(drift) / 60.0 * 0.5 * float(np.median(lasts))
    if not (abs(drift) > 3.0 * own.u_drift_V_per_min and apart > 0.5 * own.hysteresis_V > 0.5 * _ROUNDING_V):
        return []
    part = (
        f"a drift of {drift:+.2g} {unit}/min separates rising and falling half-cycles by up to {apart:.2g} "
        f"{unit}, included in the hysteresis of {own.hysteresis_V:.2g} {unit}"
    )
    return [prefixed(name, warning(part))]


def cautions(receivers: dict[str, ReceiverResponse], ways: Passes, runs: Sequence[Run]) -> list[Caution]:
    """Warnings about a sensor's figures of merit."""
    warnings, unit = _rest_warnings(runs) + _reach_warnings(ways, runs), runs[0].signals.unit
    if ways.cycles < 3:
        count = "one cycle is" if ways.cycles == 1 else "two cycles are"
        warnings.append(warning(f"{count} used: repeatability and drift cannot be judged"))
    for place, (name, own) in enumerate(receivers.items()):
        size, u = own.hysteresis_V, own.u_hysteresis_V
        if abs(own.swing_V) <= max(3.0 * own.u_swing_V, _ROUNDING_V):
            driven = runs[0].signals.stimulus.name
            swing = f"does not respond to the {driven} beyond its noise (swing {own.swing_V:.2g} {unit})"
            warnings.append(prefixed(name, do_not_use(swing)))
        if math.isfinite(u) and 1e-9 * own.range_V < size <= 3.0 * u:
            bound = (
                f"the hysteresis of {size:.2g} {unit} is within three standard uncertainties ({u:.2g} "
                f"{unit} each); it is a bound"
            )
            warnings.append(prefixed(name, note(bound)))
        warnings += _drift_warnings(name, own, runs)
        if not np.isfinite(ways.volts[..., place]).any():
            warnings.append(prefixed(name, do_not_use("contains no reading in the cycles used")))
    return warnings
