"""A design over its motion: response by counting and in power, with and without its lens, compared with variants."""

import math
from dataclasses import dataclass, field, replace

import solen
from solen.errors import DesignError
from solen.lens import Lens
from solen.material import Optical
from solen.progress import Progress, part_of
from solen.results import HIDDEN, Result, reported
from solen.sensor.as_printed import AsPrinted, as_printed
from solen.sensor.check import BodySizes, Focus, body_sizes, foci_of
from solen.sensor.practice import Practice, practice
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design
from solen.trace import Slope

SCHEMA = 1
"""Schema version of the result files."""
FLAT_TOLERANCE = 5e-4
"""Integration tolerance in space without the lens."""


@dataclass(frozen=True)
class Summary:
    """Key figures of a case, from its integrated power.

    Attributes
    ----------
    from_deg, to_deg
        First and last angle.
    contrast_from, u_contrast_from, contrast_to, u_contrast_to
        Contrast there, None if no light arrives, and its uncertainty.
    null_deg, u_null_deg, slope_per_deg, u_slope_per_deg
        Null nearest to 0 and slope of the contrast there, with their uncertainties.
    saturation_deg
        Distance from the null at which the contrast saturates.
    received_share
        Mean power at both receivers over the angles.
    u_power
        Largest uncertainty of a power.
    ledger_error
        Largest deviation of the ledger's sum from 1.
    truncated
        Largest truncated power at any angle.
    undefined_rays
        Number of rays that met an inconsistent interface.
    rays_traced
        Number of rays traced for the count and for the power.
    """

    from_deg: float
    to_deg: float
    contrast_from: float | None
    u_contrast_from: float | None
    contrast_to: float | None
    u_contrast_to: float | None
    null_deg: float | None
    u_null_deg: float | None
    slope_per_deg: float | None
    u_slope_per_deg: float | None
    saturation_deg: float | None
    received_share: float
    u_power: float
    ledger_error: float
    truncated: float
    undefined_rays: int
    rays_traced: int


class Case(Result):
    """Response of one sensor.

    Attributes
    ----------
    sensor
        The sensor; not in JSON.
    count
        Response by counting the design's rays, as in the paper; None in space.
    power
        Response in power.
    curve
        The response in power with angles added where it is curved; not in JSON.
    null_deg, u_null_deg, slope_per_deg, u_slope_per_deg
        Null nearest to 0 and slope of the contrast there, in power, with their uncertainties.
    """

    sensor: Sensor = field(metadata=HIDDEN)
    count: Response | None
    power: Response
    curve: Response = field(metadata=HIDDEN)
    null_deg: float | None
    u_null_deg: float | None
    slope_per_deg: float | None
    u_slope_per_deg: float | None

    @property
    def summary(self) -> Summary:
        """Key figures of the case."""
        power = self.power
        first, last = float(power.angle_deg[0]), float(power.angle_deg[-1])
        return Summary(
            from_deg=first,
            to_deg=last,
            contrast_from=power.contrast_at(first),
            u_contrast_from=_finite(float(power.u_contrast[0])),
            contrast_to=power.contrast_at(last),
            u_contrast_to=_finite(float(power.u_contrast[-1])),
            null_deg=self.null_deg,
            u_null_deg=self.u_null_deg,
            slope_per_deg=self.slope_per_deg,
            u_slope_per_deg=self.u_slope_per_deg,
            saturation_deg=self.curve.saturation_deg(),
            received_share=power.received_share,
            u_power=float(power.u_power.max()),
            ledger_error=max(abs(trace.ledger.total - 1.0) for trace in power.traces),
            truncated=max(trace.ledger.truncated for trace in power.traces),
            undefined_rays=sum(trace.undefined for trace in power.traces),
            rays_traced=int(power.rays.sum() + (0 if self.count is None else self.count.rays.sum())),
        )


class DesignStudy(Result):
    """A design over the angles of its motion, with and without its lens.

    Attributes
    ----------
    design
        The design studied; in result files, as in its TOML with defaults omitted.
    with_lens
        Case with the lens; None for a design without a lens.
    no_lens, no_lens_refused
        Case without the lens; None with the reason if it cannot be built.
    practice
        The design as built and its variants, if requested.
    designed, as_printed
        For a measured lens: the case with the designed lens, and the differences.
    """

    design: Design
    with_lens: Case | None = field(metadata=HIDDEN)
    no_lens: Case | None = field(metadata=HIDDEN)
    no_lens_refused: str | None = None
    practice: Practice | None = None
    designed: Case | None = field(default=None, metadata=HIDDEN)
    as_printed: AsPrinted | None = None

    @property
    def case(self) -> Case:
        """The design's own case."""
        case = self.with_lens or self.no_lens
        if case is None:
            raise AssertionError("every study has a case")
        return case

    @property
    def cases(self) -> dict[str, Case]:
        """Cases keyed by name: ``lens``, ``designed``, ``no_lens``."""
        cases = {"lens": self.with_lens, "designed": self.designed, "no_lens": self.no_lens}
        return {name: case for name, case in cases.items() if case is not None}

    @property
    def sensor(self) -> Sensor:
        """The design's own sensor."""
        return self.case.sensor

    @reported
    def schema(self) -> int:
        """Version of the schema of these results."""
        return SCHEMA

    @reported
    def solen(self) -> str:
        """Version of solen."""
        return solen.__version__

    @reported
    def simulated(self) -> bool:
        """Always true: no sensor was measured."""
        return True

    @reported
    def name(self) -> str:
        """Name of the design."""
        return self.design.name

    @reported
    def wavelength_nm(self) -> float:
        """Wavelength of the emitter."""
        return self.sensor.light.wavelength_nm

    @reported
    def material(self) -> Optical:
        """Index and absorption of the material at the wavelength of the emitter."""
        return self.sensor.material

    @reported
    def lens(self) -> Lens | None:
        """The lens; None for a drawn body."""
        return self.sensor.cut

    @reported
    def foci(self) -> tuple[Focus, ...]:
        """Foci of the lens at several indices of the material."""
        return foci_of(self.sensor)

    @reported
    def body(self) -> BodySizes:
        """Sizes of the body at rest."""
        return body_sizes(self.sensor)

    @reported
    def summary(self) -> dict[str, Summary]:
        """Key figures of each case."""
        return {name: case.summary for name, case in self.cases.items()}

    @reported
    def response(self) -> dict[str, Case]:
        """Responses of each case."""
        return self.cases

    @reported
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the results."""
        return (
            *self.sensor.warnings,
            *keys_without_effect(self.sensor),
            *(() if self.practice is None else self.practice.warnings),
        )


def study(design: Design, progress: Progress | None = None, *, practical: bool = False) -> DesignStudy:
    """Return the response of a design over its motion, with and without its lens, by counting and in power.

    All bodies of the motion are built before the first ray is traced, so that an impossible motion is rejected at once.
    ``progress`` is called with the completed fraction, up to 1. ``practical`` adds the variants of
    `solen.sensor.practice`, and the comparison of a measured lens with the designed one.
    """
    if not practical:
        return _study(design, progress)
    parts = 7 if design.lens.shape == "measured" else 5
    result = _with_designed_lens(_study(design, part_of(progress, 0, parts, 3)), part_of(progress, 3, parts, 2))
    rest, case = part_of(progress, parts - 2, parts, 2), result.case
    known = case.slope_per_deg is not None and case.u_slope_per_deg is not None
    slope = Slope(case.slope_per_deg or 0.0, case.u_slope_per_deg or 0.0) if known else None
    return replace(result, practice=practice(case.sensor, case.power, rest, slope=slope))


def _with_designed_lens(plain: DesignStudy, progress: Progress | None) -> DesignStudy:
    """Return the study with the comparison of a measured lens with the designed one, if the lens is measured."""
    lens = plain.with_lens
    if lens is None or not lens.sensor.is_measured:
        return plain
    lens.sensor.as_designed.check()
    designed = _case(lens.sensor.as_designed, None)
    return replace(plain, designed=designed, as_printed=as_printed(lens.sensor, lens.power, designed.power, progress))


def _study(design: Design, progress: Progress | None) -> DesignStudy:
    sensor = Sensor.of(design)
    sensor.check_pair()
    sensor.check()
    if not sensor.has_lens:
        return DesignStudy(design, None, _case(sensor, progress))
    without_lens, reason = _comparison(sensor)
    if without_lens is None:
        return DesignStudy(design, _case(sensor, progress), None, reason)
    return DesignStudy(
        design,
        _case(sensor, part_of(progress, 0, 2)),
        _case(without_lens, part_of(progress, 1, 2), FLAT_TOLERANCE if _in_space(design) else None),
    )


def _comparison(sensor: Sensor) -> tuple[Sensor | None, str | None]:
    """Return the sensor without its lens, or the reason why it cannot be built."""
    if sensor.is_drawn:
        return None, "the body is drawn together with its lens"
    try:
        sensor.without_lens.check()
    except DesignError as error:
        return None, str(error)
    return sensor.without_lens, None


def _case(sensor: Sensor, progress: Progress | None, tolerance: float | None = None) -> Case:
    counted = None if _in_space(sensor.design) else sensor.count(progress=part_of(progress, 0, 10))
    power = sensor.power(progress=part_of(progress, 1, 10, 8), tolerance=tolerance)
    curve = sensor.refined(power, tolerance)
    null = curve.null_deg()
    slope = None if null is None else sensor.slope_per_deg(null, tolerance)
    if null is not None and slope is not None:
        null, u_null = _null(sensor, null, slope)
    if progress is not None:
        progress(1.0)
    case = Case(sensor, counted, power, curve, null, None, None, None)
    if slope is None:
        return case
    return replace(case, u_null_deg=u_null, slope_per_deg=slope.value, u_slope_per_deg=slope.u_value)


def _null(sensor: Sensor, null_deg: float, slope: Slope) -> tuple[float, float]:
    """Return the null, refined from its interpolated value by one Newton step, and its uncertainty."""
    if sensor.is_symmetric and null_deg == 0.0:
        return 0.0, 0.0
    at_null = sensor.power([null_deg])
    step = -float(at_null.contrast[0]) / slope.value
    return null_deg + step, abs(float(at_null.u_contrast[0]) / slope.value) + abs(step * slope.u_value / slope.value)


def _in_space(design: Design) -> bool:
    return design.trace.dimension == "extruded"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
