"""Print of a lens that varies with height: its face layer by layer, and the gain that remains after printing.

The cylinder with the same middle section is printed by the same model, so a table compares both as designed and as
printed. Compensation changes the drawing of each layer; the walls next to the lens stay as designed.

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
from solen.fabricate.process.growth import uneven_um
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

SYMMETRIC_UM = 1.0
"""Maximum difference by which the light of a pixel may move opposite walls."""
MIDDLE_PIXELS = (0.0, 0.5)
"""Positions in a pixel across the axis for which the left half mirrors the right half."""
FARTHEST_PHASE = (0.5, 0.5)
"""Position in the pixel farthest from a corner; the default is a corner."""
WELL_KNOWN_UM = 3.0
CYLINDER, DESIGNED, PRINTED, DRAWN = "cylinder", "designed", "printed", "compensated"


@dataclass(frozen=True)
class LayerDeviation:
    """Deviation of the wall of one layer from the designed wall, along its normal; positive for more material.

    Attributes
    ----------
    layer
        Layer number, starting with 1 on the build plate.
    height_mm
        Mid-height of the layer above the plate.
    rms_um, mean_um, largest_um, largest_x_mm
        Statistics over half the wall, which the other half mirrors, and position of the largest deviation.
    u_rms_um
        Standard uncertainty due to the process, and to the position in the pixel if it is not specified; root mean
        square along the wall.
    """

    layer: int
    height_mm: float
    rms_um: float
    mean_um: float
    largest_um: float
    largest_x_mm: float
    u_rms_um: float


class PrintedLayers(Result):
    """Prediction of a flat print of a lens that varies with height.

    Attributes
    ----------
    name, shape, simulated
        Name of the design and shape of its lens; a prediction is always simulated.
    process, settings
        Name and values of the process.
    layers
        Number of layers.
    rms_um
        Deviation of the entire printed face from the designed face, root mean square along the normals.
    deviations
        Deviations of the first and last layers, one at mid-height and one at three quarters of the height.
    compensated_rms_um, compensated_deviations, rounds_um
        The same values for the compensated drawing, and the root mean square along z for each round; None without
        compensation.
    drawn_range_um
        Range of the displacement of the compensated drawing from the designed face, along z towards the emitter.
    responses
        Contrast and light of cylinder and lens, designed and printed; empty if not traced.
    sources, warnings
        Process file, and limits of the conclusions.
    face, compensated, half_width_mm
        The printed faces and the half width of the lens.
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
        return {name: tuple(share.tolist()) for name, (share, _) in self._remaining.items()}

    @reported
    def u_remaining(self) -> dict[str, tuple[float, ...]]:
        """Standard uncertainty of `remaining`, computed from both contrasts; 0 for the printed cylinder itself."""
        return {name: tuple(u.tolist()) for name, (_, u) in self._remaining.items()}

    @property
    def _remaining(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Contrast of each lens divided by that of the printed cylinder, and its uncertainty; NaN at contrast 0."""
        base = next((response for response in self.responses if response.name == f"{CYLINDER}, {PRINTED}"), None)
        if base is None:
            return {}
        below = np.where(base.contrast != 0.0, base.contrast, np.nan)
        found = {}
        for response in self.responses:
            share = response.contrast / below
            u = (response.u_contrast + np.abs(share) * base.u_contrast) / np.abs(below)
            found[response.name] = share, np.where(np.isfinite(share), 0.0, np.nan) if response is base else u
        return found

    @property
    def profile(self) -> LayerProfiles:
        """Printed face, in the form of a layered lens's ``[lens] profile``."""
        return self._profiles(self.face)

    def _profiles(self, face: PrintedFace) -> LayerProfiles:
        return printed_profiles(self.model, face, self.name, self.process)


def print_layers(
    sensor: Sensor,
    options: PrintOptions = PrintOptions(),
    *,
    response: bool = True,
    compensate: bool = False,
    part: bool = False,
    progress: Progress | None = None,
) -> PrintedLayers:
    """Predict the print of a design whose lens varies with height.

    For the parameters and errors, see `solen.fabricate.process.print_design`.
    """
    _check(options, part=part)
    process, sources = process_of(options)
    process = with_resin(process, sensor.design)
    of_curve = curve_cautions(process, sensor.design)
    cut = cut_for(sensor.design, process.process.layer_um)
    sensor = sensor if cut is sensor.design else Sensor.of(cut)
    _check_halves(process.process)
    model = FacePrint.of(sensor.body(), process.process, options.phase_px or (0.0, 0.0))
    face = model.printed(part_of(progress, 0, 10, 3))
    made = model.compensated(face, part_of(progress, 3, 10, 5)) if compensate else None
    by_process = _u_um(model, process)
    by_place = _u_by_place_um(model, face) if options.phase_px is None else dict.fromkeys(by_process, 0.0)
    u_um = {layer: float(np.hypot(u, by_place[layer])) for layer, u in by_process.items()}
    warnings = (*process.warnings(), *of_curve, *_of_face(sensor, model, made, by_process))
    if options.phase_px is None:
        warnings += (_of_place(by_place),)
    drawn = None if made is None else 1e3 * (model.wanted - made.drawn)
    return PrintedLayers(
        name=sensor.design.name,
        shape=sensor.lens.shape,
        simulated=True,
        process=process.name,
        settings=process.process,
        layers=model.layers,
        rms_um=face.rms_um,
        deviations=_deviations(model, face, u_um),
        compensated_rms_um=None if made is None else made.rms_um,
        compensated_deviations=() if made is None else _deviations(model, made, u_um),
        rounds_um=None if made is None else made.rounds_um,
        drawn_range_um=None if drawn is None else (float(drawn.min()), float(drawn.max())),
        responses=_responses(sensor, model, face, made, process.name, part_of(progress, 8, 10, 2)) if response else (),
        sources=sources,
        warnings=warnings,
        sensor=sensor,
        model=model,
        face=face,
        compensated=made,
    )


def layer_files(made: PrintedLayers, out: Path | None, compensate: Path | None) -> dict[Path, files.Content]:
    """Return the files of a prediction: the printed layers, and the design that draws the compensated layers.

    Raises `OutputError` if two of the files have the same path.
    """
    contents: dict[Path, files.Content] = {} if out is None else {out: layers_text(made.profile).encode()}
    if compensate is None or made.compensated is None:
        return contents
    drawn, printed = list(targets_of(compensate, "drawn").values())[1:]
    caution = "drawn for a printer, not the intended shape: do not trace it, and do not compensate it again"
    profiles = made.model.profiles(made.compensated.drawn, f"{made.name}, {LABEL}", caution)
    text = f"# {warning}\n" + dumps(_drawn_design(made.sensor, drawn.name))
    own = {compensate: text.encode(), drawn: layers_text(profiles).encode()}
    return files.joined(contents, own, {printed: layers_text(made._profiles(made.compensated)).encode()})


def printed_profiles(model: FacePrint, face: PrintedFace, name: str, process: str) -> LayerProfiles:
    """Return the profiles of a printed face, marked as simulated."""
    caution = f"predicted by a print model ({process}), not measured"
    return model.profiles(face.printed, f"{name}, printed by the model", caution)


def _drawn_design(sensor: Sensor, layers: str) -> Design:
    """Return a design for drawn layers: name, material, lens, body, and the seats that are cut from the body."""
    old, lens = sensor.design, sensor.lens
    if not isinstance(lens, LensInSpace):
        raise TypeError(type(lens).__name__)
    cut = {"focus_mm": lens.focus_mm, "half_width_mm": lens.half_width_mm, "design_index": lens.design_index}
    return Design(
        name=f"{old.name}, {LABEL}",
        material={"index": sensor.material.index},
        emitter={"distance_mm": old.emitter.distance_mm, "pattern": "lambertian"},
        lens={"shape": "layered", "profile": layers} | cut,
        body=old.body.model_dump(exclude_defaults=True),
        trace={"dimension": "extruded"},
        fabricate=old.fabricate.model_dump(exclude_defaults=True),
    )


def _check(options: PrintOptions, *, part: bool) -> None:
    """Raise `SpecError` if an option is not supported for a lens that varies with height."""
    why = "is not supported for a lens that varies with height"
    if options.orientation != "flat":
        limit = "a lens that varies with height is printed flat, with its layers parallel to the faces of the body"
        raise SpecError("--orientation", value=options.orientation, limit=limit, remedy="omit it")
    if part:
        raise SpecError("--solid", limit=why, remedy="export the printed layers: lens.profile of a layered design")
    if options.choose_phase:
        raise SpecError("--choose-phase", limit=why, remedy="specify --phase-px")
    if options.at != "middle":
        raise SpecError("--at", value=options.at, limit=f"{why}: all heights are predicted", remedy="omit it")
    if options.phase_px is not None and options.phase_px[0] not in MIDDLE_PIXELS:
        limit = "must be 0 or 0.5 across the axis for a lens that varies with height: its halves must print identically"
        raise SpecError("--phase-px", value=options.phase_px, limit=limit)


def _check_halves(settings: Settings) -> None:
    """Raise `SpecError` if the light of a pixel moves opposite walls differently, because only one half is modelled."""
    least, most = uneven_um(settings)
    if most - least > SYMMETRIC_UM:
        raise SpecError(
            "process.response",
            value=f"wall displacements of {least:+.3g} to {most:+.3g} µm, depending on the side they face",
            limit=f"must move all sides equally, within {SYMMETRIC_UM:g} µm, for a lens that varies with height",
            remedy="specify a symmetric response, or its sigma_um",
        )


def _shown(layers: int) -> list[int]:
    """Return the numbers, starting with 0, of the layers whose deviations are reported."""
    return sorted({0, layers // 2, (3 * layers) // 4, layers - 1})


def _u_um(model: FacePrint, process: Process) -> dict[int, float]:
    """Return the standard uncertainty of the reported layers due to the process, root mean square along the wall."""
    keys, covariance = process.covariance()
    scale = np.sqrt(np.diag(covariance))
    return {layer: _u_of_layer(model, process, layer, keys, scale, covariance) for layer in _shown(model.layers)}


def _u_of_layer(
    model: FacePrint, process: Process, layer: int, keys: tuple[str, ...], scale: FloatArray, covariance: FloatArray
) -> float:
    def printed(settings: Settings) -> FloatArray:
        return model.offsets_um(layer, settings)

    halves = [half_difference(process, key, u, printed) for key, u in zip(keys, scale.tolist(), strict=True)]
    if not halves:
        return 0.0
    jacobian = np.array(halves) / scale[:, None]
    return float(np.sqrt(np.mean(np.einsum("in,ij,jn->n", jacobian, covariance, jacobian))))


def _u_by_place_um(model: FacePrint, face: PrintedFace) -> dict[int, float]:
    """Standard uncertainty of the reported layers due to the position in the pixel, as in `predict.predicted`."""
    shown = _shown(model.layers)
    moved = zip(shown, model.moved_um(face, shown, FARTHEST_PHASE), strict=True)
    return {layer: float(np.sqrt(np.mean(um**2) / 3.0)) for layer, um in moved}


def _of_place(u_um: dict[int, float]) -> Caution:
    return warning(
        f"--phase-px is not specified; 0,0 is assumed. Another position in the pixel changes the wall of a layer by "
        f"{max(u_um.values()):.2g} µm rms; this is included in u_rms_um, but not in the response table"
    )


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
    made: PrintedFace | None,
    process: str,
    progress: Progress | None,
) -> tuple[LensResponse, ...]:
    """Return the responses of cylinder and lens, designed and printed, and of the compensated lens if there is one."""
    upright = Sensor.of(with_values(sensor.design, _upright(sensor)))
    cylinder = FacePrint.of(upright.body(), model.settings, model.phase)
    printed = cylinder.printed()
    prints = {CYLINDER: (upright, cylinder, printed), sensor.lens.shape: (sensor, model, face)}
    drawn = {} if made is None else {CYLINDER: cylinder.compensated(printed), sensor.lens.shape: made}
    sensors: dict[str, Sensor] = {}
    for name, (own, one, plain) in prints.items():

        def with_face(face: PrintedFace, own: Sensor = own, one: FacePrint = one) -> Sensor:
            return replace(own, cut=one.lens_of(printed_profiles(one, face, own.design.name, process)))

        sensors |= {f"{name}, {DESIGNED}": own, f"{name}, {PRINTED}": with_face(plain)}
        if name in drawn:
            sensors[f"{name}, {DRAWN}"] = with_face(drawn[name])
    return lens_responses(sensors, progress=progress)


def _upright(sensor: Sensor) -> dict[str, object]:
    """Return the values of the same design with one profile over the entire body: the cylinder."""
    values = NO_SHAPE_KEYS | {"lens.shape": "layered", "lens.profile": None}
    return values | {"lens.layer_mm": sensor.design.body.thickness_mm}


def _of_face(sensor: Sensor, model: FacePrint, made: PrintedFace | None, u_um: dict[int, float]) -> list[Caution]:
    """Return the limits of the prediction for a face that varies with height."""
    worst = max(u_um.values())
    warnings = [
        note("each layer has the wall at its mid-height; shrinkage along the height is ignored"),
        note("the walls next to the lens are traced as designed"),
        warning(
            f"the uncertainty of the process is up to {worst:.2g} µm for the wall of a layer; the response "
            "table excludes it"
        ),
    ]
    layer_mm = sensor.design.lens.layer_mm
    printers_mm = 1e-3 * model.settings.layer_um
    if layer_mm is not None and not np.isclose(layer_mm, printers_mm):
        warnings.append(warning(f"lens.layer_mm = {layer_mm:g}, but the process prints layers of {printers_mm:g} mm"))
    last_mm = float(model.edges_mm[1] - model.edges_mm[0])
    if not np.isclose(last_mm, printers_mm):
        count = f"{sensor.design.body.thickness_mm:g} mm is {model.layers - 1} layers of {printers_mm:g} mm"
        warnings.append(warning(f"{count} and one of {last_mm:.3g} mm, which is exposed like a full layer"))
    if made is not None and worst > max(2.0 * made.rms_um, WELL_KNOWN_UM):
        warnings.append(
            do_not_use(
                f"after compensation, the face deviates by {made.rms_um:.2g} µm in the model, whose uncertainty is "
                f"{worst:.2g} µm: calibrate the process with coupons from your printer before you rely on the drawing"
            )
        )
    return warnings
