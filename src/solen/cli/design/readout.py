"""The command that computes receiver voltages of a design."""

import math
from collections.abc import Iterator

from solen.cli.app import lines, text
from solen.pipeline.design.readout import readout as readout
from solen.readout import Setting
from solen.sensor.readings import DesignReadings

MOST_ROWS = 8
ANY_LOAD_OHM = 1e8
"""Beyond it a load counts as unlimited."""


@lines.register
def _(readings: DesignReadings) -> Iterator[str]:
    circuit, drive, whole, advice = readings.circuit, readings.circuit.drive, readings.range, readings.advice
    yield (
        f"{readings.name} (simulated): {circuit.transistor.name} on {circuit.load_ohm[0]:g} ohm and "
        f"{circuit.supply_V:g} V, read by {circuit.adc.name}"
    )
    yield (
        f"  emitter {drive.name} at {drive.current_mA:g} mA: {drive.typical_mW:.3g} mW "
        f"({drive.least_mW:.3g} to {drive.most_mW:.3g})"
    )
    yield f"  sensitivity at {readings.wavelength_nm:g} nm {circuit.transistor.response:.3g} of the stated one"
    yield from _table(readings)
    yield (
        f"  readings {whole.lowest_V:.3f} to {whole.highest_V:.3f} V, {100 * whole.used_of_supply:.0f} % of "
        f"the supply; resolution of one reading {_fine(whole.best_resolution_deg)} to "
        f"{_fine(whole.worst_resolution_deg)} deg"
    )
    yield f"load: adjust it until the brightest angle of the motion reads {advice.target_V:.2f} V"
    yield from map(_setting, advice.settings)
    if advice.emitter_current_mA is not None and any(setting.turn is None for setting in advice.settings):
        yield f"  {advice.emitter_current_mA:.2g} mA in the emitter bring all loads within the trimmer's range"


def _table(readings: DesignReadings) -> Iterator[str]:
    """Rows of the table, at about nine angles."""
    names = "".join(f"  {name + ' V':>9}" for name in readings.circuit.names)
    yield f"  {'deg':>7}{names}  {'mV noise':>9}  {'deg':>9}"
    for row in range(0, len(readings.angle_deg), max(1, (len(readings.angle_deg) - 1) // MOST_ROWS)):
        volts = "".join(f"  {value:9.4f}" for value in readings.voltage_V[row])
        noise, resolution = 1e3 * readings.noise.reading_V[row].max(), readings.resolution_of_all_deg[row]
        yield f"  {readings.angle_deg[row]:7.3g}{volts}  {noise:9.3f}  {_fine(float(resolution)):>9}"


def _setting(setting: Setting) -> str:
    load = "any load" if setting.largest_ohm > ANY_LOAD_OHM else f"{setting.largest_ohm:.0f} ohm"
    turn = "out of the trimmer's range" if setting.turn is None else f"{100 * setting.turn:.0f} % of the trimmer"
    now = "saturates now" if setting.saturates else f"uses {100 * setting.used:.0f} % of the supply now"
    return f"  {setting.case:9} parts: {load}, {turn}; {now}"


def _fine(value: float | None) -> str:
    return "none" if value is None or math.isnan(value) else text(float(f"{value:.2g}"))
