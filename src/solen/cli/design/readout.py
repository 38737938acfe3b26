"""The command that turns a design's light into volts."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Set, progress_bar, show, text

_Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json.")]


def readout(
    file: Path, /, *, set_: Set = None, figure: FigureFile = None, out: _Out = None, as_json: Json = False
) -> None:
    """Show what the receivers of a design read in volts over its motion, with noise, and which load suits them.

    Parameters
    ----------
    file
        The design file; its [readout] states the circuit.
    """
    from solen.pipeline.design import readout as pipeline

    with progress_bar("tracing") as progress:
        found = pipeline.readout(file, set_ or (), figure=figure, out=out, progress=progress)
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    circuit, whole, advice = found["circuit"], found["range"], found["advice"]
    least, usual, most = circuit["emitter_power_mW"]
    lines = [
        f"{found['name']} (simulated): {circuit['receiver']} on {circuit['load_ohm']:g} ohm and "
        f"{circuit['supply_V']:g} V, read by {circuit['adc']}",
        f"  emitter {circuit['emitter']} at {circuit['emitter_current_mA']:g} mA: {usual:.3g} mW "
        f"({least:.3g} to {most:.3g})",
        f"  sensitivity at {circuit['wavelength_nm']:g} nm {circuit['response']:.3g} of the stated one",
        *_table(found),
        f"  readings {whole['lowest_V']:.3f} to {whole['highest_V']:.3f} V, {100 * whole['used_of_supply']:.0f} % of "
        f"the supply; resolution of one reading {_fine(whole['best_resolution_deg'])} to "
        f"{_fine(whole['worst_resolution_deg'])} deg",
        f"load: turn it until the brightest angle of the motion reads {advice['target_V']:.2f} V",
    ]
    lines += [_setting(one) for one in advice["settings"]]
    if any(one["turn"] is None for one in advice["settings"]) and advice["emitter_current_mA"] is not None:
        lines.append(f"  {advice['emitter_current_mA']:.2g} mA in the emitter bring all of them within the trimmer")
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]


def _table(found: dict[str, Any]) -> list[str]:
    """A row for each of some nine angles."""
    angles, names = found["angle_deg"], list(found["receivers"])
    lines = [f"  {'deg':>7}" + "".join(f"  {name + ' V':>9}" for name in names) + f"  {'mV noise':>9}  {'deg':>9}"]
    chosen = range(0, len(angles), max(1, (len(angles) - 1) // 8))
    for row in chosen:
        receivers = found["receivers"].values()
        volts = "".join(f"  {one['volts'][row]:9.4f}" for one in receivers)
        noise = 1e3 * max(one["noise_V"][row] for one in receivers)
        lines.append(f"  {angles[row]:7.3g}{volts}  {noise:9.3f}  {_fine(found['both']['resolution_deg'][row]):>9}")
    return lines


def _setting(one: dict[str, Any]) -> str:
    load = "any load" if one["largest_ohm"] is None or one["largest_ohm"] > 1e8 else f"{one['largest_ohm']:.0f} ohm"
    turn = "out of the trimmer's range" if one["turn"] is None else f"{100 * one['turn']:.0f} % of the trimmer"
    now = "saturates now" if one["saturates"] else f"uses {100 * one['used']:.0f} % of the supply now"
    return f"  {one['case']:9} parts: {load}, {turn}; {now}"


def _fine(value: float | None) -> str:
    return "none" if value is None else text(float(f"{value:.2g}"))
