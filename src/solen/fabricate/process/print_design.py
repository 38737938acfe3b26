"""A design as printed: the printed lens compared with the designed lens, its effect on the response, and compensation.

`print_design` computes the printed lens with its uncertainty, compares it with the designed lens, and traces the
response of both. Optionally, it also computes a drawing that prints as designed, and the entire printed part. It
returns a `PrintedDesign`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.fabricate.label import label_of
from solen.fabricate.process.compensate import Compensation, Printing, compensated
from solen.fabricate.process.drawing import as_designed, lens_face, rings_of
from solen.fabricate.process.flat import walls_um
from solen.fabricate.process.growth import growth_range_um
from solen.fabricate.process.predict import Orientation, Phase, Prediction, best_phase, points_for, predicted
from solen.fabricate.process.printed_design import PrintedDesign, PrintedPart, Ripple, Shape, Walls
from solen.fabricate.process.process_file import Process
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.solid import printed_solid
from solen.fabricate.process.source import PrintOptions, curve_cautions, process_of, with_resin
from solen.fabricate.process.target import Deviation, Target
from solen.geometry.measures import area_mm2
from solen.lens import SplineLens
from solen.progress import Progress, part_of
from solen.ranks import Caution, do_not_use, warning
from solen.sensor import Sensor
from solen.sensor.print_loss import print_loss

_CENTRAL_95_PERCENTILES = (2.5, 97.5)
_MAX_TAPER_UM = 2.0
"""Maximum variation of the growth of walls without a warning."""
_MAX_U_UM = 3.0
"""Maximum uncertainty of a compensated lens without a warning."""


def print_design(
    sensor: Sensor,
    options: PrintOptions = PrintOptions(),
    *,
    response: bool = True,
    compensate: bool = False,
    part: bool = False,
    progress: Progress | None = None,
) -> PrintedDesign:
    """Return the predicted print of a design.

    Parameters
    ----------
    sensor
        The sensor with its designed lens.
    options
        The process and the orientation.
    response, compensate, part
        Whether to trace the response with both lenses, to compute a compensated drawing, and to model the entire part.
    progress
        Called with the completed fraction, up to 1.

    Raises
    ------
    SolenError
        If the process is invalid or cannot print the lens, or an option requires a part printed flat.
    """
    _check_flat(options, compensate=compensate, part=part)
    process, sources = process_of(options)
    model = _PrintModel(sensor, with_resin(process, sensor.design), options)
    lens = model.lens(part_of(progress, 0, 2))
    prediction = PrintedDesign(
        name=sensor.design.name,
        simulated=True,
        orientation=options.orientation,
        profile_at=model.profile_at,
        process=model.process.name,
        settings=model.process.process,
        lens=lens,
        phase=model.best_phase,
        deviation=lens.deviation,
        u_rms_um=_rms(lens.u_um),
        u_max_um=float(lens.u_um.max()),
        shape=_shape(lens.deviation),
        ripple=_ripple(lens, options.orientation),
        walls=model.walls,
        contributions_um=lens.contributions_um,
        response=None,
        compensation=model.compensation() if compensate else None,
        compensated_response=None,
        part=model.part() if part else None,
        sources=sources,
        warnings=(),
    )
    prediction = replace(
        prediction,
        warnings=(
            *model.process.warnings(),
            *curve_cautions(model.process, sensor.design),
            *_feature_warnings(sensor, model.process.process),
            *_layer_warnings(prediction),
            *_asymmetry_warnings(prediction),
            *_compensation_warnings(prediction),
        ),
    )
    return _with_response(prediction, sensor, progress) if response else prediction


@dataclass(frozen=True, eq=False)
class _PrintModel:
    """A sensor, the process that prints it, and the options."""

    sensor: Sensor
    process: Process
    options: PrintOptions

    @cached_property
    def target(self) -> Target:
        return Target.of(lens_face(self.sensor.body().prism()).curve, points_for(self.options.orientation))

    @cached_property
    def rings(self) -> list[FloatArray]:
        return rings_of(as_designed(self.sensor.body().prism()))

    @cached_property
    def best_phase(self) -> Phase | None:
        """Best position in the pixel; None unless it is to be chosen."""
        if not self.options.choose_phase:
            return None
        return best_phase(self.rings, self.target, self.process.process, self.thickness_mm, self.height_um)

    @property
    def phase_px(self) -> tuple[float, float] | None:
        """Position of the lens in its pixel; None if not specified."""
        return self.options.phase_px if self.best_phase is None else self.best_phase.phase_px

    @property
    def thickness_mm(self) -> float:
        return self.sensor.design.body.thickness_mm

    @property
    def layers(self) -> int:
        """Number of layers of the part printed flat."""
        return max(1, round(1e3 * self.thickness_mm / self.process.process.layer_um))

    @cached_property
    def height_um(self) -> float | None:
        """Height of the profile; None for the mean."""
        thickness_um = self.layers * self.process.process.layer_um
        option = self.options.at
        if option in ("mean", "middle"):
            return None if option == "mean" else 0.5 * thickness_um
        try:
            height_um = 1e3 * float(option)
        except ValueError:
            height_um = -1.0
        if not 0.0 <= height_um <= thickness_um:
            limit = f"must be middle, mean, or a height in mm from 0 to {1e-3 * thickness_um:g}"
            raise SpecError("--at", value=option, limit=limit)
        return height_um

    @property
    def profile_at(self) -> str:
        if self.options.orientation != "flat":
            return "all heights, because the profile is constant along the thickness"
        if self.height_um is None:
            return "mean over the thickness"
        return f"{1e-3 * self.height_um:g} mm above the plate, mean over its layer"

    @property
    def walls(self) -> Walls | None:
        is_flat = self.options.orientation == "flat"
        return Walls(*walls_um(self.process.process, self.layers)) if is_flat else None

    def lens(self, progress: Progress | None) -> Prediction:
        part = (self.rings, self.target, self.process, self.thickness_mm)
        return predicted(*part, self.options.orientation, self.height_um, progress, phase=self.phase_px)

    def compensation(self) -> Compensation:
        settings, phase = self.process.process, self.phase_px or (0.0, 0.0)
        body = self.sensor.body().prism()
        return compensated(Printing(body, self.target, settings, self.thickness_mm, self.height_um, phase))

    def part(self) -> PrintedPart:
        design, body = self.sensor.design, self.sensor.body().prism()
        centre = self.target.centre
        phase = self.phase_px or (0.0, 0.0)
        mesh, slabs = printed_solid(self.rings, self.process.process, self.thickness_mm, centre, design.name, phase)
        label = label_of(design, f"simulated: as printed by the model, {self.process.name}")
        label = replace(label, name=f"simulated print of {label.name}")  # the only part of the label in an STL
        designed_mm3 = area_mm2(body.outlines) * self.thickness_mm
        return PrintedPart(mesh, label, mesh.volume_mm3, designed_mm3, len(mesh.triangles), len(slabs))


def _check_flat(options: PrintOptions, *, compensate: bool, part: bool) -> None:
    """Raise `SpecError` if an option contradicts another one, or requires a part printed flat."""
    if options.choose_phase and options.phase_px is not None:
        limit = "cannot be combined with --choose-phase"
        raise SpecError("--phase-px", value=options.phase_px, limit=limit, remedy="omit one of them")
    if options.orientation == "flat":
        return
    if options.at != "middle":
        limit = "applies only to parts printed flat"
        raise SpecError("--at", value=options.at, limit=limit, remedy="omit --at")
    phase = options.choose_phase or options.phase_px is not None
    for is_set, option in ((compensate, "--compensate"), (part, "--solid"), (phase, "--phase-px or --choose-phase")):
        if is_set:
            limit = f"must be flat with {option}"
            raise SpecError("--orientation", value=options.orientation, limit=limit, remedy=f"omit {option}")


def _with_response(prediction: PrintedDesign, sensor: Sensor, progress: Progress | None) -> PrintedDesign:
    try:
        response = print_loss(sensor, prediction.profile, progress)
        compensated = prediction.compensated_profile
        compensated_response = None if compensated is None else print_loss(sensor, compensated)
        return replace(prediction, response=response, compensated_response=compensated_response)
    except SolenError as error:
        text = f"the response was not traced: {error}"
        return replace(prediction, warnings=(*prediction.warnings, warning(text)))


def _shape(deviation: Deviation) -> Shape:
    shift, form_error = deviation.shifted
    return Shape(shift, form_error.rms_um, form_error.largest_um)


def _ripple(lens: Prediction, orientation: Orientation) -> Ripple:
    if orientation == "flat":
        return Ripple("thickness", lens.ripple_through_um, None)
    low, high = np.percentile(lens.ripple_um, _CENTRAL_95_PERCENTILES)
    return Ripple("profile", float(high - low), _rms(lens.ripple_um))


def _feature_warnings(sensor: Sensor, settings: Settings) -> list[Caution]:
    """Warn of features of a free-form lens that are too fine for the process."""
    if not isinstance(sensor.cut, SplineLens):
        return []
    limit = "the width of a bump that prints with 90 % of its height"
    return [warning(text) for text in sensor.cut.fine_feature_warnings(settings.min_feature_um, limit)]


def _layer_warnings(prediction: PrintedDesign) -> list[Caution]:
    """Warn of effects of layers that the profile of the lens does not contain."""
    walls = prediction.walls
    if walls is None:
        steps = f"layer steps of {prediction.ripple.rms_um:.2g} µm RMS along the profile scatter light"
        return [warning(f"{steps}; the traced profile does not contain them")]
    first, middle, last = walls.first_um, walls.middle_um, walls.last_um
    if max(first, middle, last) - min(first, last) < _MAX_TAPER_UM:
        return []
    growth = f"{first:+.3g} µm at the first layer, {middle:+.3g} µm at mid-height and {last:+.3g} µm at the last layer"
    return [warning(f"walls grow beyond their image by {growth}: the shape of the lens depends on the height")]


def _asymmetry_warnings(prediction: PrintedDesign) -> list[Caution]:
    """Warn if an asymmetric pixel response makes the growth of walls depend on their direction."""
    low, high = growth_range_um(prediction.settings)
    if prediction.walls is None or high - low < _MAX_TAPER_UM:
        return []
    growth = f"walls grow beyond their image by {low:+.3g} to {high:+.3g} µm, depending on the direction they face"
    text = f"the pixel response is not symmetric: {growth}"
    return [warning(f"{text}; this is included for the lens, but other walls have the mean of all directions")]


def _compensation_warnings(prediction: PrintedDesign) -> list[Caution]:
    """Warn if the uncertainty of the process exceeds the error that compensation leaves."""
    u_um = prediction.u_rms_um
    if prediction.compensation is None or u_um < max(2.0 * prediction.compensation.printed.rms_um, _MAX_U_UM):
        return []
    rms_um = prediction.compensation.printed.rms_um
    text = f"the compensated lens deviates by {rms_um:.2g} µm in the model, whose uncertainty is {u_um:.2g} µm"
    return [do_not_use(f"{text}: before you use the drawing, calibrate the process with coupons from your printer")]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
