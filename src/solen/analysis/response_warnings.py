"""Warnings about the response of a sensor: clipping, rest position, range, drift, speeds and unknown load cell errors.

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

_MARGIN = 0.1  # fraction of the range
_ROUNDING_V = 1e-9


def cell_warnings(stimulus: Stimulus, cell: LoadCell | None) -> list[Caution]:
    """Return a warning if the uncertainty of the forces is unknown."""
    if stimulus is not FORCE or (cell is not None and cell.u_slope is not None):
        return []
    unknown = "the uncertainty of the load cell is not specified, so uncertainties and bands exclude it"
    return [note(f"{unknown}; specify it with u_sensitivity_percent in [load_cell]")]


def timing_warnings(timing: Timing, receivers: dict[str, ReceiverResponse], sign: str) -> list[Caution]:
    """Return a warning if timing may explain a hysteresis."""
    if timing.separated or timing.timing_deg == 0.0:
        return []
    if not any(receiver.hysteresis_V > 3.0 * receiver.u_hysteresis_V for receiver in receivers.values()):
        return []
    speeds = " and ".join(f"{speed:.3g}" for speed in timing.speeds_deg_per_s)
    reason, remedy = f"at a single speed ({speeds}{sign}/s)", "also record cycles at half or twice that speed"
    if len(timing.speeds_deg_per_s) > 1:
        reason, remedy = f"with so few cycles at {speeds}{sign}/s", "record more cycles at each speed"
    text = (
        f"{reason}, hysteresis cannot be separated from lag; angles and readings are synchronous to within "
        f"±{1e3 * timing.bound_s:.2g} ms, which may add up to {timing.timing_deg:.2g}{sign} to the difference between "
        f"the directions: {remedy}"
    )
    return [warning(text)]


def omitted_speed_warnings(run: Run) -> Iterator[Caution]:
    """Yield a warning if the cycles omitted at the beginning are the only cycles at another speed."""
    signals, motion, sign = run.signals, run.motion, run.signals.stimulus.sign
    speeds = cycle_speeds(signals.time_s, signals.angle_deg, motion, range(len(motion.cycles)))
    timed = speeds[list(run.timed)]
    lost = [speed for speed in speeds[: run.timed[0]].tolist() if not same_speed(timed, speed).any()]
    if lost:
        used = float(np.median(speeds[list(run.used)]))
        yield warning(
            f"--drop {run.timed[0]} omits {len(lost)} cycle{'s' * (len(lost) != 1)} at {lost[0]:.3g}{sign}/s from the "
            f"beginning, which leaves too few at that speed; all figures are for {used:.3g}{sign}/s: "
            "record more cycles at each speed"
        )


def clip_warnings(signals: Signals, marked: BoolArray) -> list[Caution]:
    """Return warnings with the number of clipped samples (n, m) of each receiver."""
    warnings = []
    for name, column, flags in zip(signals.receivers, signals.volts.T, marked.T, strict=True):
        if flags.any():
            limits = sorted({float(value) for value in (column[flags].min(), column[flags].max())})
            listed = " and ".join(f"{value:.4g} {signals.unit}" for value in limits)
            clipping = f"samples clipped at {listed}"
            if signals.ambient_subtracted:
                clipping = "readings contain samples at a limit of the recorder"
            text = (
                f"{int(flags.sum())} {clipping} ({100.0 * flags.mean():.2g} %); angles at which a cycle is "
                "clipped have no mean, and the figures of merit are computed from the other angles"
            )
            warnings.append(prefixed(name, warning(text)))
    return warnings


def _rest_warnings(runs: Sequence[Run]) -> list[Caution]:
    """Return a warning if the angle is not 0 at rest and never passes 0, so that nothing is known near zero."""
    for run in runs:
        motion, stimulus = run.motion, run.signals.stimulus
        off_zero = abs(motion.rest_deg) > _MARGIN * (motion.high_deg - motion.low_deg)
        if off_zero and not motion.low_deg < 0 < motion.high_deg:
            option = f"--zero-deg {motion.rest_deg:.4g}" if stimulus is ANGLE else "--tare-s"
            text = (
                f"the {stimulus.name} is {motion.rest_deg:.4g}{stimulus.sign} at rest and never passes 0, so there are "
                f"no figures near zero; set the zero there with {option}"
            )
            return [warning(text)]
    return []


def _range_warnings(passes: Passes, runs: Sequence[Run]) -> list[Caution]:
    """Return a warning if the range common to all half-cycles is much smaller than the total range."""
    low, high = min(run.motion.low_deg for run in runs), max(run.motion.high_deg for run in runs)
    first, last = float(passes.angle_deg[0]), float(passes.angle_deg[-1])
    if last - first > (1.0 - _MARGIN) * (high - low):
        return []
    stimulus = runs[0].signals.stimulus
    sign = stimulus.sign
    text = (
        f"the {stimulus.name} ranges from {low:.3g}{sign} to {high:.3g}{sign}, but the range common to all "
        f"used half-cycles is {first:.3g}{sign} to {last:.3g}{sign}: curves and figures refer to this common range"
    )
    return [warning(text)]


def _drift_warnings(name: str, response: ReceiverResponse, runs: Sequence[Run]) -> list[Caution]:
    """Return a warning if drift over up to half a cycle accounts for half of the hysteresis."""
    drift, unit = response.drift_V_per_min, runs[0].signals.unit
    cycles = [run.motion.cycles[index] for run in runs for index in run.used]
    half_s = 0.5 * float(np.median([cycle.end_s - cycle.start_s for cycle in cycles]))
    change = abs(drift) / 60.0 * half_s
    hysteresis = response.hysteresis_V
    if not (abs(drift) > 3.0 * response.u_drift_V_per_min and change > 0.5 * hysteresis > 0.5 * _ROUNDING_V):
        return []
    text = (
        f"a drift of {drift:+.2g} {unit}/min separates rising and falling half-cycles by up to {change:.2g} {unit}, "
        f"which is included in the hysteresis of {hysteresis:.2g} {unit}"
    )
    return [prefixed(name, warning(text))]


def cautions(receivers: dict[str, ReceiverResponse], passes: Passes, runs: Sequence[Run]) -> list[Caution]:
    """Return warnings about a sensor's figures of merit."""
    warnings = _rest_warnings(runs) + _range_warnings(passes, runs)
    if passes.cycles < 3:
        count = "one cycle is" if passes.cycles == 1 else "two cycles are"
        warnings.append(warning(f"{count} used: repeatability and drift cannot be determined"))
    for index, (name, response) in enumerate(receivers.items()):
        warnings += [prefixed(name, caution) for caution in _size_warnings(response, runs[0].signals)]
        warnings += _drift_warnings(name, response, runs)
        if not np.isfinite(passes.volts[..., index]).any():
            warnings.append(prefixed(name, do_not_use("has no reading in the cycles used")))
    return warnings


def _size_warnings(response: ReceiverResponse, signals: Signals) -> Iterator[Caution]:
    """Yield warnings about a swing or a hysteresis that is not larger than its uncertainty."""
    size, u, unit = response.hysteresis_V, response.u_hysteresis_V, signals.unit
    if abs(response.swing_V) <= max(3.0 * response.u_swing_V, _ROUNDING_V):
        yield do_not_use(
            f"does not respond to the {signals.stimulus.name} above its noise (swing {response.swing_V:.2g} {unit})"
        )
    if math.isfinite(u) and 1e-9 * response.range_V < size <= 3.0 * u:
        yield note(
            f"the hysteresis of {size:.2g} {unit} is at most three times its standard uncertainty of {u:.2g} {unit}; "
            "it is an upper bound"
        )
