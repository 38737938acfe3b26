"""The command `solen bench analyse`, which analyses recordings."""

import math
from collections.abc import Iterator

from solen.analysis import ReceiverResponse, SensorResponse, Study
from solen.analysis.ageing import Ageing
from solen.analysis.network import NetworkStates
from solen.analysis.timing import ReceiverTiming, Timing
from solen.cli.app import lines
from solen.pipeline.bench.analyse import analyse as analyse
from solen.recording.stimulus import Stimulus

LENS = {None: "", True: ", lens", False: ", no lens"}
"""Text after a sensor's name: whether it has a lens, if this is known."""


@lines.register
def _(result: NetworkStates) -> Iterator[str]:
    stops, simulated = len(result.angle_deg), "; simulated" if result.simulated else ""
    motions = zip(result.motions, result.angle_deg.T, strict=True)
    ranges = ", ".join(f"{name} {angle.min():.3g}° to {angle.max():.3g}°" for name, angle in motions)
    yield f"{result.sensor or 'network'}: {stops} stops, {ranges}{simulated}"
    low, high = result.signal_V.min(axis=0), result.signal_V.max(axis=0)
    for i, emitter in enumerate(result.emitters):
        yield f"  {emitter} on:"
        for j, receiver in enumerate(result.receivers):
            signals = f"{low[i, j]:.4g} to {high[i, j]:.4g} {result.unit}"
            u = float(result.u_signal_V[:, i, j].mean())
            yield f"    {receiver}: {signals}, ± {u:.1g} at a stop; noise of a reading {result.noise_V[i, j]:.2g}"


@lines.register
def _(study: Study) -> Iterator[str]:
    for sensor in study.sensors.values():
        yield from _sensor(sensor, simulated=study.simulated)
    for name, swing in (study.lens_beside_none or {}).items():
        if math.isfinite(swing.without_lens_percent):
            yield f"the swing of {name} without a lens is {swing.without_lens_percent:.3g} % of that with a lens"
    if study.detected and study.command is not None:
        yield f"command with all settings: {study.command}"


def _sensor(sensor: SensorResponse, *, simulated: bool) -> Iterator[str]:
    motion = sensor.runs[0].motion
    cycles = f"{sensor.cycles_used} of {sum(len(run.motion.cycles) for run in sensor.runs)} cycles"
    sign = sensor.stimulus.sign
    reach = f"{motion.low_deg:.3g}{sign} to {motion.high_deg:.3g}{sign}"
    others = sum(len(run.timed) - len(run.used) for run in sensor.runs)
    speeds = f"; {others} more at another speed, used only for timing" if others else ""
    yield f"{sensor.label}{LENS[sensor.lens]}: {cycles}, {reach}{speeds}{'; simulated' if simulated else ''}"
    for name, receiver in sensor.receivers.items():
        yield from _receiver(name, receiver, sensor.timing.receivers[name], sensor.unit, sign)
    if sensor.cell is not None and (u_slope := sensor.cell.u_slope) is not None:
        yield f"  load cell: its specified uncertainty, {100.0 * u_slope:.2g} % of each sensitivity, is included"
    yield _timing(sensor.timing, sensor.stimulus)
    if sensor.ageing is not None:
        yield from _ageing(sensor.ageing, sensor.unit, sign)
    pair = sensor.left_minus_right
    if pair is not None and math.isfinite(pair.balance_deg):
        quantity = "voltage" if sensor.unit == "V" else "value"
        yield f"  left and right have the same {quantity} at {_pm(pair.balance_deg, pair.u_balance_deg, sign)}"


def _ageing(ageing: Ageing, unit: str, sign: str) -> Iterator[str]:
    groups = len(ageing.first_cycle)
    yield f"  change per 1000 cycles, from {groups} groups of {ageing.first_cycle[1] - 1} cycles:"
    for name, receiver in ageing.receivers.items():
        change = _pm(1e3 * receiver.swing_V_per_cycle, 1e3 * receiver.u_swing_V_per_cycle, f" {unit}")
        first, last = receiver.noise_V[[0, -1]]
        yield f"    {name}: swing {change}; noise from {first:.2g} to {last:.2g} {unit}"
    balance = _pm(1e3 * ageing.balance_deg_per_cycle, 1e3 * ageing.u_balance_deg_per_cycle, sign)
    yield f"    {'angle' if sign == '°' else 'value'} of equal signals: {balance}"


def _timing(timing: Timing, stimulus: Stimulus) -> str:
    if timing.separated:
        lag = f"{1e3 * timing.lag_s:.3g} ± {1e3 * timing.u_lag_s:.2g} ms"
        return f"  timing: from two speeds, the voltages lag the {stimulus.name} by {lag}"
    if not math.isfinite(timing.bound_s):
        return "  timing: unknown"
    if timing.timing_deg == 0.0:
        return "  timing: no contribution, because all readings were taken at stops"
    return (
        f"  timing: uncertain by ±{1e3 * timing.bound_s:.2g} ms, i.e. up to {timing.timing_deg:.2g}{stimulus.sign} "
        "between the two directions, which a single speed cannot separate from hysteresis"
    )


def _receiver(name: str, response: ReceiverResponse, timing: ReceiverTiming, unit: str, sign: str) -> Iterator[str]:
    slope_unit = f" {unit}/{sign.strip()}"
    slope = _pm(response.sensitivity_V_per_deg, response.u_sensitivity_V_per_deg, slope_unit)
    near_zero = _pm(response.sensitivity_near_zero_V_per_deg, response.u_sensitivity_near_zero_V_per_deg, slope_unit)
    full_scale = _pm(response.range_V, response.u_range_V, f" {unit}")
    yield f"  {name}: range {full_scale}; sensitivity {slope}, near zero {near_zero}"
    linearity = _percent(response.independent_linearity_percent)
    percentages = (
        f"hysteresis {_percent(response.hysteresis_percent)} {_timing_part(timing)}, linearity {linearity}, "
        f"repeatability {_percent(response.repeatability_percent)} of full scale"
    )
    yield f"    {percentages}; drift {_pm(response.drift_V_per_min, response.u_drift_V_per_min, f' {unit}/min')}"
    angle = response.resolution_near_zero_deg
    noise = f"{1e3 * response.noise_V:.3g} mV" if unit == "V" else f"{response.noise_V:.3g} {unit}"
    yield f"    noise {noise}" + (f", i.e. {angle:.2g}{sign} near zero" if angle == angle else "")


def _timing_part(timing: ReceiverTiming) -> str:
    """Return the contribution of timing to the hysteresis, or the hysteresis without a lag if this is known."""
    if math.isfinite(timing.u_hysteresis_V):
        return f"(without lag {_percent(timing.hysteresis_percent)})"
    return f"(timing up to {_percent(timing.timing_percent)})"


def _pm(value: float, u: float, unit: str) -> str:
    if not math.isfinite(value):
        return "unknown"
    if not (math.isfinite(u) and u):
        return f"{value:.4g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(u)))
    return f"{value:.{digits}f} ± {u:.{digits}f}{unit}" if digits < 9 else f"{value:.9g} ± {u:.1e}{unit}"


def _percent(value: float) -> str:
    return f"{value:.2g} %" if math.isfinite(value) else "unknown"
