"""Print of a lens that varies with height: its face layer by layer, and its contrast before and after printing.

A cylindrical lens with the same middle section is printed by the same model, so that both are compared as designed and
as printed. Compensation changes the drawing of each layer; the walls next to the lens remain as designed.

`print_layers` returns `PrintedLayers`; `layer_files` returns the corresponding files.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from solen import files
from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.fabricate.lens_parts import cut_for
from solen.fabricate.process.compensation_files import LABEL, targets_of
from solen.fabricate.process.face_print import FacePrint, PrintedFace
from solen.fabricate.process.growth import growth_range_um
from solen.fabricate.process.predict import half_difference
from solen.fabricate.process.process_file import Process
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.source import PrintOptions, curve_cautions, process_of, with_resin
from solen.lens import LayerProfiles, LensInSpace, layers_text
from solen.progress import Progress, part_of
from solen.ranks import Caution, do_not_use, note, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, reported
from solen.sensor import Sensor
from solen.sensor.lens_responses import LensResponse, lens_responses
from solen.sensor.sensor import NO_SHAPE_KEYS
from solen.spec import Design, dumps, with_values

MAX_ASYMMETRY_UM = 1.0
"""Maximum difference between the growths of walls that face in different directions."""
SYMMETRIC_PHASES = (0.0, 0.5)
"""Positions in a pixel along x for which the left half of the image mirrors the right half."""
FARTHEST_PHASE = (0.5, 0.5)
"""Position in a pixel farthest from the default, a corner."""
MAX_U_UM = 3.0
"""Maximum uncertainty of a compensated face without a warning."""
CYLINDER, DESIGNED, PRINTED, COMPENSATED = "cylinder", "designed", "printed", "compensated"


@dataclass(frozen=True)
class LayerDeviation:
    """Deviation of the wall of one layer from the designed wall, along its normal; positive for additional material.

    Attributes
    ----------
    layer
        Number of the layer, counted from 1 at the build plate.
    height_mm
        Mid-height of the layer above the plate.
    rms_um, mean_um, largest_um, largest_x_mm
        Statistics along half of the wall, which the other half mirrors, and position of the largest deviation.
    u_rms_um
        Standard uncertainty, RMS along the wall, due to the process and to the position in the pixel if this is not
        specified.
    """

    layer: int
    height_mm: float
    rms_um: float
    mean_um: float
    largest_um: float
    largest_x_mm: float
    u_rms_um: float


class PrintedLayers(Result):
    """Predicted print of a lens that varies with height.

    Attributes
    ----------
    name, shape, simulated
        Name of the design and shape of its lens; a prediction is always simulated.
    process, settings
        Name and values of the process.
    layers
        Number of layers.
    rms_um
        Deviation of the printed face from the designed face, RMS along the normals.
    deviations
        Deviations of the first and the last layer, and of the layers at one half and three quarters of the height.
    compensated_rms_um, compensated_deviations, rounds_um
        RMS deviation and layer deviations printed from the compensated drawing, and RMS deviation along z after each
        round; None without compensation.
    drawn_range_um
        Range of the displacement of the compensated drawing from the designed face, along z towards the emitter.
    responses
        Contrast and light of the cylinder and the lens, as designed and as printed; empty if not traced.
    sources, warnings
        Process file, and limits of the conclusions.
    sensor, model, face, compensated
        The designed sensor, the print model, and the printed faces; omitted from JSON.
    """

    name: str
    shape: str
    simulated: bool
    process: str
    settings: Settings
    layers: int
    rms_um: float
    deviations: tuple[LayerDeviation, ...]
    compensated_rms_um: float | None
    compensated_deviations: tuple[LayerDeviation, ...]
    rounds_um: tuple[float, ...] | None
    drawn_range_um: tuple[float, float] | None
    responses: tuple[LensResponse, ...]
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    sensor: Sensor = field(metadata=HIDDEN)
    model: FacePrint = field(metadata=HIDDEN)
    face: PrintedFace = field(metadata=HIDDEN)
    compensated: PrintedFace | None = field(metadata=HIDDEN)

    @reported
    def remaining(self) -> dict[str, tuple[float, ...]]:
        """Contrast of each lens divided by that of the printed cylinder, for each angle; empty without responses."""
        return {name: tuple(ratio.tolist()) for name, (ratio, _) in self._remaining.items()}

    @reported
    def u_remaining(self) -> dict[str, tuple[float, ...]]:
        """Standard uncertainty of `remaining`, from both contrasts; 0 for the printed cylinder itself."""
        return {name: tuple(u.tolist()) for name, (_, u) in self._remaining.items()}

    @property
    def _remaining(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Contrast of each lens divided by that of the printed cylinder, and its uncertainty; NaN at contrast 0."""
        base = next((response for response in self.responses if response.name == f"{CYLINDER}, {PRINTED}"), None)
        if base is None:
            return {}
        divisor = np.where(base.contrast != 0.0, base.contrast, np.nan)
        ratios = {}
        for response in self.responses:
            ratio = response.contrast / divisor
            u = (response.u_contrast + np.abs(ratio) * base.u_contrast) / np.abs(divisor)
            ratios[response.name] = ratio, np.where(np.isfinite(ratio), 0.0, np.nan) if response is base else u
        return ratios

    @property
    def profile(self) -> LayerProfiles:
        """Printed face, in the form of ``lens.profile`` of a layered lens."""
        return printed_profiles(self.model, self.face, self.name, self.process)


def print_layers(
    sensor: Sensor,
    options: PrintOptions = PrintOptions(),
    *,
    response: bool = True,
    compensate: bool = False,
    part: bool = False,
    progress: Progress | None = None,
) -> PrintedLayers:
    """Return the predicted print of a design whose lens varies with height.

    For parameters and errors, see `solen.fabricate.process.print_design`.
    """
    _check_options(options, part=part)
    process, sources = process_of(options)
    process = with_resin(process, sensor.design)
    curve_warnings = curve_cautions(process, sensor.design)
    design = cut_for(sensor.design, process.process.layer_um)
    sensor = sensor if design is sensor.design else Sensor.of(design)
    _check_symmetry(process.process)
    model = FacePrint.of(sensor.body(), process.process, options.phase_px or (0.0, 0.0))
    face = model.printed(part_of(progress, 0, 10, 3))
    compensated = model.compensated(face, part_of(progress, 3, 10, 5)) if compensate else None
    u_process_um = _u_process_um(model, process)
    u_phase_um = _u_phase_um(model, face) if options.phase_px is None else dict.fromkeys(u_process_um, 0.0)
    u_um = {layer: float(np.hypot(u, u_phase_um[layer])) for layer, u in u_process_um.items()}
    warnings = (*process.warnings(), *curve_warnings, *_face_warnings(sensor, model, compensated, u_process_um))
    if options.phase_px is None:
        warnings += (_phase_warning(u_phase_um),)
    drawn_um = None if compensated is None else 1e3 * (model.intended - compensated.drawn)
    faces = (face, compensated)
    return PrintedLayers(
        name=sensor.design.name,
        shape=sensor.lens.shape,
        simulated=True,
        process=process.name,
        settings=process.process,
        layers=model.layers,
        rms_um=face.rms_um,
        deviations=_deviations(model, face, u_um),
        compensated_rms_um=None if compensated is None else compensated.rms_um,
        compensated_deviations=() if compensated is None else _deviations(model, compensated, u_um),
        rounds_um=None if compensated is None else compensated.rounds_um,
        drawn_range_um=None if drawn_um is None else (float(drawn_um.min()), float(drawn_um.max())),
        responses=_responses(sensor, model, *faces, process.name, part_of(progress, 8, 10, 2)) if response else (),
        sources=sources,
        warnings=warnings,
        sensor=sensor,
        model=model,
        face=face,
        compensated=compensated,
    )


def layer_files(prediction: PrintedLayers, out: Path | None, compensate: Path | None) -> dict[Path, files.Content]:
    """Return the files of a prediction: the printed layers, and the design that draws the compensated layers."""
    contents: dict[Path, files.Content] = {} if out is None else {out: layers_text(prediction.profile).encode()}
    model, compensated = prediction.model, prediction.compensated
    if compensate is None or compensated is None:
        return contents
    drawn, printed = list(targets_of(compensate, "drawn").values())[1:]
    caution = f"{LABEL}: do not trace it, and do not compensate it again"
    drawing = f"# {caution.capitalize()}.\n{dumps(_drawn_design(prediction.sensor, drawn.name))}"
    drawn_profiles = model.profiles(compensated.drawn, f"{prediction.name}, {LABEL}", caution)
    profiles = printed_profiles(model, compensated, prediction.name, prediction.process)
    contents |= {compensate: drawing.encode(), drawn: layers_text(drawn_profiles).encode()}
    return contents | {printed: layers_text(profiles).encode()}


def printed_profiles(model: FacePrint, face: PrintedFace, name: str, process: str) -> LayerProfiles:
    """Return the profiles of a printed face, marked as simulated."""
    caution = f"predicted by a print model ({process}), not measured"
    return model.profiles(face.printed, f"{name}, printed by the model", caution)


def _drawn_design(sensor: Sensor, layers: str) -> Design:
    """Return a design with drawn layers: name, material, lens, body and seats."""
    original, lens = sensor.design, sensor.lens
    if not isinstance(lens, LensInSpace):
        raise TypeError(type(lens).__name__)
    numbers = {"focus_mm": lens.focus_mm, "half_width_mm": lens.half_width_mm, "design_index": lens.design_index}
    return Design(
        name=f"{original.name}, {LABEL}",
        material={"index": sensor.material.index},
        emitter={"distance_mm": original.emitter.distance_mm, "pattern": "lambertian"},
        lens={"shape": "layered", "profile": layers} | numbers,
        body=original.body.model_dump(exclude_defaults=True),
        trace={"dimension": "extruded"},
        fabricate=original.fabricate.model_dump(exclude_defaults=True),
    )


def _check_options(options: PrintOptions, *, part: bool) -> None:
    """Raise `SpecError` if an option is not supported for a lens that varies with height."""
    unsupported = "is not supported for a lens that varies with height"
    if options.orientation != "flat":
        limit = "must be flat for a lens that varies with height: its layers are parallel to the faces of the body"
        raise SpecError("--orientation", value=options.orientation, limit=limit, remedy="omit --orientation")
    if part:
        remedy = "export a layered design with the printed layers as lens.profile"
        raise SpecError("--solid", limit=unsupported, remedy=remedy)
    if options.choose_phase:
        raise SpecError("--choose-phase", limit=unsupported, remedy="specify --phase-px")
    if options.at != "middle":
        limit = f"{unsupported}, which is predicted at all heights"
        raise SpecError("--at", value=options.at, limit=limit, remedy="omit --at")
    if options.phase_px is not None and options.phase_px[0] not in SYMMETRIC_PHASES:
        limit = "must be 0 or 0.5 along x for a lens that varies with height, whose halves must print identically"
        raise SpecError("--phase-px", value=options.phase_px, limit=limit)


def _check_symmetry(settings: Settings) -> None:
    """Raise `SpecError` if opposite walls grow differently, because only one half of the lens is modelled."""
    low, high = growth_range_um(settings)
    if high - low > MAX_ASYMMETRY_UM:
        condition = f"the growth of walls may vary with their direction by at most {MAX_ASYMMETRY_UM:g} µm"
        limit = (
            f"is too asymmetric for a lens that varies with height: {condition}, but is {low:+.3g} to {high:+.3g} µm"
        )
        raise SpecError("process.response", limit=limit, remedy="specify a symmetric response, or sigma_um instead")


def _reported_layers(layers: int) -> list[int]:
    """Return the indices of the layers whose deviations are reported."""
    return sorted({0, layers // 2, (3 * layers) // 4, layers - 1})


def _u_process_um(model: FacePrint, process: Process) -> dict[int, float]:
    """Return the standard uncertainty of the wall of each reported layer due to the process, RMS along the wall.

    The uncertainties are in µm, keyed by layer index.
    """
    keys, covariance = process.covariance()
    scale = np.sqrt(np.diag(covariance))
    layers = _reported_layers(model.layers)
    return {layer: _u_layer_um(model, process, layer, keys, scale, covariance) for layer in layers}


def _u_layer_um(
    model: FacePrint, process: Process, layer: int, keys: tuple[str, ...], scale: FloatArray, covariance: FloatArray
) -> float:
    def printed(settings: Settings) -> FloatArray:
        return model.offsets_um(layer, settings)

    halves = [half_difference(process, key, u, printed) for key, u in zip(keys, scale.tolist(), strict=True)]
    if not halves:
        return 0.0
    jacobian = np.array(halves) / scale[:, None]
    return float(np.sqrt(np.mean(np.einsum("in,ij,jn->n", jacobian, covariance, jacobian))))


def _u_phase_um(model: FacePrint, face: PrintedFace) -> dict[int, float]:
    """Return the standard uncertainty of the wall of each reported layer due to the unknown position in the pixel.

    The uncertainties, RMS along the wall in µm, are keyed by layer index.
    """
    layers = _reported_layers(model.layers)
    changes = zip(layers, model.changes_um(face, layers, FARTHEST_PHASE), strict=True)
    return {layer: float(np.sqrt(np.mean(um**2) / 3.0)) for layer, um in changes}


def _phase_warning(u_um: dict[int, float]) -> Caution:
    change = f"another position in the pixel changes the wall of a layer by {max(u_um.values()):.2g} µm RMS"
    text = f"--phase-px is not specified, and 0,0 is assumed: {change}"
    return warning(f"{text}; this is included in u_rms_um, but not in the response table")


def _deviations(model: FacePrint, face: PrintedFace, u_um: dict[int, float]) -> tuple[LayerDeviation, ...]:
    rows = []
    for layer, u in u_um.items():
        um = face.um[layer]
        worst, x = int(np.argmax(np.abs(um))), np.linspace(0.0, model.lens.half_width_mm, len(um))
        height_mm = model.lens.half_height_mm - float(face.y_mm[layer])
        rms, mean = float(np.sqrt(np.mean(um**2))), float(np.mean(um))
        rows.append(LayerDeviation(layer + 1, height_mm, rms, mean, float(um[worst]), float(x[worst]), u))
    return tuple(rows)


def _responses(
    sensor: Sensor,
    model: FacePrint,
    face: PrintedFace,
    compensated: PrintedFace | None,
    process: str,
    progress: Progress | None,
) -> tuple[LensResponse, ...]:
    """Return the responses of the cylinder and the lens: designed, printed and, if applicable, compensated."""
    cylinder_sensor = Sensor.of(with_values(sensor.design, _cylinder(sensor)))
    cylinder = FacePrint.of(cylinder_sensor.body(), model.settings, model.phase)
    printed = cylinder.printed()
    compensated_cylinder = None if compensated is None else cylinder.compensated(printed)
    rows = (
        (CYLINDER, cylinder_sensor, cylinder, printed, compensated_cylinder),
        (sensor.lens.shape, sensor, model, face, compensated),
    )
    sensors: dict[str, Sensor] = {}
    for name, designed, face_print, uncompensated, corrected in rows:
        sensors[f"{name}, {DESIGNED}"] = designed
        sensors[f"{name}, {PRINTED}"] = _with_face(designed, face_print, uncompensated, process)
        if corrected is not None:
            sensors[f"{name}, {COMPENSATED}"] = _with_face(designed, face_print, corrected, process)
    return lens_responses(sensors, progress=progress)


def _with_face(sensor: Sensor, model: FacePrint, face: PrintedFace, process: str) -> Sensor:
    return replace(sensor, cut=model.lens_of(printed_profiles(model, face, sensor.design.name, process)))


def _cylinder(sensor: Sensor) -> dict[str, object]:
    """Return the design values of a cylindrical lens: layered, with a single layer."""
    values = NO_SHAPE_KEYS | {"lens.shape": "layered", "lens.profile": None}
    return values | {"lens.layer_mm": sensor.design.body.thickness_mm}


def _face_warnings(
    sensor: Sensor, model: FacePrint, compensated: PrintedFace | None, u_um: dict[int, float]
) -> list[Caution]:
    """Return the limits of the prediction of a face that varies with height."""
    worst = max(u_um.values())
    warnings = [
        note("the wall of each layer is computed at its mid-height; shrinkage along the height is neglected"),
        note("the walls next to the lens are traced as designed"),
        warning(
            f"the uncertainty of the process is up to {worst:.2g} µm for the wall of a layer; it is not included in "
            "the response table"
        ),
    ]
    layer_mm = sensor.design.lens.layer_mm
    printed_mm = 1e-3 * model.settings.layer_um
    if layer_mm is not None and not np.isclose(layer_mm, printed_mm):
        warnings.append(warning(f"lens.layer_mm is {layer_mm:g}, but the process prints layers of {printed_mm:g} mm"))
    last_mm = float(model.edges_mm[1] - model.edges_mm[0])
    if not np.isclose(last_mm, printed_mm):
        layers = f"{model.layers - 1} layers of {printed_mm:g} mm and one of {last_mm:.3g} mm"
        text = f"the thickness of {sensor.design.body.thickness_mm:g} mm is divided into {layers}"
        warnings.append(warning(f"{text}, which is exposed like a full layer"))
    if compensated is not None and worst > max(2.0 * compensated.rms_um, MAX_U_UM):
        rms_um = compensated.rms_um
        text = f"the compensated face deviates by {rms_um:.2g} µm in the model, whose uncertainty is {worst:.2g} µm"
        remedy = "before you use the drawing, calibrate the process with coupons from your printer"
        warnings.append(do_not_use(f"{text}: {remedy}"))
    return warnings
