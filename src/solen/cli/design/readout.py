"""The command for receiver voltages of a design."""

import math
from collections.abc import Iterator

from solen.cli.app import lines, text
from solen.pipeline.design.readout import readout as readout
from solen.readout import Circuit, Drive, Setting
from solen.readout.advice import Advice
from solen.sensor.network.volts import NetworkVolts
from solen.sensor.readings import DesignReadings

MAX_ROWS = 8
ANY_LOAD_OHM = 1e8
"""Load in ohms above which the largest load is printed as any load."""


@lines.register
def _(readings: DesignReadings) -> Iterator[str]:
    circuit, summary = readings.circuit, readings.range
    yield f"{readings.name} (simulated): {_receivers(circuit)}"
    yield f"  emitter {_emitter(circuit.drive)}"
    yield f"  sensitivity at {readings.wavelength_nm:g} nm {circuit.transistor.response:.3g} of the specified value"
    yield from _table(readings)
    yield (
        f"  readings {summary.lowest_V:.3f} to {summary.highest_V:.3f} V, {100 * summary.used_of_supply:.0f} % of "
        f"the supply; resolution of one reading {_resolution(summary.best_resolution_deg)} to "
        f"{_resolution(summary.worst_resolution_deg)} deg"
    )
    yield from _load(readings.advice)


@lines.register
def _(volts: NetworkVolts) -> Iterator[str]:
    first, rest, (low, high) = volts.circuits[0], volts.at_rest, volts.range_V
    yield f"{volts.name} (simulated), {len(rest.emitters)} emitters in turn: {_receivers(first)}"
    width = max(14, *(len(name) + 2 for name in rest.receivers))
    yield f"  {'V, mV noise':12}" + "".join(f"{name:>{width}}" for name in rest.receivers)
    for name, voltage, sd in zip(rest.emitters, rest.voltage_V[0], rest.sd_V[0], strict=True):
        cells = (f"{value:.4f} {1e3 * noise:5.2f}" for value, noise in zip(voltage, sd, strict=True))
        yield f"  {name:12}" + "".join(f"{cell:>{width}}" for cell in cells)
    drives = [_emitter(circuit.drive) for circuit in volts.circuits]
    for drive in dict.fromkeys(drives):
        names = (name for name, emitter_drive in zip(rest.emitters, drives, strict=True) if emitter_drive == drive)
        yield f"  {', '.join(names)}: {drive}"
    for name, motion in volts.by_motion.items():
        yield f"  {name}: resolution in deg of one reading of every receiver, if the other motions are known"
        yield f"  {'deg':>7}" + "".join(f"{emitter + ' lit':>12}" for emitter in rest.emitters) + f"{'all':>12}"
        for row in _rows(len(motion.angle_deg)):
            sds = (*motion.resolution_deg[row].tolist(), float(motion.resolution_of_all_deg[row]))
            yield f"  {motion.angle_deg[row]:7.3g}" + "".join(f"{_resolution(sd):>12}" for sd in sds)
    yield f"  voltages {low:.3f} to {high:.3f} V, {100 * (high - low) / first.supply_V:.0f} % of the supply"
    yield from _load(volts.advice)


def _rows(count: int) -> range:
    """Return the indices of about nine evenly spaced rows."""
    return range(0, count, max(1, (count - 1) // MAX_ROWS))


def _receivers(circuit: Circuit) -> str:
    load = f"{circuit.load_ohm[0]:g} ohm and {circuit.supply_V:g} V"
    return f"{circuit.transistor.name} on {load}, read by {circuit.adc.name}"


def _emitter(drive: Drive) -> str:
    spread = f"{drive.typical_mW:.3g} mW ({drive.min_mW:.3g} to {drive.max_mW:.3g})"
    return f"{drive.name} at {drive.current_mA:g} mA: {spread}"


def _load(advice: Advice) -> Iterator[str]:
    yield f"load: adjust it until the voltage at the brightest angle of the motion is {advice.target_V:.2f} V"
    yield from map(_setting, advice.settings)
    if advice.emitter_current_mA is not None and any(setting.turn is None for setting in advice.settings):
        current = f"{advice.emitter_current_mA:.2g} mA"
        yield f"  with an emitter current of {current}, all loads would be within the range of the trimmer"


def _table(readings: DesignReadings) -> Iterator[str]:
    """Yield the rows of the table, at about nine angles."""
    names = "".join(f"  {name + ' V':>9}" for name in readings.circuit.names)
    yield f"  {'deg':>7}{names}  {'mV noise':>9}  {'deg':>9}"
    for row in _rows(len(readings.angle_deg)):
        volts = "".join(f"  {value:9.4f}" for value in readings.voltage_V[row])
        noise, resolution = 1e3 * readings.noise.reading_V[row].max(), readings.resolution_of_all_deg[row]
        yield f"  {readings.angle_deg[row]:7.3g}{volts}  {noise:9.3f}  {_resolution(float(resolution)):>9}"


def _setting(setting: Setting) -> str:
    load = "any load" if setting.largest_ohm > ANY_LOAD_OHM else f"{setting.largest_ohm:.0f} ohm"
    turn = "outside the trimmer's range" if setting.turn is None else f"{100 * setting.turn:.0f} % of the trimmer"
    used = "saturated" if setting.saturates else f"{100 * setting.used:.0f} % of the supply used"
    return f"  {setting.case:9} parts: {load}, {turn}; with the present load {used}"


def _resolution(value: float | None) -> str:
    return "none" if value is None or math.isnan(value) else text(float(f"{value:.2g}"))
