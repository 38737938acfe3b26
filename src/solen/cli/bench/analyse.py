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
"""Words for the lens of a sensor."""


@lines.register
def _(result: NetworkStates) -> Iterator[str]:
    stops, simulated = len(result.angle_deg), "; simulated" if result.simulated else ""
    ends = zip(result.motions, result.angle_deg.T, strict=True)
    reached = ", ".join(f"{name} {angle.min():.3g}° to {angle.max():.3g}°" for name, angle in ends)
    yield f"{result.sensor or 'network'}: {stops} stops, {reached}{simulated}"
    low, high = result.signal_V.min(axis=0), result.signal_V.max(axis=0)
    for lit, emitter in enumerate(result.emitters):
        yield f"  {emitter} lit:"
        for read, receiver in enumerate(result.receivers):
            ends_V = f"{low[lit, read]:.4g} to {high[lit, read]:.4g} {result.unit}"
            u = float(result.u_signal_V[:, lit, read].mean())
            yield f"    {receiver}: {ends_V}, ± {u:.1g} at a stop; noise of a reading {result.noise_V[lit, read]:.2g}"


@lines.register
def _(study: Study) -> Iterator[str]:
    for sensor in study.sensors.values():
        yield from _sensor(sensor, simulated=study.simulated)
    for name, swing in (study.lens_beside_none or {}).items():
        if math.isfinite(swing.without_lens_percent):
            yield f"without a lens {name} swings by {swing.without_lens_percent:.3g} % of its swing with the lens"
    if study.detected and study.command is not None:
        yield f"in full: {study.command}"


def _sensor(sensor: SensorResponse, *, simulated: bool) -> Iterator[str]:
    motion = sensor.runs[0].motion
    cycles = f"{sensor.cycles_used} of {sum(len(run.motion.cycles) for run in sensor.runs)} cycles"
    sign = sensor.stimulus.sign
    reach = f"{motion.low_deg:.3g}{sign} to {motion.high_deg:.3g}{sign}"
    others = sum(len(run.timed) - len(run.used) for run in sensor.runs)
    speeds = f"; {others} more, at another speed, for timing" if others else ""
    yield f"{sensor.label}{LENS[sensor.lens]}: {cycles}, {reach}{speeds}{'; simulated' if simulated else ''}"
    for name, receiver in sensor.receivers.items():
        yield from _receiver(name, receiver, sensor.timing.receivers[name], sensor.unit, sign)
    if sensor.cell is not None and (share := sensor.cell.u_slope) is not None:
        yield (f"  load cell: its specified uncertainty, {100.0 * share:.2g} % of each sensitivity, is included")
    yield _timing(sensor.timing, sensor.stimulus)
    if sensor.ageing is not None:
        yield from _ageing(sensor.ageing, sensor.unit, sign)
    pair = sensor.left_minus_right
    if pair is not None and math.isfinite(pair.balance_deg):
        what = "voltage" if sensor.unit == "V" else "value"
        yield f"  left and right show the same {what} at {_pm(pair.balance_deg, pair.u_balance_deg, sign)}"


def _ageing(ageing: Ageing, unit: str, sign: str) -> Iterator[str]:
    groups = len(ageing.first_cycle)
    yield f"  over {groups} groups of {ageing.first_cycle[1] - 1} cycles, per 1000 cycles:"
    for name, receiver in ageing.receivers.items():
        change = _pm(1e3 * receiver.swing_V_per_cycle, 1e3 * receiver.u_swing_V_per_cycle, f" {unit}")
        yield f"    {name}: swing {change}; noise {receiver.noise_V[0]:.2g} to {receiver.noise_V[-1]:.2g} {unit}"
    yield f"    null {_pm(1e3 * ageing.balance_deg_per_cycle, 1e3 * ageing.u_balance_deg_per_cycle, sign)}"


def _timing(timing: Timing, stimulus: Stimulus) -> str:
    if timing.separated:
        lag = f"{1e3 * timing.lag_s:.3g} ± {1e3 * timing.u_lag_s:.2g} ms"
        return f"  timing: from two speeds, the voltages lag the {stimulus.name} by {lag}"
    if not math.isfinite(timing.bound_s):
        return "  timing: unknown"
    if timing.timing_deg == 0.0:
        return "  timing: no contribution, as all readings were taken at stops"
    most = f"{timing.timing_deg:.2g}{stimulus.sign}"
    return (
        f"  timing: ±{1e3 * timing.bound_s:.2g} ms, up to {most} between the two directions; a single speed cannot "
        "separate it further from hysteresis"
    )


def _receiver(name: str, response: ReceiverResponse, timing: ReceiverTiming, unit: str, sign: str) -> Iterator[str]:
    each = f" {unit}/{sign.strip()}"
    slope = _pm(response.sensitivity_V_per_deg, response.u_sensitivity_V_per_deg, each)
    near_zero = _pm(response.sensitivity_near_zero_V_per_deg, response.u_sensitivity_near_zero_V_per_deg, each)
    swing = _pm(response.range_V, response.u_range_V, f" {unit}")
    yield f"  {name}: range {swing}; sensitivity {slope}, near zero {near_zero}"
    linearity = _percent(response.independent_linearity_percent)
    shares = (
        f"hysteresis {_percent(response.hysteresis_percent)} {_apart(timing)}, linearity {linearity}, "
        f"repeatability {_percent(response.repeatability_percent)} of full scale"
    )
    yield f"    {shares}; drift {_pm(response.drift_V_per_min, response.u_drift_V_per_min, f' {unit}/min')}"
    angle = response.resolution_near_zero_deg
    noise = f"{1e3 * response.noise_V:.3g} mV" if unit == "V" else f"{response.noise_V:.3g} {unit}"
    yield f"    noise {noise}" + (f", that is {angle:.2g}{sign} near zero" if angle == angle else "")


def _apart(timing: ReceiverTiming) -> str:
    """Return the contribution of timing to the hysteresis, or the hysteresis that remains when a lag is removed."""
    if math.isfinite(timing.u_hysteresis_V):
        return f"(without lag {_percent(timing.hysteresis_percent)})"
    return f"(timing up to {_percent(timing.timing_percent)})"


def _pm(value: float, u: float, unit: str) -> str:
    if not math.isfinite(value):
        return "not known"
    if not (math.isfinite(u) and u):
        return f"{value:.4g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(u)))
    return f"{value:.{digits}f} ± {u:.{digits}f}{unit}" if digits < 9 else f"{value:.9g} ± {u:.1e}{unit}"


def _percent(value: float) -> str:
    return f"{value:.2g} %" if math.isfinite(value) else "not known"
