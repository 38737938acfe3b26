"""Settings for the program of a printer that takes the STL and cuts it into layers itself, as most do.

What to type in, with units, and what to compare with what the program then shows: the number of layers, the height and
the dose. As a dictionary for programs and as Markdown to print out and lay beside the printer.
"""

import math
from typing import Any

from solen.fabricate.label import WRITER
from solen.fabricate.layers.job import Job
from solen.material.cure.layers import cure_depth_um
from solen.material.resin import Cure

SHEET_SCHEMA = 1


def settings(
    job: Job,
    *,
    name: str,
    stl: str,
    material: str,
    orientation: str,
    z_offset_um: float = 0.0,
    cure: Cure | None = None,
) -> dict[str, Any]:
    """Settings of a job, units in the keys.

    Parameters
    ----------
    job
        The print job.
    name, stl
        Name of the part, and of the STL that the program takes, already turned as it is to be printed.
    material
        The resin, in words.
    orientation
        How the part lies, in words.
    z_offset_um
        Thickness of what lies between plate and window and is not printed: a film, a base that is there already.
    cure
        Working curve of the resin; with it the depth that each exposure cures is told.
    """
    exposure, count = job.exposure, job.count
    burn_in = min(count, exposure.burn_in_layers)
    found: dict[str, Any] = {
        "solen_settings": SHEET_SCHEMA,
        "writer": WRITER,
        "part": name,
        "stl": stl,
        "stl_unit": "mm",
        "material": material,
        "printer": job.printer.name,
        "wavelength_nm": None if job.printer.wavelength_nm is None else job.printer.wavelength_nm.usual,
        "pixel_um": job.printer.pitch_um.usual,
        "orientation": orientation,
        "size_mm": list(job.solid.size_mm),
        "copies": job.copies,
        "layer_um": job.layer_um,
        "burn_in_layers": burn_in,
        "burn_in_exposure_s": exposure.burn_in_s,
        "exposure_s": exposure.layer_s,
        "irradiance_mW_per_cm2": exposure.irradiance_mW_per_cm2,
        "burn_in_dose_mJ_per_cm2": exposure.irradiance_mW_per_cm2 * exposure.burn_in_s,
        "dose_mJ_per_cm2": exposure.irradiance_mW_per_cm2 * exposure.layer_s,
        "z_offset_um": z_offset_um,
        "expected_layers": count,
        "stack_height_mm": job.height_mm,
        "volume_ml": job.volume_mm3 / 1000.0,
        "exposures_s": exposure.total_s(count),
        "pause_s": None if job.printer.pause_s is None else job.printer.pause_s.usual,
        "estimated_time_s": job.seconds,
        "cure_depth_um": None,
        "burn_in_cure_depth_um": None,
    }
    if cure is not None:
        for key in ("", "burn_in_"):
            depth = float(cure_depth_um(found[f"{key}dose_mJ_per_cm2"], cure.Dp_um, cure.Ec_mJ_per_cm2))
            found[f"{key}cure_depth_um"] = max(depth, 0.0)
    return found


def as_sheet(found: dict[str, Any], warnings: list[str]) -> str:
    """Settings as Markdown, with what to check in the program and what must be known of the numbers."""
    size = " × ".join(f"{length:.4g}" for length in found["size_mm"])
    burn_in = f"{found['burn_in_exposure_s']:g} s = {found['burn_in_dose_mJ_per_cm2']:.4g} mJ/cm²"
    rows = [
        ("STL to load", f"`{found['stl']}`, in **mm**; it is turned already: do not rotate it"),
        ("Material", found["material"]),
        ("Printer", _printer(found)),
        ("Orientation", found["orientation"]),
        ("Copies", str(found["copies"])),
        ("Layer (slice) thickness", f"{found['layer_um']:g} µm"),
        ("Burn-in layers", str(found["burn_in_layers"])),
        ("Burn-in exposure", f"{burn_in} per layer"),
        ("Exposure of all others", f"{found['exposure_s']:g} s = {found['dose_mJ_per_cm2']:.4g} mJ/cm² per layer"),
        ("Light intensity", f"{found['irradiance_mW_per_cm2']:g} mW/cm² at the window: measure yours"),
        ("Z offset", f"{found['z_offset_um']:g} µm above the calibrated zero of the plate"),
        ("Supports", "none; solen makes none"),
        ("Anti-aliasing, scaling, shrinkage compensation", "off, unless you calibrated them yourself"),
    ]
    checks = [
        ("Size of one part", f"{size} mm (X × Y × Z, Z away from the plate)"),
        ("Layers", f"{found['expected_layers']}, {found['stack_height_mm']:.4g} mm high"),
        ("Resin in the parts", f"{found['volume_ml']:.3g} ml"),
        ("Exposures alone", _time(found["exposures_s"])),
    ]
    if found["estimated_time_s"] is not None:
        guess = f"about {_time(found['estimated_time_s'])}, with {found['pause_s']:g} s between exposures"
        checks.append(("Whole print", guess))
    if found["cure_depth_um"] is not None:
        depths = f"{found['cure_depth_um']:.0f} µm; burn-in {found['burn_in_cure_depth_um']:.0f} µm"
        checks.append(("Depth that one exposure cures (working curve)", depths))
    notes = [f"- {line}" for line in warnings]
    lines = [f"# {found['part']}: settings for the print", "", *_table("Setting", "Value", rows), ""]
    lines += ["What the program must then show:", "", *_table("Check", "Expected", checks), ""]
    lines += (["Mind:", "", *notes, ""] if notes else []) + [f"Written by {found['writer']}."]
    return "\n".join(lines) + "\n"


def _printer(found: dict[str, Any]) -> str:
    light = "" if found["wavelength_nm"] is None else f", {found['wavelength_nm']:g} nm"
    return f"{found['printer']}{light}, pixels of {found['pixel_um']:g} µm"


def _table(left: str, right: str, rows: list[tuple[str, str]]) -> list[str]:
    return [f"| {left} | {right} |", "|---|---|", *(f"| {name} | {_cell(value)} |" for name, value in rows)]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _time(seconds: float) -> str:
    """Hours and minutes, or minutes and seconds."""
    whole = math.ceil(seconds)
    hours, minutes = divmod(round(whole / 60), 60)
    return f"{hours} h {minutes:02d} min" if whole >= 3600 else f"{whole // 60} min {whole % 60:02d} s"
