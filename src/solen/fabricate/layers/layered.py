"""Summary of a print in layers: numbers, settings, and warnings before printing."""

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
"""Lengths outside this range suggest that the part was drawn in another unit."""
MIN_FIRST_AREA = 0.1
"""Minimum area of the first layer, as a fraction of the largest area, without a warning."""
MAX_VOLUME_ERROR = 0.01
"""Maximum relative difference between the volumes of the layers and the solid without a warning."""
MAX_HEIGHT_ERROR_UM = 1.0
"""Maximum height difference without a note or warning."""
MAX_WAVELENGTH_DIFFERENCE_NM = 10.0
"""Maximum difference between the wavelengths of a working curve and the printer without a warning."""


class LayeredPrint(Result):
    """A part sliced into layers for a printer.

    Attributes
    ----------
    job
        The printed solid; omitted from JSON.
    name, printer
        Names of the part and of the printer.
    pitch_um, pitch_y_um, columns, rows
        Sizes of a pixel and numbers of pixels along X and Y.
    layer_um, layers, height_mm
        Thickness and number of the layers, and height of the stack.
    size_mm
        Extent of one part along X, Y and Z.
    copies, places_mm
        Number of parts, and positions of their centres relative to the centre of the plate.
    solid_volume_mm3, stack_volume_mm3, volume_error
        Volume of the parts, volume of their layers, and the relative difference; None without images.
    islands
        Layers with unsupported regions, each with the number of these regions.
    settings
        Settings to enter in a slicer.
    sources, warnings
        The sliced file, and warnings to consider before printing.
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
    """Return the summary of a job; ``stl`` names its STL file, and ``stack`` is None without images."""
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
        places_mm=job.positions_mm,
        solid_volume_mm3=job.volume_mm3,
        stack_volume_mm3=volume_mm3,
        volume_error=None if volume_mm3 is None else volume_mm3 / job.volume_mm3 - 1.0,
        islands=() if stack is None else stack.islands,
        settings=settings,
        sources=(part.source,),
        warnings=(*part.warnings, *_warnings(job, settings, part.resin, stack)),
    )


def _warnings(job: Job, settings: PrintSettings, resin: Resin | None, stack: Stack | None) -> list[Caution]:
    warnings = [
        *_printer_warnings(job),
        *_grey_warnings(job),
        *_process_warnings(job),
        *_size_warnings(job),
        *_burn_in_warnings(job),
        *_horizontal_face_warnings(job),
        *_cure_warnings(settings, None if has_curve(job.process) else resin, job.printer),
    ]
    return warnings if stack is None else warnings + _stack_warnings(job, stack)


def _printer_warnings(job: Job) -> list[Caution]:
    warnings = []
    if job.printer.unconfirmed:
        *others, last = job.printer.unconfirmed
        numbers = f"{', '.join(others)} and {last}" if others else last
        text = f"{numbers} of {job.printer.name} are estimates: check them before you print"
        warnings.append(warning(text))
    if job.slicing.irradiance_mW_per_cm2 is None and job.printer.irradiance_mw_per_cm2 is None:
        assumption = f"doses are for {PAPER_MW_PER_CM2:g} mW/cm², the irradiance of the printer in the paper"
        warnings.append(warning(f"{assumption}: measure that of your printer"))
    return warnings


def _grey_warnings(job: Job) -> list[Caution]:
    """Warn if the grey response was measured with other pixels."""
    printer_um, process_um = tuple(1000.0 * side for side in job.printer.pitches_mm), job.greys.pixels_um
    if not job.greys.response or process_um is None or all(map(math.isclose, printer_um, process_um)):
        return []
    measured, printed = (" × ".join(dict.fromkeys(f"{side:.4g}" for side in um)) for um in (process_um, printer_um))
    text = f"the grey response was measured with pixels of {measured} µm, but {job.printer.name} has {printed} µm"
    return [warning(f"{text}: the light of its grey levels may differ")]


def _process_warnings(job: Job) -> list[Caution]:
    """Warn if layers or exposures differ from the process."""
    if job.slicing.process is None or job.process is None or job.solid.exposures_s:
        return []
    differences = job.slicing.described_differences(job.process.process)
    return [warning(f"the print differs from the process: {text}") for text in differences]


def _size_warnings(job: Job) -> list[Caution]:
    warnings, longest_mm = [], max(job.solid.size_mm)
    if not MIN_SIZE_MM <= longest_mm <= MAX_SIZE_MM:
        text = f"the part is {longest_mm:.3g} mm long: an STL contains no unit and is read in mm; check its unit"
        warnings.append(warning(text))
    difference_um = (job.height_mm - job.solid.size_mm[2]) * 1000.0
    if abs(difference_um) > MAX_HEIGHT_ERROR_UM:
        stack = f"{job.count} layers of {job.slicing.layer_um:g} µm"
        comparison = "higher" if difference_um > 0.0 else "lower"
        warnings.append(note(f"{stack} are {abs(difference_um):.1f} µm {comparison} than the part"))
    return warnings


def _burn_in_warnings(job: Job) -> list[Caution]:
    """Warn if a part ends within the burn-in, because none of its layers has the normal exposure."""
    slicing = job.slicing
    if job.count != job.burn_in_layers or slicing.burn_in_s == slicing.exposure_s:
        return []
    layers = f"all {job.count} layers are burn-in layers" if job.count > 1 else "the only layer is a burn-in layer"
    times = f"exposed for {slicing.burn_in_s:g} s, not {slicing.exposure_s:g} s"
    return [warning(f"{layers}, {times}; for a print without burn-in, set --burn-in-layers 0")]


def _horizontal_face_warnings(job: Job) -> list[Caution]:
    """Warn of horizontal faces within a layer, which are printed at one of its boundaries."""
    faces = [height for height in job.solid.heights_mm if 0.0 < height < job.solid.size_mm[2] - 1e-4]
    moves_um = [abs(math.ceil(height / job.layer_mm - 0.5) * job.layer_mm - height) * 1000.0 for height in faces]
    between = [height for height, move_um in zip(faces, moves_um, strict=True) if move_um > MAX_HEIGHT_ERROR_UM]
    if not between:
        return []
    first = f"the first at {between[0]:.4g} mm"
    faces_in_layers = f"{len(between)} horizontal faces are not at the boundary of a layer ({first})"
    return [warning(f"{faces_in_layers} and are printed up to {max(moves_um):.1f} µm away from their heights")]


def _cure_warnings(settings: PrintSettings, resin: Resin | None, printer: Printer) -> list[Caution]:
    if settings.cure_depth_um is None:
        return []
    warnings = [] if resin is None else list(resin.cautions("cure"))
    if settings.cure_depth_um <= settings.layer_um:
        depth = f"{settings.cure_depth_um:.0f} µm, but layers are {settings.layer_um:g} µm thick"
        warnings.append(do_not_use(f"one exposure cures {depth}: they would not adhere to each other"))
    light, cure = printer.wavelength_nm, None if resin is None else resin.cure
    if cure is None or light is None or cure.wavelength_nm is None:
        return warnings
    if abs(light.nominal - cure.wavelength_nm) > MAX_WAVELENGTH_DIFFERENCE_NM:
        wavelengths = f"{cure.wavelength_nm:g} nm, but the printer uses {light.nominal:g} nm"
        warnings.append(do_not_use(f"the working curve was measured at {wavelengths}: its cure depths do not apply"))
    return warnings


def _stack_warnings(job: Job, stack: Stack) -> list[Caution]:
    warnings = []
    if stack.islands:
        index, count = stack.islands[0]
        first = f"the first {count} at layer {index + 1}, {index * job.layer_mm:.4g} mm"
        total = sum(count for _, count in stack.islands)
        text = f"{total} regions have nothing below them ({first}): add supports with another program; solen makes none"
        warnings.append(warning(text))
    if stack.first_mm2 < MIN_FIRST_AREA * stack.largest_mm2:
        first_mm2, largest_mm2 = (area / job.slicing.copies for area in (stack.first_mm2, stack.largest_mm2))
        text = f"the first layer has only {first_mm2:.3g} mm², but the largest has {largest_mm2:.3g} mm²"
        warnings.append(warning(f"{text}: add a base or supports, or rotate the part"))
    error = stack.volume_mm3 / job.volume_mm3 - 1.0
    if abs(error) > MAX_VOLUME_ERROR:
        text = f"the layers have a volume of {stack.volume_mm3:.4g} mm³, but the solid has {job.volume_mm3:.4g} mm³"
        cause = "the mesh intersects itself, or has details smaller than a layer or a pixel"
        warnings.append(do_not_use(f"{text} ({100.0 * error:+.1f} %): {cause}"))
    return warnings
