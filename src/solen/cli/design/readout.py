"""The command that computes receiver voltages of a design."""

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
"""Load above which it is treated as unlimited."""


@lines.register
def _(readings: DesignReadings) -> Iterator[str]:
    circuit, whole = readings.circuit, readings.range
    yield f"{readings.name} (simulated): {_receivers(circuit)}"
    yield f"  emitter {_emitter(circuit.drive)}"
    yield (f"  sensitivity at {readings.wavelength_nm:g} nm {circuit.transistor.response:.3g} of the specified value")
    yield from _table(readings)
    yield (
        f"  readings {whole.lowest_V:.3f} to {whole.highest_V:.3f} V, {100 * whole.used_of_supply:.0f} % of "
        f"the supply; resolution of one reading {_fine(whole.best_resolution_deg)} to "
        f"{_fine(whole.worst_resolution_deg)} deg"
    )
    yield from _load(readings.advice)


@lines.register
def _(volts: NetworkVolts) -> Iterator[str]:
    first, rest, (low, high) = volts.circuits[0], volts.at_rest, volts.range_V
    yield f"{volts.name} (simulated), {len(rest.emitters)} emitters in turn: {_receivers(first)}"
    wide = max(14, *(len(name) + 2 for name in rest.receivers))
    yield f"  {'V, mV noise':12}" + "".join(f"{name:>{wide}}" for name in rest.receivers)
    for name, on, sd in zip(rest.emitters, rest.voltage_V[0], rest.sd_V[0], strict=True):
        cells = (f"{value:.4f} {1e3 * noise:5.2f}" for value, noise in zip(on, sd, strict=True))
        yield f"  {name:12}" + "".join(f"{cell:>{wide}}" for cell in cells)
    drives = [_emitter(circuit.drive) for circuit in volts.circuits]
    for drive in dict.fromkeys(drives):
        lit = (name for name, own in zip(rest.emitters, drives, strict=True) if own == drive)
        yield f"  {', '.join(lit)}: {drive}"
    for motion, one in volts.by_motion.items():
        yield (f"  {motion}: resolution in deg of one reading of every receiver, if the other motions are known")
        yield f"  {'deg':>7}" + "".join(f"{name + ' lit':>12}" for name in rest.emitters) + f"{'all':>12}"
        for row in range(0, len(one.angle_deg), max(1, (len(one.angle_deg) - 1) // MAX_ROWS)):
            sds = (*one.resolution_deg[row].tolist(), float(one.resolution_of_all_deg[row]))
            yield f"  {one.angle_deg[row]:7.3g}" + "".join(f"{_fine(sd):>12}" for sd in sds)
    yield f"  voltages {low:.3f} to {high:.3f} V, {100 * (high - low) / first.supply_V:.0f} % of the supply"
    yield from _load(volts.advice)


def _receivers(circuit: Circuit) -> str:
    load = f"{circuit.load_ohm[0]:g} ohm and {circuit.supply_V:g} V"
    return f"{circuit.transistor.name} on {load}, read by {circuit.adc.name}"


def _emitter(drive: Drive) -> str:
    spread = f"{drive.typical_mW:.3g} mW ({drive.min_mW:.3g} to {drive.max_mW:.3g})"
    return f"{drive.name} at {drive.current_mA:g} mA: {spread}"


def _load(advice: Advice) -> Iterator[str]:
    yield f"load: adjust it until the brightest angle of the motion has {advice.target_V:.2f} V"
    yield from map(_setting, advice.settings)
    if advice.emitter_current_mA is not None and any(setting.turn is None for setting in advice.settings):
        yield f"  {advice.emitter_current_mA:.2g} mA in the emitter would bring all loads within the trimmer's range"


def _table(readings: DesignReadings) -> Iterator[str]:
    """Yield the rows of the table, at about nine angles."""
    names = "".join(f"  {name + ' V':>9}" for name in readings.circuit.names)
    yield f"  {'deg':>7}{names}  {'mV noise':>9}  {'deg':>9}"
    for row in range(0, len(readings.angle_deg), max(1, (len(readings.angle_deg) - 1) // MAX_ROWS)):
        volts = "".join(f"  {value:9.4f}" for value in readings.voltage_V[row])
        noise, resolution = 1e3 * readings.noise.reading_V[row].max(), readings.resolution_of_all_deg[row]
        yield f"  {readings.angle_deg[row]:7.3g}{volts}  {noise:9.3f}  {_fine(float(resolution)):>9}"


def _setting(setting: Setting) -> str:
    load = "any load" if setting.largest_ohm > ANY_LOAD_OHM else f"{setting.largest_ohm:.0f} ohm"
    turn = "outside the trimmer's range" if setting.turn is None else f"{100 * setting.turn:.0f} % of the trimmer"
    now = "saturates now" if setting.saturates else f"uses {100 * setting.used:.0f} % of the supply now"
    return f"  {setting.case:9} parts: {load}, {turn}; {now}"


def _fine(value: float | None) -> str:
    return "none" if value is None or math.isnan(value) else text(float(f"{value:.2g}"))
