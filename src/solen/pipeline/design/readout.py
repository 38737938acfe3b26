"""What the receivers of a design read over its motion: from the design file to volts, noise, resolution and advice."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray, Progress
from solen.parts import AdcPart, Part, ReceiverPart, TrimmerPart
from solen.parts.datasheet import Sourced
from solen.pipeline.design.commands import open_design, source_of
from solen.pipeline.outputs import check_figure, check_out, leave
from solen.readout import Circuit, Readings
from solen.readout.cautions import cautions
from solen.readout.circuit import emitter_part, named_part
from solen.sensor import Sensor, idle_keys
from solen.sensor.readings import readings
from solen.spec import Design

MOST_STEP = 0.25
"""Share of the whole range by which a reading may move from one angle to the next before its slope is called coarse."""


def readout(
    path: Path,
    assignments: Sequence[str] = (),
    *,
    figure: Path | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Volts of a design's receivers over its motion, traced in power, with what they spread by and may be off by."""
    check_figure(figure)
    check_out(out)
    design = open_design(path, assignments)
    sensor = Sensor.of(design)
    parts = _parts(design)
    found = readings(sensor, progress)
    circuit, dark = found.circuit, float(found.off_V.max())
    in_space = design.trace.dimension == "extruded"
    told = cautions(circuit, found.advice, sensor.light.wavelength_nm, dark, in_space=in_space)
    data = {
        "design": str(path),
        "name": design.name,
        "simulated": True,
        "circuit": _circuit(design, circuit, sensor),
        "angle_deg": found.angle_deg.tolist(),
        "receivers": {name: _receiver(found, place) for place, name in enumerate(circuit.names)},
        "both": {"resolution_deg": _listed(found.both_deg), "contrast": _listed(found.contrast)},
        "range": _range(found),
        "advice": _advice(found),
        "parts": [_source(part) for part in parts],
        "sources": [source_of(path)],
        "warnings": [*sensor.warnings, *idle_keys(sensor, "power"), *told, *_coarse(found)],
    }

    def draw() -> Any:
        from solen.report.design.readout import readout_figure

        return readout_figure(found, design.name)

    return leave(data, "readout", out, figure, draw)


def _parts(design: Design) -> tuple[Part, ...]:
    return (
        named_part(design, "part", ReceiverPart),
        emitter_part(design),
        named_part(design, "trimmer", TrimmerPart),
        named_part(design, "adc", AdcPart),
    )


def _source(part: Part) -> dict[str, Any]:
    """What a part's numbers rest on: its document, and which of them are estimates."""
    sourced = {key: value for key, value in part if isinstance(value, Sourced)}
    estimates = [key for key, value in sourced.items() if value.basis == "estimate"]
    if isinstance(part, AdcPart):
        estimates += ["range"] * any(one.basis == "estimate" for one in part.range)
    return {"name": part.name, "kind": part.kind, "document": part.document, "estimates": estimates}


def _circuit(design: Design, circuit: Circuit, sensor: Sensor) -> dict[str, Any]:
    drive, adc, part = circuit.drive, circuit.adc, circuit.transistor
    return {
        "receiver": part.name,
        "sensitivity_uA_per_mW_cm2": [part.least_uA, part.typical_uA, part.most_uA],
        "wavelength_nm": sensor.light.wavelength_nm,
        "response": part.response,
        "emitter": drive.name,
        "emitter_current_mA": drive.current_mA,
        "emitter_power_mW": [drive.least_mW, drive.typical_mW, drive.most_mW],
        "load_ohm": circuit.load_ohm[0],
        "supply_V": circuit.supply_V,
        "adc": adc.name,
        "adc_range_V": [adc.low_V, adc.high_V],
        "adc_step_V": adc.step_V,
        "samples": circuit.samples,
        "rate_hz": circuit.rate_hz,
        "temperature_C": design.readout.temperature_c,
        "ambient_mW_cm2": design.readout.ambient_mw_cm2,
        "time_constant_us": float(circuit.time_constant_us[0]),
        "noise_bandwidth_hz": float(circuit.noise_bandwidth_hz[0]),
    }


def _receiver(found: Readings, place: int) -> dict[str, Any]:
    circuit, parts = found.circuit, found.noise
    share = found.power_fraction
    columns = {
        "power_fraction": share,
        "irradiance_mW_cm2": circuit.irradiance_mW_cm2(share),
        "volts": found.volts,
        "volts_dimmest": found.cases["dimmest"],
        "volts_brightest": found.cases["brightest"],
        "volts_off": found.off_V,
        "u_trace_V": found.u_trace_V,
        "noise_V": parts.reading_V,
        "noise_shot_V": parts.shot_V,
        "noise_thermal_V": parts.thermal_V,
        "noise_converter_V": parts.converter_V,
        "noise_quantisation_V": parts.quantisation_V,
        "noise_subtracted_V": found.sd_V,
        "slope_V_per_deg": found.slope_V_per_deg,
        "resolution_deg": found.resolution_deg,
        "drift_V_per_K": found.drift_V_per_K,
    }
    listed = {name: _listed(column[:, place]) for name, column in columns.items()}
    return {"area_mm2": circuit.area_mm2[place]} | listed


def _range(found: Readings) -> dict[str, Any]:
    low, high = float(found.volts.min()), float(found.volts.max())
    best = found.both_deg[np.isfinite(found.both_deg)]
    return {
        "lowest_V": low,
        "highest_V": high,
        "used_of_supply": (high - low) / found.circuit.supply_V,
        "best_resolution_deg": float(best.min()) if best.size else None,
        "worst_resolution_deg": float(best.max()) if best.size else None,
    }


def _advice(found: Readings) -> dict[str, Any]:
    """Advice as plain data: null for a load that nothing limits."""
    told = asdict(found.advice)
    for one in told["settings"]:
        one["largest_ohm"] = one["largest_ohm"] if np.isfinite(one["largest_ohm"]) else None
    return told


def _coarse(found: Readings) -> list[str]:
    """Where angles are too far apart to tell a slope."""
    if len(found.angle_deg) < 2:
        return ["one angle has no slope: no resolution can be told"]
    moved = np.abs(np.diff(found.volts, axis=0))
    whole = float(np.ptp(found.volts))
    if whole <= 0.0 or moved.max() <= MOST_STEP * whole:
        return []
    row = int(np.argmax(moved.max(axis=1)))
    low, high = found.angle_deg[row], found.angle_deg[row + 1]
    return [
        f"from {low:g} to {high:g} deg a reading moves by {moved.max():.2f} V, {100 * moved.max() / whole:.0f} % of "
        "its range: slopes and resolution there are means over the step; take a smaller motion.step_deg"
    ]


def _listed(values: FloatArray) -> list[float | None]:
    """Numbers for JSON: null for what is none."""
    return [float(value) if np.isfinite(value) else None for value in values]
