"""Summary of a print in layers: its numbers, its settings, and warnings before printing."""

import math
from dataclasses import field

from solen.fabricate.layers.archive import Stack
from solen.fabricate.layers.job import PAPER_MW_PER_CM2, Job
from solen.fabricate.layers.printable import Printable
from solen.fabricate.layers.sheet import PrintSettings, has_curve, print_settings
from solen.material.resin import Resin
from solen.parts import Printer
from solen.ranks import Caution, do_not_use, note, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result

MIN_SIZE_MM, MAX_SIZE_MM = 0.5, 1000.0
"""A part outside these sizes was probably drawn in a different unit."""
NARROW = 0.1
"""A part whose first layer has less than this fraction of the largest layer area requires a base or supports."""
OTHER_VOLUME = 0.01
"""Relative volume difference above which the layers do not match the solid."""
HEIGHT_UM = 1.0
"""Height difference between stack and part below which no warning is given."""
APART_NM = 10.0
"""Maximum wavelength difference between a working curve and the printer."""


class LayeredPrint(Result):
    """A part sliced into layers for a printer.

    Attributes
    ----------
    job
        The printed solid; omitted from JSON.
    name, printer
        Names of the part and of the printer.
    pitch_um, pitch_y_um, columns, rows
        Pixel pitch and number of pixels along X and Y.
    layer_um, layers, height_mm
        Thickness and number of the layers, and stack height.
    size_mm
        Extent of one part along X, Y and Z.
    copies, places_mm
        Number of parts, and positions of their centres relative to the centre of the plate.
    solid_volume_mm3, stack_volume_mm3, volume_error
        Volume of the parts, volume of their layers, and the relative difference; None without images.
    islands
        Layers in which regions begin in the air, each with the number of these regions.
    settings
        Settings to enter in the slicing program.
    sources, warnings
        The sliced file, and warnings before printing.
    """

    job: Job = field(metadata=HIDDEN)
    name: str
    printer: str
    pitch_um: float
    pitch_y_um: float
    columns: int
    rows: int
    layer_um: float
    layers: int
    size_mm: tuple[float, float, float]
    height_mm: float
    copies: int
    places_mm: tuple[tuple[float, float], ...]
    solid_volume_mm3: float
    stack_volume_mm3: float | None
    volume_error: float | None
    islands: tuple[tuple[int, int], ...]
    settings: PrintSettings
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]


def layered_print(job: Job, part: Printable, stl: str, stack: Stack | None) -> LayeredPrint:
    """Summarise a job; ``stl`` names its STL file, and ``stack`` is None without images."""
    settings = print_settings(job, part, stl)
    rows, columns = job.printer.shape
    volume_mm3 = None if stack is None else stack.volume_mm3
    return LayeredPrint(
        job=job,
        name=part.label.name,
        printer=job.printer.name,
        pitch_um=1000.0 * job.printer.pitches_mm[0],
        pitch_y_um=1000.0 * job.printer.pitches_mm[1],
        columns=columns,
        rows=rows,
        layer_um=job.slicing.layer_um,
        layers=job.count,
        size_mm=job.solid.size_mm,
        height_mm=job.height_mm,
        copies=job.slicing.copies,
        places_mm=job.places_mm,
        solid_volume_mm3=job.volume_mm3,
        stack_volume_mm3=volume_mm3,
        volume_error=None if volume_mm3 is None else volume_mm3 / job.volume_mm3 - 1.0,
        islands=() if stack is None else stack.islands,
        settings=settings,
        sources=(part.source,),
        warnings=(*part.warnings, *_warnings(job, settings, part.stated_resin, stack)),
    )


def _warnings(job: Job, settings: PrintSettings, resin: Resin | None, stack: Stack | None) -> list[Caution]:
    warnings = [
        *_of_printer(job),
        *_of_greys(job),
        *_of_process(job),
        *_of_size(job),
        *_of_burn_in(job),
        *_of_level_faces(job),
        *_of_cure(settings, None if has_curve(job.process) else resin, job.printer),
    ]
    return warnings if stack is None else warnings + _of_stack(job, stack)


def _of_printer(job: Job) -> list[Caution]:
    warnings = []
    if job.printer.unconfirmed:
        *others, last = job.printer.unconfirmed
        numbers = f"{', '.join(others)} and {last}" if others else last
        warnings.append(
            warning(f"{numbers} of {job.printer.name} are estimates: check them before printing the images")
        )
    if job.slicing.irradiance_mW_per_cm2 is None and job.printer.irradiance_mw_per_cm2 is None:
        warnings.append(
            warning(
                f"doses assume {PAPER_MW_PER_CM2:g} mW/cm², the irradiance of the printer in the paper; measure yours"
            )
        )
    return warnings


def _of_greys(job: Job) -> list[Caution]:
    """Warn if the grey response was measured with other pixels."""
    here, there = tuple(1000.0 * side for side in job.printer.pitches_mm), job.greys.pixels_um
    if not job.greys.answer or there is None or all(map(math.isclose, here, there)):
        return []
    of, to = (" × ".join(dict.fromkeys(f"{side:.4g}" for side in sides)) for sides in (there, here))
    return [
        warning(
            f"the process was measured with {of} µm pixels, but {job.printer.name} has {to} µm pixels: "
            "its grey levels may transmit different light"
        )
    ]


def _of_process(job: Job) -> list[Caution]:
    """Warn if layers or exposures differ from the process."""
    if job.slicing.process is None or job.process is None or job.solid.exposures_s:
        return []
    return [warning(f"not printed as in the process: {one}") for one in job.slicing.otherwise(job.process.process)]


def _of_size(job: Job) -> list[Caution]:
    warnings, longest_mm = [], max(job.solid.size_mm)
    if not MIN_SIZE_MM <= longest_mm <= MAX_SIZE_MM:
        warnings.append(
            warning(
                f"the part is {longest_mm:.3g} mm long: an STL contains no unit and is read as "
                "mm; check the unit of the part"
            )
        )
    off_um = (job.height_mm - job.solid.size_mm[2]) * 1000.0
    if abs(off_um) > HEIGHT_UM:
        way = "higher" if off_um > 0.0 else "lower"
        warnings.append(
            note(f"{job.count} layers of {job.slicing.layer_um:g} µm are {abs(off_um):.1f} µm {way} than the part")
        )
    return warnings


def _of_burn_in(job: Job) -> list[Caution]:
    """Warn if a part ends within the burn-in, because none of its layers has the normal exposure."""
    slicing = job.slicing
    if job.count != job.burn_in_layers or slicing.burn_in_s == slicing.exposure_s:
        return []
    part = (
        "the part consists of a single layer"
        if job.count == 1
        else f"all {job.count} layers of the part are burn-in layers"
    )
    return [
        warning(
            f"{part}: burn-in exposes it for {slicing.burn_in_s:g} s instead of {slicing.exposure_s:g} s; "
            "omit the burn-in with --burn-in-layers 0"
        )
    ]


def _of_level_faces(job: Job) -> list[Caution]:
    """Warn of horizontal faces within a layer, because they are printed at one of its boundaries."""
    faces = [height for height in job.solid.heights_mm if 0.0 < height < job.solid.size_mm[2] - 1e-4]
    moves_um = [abs(math.ceil(height / job.layer_mm - 0.5) * job.layer_mm - height) * 1000.0 for height in faces]
    between = [height for height, move_um in zip(faces, moves_um, strict=True) if move_um > HEIGHT_UM]
    if not between:
        return []
    first = f"the first at {between[0]:.4g} mm"
    return [
        warning(
            f"{len(between)} horizontal faces are within a layer ({first}) and move by up to {max(moves_um):.1f} µm"
        )
    ]


def _of_cure(settings: PrintSettings, resin: Resin | None, printer: Printer) -> list[Caution]:
    if settings.cure_depth_um is None:
        return []
    warnings = [] if resin is None else list(resin.cautions("cure"))
    if settings.cure_depth_um <= settings.layer_um:
        depth = f"{settings.cure_depth_um:.0f} µm, while a layer is {settings.layer_um:g} µm thick"
        warnings.append(do_not_use(f"one exposure cures {depth}: the layers would not adhere to each other"))
    light, cure = printer.wavelength_nm, None if resin is None else resin.cure
    if cure is None or light is None or cure.wavelength_nm is None:
        return warnings
    if abs(light.nominal - cure.wavelength_nm) > APART_NM:
        apart = f"{cure.wavelength_nm:g} nm, while the printer uses {light.nominal:g} nm"
        warnings.append(do_not_use(f"the working curve was measured at {apart}: its cure depths do not apply here"))
    return warnings


def _of_stack(job: Job, stack: Stack) -> list[Caution]:
    warnings = []
    if stack.islands:
        index, pieces = stack.islands[0]
        where = f"{pieces} at layer {index + 1}, {index * job.layer_mm:.4g} mm"
        total = sum(count for _, count in stack.islands)
        warnings.append(
            warning(
                f"{total} regions begin in the air (first {where}): they require supports, which solen does not make"
            )
        )
    if stack.first_mm2 < NARROW * stack.largest_mm2:
        first, largest = (area / job.slicing.copies for area in (stack.first_mm2, stack.largest_mm2))
        areas = f"{first:.3g} mm², while its largest layer has an area of {largest:.3g} mm²"
        warnings.append(warning(f"the part rests on {areas}: add a base or supports, or rotate it"))
    off = stack.volume_mm3 / job.volume_mm3 - 1.0
    if abs(off) > OTHER_VOLUME:
        warnings.append(
            do_not_use(
                f"the layers have a volume of {stack.volume_mm3:.4g} mm³ and the solid {job.volume_mm3:.4g} mm³ "
                f"({100.0 * off:+.1f} %): the mesh intersects itself, or has details smaller than a layer or a pixel"
            )
        )
    return warnings
