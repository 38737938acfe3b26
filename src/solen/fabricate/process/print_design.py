"""A design as printed: the printed lens compared with the designed lens, its effect on the response, and compensation.

`print_design` predicts the lens with its uncertainty, compares it with the designed lens, and traces the response of
both. On request, it also computes a drawing that prints as designed, and models the entire printed part. It returns a
`PrintedDesign`.
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
from solen.fabricate.process.growth import uneven_um
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
_TAPER_UM = 2.0
"""Taper of the walls above which a warning is given."""
_WELL_KNOWN_UM = 3.0


def print_design(
    sensor: Sensor,
    options: PrintOptions = PrintOptions(),
    *,
    response: bool = True,
    compensate: bool = False,
    part: bool = False,
    progress: Progress | None = None,
) -> PrintedDesign:
    """Predict the print of a design.

    Parameters
    ----------
    sensor
        The sensor with its designed lens.
    options
        The process and the orientation.
    response, compensate, part
        Whether to trace the response with both lenses, compute a compensated drawing, and model the entire part.
    progress
        Called with the completed fraction, up to 1.

    Raises
    ------
    SolenError
        If the process is impossible or cannot print the lens, or if an option requires a flat part.
    """
    _check_flat(options, compensate=compensate, part=part)
    process, sources = process_of(options)
    made = _Print(sensor, with_resin(process, sensor.design), options)
    lens = made.lens(part_of(progress, 0, 2))
    prediction = PrintedDesign(
        name=sensor.design.name,
        simulated=True,
        orientation=options.orientation,
        profile_at=made.profile_at,
        process=made.process.name,
        settings=made.process.process,
        lens=lens,
        phase=made.chosen,
        deviation=lens.deviation,
        u_rms_um=_rms(lens.u_um),
        u_max_um=float(lens.u_um.max()),
        shape=_shape(lens.deviation),
        ripple=_ripple(lens, options.orientation),
        walls=made.walls,
        contributions_um=lens.contributions_um,
        response=None,
        compensation=made.compensation() if compensate else None,
        compensated_response=None,
        part=made.part() if part else None,
        sources=sources,
        warnings=(),
    )
    prediction = replace(
        prediction,
        warnings=(
            *made.process.warnings(),
            *curve_cautions(made.process, sensor.design),
            *_of_features(sensor, made.process.process),
            *_of_layers(prediction),
            *_of_response(prediction),
            *_of_compensation(prediction),
        ),
    )
    return _with_response(prediction, sensor, progress) if response else prediction


@dataclass(frozen=True, eq=False)
class _Print:
    """A sensor, the process that prints it, and the print options."""

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
    def chosen(self) -> Phase | None:
        """Best position in the pixel, if requested."""
        if not self.options.choose_phase:
            return None
        return best_phase(self.rings, self.target, self.process.process, self.thickness_mm, self.height_um)

    @property
    def phase_px(self) -> tuple[float, float] | None:
        """Position of the lens in its pixel; None if not specified."""
        return self.options.phase_px if self.chosen is None else self.chosen.phase_px

    @property
    def thickness_mm(self) -> float:
        return self.sensor.design.body.thickness_mm

    @property
    def layers(self) -> int:
        """Number of layers of a part that lies flat."""
        return max(1, round(1e3 * self.thickness_mm / self.process.process.layer_um))

    @cached_property
    def height_um(self) -> float | None:
        """Height of the profile; None for the mean."""
        thickness_um = self.layers * self.process.process.layer_um
        at = self.options.at
        if at in ("mean", "middle"):
            return None if at == "mean" else 0.5 * thickness_um
        try:
            height_um = 1e3 * float(at)
        except ValueError:
            height_um = -1.0
        if not 0.0 <= height_um <= thickness_um:
            limit = f"must be middle, mean, or a height in mm from 0 to {1e-3 * thickness_um:g}"
            raise SpecError("--at", value=at, limit=limit)
        return height_um

    @property
    def profile_at(self) -> str:
        if self.options.orientation != "flat":
            return "the entire thickness: the profile is constant along it"
        if self.height_um is None:
            return "mean over the thickness"
        return f"{1e-3 * self.height_um:g} mm above the platform, mean over its layer"

    @property
    def walls(self) -> Walls | None:
        flat = self.options.orientation == "flat"
        return Walls(*walls_um(self.process.process, self.layers)) if flat else None

    def lens(self, progress: Progress | None) -> Prediction:
        orientation, height_um = self.options.orientation, self.height_um
        return predicted(
            self.rings,
            self.target,
            self.process,
            self.thickness_mm,
            orientation,
            height_um,
            progress,
            phase=self.phase_px,
        )

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
        label = replace(label, name=f"simulated print of {label.name}")  # an STL only stores the name
        designed_mm3 = area_mm2(body.outlines) * self.thickness_mm
        return PrintedPart(mesh, label, mesh.volume_mm3, designed_mm3, len(mesh.triangles), len(slabs))


def _check_flat(options: PrintOptions, *, compensate: bool, part: bool) -> None:
    """Raise `SpecError` if an option for flat parts is combined with another orientation."""
    if options.choose_phase and options.phase_px is not None:
        raise SpecError(
            "--phase-px",
            value=options.phase_px,
            limit="cannot be combined with --choose-phase",
            remedy="omit one of these options",
        )
    if options.orientation == "flat":
        return
    if options.at != "middle":
        raise SpecError("--at", value=options.at, limit="applies to parts printed flat", remedy="omit it")
    phase = options.choose_phase or options.phase_px is not None
    for asked, option in ((compensate, "--compensate"), (part, "--solid"), (phase, "--phase-px or --choose-phase")):
        if asked:
            limit = f"{option} applies to parts printed flat"
            raise SpecError("--orientation", value=options.orientation, limit=limit, remedy="print it flat")


def _with_response(prediction: PrintedDesign, sensor: Sensor, progress: Progress | None) -> PrintedDesign:
    try:
        response = print_loss(sensor, prediction.profile, progress)
        compensated = prediction.compensated_profile
        again = None if compensated is None else print_loss(sensor, compensated)
        return replace(prediction, response=response, compensated_response=again)
    except SolenError as bad:
        return replace(prediction, warnings=(*prediction.warnings, warning(f"no response: {bad}")))


def _shape(deviation: Deviation) -> Shape:
    shift, left = deviation.shifted
    return Shape(shift, left.rms_um, left.largest_um)


def _ripple(lens: Prediction, orientation: Orientation) -> Ripple:
    if orientation == "flat":
        return Ripple("thickness", lens.ripple_through_um, None)
    low, high = np.percentile(lens.ripple_um, _CENTRAL_95_PERCENTILES)
    return Ripple("profile", float(high - low), _rms(lens.ripple_um))


def _of_features(sensor: Sensor, settings: Settings) -> list[Caution]:
    """Warn of bumps and bends of a free-form lens that are too fine for the process."""
    if not isinstance(sensor.cut, SplineLens):
        return []
    fine = sensor.cut.fine_feature_warnings(
        settings.min_feature_um, "the finest feature that the process prints to 90 %"
    )
    return [warning(text) for text in fine]


def _of_layers(prediction: PrintedDesign) -> list[Caution]:
    """Warn of effects of layers on the lens that the profile ignores."""
    walls = prediction.walls
    if walls is None:
        return [
            warning(
                f"the layer steps, {prediction.ripple.rms_um:.2g} µm root mean square along the profile, "
                "scatter light; the traced profile omits them"
            )
        ]
    first, middle, last = walls.first_um, walls.middle_um, walls.last_um
    if max(first, middle, last) - min(first, last) < _TAPER_UM:
        return []
    return [
        warning(
            f"walls are {first:+.3g} µm beyond their image at the first layer, {middle:+.3g} µm at mid-height and "
            f"{last:+.3g} µm at the last layer: the lens shape differs for light at another height"
        )
    ]


def _of_response(prediction: PrintedDesign) -> list[Caution]:
    """Warn if an asymmetric response moves walls by different amounts, because walls next to the lens use the mean."""
    least, most = uneven_um(prediction.settings)
    if prediction.walls is None or most - least < _TAPER_UM:
        return []
    return [
        warning(
            f"the response is not symmetric: walls are {least:+.3g} to {most:+.3g} µm beyond their image, depending on "
            "the side they face; the lens includes this, but other walls use the mean of all sides"
        )
    ]


def _of_compensation(prediction: PrintedDesign) -> list[Caution]:
    """Warn if a compensated drawing is limited by the uncertainty of the process."""
    u_um = prediction.u_rms_um
    if prediction.compensation is None or u_um < max(2.0 * prediction.compensation.printed.rms_um, _WELL_KNOWN_UM):
        return []
    return [
        do_not_use(
            f"after compensation, the lens deviates by {prediction.compensation.printed.rms_um:.2g} µm in the model, "
            f"whose uncertainty is {u_um:.2g} µm: calibrate the process with coupons from your printer before you rely "
            "on the drawing"
        )
    ]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
