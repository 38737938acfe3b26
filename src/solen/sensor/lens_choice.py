"""Which lens: a design with the cylinder, with layers and with a line focus, beside one another.

The idea: lenses for space keep the focus for skew rays, so a small angle moves more light; they ask for an emitter in
the middle of the body's height, and their response is bent more. So each lens is traced at a few angles of the design's
motion, once as it is and at one angle with the emitter off in y. Angles are shares of the way from the null to the ends
of the motion; of a symmetric sensor on one side.

The interface: `lens_choice` of a sensor and its response, which returns a `LensChoice`.
"""

import math
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError, SolenError
from solen.plane import off_a_line
from solen.results import Result, reported
from solen.sensor.effects import off_by, swept
from solen.sensor.response import Response
from solen.sensor.sensor import OF_SPACE, Sensor
from solen.spec import with_values

SHAPES = CYLINDER, LAYERED, _ = ("cartesian-oval", "layered", "line-focus")
SIXTHS, OFF_SIXTH = (1, 2, 3, 6), 2
"""Sixths of the way from the null to an end of the motion: all that are compared, and the one with the emitter off."""
Y_OFF_MM, LEAST_DEG = 0.1, 1e-6
WORTH, RESOLVED = 1.1, 2.0
"""Gain of the signal from which on another lens pays, and how many uncertainties it must be above that of none."""


class LensFigures(Result):
    """A design with one lens.

    Attributes
    ----------
    shape
        The lens.
    angle_deg, contrast, u_contrast
        Angles (K,) and the contrast there, with its uncertainty.
    slope_per_deg, u_slope_per_deg, within_deg
        Slope of the contrast about the null, over so many degrees to each side.
    received, u_received
        Power at both receivers, mean over the angles.
    nonlinearity, u_nonlinearity
        Largest deviation of the contrast from the straight line for which it is least, as a share of half its range.
    off_deg, off_contrast, u_off_contrast, off_received
        Where it was traced with the emitter off in y as well, and what it gives there.
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

    @property
    def there(self) -> tuple[float, float]:
        """Contrast with its uncertainty, where it was traced with the emitter off as well."""
        place = int(np.argmin(np.abs(self.angle_deg - self.off_deg)))
        return float(self.contrast[place]), float(self.u_contrast[place])


class LensChoice(Result):
    """A design with one lens after the other.

    Attributes
    ----------
    y_off_mm
        How far off the emitter is in y, away from the middle of the body's height.
    own
        The design's own lens.
    lenses
        The lenses that can be made, the cylinder first.
    skipped
        Others, and why they cannot.
    """

    y_off_mm: float
    own: str
    lenses: tuple[LensFigures, ...]
    skipped: dict[str, str]

    def of(self, shape: str) -> LensFigures | None:
        """Figures of a lens."""
        return next((lens for lens in self.lenses if lens.shape == shape), None)

    @reported
    def gain(self) -> float | None:
        """Signal (R − L) of the layered lens over that of the cylinder, both with the emitter off; None without one."""
        cylinder, layered = self.of(CYLINDER), self.of(LAYERED)
        if cylinder is None or layered is None or not abs(cylinder.off_contrast * cylinder.off_received) > 0.0:
            return None
        return abs(layered.off_contrast * layered.off_received / (cylinder.off_contrast * cylinder.off_received))

    @reported
    def layers_pay(self) -> bool | None:
        """Whether the layered lens gives a tenth more signal at least even so, beyond what the uncertainties leave."""
        cylinder, layered, gain = self.of(CYLINDER), self.of(LAYERED), self.gain
        if cylinder is None or layered is None or gain is None:
            return None
        u = gain * sum(one.u_off_contrast / abs(one.off_contrast) for one in (cylinder, layered))
        return gain > WORTH and gain - 1.0 > RESOLVED * u


def lens_choice(sensor: Sensor, known: Response, null_deg: float | None) -> LensChoice:
    """A sensor with each lens that it may have.

    Parameters
    ----------
    sensor
        A design in space with a chip, with a cylinder or a lens for space.
    known
        Its response; angles of it are not traced again.
    null_deg
        Its null.

    Raises
    ------
    DesignError
        Where there is nothing to compare, with the reason.
    """
    if why := _why_not(sensor, null_deg):
        raise DesignError("comparison of lenses", value=sensor.design.name, limit=why)
    ends = _ends_deg(sensor, known, null_deg or 0.0)
    found: list[LensFigures] = []
    skipped: dict[str, str] = {}
    for shape in SHAPES:
        own = shape == sensor.design.lens.shape
        try:
            other = sensor if own else Sensor.of(with_values(sensor.design, OF_SPACE | {"lens.shape": shape}))
            found.append(_figures(other, null_deg or 0.0, ends, known if own else None))
        except SolenError as bad:
            skipped[shape] = str(bad)
    return LensChoice(Y_OFF_MM, sensor.design.lens.shape, tuple(found), skipped)


def _why_not(sensor: Sensor, null_deg: float | None) -> str:
    """Why there is nothing to compare; empty where there is."""
    plane = sensor.design.trace.dimension != "extruded"
    cases = {
        "light stays in the plane, where all of them are the Cartesian oval": plane,
        "the design has no oval of its own": sensor.is_drawn or sensor.design.lens.shape not in SHAPES,
        "a file of rays is not followed through a lens for space": sensor.light.ray_file is not None,
        "the emitter is a point: state its chip": not sensor.light.width_mm > 0.0,
        "the response has no null": null_deg is None,
    }
    return next((why for why, applies in cases.items() if applies), "")


def _ends_deg(sensor: Sensor, known: Response, null_deg: float) -> list[float]:
    """Ends of the motion to which lenses are compared: of a symmetric sensor one."""
    first, last = float(known.angle_deg[0]), float(known.angle_deg[-1])
    ends = [first] if sensor.is_symmetric and first < 0.0 else [first, last]
    return [end for end in ends if abs(end - null_deg) > LEAST_DEG]


def _figures(sensor: Sensor, null_deg: float, ends_deg: Sequence[float], known: Response | None) -> LensFigures:
    angles = sorted(null_deg + (end - null_deg) * n / max(SIXTHS) for end in ends_deg for n in SIXTHS)
    found = swept(sensor, angles, known)
    off_deg = null_deg + (ends_deg[0] - null_deg) * OFF_SIXTH / max(SIXTHS)
    y_mm = sensor.design.emitter.y_mm
    off = swept(off_by(sensor, "emitter.y_mm", math.copysign(Y_OFF_MM, y_mm)), [off_deg])
    angle, contrast, u = found.angle_deg - null_deg, found.contrast, found.u_contrast
    if not (np.isfinite(contrast).all() and np.isfinite(off.contrast).all()):
        raise DesignError("contrast", value="none", limit="no light arrives at some angle")
    if len(ends_deg) == 1:  # it is the mirror image of itself, or its motion ends at the null
        angle, contrast = np.append(angle, [0.0, *-angle]), np.append(contrast, [0.0, *-contrast])
        u = np.append(u, [0.0, *u])
    order = np.argsort(angle)
    angle, contrast, u = angle[order], contrast[order], u[order]
    inner = np.flatnonzero(np.abs(angle) <= np.abs(angle[angle != 0.0]).min() * (1.0 + 1e-9))[[0, -1]]
    span, half_range = float(np.ptp(angle[inner])), 0.5 * float(np.ptp(contrast))
    nonlinearity = off_a_line(angle, contrast) / half_range
    return LensFigures(
        shape=sensor.design.lens.shape,
        angle_deg=found.angle_deg,
        contrast=found.contrast,
        u_contrast=found.u_contrast,
        slope_per_deg=float(np.diff(contrast[inner])[0]) / span,
        u_slope_per_deg=float(u[inner].sum()) / span,
        within_deg=0.5 * span,
        received=found.received_share,
        u_received=2.0 * float(found.u_power.max()),
        nonlinearity=nonlinearity,
        u_nonlinearity=float(u.max()) * (1.0 + nonlinearity) / half_range,
        off_deg=off_deg,
        off_contrast=float(off.contrast[0]),
        u_off_contrast=float(off.u_contrast[0]),
        off_received=off.received_share,
    )
