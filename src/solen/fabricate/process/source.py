"""The process that prints a design: a file or the default, with the pixels of a printer and the cure of a resin.

`ProcessOptions` select a process, and `PrintOptions` add the print of a design; `process_of` returns the process, and
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
from solen.fabricate.process.process_file import Calibration, Process, default_process, read_process, response_of_file
from solen.material.cure.law import read_law
from solen.material.resin import Resin, resin_of
from solen.parts import printer_of
from solen.ranks import Caution, warning
from solen.recording import Provenance
from solen.spec import Design
from solen.spec.strict import Options

PixelShare = Annotated[float, Field(ge=0, lt=1)]


class ProcessOptions(Options):
    """The process that prints a design."""

    process: Path | None = None
    """Process file; default: published settings with assumed optics."""
    cure: Path | None = None
    """Working curve of the resin, with the lamp spectrum if fitted: solen resin cure --out."""
    printer: str | None = None
    """Printer whose pixels are used: a name from solen print printers, or a printer file (.toml)."""


class PrintOptions(ProcessOptions):
    """Print options for a design."""

    orientation: Orientation = "flat"
    """Orientation of the part in the printer; upright prints the lens last."""
    phase_px: tuple[PixelShare, PixelShare] | None = None
    """Position of the lens vertex in its pixel along x and z, as in solen print layers; default: a corner."""
    choose_phase: bool = False
    """Choose the position in the pixel that minimises the deviation of the lens shape (flat parts)."""
    at: str = "middle"
    """Profile height for a flat part: middle of the thickness, mean over it, or a height in mm."""


def process_of(options: ProcessOptions) -> tuple[Process, tuple[Provenance, ...]]:
    """Return the selected process, with the pixels of a selected printer, and the provenance of its files."""
    process, sources = (default_process(), ()) if options.process is None else _of_file(options.process)
    if options.cure is not None:
        process, sources = with_cure(process, options.cure), (*sources, _source(options.cure, "solen-cure"))
    return with_printer(process, options.printer), sources


def _of_file(path: Path) -> tuple[Process, tuple[Provenance, ...]]:
    process = read_process(path)
    simulated = process.calibration is not None and process.calibration.simulated
    light = response_of_file(path)
    measured = () if light is None else (_source(light, "pixel-response"),)
    return process, (replace(_source(path, "solen-process"), simulated=simulated), *measured)


def files_read(process: Path | None, cure: Path | None) -> list[Path | None]:
    """Return the files from which a process is read: process file, pixel response and working curve."""
    return [process, None if process is None else response_of_file(process), cure]


def _source(path: Path, kind: str) -> Provenance:
    return Provenance(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), kind)


def with_cure(process: Process, path: Path) -> Process:
    """Process with the working curve of a file, using the lamp spectrum unless the discs fit Jacobs' law better.

    Raises
    ------
    DataError
        If the file is not a working curve, or the process was calibrated: its critical dose is then an effective value
        for its walls.
    """
    curve = read_law(path)
    if process.keeps_growth:
        limit = f"the process {process.name} was calibrated with another Dp; its critical dose applies only to walls"
        remedy = "calibrate with a process that has this Dp and lamp"
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
    """Return a process with the pixels of a printer, specified by name or file; unchanged without a printer.

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
    least, most = printer.layers_um
    if not least <= layer_um <= most:
        limit = f"{printer.name} prints layers of {least:g} to {most:g} µm"
        raise DataError("process.layer_um", value=layer_um, limit=limit, remedy="change one of the two")
    if process.calibration is not None and not np.allclose(pixels_um, process.process.pixels_um, rtol=1e-6):
        limit = f"the process was calibrated with {process.process.pixel_um:g} µm pixels"
        remedy = "omit --printer, or calibrate that printer"
        raise DataError("--printer", value=f"{printer.name}, {printer.pixel_text} µm", limit=limit, remedy=remedy)
    if process.process.response is not None and not np.allclose(pixels_um, process.process.pixels_um, rtol=1e-6):
        limit = f"the process contains the response of a {process.process.pixel_um:g} µm pixel"
        remedy = "omit --printer, or measure the response of that printer"
        raise DataError("--printer", value=f"{printer.name}, {printer.pixel_text} µm", limit=limit, remedy=remedy)
    changed = process.with_settings(
        pixel_um=pixels_um[0], pixel_y_um=None if printer.pitch_y_um is None else pixels_um[1]
    )
    source = f"{printer.pitch_um.basis}: {printer.name}"
    return changed.model_copy(update={"source": changed.source | {"pixel_um": source}})


def curve_cautions(process: Process, design: Design) -> list[Caution]:
    """Warn if a measured working curve of the resin is used, or if the process uses its own curve instead."""
    resin = None if design.material.resin is None else resin_of(design.material.resin, design.resin_file)
    if resin is not None and process.source.get("Dp_um") == _of_resin(resin):
        return list(resin.cautions("cure"))
    if resin is None or resin.cure is None or not process.process.lamp:
        return []
    mine = process.process
    return [
        warning(
            f"the working curve of the resin {resin.name} (Dp {resin.cure.Dp_um:.4g} µm, Ec "
            f"{resin.cure.Ec_mJ_per_cm2:.4g} mJ/cm²) is not used: the process {process.name} specifies a lamp, with Dp "
            f"{mine.Dp_um:.4g} µm at the surface and Ec {mine.Ec_mJ_per_cm2:.4g} mJ/cm²"
        )
    ]


def with_resin(process: Process, design: Design) -> Process:
    """Process with the working curve of the design's resin if this is measured and the process only assumes its own."""
    resin = None if design.material.resin is None else resin_of(design.material.resin, design.resin_file)
    keys = ("Dp_um", "Ec_mJ_per_cm2")
    if resin is None or resin.cure is None or process.calibration is not None or process.process.lamp:
        return process  # the curve's Dp differs from a lamp's Dp at the surface
    if set(keys) - set(process.assumptions):
        return process
    cure, calibration = resin.cure, None
    if cure.covariance is not None:
        simulated = any(source.simulated for source in resin.sources if source.of == "cure")
        calibration = Calibration(keys=keys, covariance=cure.covariance, simulated=simulated)
    changed = process.with_settings(Dp_um=cure.Dp_um, Ec_mJ_per_cm2=cure.Ec_mJ_per_cm2)
    source = changed.source | dict.fromkeys(keys, _of_resin(resin))
    return changed.model_copy(update={"source": source, "calibration": calibration})


def _of_resin(resin: Resin) -> str:
    """Return the source of the parameters that a process takes from a resin."""
    return f"resin: {resin.name}"
