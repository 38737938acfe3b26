"""The process that prints a design: a file or the default, with the pixels of a printer and the cure of a resin.

`ProcessOptions` specify a process, and `PrintOptions` also the print of a design. `process_of` returns the process, and
`with_printer` and `with_resin` adapt it.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from solen.errors import DataError
from solen.fabricate.process.predict import Orientation
from solen.fabricate.process.process_file import Calibration, Process, default_process, read_process, response_file
from solen.material.cure.law import read_law
from solen.material.resin import Resin, resin_of
from solen.parts import Printer, printer_of
from solen.ranks import Caution, warning
from solen.recording import Provenance
from solen.spec import Design
from solen.spec.strict import Options

PixelFraction = Annotated[float, Field(ge=0, lt=1)]


class ProcessOptions(Options):
    """The process that prints a design."""

    process: Path | None = None
    """Process file; default: the settings of the paper, with assumptions about the projector."""
    cure: Path | None = None
    """Working curve of the resin, with a fitted lamp spectrum if any: a file of solen resin cure --out."""
    printer: str | None = None
    """Printer whose pixels are used: name in the library (solen print printers), or a printer file."""


class PrintOptions(ProcessOptions):
    """The process that prints a design, and the options of the print."""

    orientation: Orientation = "flat"
    """Orientation of the part on the plate; upright prints the lens last."""
    phase_px: tuple[PixelFraction, PixelFraction] | None = None
    """Position of the lens vertex in its pixel along x and z, as in solen print layers; default: a corner."""
    choose_phase: bool = False
    """Choose the position in the pixel that minimises the deviation of the lens shape (parts printed flat)."""
    at: str = "middle"
    """Height of the profile of a part printed flat: middle or mean of the thickness, or a height in mm."""


def process_of(options: ProcessOptions) -> tuple[Process, tuple[Provenance, ...]]:
    """Return the specified process, with the pixels of the specified printer, and the provenance of its files."""
    process, sources = (default_process(), ()) if options.process is None else _read(options.process)
    if options.cure is not None:
        process, sources = with_cure(process, options.cure), (*sources, _source(options.cure, "solen-cure"))
    return with_printer(process, options.printer), sources


def _read(path: Path) -> tuple[Process, tuple[Provenance, ...]]:
    process = read_process(path)
    simulated = process.calibration is not None and process.calibration.simulated
    response = response_file(path)
    response_sources = () if response is None else (_source(response, "pixel-response"),)
    return process, (replace(_source(path, "solen-process"), simulated=simulated), *response_sources)


def files_read(process: Path | None, cure: Path | None) -> list[Path | None]:
    """Return the files from which a process is read: process file, pixel response and working curve."""
    return [process, None if process is None else response_file(process), cure]


def _source(path: Path, kind: str) -> Provenance:
    return Provenance(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), kind)


def with_cure(process: Process, path: Path) -> Process:
    """Return a process with the working curve of a file, and its lamp spectrum if that fits better than Jacobs' law.

    Raises
    ------
    DataError
        If the file is not a working curve, or the process was calibrated, so that its critical dose is an effective
        value for walls.
    """
    curve = read_law(path)
    if process.keeps_growth:
        limit = f"does not apply to {process.name}, which was calibrated: its critical dose is valid only for walls"
        remedy = "omit --cure, or calibrate a process that has this working curve"
        raise DataError("--cure", value=path.name, limit=limit, remedy=remedy)
    keys = ("Dp_um", "Ec_mJ_per_cm2")
    changed = process.with_settings(**curve.values)
    calibration = None
    if not curve.uncertainties:
        calibration = Calibration(keys=keys, covariance=curve.covariance, simulated=curve.simulated)
    source = changed.source | dict.fromkeys((*keys, "lamp"), f"solen resin cure: {path.name}")
    u = changed.uncertainty | curve.uncertainties
    return changed.model_copy(update={"source": source, "uncertainty": u, "calibration": calibration})


def with_printer(process: Process, name: str | None) -> Process:
    """Return a process with the pixels of a printer, given by its name or file; without a printer, the process itself.

    Raises
    ------
    DataError
        If there is no such printer, it cannot print the layer thickness of the process, or the process was calibrated
        with other pixels.
    """
    if name is None:
        return process
    printer = printer_of(name)
    layer_um = process.process.layer_um
    pixels_um = tuple(1000.0 * side for side in printer.pitches_mm)
    low, high = printer.layers_um
    if not low <= layer_um <= high:
        limit = f"must be {low:g} to {high:g} µm for {printer.name}"
        raise DataError(
            "process.layer_um", value=layer_um, limit=limit, remedy="change layer_um, or use another printer"
        )
    if not np.allclose(pixels_um, process.process.pixels_um, rtol=1e-6):
        _check_printer(process, name, printer)
    changed = process.with_settings(
        pixel_um=pixels_um[0], pixel_y_um=None if printer.pitch_y_um is None else pixels_um[1]
    )
    source = f"{printer.pitch_um.basis}: {printer.name}"
    return changed.model_copy(update={"source": changed.source | {"pixel_um": source}})


def _check_printer(process: Process, name: str, printer: Printer) -> None:
    """Raise `DataError` if the pixels of a process cannot be replaced by those of a printer."""
    pixels = f"has pixels of {printer.pixel_text} µm"
    if process.calibration is not None:
        limit = f"{pixels}, but the process was calibrated with {process.process.pixel_um:g} µm"
        raise DataError("--printer", value=name, limit=limit, remedy="omit --printer, or calibrate this printer")
    if process.process.response is not None:
        limit = f"{pixels}, but the process contains the response of a pixel of {process.process.pixel_um:g} µm"
        raise DataError(
            "--printer", value=name, limit=limit, remedy="omit --printer, or measure the response of this printer"
        )


def curve_cautions(process: Process, design: Design) -> list[Caution]:
    """Return the warnings about the working curve of the resin, or a warning that the process does not use it."""
    resin = None if design.material.resin is None else resin_of(design.material.resin, design.resin_file)
    if resin is not None and process.source.get("Dp_um") == _resin_source(resin):
        return list(resin.cautions("cure"))
    if resin is None or resin.cure is None or not process.process.lamp:
        return []
    curve, settings = resin.cure, process.process
    resin_curve = f"{resin.name} (Dp {curve.Dp_um:.4g} µm, Ec {curve.Ec_mJ_per_cm2:.4g} mJ/cm²)"
    used = f"Dp {settings.Dp_um:.4g} µm at the surface, Ec {settings.Ec_mJ_per_cm2:.4g} mJ/cm²"
    text = f"the working curve of the resin {resin_curve} is not used"
    return [warning(f"{text}: the process {process.name} has a lamp with several lines ({used})")]


def with_resin(process: Process, design: Design) -> Process:
    """Return a process with the working curve of the design's resin if that of the process is only an assumption."""
    resin = None if design.material.resin is None else resin_of(design.material.resin, design.resin_file)
    keys = ("Dp_um", "Ec_mJ_per_cm2")
    if resin is None or resin.cure is None or process.calibration is not None or process.process.lamp:
        return process  # Dp of a working curve differs from Dp of a lamp at the surface
    if set(keys) - set(process.assumptions):
        return process
    cure, calibration = resin.cure, None
    if cure.covariance is not None:
        simulated = any(source.simulated for source in resin.sources if source.of == "cure")
        calibration = Calibration(keys=keys, covariance=cure.covariance, simulated=simulated)
    changed = process.with_settings(Dp_um=cure.Dp_um, Ec_mJ_per_cm2=cure.Ec_mJ_per_cm2)
    source = changed.source | dict.fromkeys(keys, _resin_source(resin))
    return changed.model_copy(update={"source": source, "calibration": calibration})


def _resin_source(resin: Resin) -> str:
    """Return the source of the parameters that a process takes from a resin."""
    return f"resin: {resin.name}"
