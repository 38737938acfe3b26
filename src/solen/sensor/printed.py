"""What a lens as it was printed does to the response, beside the one that was asked for.

The idea: the same body, emitter and material with two lenses. What lies between their responses is what printing did;
how well that is known follows from outlines drawn within the uncertainty of the measured profile. These are traced at
some of the angles, and less closely than the lens itself: eight outlines tell an uncertainty to a quarter. Light of a
point is integrated, as it jumps; of a chip, whose light is smooth, a fan of `DRAWN_RAYS` is enough. Beside the design's
own emitter a chip is compared, where the design states none: the step of a point hides what a real one shows.

The interface: `printed` of a sensor with a measured lens, which returns a `Printed`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray, Progress
from solen.errors import DesignError
from solen.lens import MeasuredLens
from solen.sensor.off_index import STANDARD_ERROR, swept
from solen.sensor.practice import CHIP_MM, slope_per_deg, spread
from solen.sensor.response import Response, contrast, powers
from solen.sensor.sensor import Sensor
from solen.spec import with_values
from solen.trace.adaptive import is_extended

MOST_ANGLES, MOST_SAMPLED_ANGLES = 13, 5
"""Angles at most at which the two are compared: integrated, and sampled as in space."""
DRAWS = 8
"""Outlines drawn within the uncertainty; a standard uncertainty is known to a quarter by so many."""
DRAWN_TOLERANCE = 1e-4
"""Within what fraction of the emitted power light of a point through a drawn outline is integrated."""
DRAWN_RAYS = 2**14
"""Rays of a chip through a drawn outline: a contrast is known to some 5e-4 by them."""


@dataclass(frozen=True)
class Comparison:
    """Responses of one emitter with the designed lens and with the printed one, at the same N angles.

    Attributes
    ----------
    width_mm
        Width of the emitter; 0 for a point.
    designed, printed
        The two responses.
    u_shape
        (N,) standard uncertainty of the printed one's contrast by that of its outline alone.
    null_deg
        Balance points of both, None where there is none.
    u_null_deg
        Standard uncertainty of the printed one's.
    """

    width_mm: float
    designed: Response
    printed: Response
    u_shape: FloatArray
    null_deg: tuple[float | None, float | None]
    u_null_deg: float | None

    @property
    def difference(self) -> FloatArray:
        """(N,) contrast of the printed one less that of the designed one."""
        return self.printed.contrast - self.designed.contrast

    @property
    def u_difference(self) -> FloatArray:
        """(N,) standard uncertainty of `difference`: of the outline, and of both traces."""
        return np.sqrt(self.u_shape**2 + self.printed.u_contrast**2 + self.designed.u_contrast**2)

    @property
    def largest(self) -> int | None:
        """Place of the largest difference; None without light."""
        size = np.abs(self.difference)
        return int(np.nanargmax(size)) if np.isfinite(size).any() else None

    @property
    def null_shift_deg(self) -> float | None:
        """How far the balance point has moved."""
        before, after = self.null_deg
        return None if before is None or after is None else after - before

    @property
    def received(self) -> tuple[float, float]:
        """Light at both receivers, mean over the angles: designed, printed."""
        before, after = (float((one.right + one.left).mean()) for one in (self.designed, self.printed))
        return before, after


@dataclass(frozen=True)
class Printed:
    """A design beside itself as printed.

    ``own`` is with the design's emitter; ``chip`` with one of `CHIP_MM` where that is a point, else None. ``draws`` is
    the number of outlines that the uncertainties come from, 0 where the profile is exact.
    """

    lens: MeasuredLens
    own: Comparison
    chip: Comparison | None
    draws: int

    @property
    def simulated(self) -> bool:
        """Whether the profile was computed."""
        return self.lens.fit.profile.simulated

    @property
    def told(self) -> str:
        """What it is, in words: ``as printed (measured)``."""
        return f"as printed ({'simulated' if self.simulated else 'measured'})"


def printed(
    sensor: Sensor,
    own: Response,
    designed: Response | None = None,
    progress: Progress | None = None,
    *,
    draws: int = DRAWS,
) -> Printed:
    """Compare a sensor whose lens was measured with the one that was designed.

    Parameters
    ----------
    sensor
        The sensor with the measured lens.
    own, designed
        Its response in power, and that of the design where it is known.
    progress
        Called with the share done, up to 1.
    draws
        Outlines to draw within the uncertainty of the profile.

    Raises
    ------
    DesignError
        Where the lens is not a measured one, or the body cannot be built with one of the two.
    """
    if not isinstance(sensor.cut, MeasuredLens):
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit='must be "measured" for a comparison')
    draws = draws if sensor.cut.fit.profile.u_mm.any() else 0
    scene = sensor.scene(float(own.angle_deg[0]))
    sampled = scene.is_random or scene.extrusion is not None
    angles = spread(own.angle_deg.tolist(), MOST_SAMPLED_ANGLES if sampled else MOST_ANGLES)
    is_point = sensor.light.width_mm == 0.0 and sensor.light.ray_file is None
    parts = 2 if is_point else 1

    def told(first: int) -> Progress | None:
        return None if progress is None else lambda done: progress((first + done) / parts)

    mine = _comparison(sensor, sensor.as_designed, angles, draws, told(0), (own, designed))
    chip = None
    if is_point:
        wide, wide_designed = _with_chip(sensor), _with_chip(sensor.as_designed)
        chip = _comparison(wide, wide_designed, angles, draws, told(1), (None, None))
    return Printed(sensor.cut, mine, chip, draws)


def _comparison(
    sensor: Sensor,
    designed: Sensor,
    angles: Sequence[float],
    draws: int,
    progress: Progress | None,
    known: tuple[Response | None, Response | None],
) -> Comparison:
    lens = sensor.cut
    if not isinstance(lens, MeasuredLens):
        raise AssertionError("checked before")
    before, after = swept(designed, angles, known[1]), swept(sensor, angles, known[0])
    away = []
    for number in range(1, draws + 1):
        drawn = replace(sensor, cut=lens.drawn_within(number))
        away.append(_contrasts(drawn, after) - after.contrast)
        if progress is not None:
            progress(number / draws)
    u_shape = np.sqrt(np.mean(np.square(away), axis=0)) if away else np.zeros(len(angles))
    nulls = tuple((known_one or one).null_deg() for one, known_one in zip((before, after), known[::-1], strict=True))
    return Comparison(
        width_mm=sensor.light.width_mm,
        designed=before,
        printed=after,
        u_shape=u_shape,
        null_deg=(nulls[0], nulls[1]),
        u_null_deg=_u_null(after, u_shape, nulls[1]),
    )


def _contrasts(drawn: Sensor, found: Response) -> FloatArray:
    """Contrasts (N,) with a drawn outline at the angles of a response; NaN where no light arrives.

    Where that was integrated for a point, or sampled, so are these; else a fan tells them.
    """
    angles, scene = found.angle_deg.tolist(), drawn.scene(float(found.angle_deg[0]))
    integrated = not is_extended(scene) and all(trace.method == "adaptive" for trace in found.traces)
    if integrated or scene.is_random or scene.extrusion is not None:
        return drawn.power(angles, standard_error=STANDARD_ERROR, tolerance=DRAWN_TOLERANCE).contrast
    readings = [powers(drawn.trace(angle, "power", DRAWN_RAYS)) for angle in angles]
    values = [contrast(one["right"], one["left"]) for one in readings]
    return np.array([np.nan if value is None else value for value in values])


def _u_null(response: Response, u_shape: FloatArray, null_deg: float | None) -> float | None:
    """Uncertainty of a balance point: that of the contrast there by its slope between the angles beside it."""
    if null_deg is None or len(response.angle_deg) < 2:
        return None
    slope = slope_per_deg(response, null_deg)
    u = float(np.interp(null_deg, response.angle_deg, np.hypot(u_shape, response.u_contrast)))
    return abs(u / slope) if np.isfinite(slope) and slope != 0.0 and np.isfinite(u) else None


def _with_chip(sensor: Sensor) -> Sensor:
    return replace(sensor, design=with_values(sensor.design, {"emitter.width_mm": CHIP_MM}))
