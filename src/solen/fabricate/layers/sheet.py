"""Settings sheet for a slicer, which reads the STL and makes its own layers.

The sheet lists the settings to enter, with units, and the values to check in the slicer: the number of layers, the
height and the dose. It is available as a result for programs, and as Markdown to print out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from solen.arrays import FloatArray
from solen.fabricate.label import WRITER
from solen.fabricate.layers.job import GREY_STEPS, Job
from solen.fabricate.layers.orientation import described
from solen.fabricate.layers.printable import Printable
from solen.fabricate.layers.solid import Exposures
from solen.fabricate.process import Process
from solen.material.cure.law import CureLaw
from solen.material.resin import Resin
from solen.results import Result

SHEET_SCHEMA = 1


@dataclass(frozen=True)
class SeparateExposure:
    """A part that is exposed separately, with its exposure time and dose."""

    feature: str
    exposure_s: float
    dose_mJ_per_cm2: float


class PrintSettings(Result):
    """Print settings.

    Attributes
    ----------
    solen_settings, writer
        Version of this table, and version of solen that wrote it.
    part, stl, stl_unit
        Name of the part, and name and unit of the STL, which is already oriented for printing.
    material, printer, orientation, lies
        Descriptions; ``lies`` is the required orientation, None if any orientation is suitable.
    seats
        Names of the pockets and slots in the solid; None if the file does not contain them.
    wavelength_nm, pixel_um, pixel_y_um
        Wavelength of the printer, and sizes of a pixel along X and Y.
    size_mm, copies
        Extent of one part along X, Y and Z, and number of parts.
    layer_um, expected_layers, stack_height_mm
        Thickness and number of the layers, and height of the stack.
    burn_in_layers, burn_in_exposure_s, exposure_s
        Number and exposure time of the burn-in layers, and exposure time of the other layers.
    images
        Parts that are exposed one after the other at one height; empty for a stack.
    irradiance_mW_per_cm2, burn_in_dose_mJ_per_cm2, dose_mJ_per_cm2
        Irradiance and doses at the window.
    phase_px, anti_aliasing, process, greys
        Properties of the images: position of the origin of the part in its pixel and whether edges are grey (both None
        without images), the process file, and the pairs of grey level and light with which edges are drawn.
    z_offset_um
        Thickness of a film or base under the part.
    volume_ml
        Total volume of resin in the parts.
    exposures_s, pause_s, estimated_time_s
        Total exposure time, pause between exposures, and duration of the print.
    cure, cure_depth_um, burn_in_cure_depth_um
        Description of the working curve, and cure depth of a single exposure; None without a working curve.
    layer_exposures_s, layer_doses_mJ_per_cm2, layer_received_mJ_per_cm2
        For each layer in printing order: exposure time, dose at the window, and mean dose that the layer receives,
        including light through later layers; the last is None without a working curve.
    """

    solen_settings: int
    writer: str
    part: str
    stl: str
    stl_unit: str
    material: str
    printer: str
    wavelength_nm: float | None
    pixel_um: float
    pixel_y_um: float
    orientation: str
    lies: str | None
    seats: tuple[str, ...] | None
    size_mm: tuple[float, float, float]
    copies: int
    layer_um: float
    burn_in_layers: int
    burn_in_exposure_s: float
    exposure_s: float
    images: tuple[SeparateExposure, ...]
    irradiance_mW_per_cm2: float
    burn_in_dose_mJ_per_cm2: float
    dose_mJ_per_cm2: float
    phase_px: tuple[float, float] | None
    anti_aliasing: bool | None
    process: str | None
    greys: tuple[tuple[float, float], ...] | None
    z_offset_um: float
    expected_layers: int
    stack_height_mm: float
    volume_ml: float
    exposures_s: float
    pause_s: float | None
    estimated_time_s: float | None
    cure: str | None
    cure_depth_um: float | None
    burn_in_cure_depth_um: float | None
    layer_exposures_s: tuple[float, ...]
    layer_doses_mJ_per_cm2: tuple[float, ...]
    layer_received_mJ_per_cm2: tuple[float, ...] | None


def print_settings(job: Job, part: Printable, stl: str) -> PrintSettings:
    """Return the settings of a job; ``stl`` names its STL file."""
    slicing, printer, doses = job.slicing, job.printer, job.doses_mJ_per_cm2
    law, curve = cure_law(job, part.resin)
    dose, burn_in_dose = (job.irradiance_mW_per_cm2 * time for time in (slicing.exposure_s, slicing.burn_in_s))
    return PrintSettings(
        solen_settings=SHEET_SCHEMA,
        writer=WRITER,
        part=part.label.name,
        stl=stl,
        stl_unit="mm",
        material=part.material,
        printer=printer.name,
        wavelength_nm=None if printer.wavelength_nm is None else printer.wavelength_nm.nominal,
        pixel_um=1000.0 * printer.pitches_mm[0],
        pixel_y_um=1000.0 * printer.pitches_mm[1],
        orientation=described(slicing.orientation, slicing.rotate_deg),
        lies=part.required_orientation,
        seats=part.seats,
        size_mm=job.solid.size_mm,
        copies=slicing.copies,
        layer_um=slicing.layer_um,
        burn_in_layers=job.burn_in_layers,
        burn_in_exposure_s=slicing.burn_in_s,
        exposure_s=slicing.exposure_s,
        images=_separate_exposures(job),
        irradiance_mW_per_cm2=job.irradiance_mW_per_cm2,
        burn_in_dose_mJ_per_cm2=burn_in_dose,
        dose_mJ_per_cm2=dose,
        phase_px=None if slicing.sheet_only else slicing.phase_px,
        anti_aliasing=None if slicing.sheet_only else not slicing.no_anti_aliasing,
        process=None if slicing.process is None else slicing.process.name,
        greys=job.greys.response or None,
        z_offset_um=slicing.z_offset_um,
        expected_layers=job.count,
        stack_height_mm=job.height_mm,
        volume_ml=job.volume_mm3 / 1000.0,
        exposures_s=job.exposures_s,
        pause_s=job.pause_s,
        estimated_time_s=job.seconds,
        cure=curve,
        cure_depth_um=None if law is None else law.depth_um(dose),
        burn_in_cure_depth_um=None if law is None else law.depth_um(burn_in_dose),
        layer_exposures_s=tuple(job.seconds_of(index) for index in range(job.count)),
        layer_doses_mJ_per_cm2=tuple(doses.tolist()),
        layer_received_mJ_per_cm2=_received(job, law, doses),
    )


def has_curve(process: Process | None) -> TypeGuard[Process]:
    """Return whether a process contains a measured working curve, which takes precedence over that of the resin."""
    return process is not None and not {"Dp_um", "Ec_mJ_per_cm2"} & set(process.assumptions)


def cure_law(job: Job, resin: Resin | None) -> tuple[CureLaw | None, str | None]:
    """Return the cure law and its description: of the process if it was measured, otherwise of the resin."""
    process = job.process
    if has_curve(process):
        s = process.process
        lamp = f", lamp spectrum of {len(s.lamp)} lines" if s.lamp else ""
        return s.law, f"Dp {s.Dp_um:.4g} µm, Ec {s.Ec_mJ_per_cm2:.3g} mJ/cm²{lamp} ({process.source['Dp_um']})"
    if resin is None or resin.cure is None:
        return None, None
    law = CureLaw(resin.cure.Dp_um, resin.cure.Ec_mJ_per_cm2)
    return law, f"Dp {law.Dp_um:.4g} µm, Ec {law.Ec_mJ_per_cm2:.3g} mJ/cm² (resin)"


def _received(job: Job, law: CureLaw | None, doses: FloatArray) -> tuple[float, ...] | None:
    if law is None:
        return None
    received = doses if job.solid.exposures_s else law.mean_doses(doses, job.slicing.layer_um)
    return tuple(np.round(received, 4).tolist())


def _separate_exposures(job: Job) -> tuple[SeparateExposure, ...]:
    if not isinstance(job.solid, Exposures):
        return ()
    names = (GREY_STEPS,) if job.solid.greys else job.solid.names
    doses = (job.irradiance_mW_per_cm2 * seconds for seconds in job.solid.exposures_s)
    return tuple(map(SeparateExposure, names, job.solid.exposures_s, doses))


def as_sheet(settings: PrintSettings, warnings: Sequence[str]) -> str:
    """Return the settings as Markdown, with the values to check in the slicer and the warnings."""
    notes = ["Warnings:", "", *(f"- {line}" for line in warnings), ""] if warnings else []
    lines = [f"# {settings.part}: print settings", "", *_table("Setting", "Value", _settings(settings)), ""]
    lines += ["Values that the slicer must then show:", "", *_table("Check", "Expected", _checks(settings)), ""]
    return "\n".join([*lines, *notes, f"Written by {settings.writer}."]) + "\n"


def _settings(s: PrintSettings) -> list[tuple[str, str]]:
    light = "" if s.wavelength_nm is None else f", {s.wavelength_nm:g} nm"
    sides = " × ".join(dict.fromkeys(f"{side:.5g}" for side in (s.pixel_um, s.pixel_y_um)))
    return [
        ("STL to load", f"`{s.stl}`, in **mm**; already oriented: do not rotate it"),
        ("Material", s.material),
        ("Printer", f"{s.printer}{light}, {sides} µm pixels"),
        ("Orientation", s.orientation),
        *([("Required orientation", s.lies)] if s.lies else []),
        *([] if s.seats is None else [("Pockets and slots", ", ".join(s.seats) or "none")]),
        ("Copies", str(s.copies)),
        ("Layer (slice) thickness", f"{s.layer_um:g} µm"),
        *_exposures(s),
        *([("Working curve", s.cure)] if s.cure else []),
        ("Light intensity", f"{s.irradiance_mW_per_cm2:g} mW/cm² at the window: measure that of your printer"),
        ("Z offset", f"{s.z_offset_um:g} µm above the calibrated zero of the plate"),
        *_images(s),
        ("Supports", "none; solen does not make supports"),
        ("Anti-aliasing, scaling, shrinkage compensation", "off, unless you have calibrated them yourself"),
    ]


def _images(s: PrintSettings) -> list[tuple[str, str]]:
    """Describe the images that solen draws."""
    if s.phase_px is None:
        return []
    x, y = s.phase_px
    edges = "grey, in proportion to the covered fraction"
    if s.greys:
        edges = f"grey, with the {len(s.greys)} measured grey levels of `{s.process}`"
    return [
        ("solen's images: edges", edges if s.anti_aliasing else "no grey pixels"),
        ("solen's images: origin", f"at {x:g}, {y:g} in its pixel"),
    ]


def _exposures(s: PrintSettings) -> list[tuple[str, str]]:
    if s.images:
        separate = [
            (f"Separate exposure of {part.feature}", f"{part.exposure_s:g} s = {part.dose_mJ_per_cm2:.4g} mJ/cm²")
            for part in s.images
        ]
        return [("Burn-in layers", "0"), *separate]
    return [
        ("Burn-in layers", str(s.burn_in_layers)),
        ("Burn-in exposure", f"{s.burn_in_exposure_s:g} s = {s.burn_in_dose_mJ_per_cm2:.4g} mJ/cm² per layer"),
        ("Exposure of all other layers", f"{s.exposure_s:g} s = {s.dose_mJ_per_cm2:.4g} mJ/cm² per layer"),
    ]


def _checks(s: PrintSettings) -> list[tuple[str, str]]:
    size = " × ".join(f"{length:.4g}" for length in s.size_mm)
    checks = [
        ("Size of one part", f"{size} mm (X × Y × Z, Z away from the plate)"),
        ("Layers", f"{s.expected_layers}, {s.stack_height_mm:.4g} mm high"),
        ("Resin in the parts", f"{s.volume_ml:.3g} ml"),
        ("Total exposure time", _time(s.exposures_s)),
    ]
    if s.estimated_time_s is not None:
        checks.append(
            ("Duration of the print", f"about {_time(s.estimated_time_s)}, with {s.pause_s:.3g} s between exposures")
        )
    if s.cure_depth_um is not None:
        depths = f"{s.cure_depth_um:.0f} µm; burn-in {s.burn_in_cure_depth_um:.0f} µm"
        checks.append(("Cure depth of one exposure (working curve)", depths))
    if (received := s.layer_received_mJ_per_cm2) and not s.images:
        first, middle, last = (f"{received[index]:.3g}" for index in (0, len(received) // 2, -1))
        doses = f"first {first}, middle {middle}, last {last} mJ/cm²"
        checks.append(("Mean dose of layers, including later exposures", doses))
    return checks


def _table(left: str, right: str, rows: list[tuple[str, str]]) -> list[str]:
    cells = (f"| {name} | {value.replace('|', chr(92) + '|')} |" for name, value in rows)
    return [f"| {left} | {right} |", "|---|---|", *cells]


def _time(seconds: float) -> str:
    """Format a duration in hours and minutes, or in minutes and seconds."""
    rounded = math.ceil(seconds)
    hours, minutes = divmod(round(rounded / 60), 60)
    return f"{hours} h {minutes:02d} min" if rounded >= 3600 else f"{rounded // 60} min {rounded % 60:02d} s"
