"""Effect of the printed lens on the response, compared with the designed lens.

Both lenses are traced with the same body, emitter and material. The difference of their responses is the effect of
printing. Its uncertainty follows from random outlines within the uncertainty of the measured profile. These
are traced with a larger tolerance than the lens itself: eight outlines determine the uncertainty to about 25 %. Light
from a point is integrated, because its response has steps; for a chip, whose response is smooth, a fan of `DRAWN_RAYS`
suffices. If the design's emitter is a point, the lenses are also compared with a chip, since the steps hide the
response of a real emitter.

Public names: `as_printed` and `AsPrinted`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.lens import MeasuredLens
from solen.progress import Progress, part_of, tracked
from solen.results import HIDDEN, Result, reported
from solen.sensor.effects import STANDARD_ERROR, response_at
from solen.sensor.practice import CHIP_MM, slope_per_deg, subsample
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.spec import with_values
from solen.trace.adaptive import is_extended

MAX_ANGLES, MAX_ANGLES_IN_SPACE = 13, 5
"""Maximum numbers of angles at which the two lenses are compared, in the plane and in space."""
DRAWS = 8
"""Number of random outlines; eight determine a standard uncertainty to about 25 %."""
DRAWN_TOLERANCE = 1e-3
"""Integration tolerance for a random outline, as a fraction of the emitted power."""
DRAWN_RAYS = 2**14
"""Number of rays from a chip through a random outline, for a contrast accuracy of about 5e-4."""


@dataclass(frozen=True)
class Difference:
    """Contrast with the printed lens minus that with the designed lens, at one angle."""

    angle_deg: float
    contrast: float
    u_contrast: float


class Comparison(Result):
    """Responses of one emitter with the designed lens and with the printed lens, at the same N angles.

    Attributes
    ----------
    width_mm
        Width of the emitter; 0 for a point.
    designed, printed
        The two responses.
    u_shape
        Standard uncertainty (N,) of the contrast with the printed lens due to its outline alone.
    null_designed_deg, null_printed_deg
        Nulls of the two responses; None if there is none.
    u_null_shift_deg
        Standard uncertainty of the distance between the nulls.
    """

    width_mm: float
    designed: Response
    printed: Response
    u_shape: FloatArray = field(metadata=HIDDEN)
    null_designed_deg: float | None
    null_printed_deg: float | None
    u_null_shift_deg: float | None

    @reported
    def difference(self) -> FloatArray:
        """Contrast (N,) with the printed lens minus that with the designed lens."""
        return self.printed.contrast - self.designed.contrast

    @reported
    def u_difference(self) -> FloatArray:
        """Standard uncertainty (N,) of `difference`, from the outline and both traces."""
        return np.sqrt(self.u_shape**2 + self.printed.u_contrast**2 + self.designed.u_contrast**2)

    @reported
    def largest(self) -> Difference | None:
        """Largest difference, or None without light."""
        size = np.abs(self.difference)
        if not np.isfinite(size).any():
            return None
        index = int(np.nanargmax(size))
        columns = (self.designed.angle_deg, self.difference, self.u_difference)
        return Difference(*(float(column[index]) for column in columns))

    @reported
    def null_shift_deg(self) -> float | None:
        """Shift of the null due to printing."""
        before, after = self.null_designed_deg, self.null_printed_deg
        return None if before is None or after is None else after - before


class AsPrinted(Result):
    """A design compared with its print.

    Attributes
    ----------
    lens
        The measured lens.
    emitter, chip
        Comparison with the design's emitter and, if that is a point, with a chip of `CHIP_MM`, otherwise None.
    draws
        Number of random outlines for the uncertainties; 0 for an exact profile.
    """

    lens: MeasuredLens = field(metadata=HIDDEN)
    emitter: Comparison
    chip: Comparison | None
    draws: int

    @reported
    def simulated(self) -> bool:
        """Whether the profile was computed rather than measured."""
        return self.lens.fit.profile.simulated

    @property
    def label(self) -> str:
        """Name in figures and sentences: ``as printed (measured)``."""
        return f"as printed ({'simulated' if self.simulated else 'measured'})"


def as_printed(
    sensor: Sensor,
    response: Response,
    designed: Response | None = None,
    progress: Progress | None = None,
    *,
    draws: int = DRAWS,
) -> AsPrinted:
    """Compare a sensor that has a measured lens with the designed sensor.

    Parameters
    ----------
    sensor
        The sensor with the measured lens.
    response, designed
        Its response in power, and that of the designed sensor if already traced.
    progress
        Function called with the completed fraction, up to 1.
    draws
        Number of random outlines within the uncertainty of the profile.

    Raises
    ------
    DesignError
        If the lens is not measured, or the body cannot be built with one of the two lenses.
    """
    if not isinstance(sensor.cut, MeasuredLens):
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit='must be "measured" for a comparison')
    draws = draws if sensor.cut.fit.profile.u_mm.any() else 0
    scene = sensor.scene(float(response.angle_deg[0]))
    sampled = scene.is_random or scene.extrusion is not None
    angles = subsample(response.angle_deg.tolist(), MAX_ANGLES_IN_SPACE if sampled else MAX_ANGLES)
    is_point = sensor.light.width_mm == 0.0 and sensor.light.ray_file is None
    parts = 2 if is_point else 1

    known = (response, designed)
    emitter = _comparison(sensor, sensor.as_designed, angles, draws, part_of(progress, 0, parts), known)
    chip = None
    if is_point:
        chip_sensors = _with_chip(sensor), _with_chip(sensor.as_designed)
        chip = _comparison(*chip_sensors, angles, draws, part_of(progress, 1, parts), (None, None))
    return AsPrinted(sensor.cut, emitter, chip, draws)


def _comparison(
    sensor: Sensor,
    designed: Sensor,
    angles: Sequence[float],
    draws: int,
    progress: Progress | None,
    responses: tuple[Response | None, Response | None],
) -> Comparison:
    lens = sensor.cut
    if not isinstance(lens, MeasuredLens):
        raise AssertionError("as_printed checks that the lens is measured")
    before, after = response_at(designed, angles, responses[1]), response_at(sensor, angles, responses[0])
    deviations = []
    for seed in tracked(range(1, draws + 1), progress):
        drawn = replace(sensor, cut=lens.with_outline(seed))
        deviations.append(_contrasts(drawn, after) - after.contrast)
    u_shape = np.sqrt(np.mean(np.square(deviations), axis=0)) if deviations else np.zeros(len(angles))
    nulls = [(full or subset).null_deg() for subset, full in zip((before, after), responses[::-1], strict=True)]
    return Comparison(
        width_mm=sensor.light.width_mm,
        designed=before,
        printed=after,
        u_shape=u_shape,
        null_designed_deg=nulls[0],
        null_printed_deg=nulls[1],
        u_null_shift_deg=_u_null(after, u_shape, nulls[1]),
    )


def _contrasts(drawn: Sensor, response: Response) -> FloatArray:
    """Return contrasts (N,) with a random outline at the angles of a response; NaN without light.

    The contrasts are integrated or sampled if the response was, and otherwise traced with a fan of rays.
    """
    angles, scene = response.angle_deg.tolist(), drawn.scene(float(response.angle_deg[0]))
    integrated = not is_extended(scene) and all(trace.method == "adaptive" for trace in response.traces)
    if integrated or scene.is_random or scene.extrusion is not None:
        return drawn.power(angles, standard_error=STANDARD_ERROR, tolerance=DRAWN_TOLERANCE).contrast
    return drawn.power_of_rays(angles, DRAWN_RAYS).contrast


def _u_null(response: Response, u_shape: FloatArray, null_deg: float | None) -> float | None:
    """Return the uncertainty of a null: the contrast uncertainty divided by the slope between neighbouring angles."""
    if null_deg is None or len(response.angle_deg) < 2:
        return None
    slope = slope_per_deg(response, null_deg)
    u = float(np.interp(null_deg, response.angle_deg, np.hypot(u_shape, response.u_contrast)))
    return abs(u / slope) if np.isfinite(slope) and slope != 0.0 and np.isfinite(u) else None


def _with_chip(sensor: Sensor) -> Sensor:
    return replace(sensor, design=with_values(sensor.design, {"emitter.width_mm": CHIP_MM}))
