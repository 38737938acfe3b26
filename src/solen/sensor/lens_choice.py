"""Lens choice: a design compared with the cylinder, the layered and the line-focus lens.

The layered and the line-focus lens also focus skew rays, so that a small rotation redistributes more light. They need
an emitter at mid-height of the body, and their response is less linear. Each lens is therefore traced at a few angles
of the design's motion and, at one of them, also with the emitter displaced in y. The angles are fractions of the
distance from the null to the ends of the motion; for symmetric sensors on one side only.

Public names: `lens_choice` and `LensChoice`.
"""

import math
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError, SolenError
from solen.lens import LayeredLensFromFile
from solen.plane import deviation_from_line
from solen.results import Result, reported
from solen.sensor.effects import COVERAGE_FACTOR, response_at, with_deviations
from solen.sensor.response import Response
from solen.sensor.sensor import NO_SHAPE_KEYS, Sensor
from solen.spec import with_values

SHAPES = CYLINDER, LAYERED, _ = ("cartesian-oval", "layered", "line-focus")
SIXTHS, DISPLACED_SIXTH = (1, 2, 3, 6), 2
"""Angles compared, in sixths of the distance from the null to an end of the motion; angle of the displaced emitter."""
Y_DISPLACEMENT_MM, MIN_DEG = 0.1, 1e-6
MIN_GAIN = 1.1
"""Smallest gain of the signal for which another lens is worthwhile."""


class LensFigures(Result):
    """Key figures of a design with one lens.

    Attributes
    ----------
    shape
        Shape of the lens.
    angle_deg, contrast, u_contrast
        Angles (K,) and the contrast there, with its uncertainty.
    slope_per_deg, u_slope_per_deg, within_deg
        Slope of the contrast about the null, between the nearest angle on either side, and half their distance.
    received, u_received
        Mean power at both receivers over the angles, and its uncertainty.
    nonlinearity, u_nonlinearity
        Largest deviation of the contrast from the minimax straight line, relative to half the contrast range.
    off_deg, off_contrast, u_off_contrast, off_received
        Angle that was also traced with the emitter displaced in y, and the results with the displacement. Profiles from
        a file are not symmetric about the mid-plane of the body: for them, the emitter is displaced to the side with
        the smaller signal.
    given
        Whether the profiles come from a file: as printed, or compensated for printing.
    """

    shape: str
    angle_deg: FloatArray
    contrast: FloatArray
    u_contrast: FloatArray
    slope_per_deg: float
    u_slope_per_deg: float
    within_deg: float
    received: float
    u_received: float
    nonlinearity: float
    u_nonlinearity: float
    off_deg: float
    off_contrast: float
    u_off_contrast: float
    off_received: float
    given: bool = False

    @property
    def centred_contrast(self) -> tuple[float, float]:
        """Contrast and its uncertainty at the angle ``off_deg``, without displacement of the emitter."""
        index = int(np.argmin(np.abs(self.angle_deg - self.off_deg)))
        return float(self.contrast[index]), float(self.u_contrast[index])

    @property
    def off_signal(self) -> tuple[float, float]:
        """Absolute signal |R − L| with the emitter displaced, and its uncertainty."""
        return abs(self.off_contrast) * self.off_received, self.u_off_contrast * self.off_received


class LensChoice(Result):
    """A design compared with each lens.

    Attributes
    ----------
    y_off_mm
        Displacement of the emitter in y from mid-height of the body.
    own
        Shape of the design's own lens.
    lenses
        The lenses that can be made, the cylinder first.
    skipped
        Reasons why the other lenses cannot be made, keyed by shape.
    """

    y_off_mm: float
    own: str
    lenses: tuple[LensFigures, ...]
    skipped: dict[str, str]

    def of(self, shape: str) -> LensFigures | None:
        """Return the key figures of the design with one lens, or None if this lens is not compared."""
        return next((lens for lens in self.lenses if lens.shape == shape), None)

    @reported
    def gain(self) -> float | None:
        """Signal of the layered lens relative to the cylinder's, with the emitter displaced; None if one is missing."""
        return None if self._gain_and_u is None else self._gain_and_u[0]

    @reported
    def u_gain(self) -> float | None:
        """Uncertainty of the gain."""
        return None if self._gain_and_u is None else self._gain_and_u[1]

    @reported
    def layers_pay(self) -> bool | None:
        """Whether `gain` exceeds 1.1 by more than twice its uncertainty."""
        if self._gain_and_u is None:
            return None
        gain, u_gain = self._gain_and_u
        return gain - MIN_GAIN > COVERAGE_FACTOR * u_gain

    @property
    def _gain_and_u(self) -> tuple[float, float] | None:
        """Gain and its uncertainty; None if one of the two lenses is missing or gives no signal."""
        cylinder, layered = self.of(CYLINDER), self.of(LAYERED)
        if cylinder is None or layered is None:
            return None
        (base, u_base), (signal, u_signal) = cylinder.off_signal, layered.off_signal
        if not base > 0.0:
            return None
        return signal / base, (u_signal + u_base * signal / base) / base


def lens_choice(sensor: Sensor, response: Response, null_deg: float | None) -> LensChoice:
    """Compare a sensor with each possible lens.

    Parameters
    ----------
    sensor
        A design in space with a chip, with one of the three lenses.
    response
        Its response; the angles that it contains are not traced again.
    null_deg
        Its null.

    Raises
    ------
    DesignError
        If no comparison is possible, with the reason.
    """
    if why := _why_not(sensor, null_deg):
        raise DesignError("lens comparison", value=sensor.design.name, limit=f"is not possible: {why}")
    mirrored = _is_mirrored(sensor, response)
    centre_deg = 0.0 if null_deg is None or mirrored else null_deg
    ends = _ends_deg(response, centre_deg, mirrored=mirrored)
    if why := _why_not_about(ends, mirrored=mirrored):
        raise DesignError("lens comparison", value=sensor.design.name, limit=f"is not possible: {why}")
    figures: list[LensFigures] = []
    skipped: dict[str, str] = {}
    for shape in SHAPES:
        try:
            if shape == sensor.design.lens.shape:
                figures.append(_figures(sensor, centre_deg, ends, response))
            else:
                other = Sensor.of(with_values(sensor.design, NO_SHAPE_KEYS | {"lens.shape": shape}))
                figures.append(_figures(other, centre_deg, ends, None))
        except SolenError as error:
            skipped[shape] = str(error)
    return LensChoice(Y_DISPLACEMENT_MM, sensor.design.lens.shape, tuple(figures), skipped)


def _why_not(sensor: Sensor, null_deg: float | None) -> str:
    """Return the reason why no comparison is possible; empty if one is."""
    plane = sensor.design.trace.dimension != "extruded"
    cases = {
        "the rays are in the plane, where cylinder, layered and line-focus lens are all the Cartesian oval": plane,
        "the design has neither a cylinder nor a layered or line-focus lens": sensor.is_drawn
        or sensor.design.lens.shape not in SHAPES,
        "rays from a file cannot be traced through a lens for skew rays": sensor.light.ray_file is not None,
        "the emitter is a point: specify the size of its chip": not sensor.light.width_mm > 0.0,
        "the response has no null": null_deg is None,
    }
    return next((why for why, applies in cases.items() if applies), "")


def _why_not_about(ends_deg: Sequence[float], *, mirrored: bool) -> str:
    """Return the reason why the motion does not allow a comparison about the null; empty if it does."""
    if not ends_deg:
        return "the motion does not extend beyond the null"
    if len(ends_deg) == 1 and not mirrored:
        return "the motion begins or ends at the null, and the design is not symmetric: extend it to both sides"
    return ""


def _is_mirrored(sensor: Sensor, response: Response) -> bool:
    """Return whether the response is mirror-symmetric about 0, and 0 is within the motion."""
    return sensor.is_symmetric and float(response.angle_deg[0]) <= 0.0 <= float(response.angle_deg[-1])


def _ends_deg(response: Response, null_deg: float, *, mirrored: bool) -> list[float]:
    """Return the ends of the motion used for the comparison, the farther first; only one end if symmetric."""
    first, last = float(response.angle_deg[0]), float(response.angle_deg[-1])
    ends = [first] if mirrored and first < -MIN_DEG else [first, last]
    return sorted((end for end in ends if abs(end - null_deg) > MIN_DEG), key=lambda end: -abs(end - null_deg))


def _figures(sensor: Sensor, null_deg: float, ends_deg: Sequence[float], response: Response | None) -> LensFigures:
    angles = sorted(null_deg + (end - null_deg) * n / max(SIXTHS) for end in ends_deg for n in SIXTHS)
    centred = response_at(sensor, angles, response)
    off_deg = null_deg + (ends_deg[0] - null_deg) * DISPLACED_SIXTH / max(SIXTHS)
    y_mm, given = sensor.design.emitter.y_mm, isinstance(sensor.lens, LayeredLensFromFile)
    steps = (-Y_DISPLACEMENT_MM, Y_DISPLACEMENT_MM) if given else (math.copysign(Y_DISPLACEMENT_MM, y_mm),)
    responses = [response_at(with_deviations(sensor, {"emitter.y_mm": step}), [off_deg]) for step in steps]
    displaced = min(responses, key=lambda response: abs(float(response.contrast[0])) * response.received_share)
    angle, contrast, u = centred.angle_deg - null_deg, centred.contrast, centred.u_contrast
    if not (np.isfinite(contrast).all() and np.isfinite(displaced.contrast).all()):
        raise DesignError("contrast", limit="is undefined at angles at which no light arrives")
    if len(ends_deg) == 1:  # the other side is the mirror image
        angle, contrast = np.append(angle, [0.0, *-angle]), np.append(contrast, [0.0, *-contrast])
        u = np.append(u, [0.0, *u])
    order = np.argsort(angle)
    angle, contrast, u = angle[order], contrast[order], u[order]
    inner = [np.flatnonzero(angle < 0.0)[-1], np.flatnonzero(angle > 0.0)[0]]
    span, half_range = float(np.ptp(angle[inner])), 0.5 * float(np.ptp(contrast))
    if not half_range > 0.0:
        raise DesignError("contrast", value=float(contrast[0]), limit="must change over the motion")
    nonlinearity = deviation_from_line(angle, contrast) / half_range
    return LensFigures(
        shape=sensor.design.lens.shape,
        angle_deg=centred.angle_deg,
        contrast=centred.contrast,
        u_contrast=centred.u_contrast,
        slope_per_deg=float(np.diff(contrast[inner])[0]) / span,
        u_slope_per_deg=float(u[inner].sum()) / span,
        within_deg=0.5 * span,
        received=centred.received_share,
        u_received=2.0 * float(centred.u_power.max()),
        nonlinearity=nonlinearity,
        u_nonlinearity=float(u.max()) * (1.0 + nonlinearity) / half_range,
        off_deg=off_deg,
        off_contrast=float(displaced.contrast[0]),
        u_off_contrast=float(displaced.u_contrast[0]),
        off_received=displaced.received_share,
        given=given,
    )
