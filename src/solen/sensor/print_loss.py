"""Loss of response due to printing: contrast, slope and light compared with the designed lens.

Both lenses are traced in power with the same fan of rays, so that only the lens differs. With a point emitter, unlike
with a real one, the response shows every ripple of a lens: the lenses are therefore also compared with a small chip.

Public names: `print_loss`, `PrintLoss` and `EmitterLoss`.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.lens import DesignedLens
from solen.lens.build import measured_lens
from solen.lens.profile import MeasuredProfile
from solen.progress import Progress
from solen.results import reported
from solen.sensor.practice import CHIP_MM, subsample
from solen.sensor.sensor import Sensor
from solen.spec import with_values

DEFAULT_RAYS = 2**14
MAX_ANGLES = 13
SLOPE_DEG = 0.1
"""Angles ± from 0 between which the slope is computed."""


@dataclass(frozen=True, eq=False)
class EmitterLoss:
    """Responses of one emitter with the designed and the printed lens, at the same N angles.

    Attributes
    ----------
    width_mm
        Width of the emitter; 0 for a point.
    angle_deg
        Angles (N,).
    contrast_designed, contrast_printed
        Contrast (N,); NaN without light.
    light_designed, light_printed
        Power (N,) at both receivers together, as a fraction of the emitted power.
    slope_designed_per_deg, slope_printed_per_deg
        Slope of the contrast about 0; None without light.
    """

    width_mm: float
    angle_deg: FloatArray
    contrast_designed: FloatArray
    contrast_printed: FloatArray
    light_designed: FloatArray
    light_printed: FloatArray
    slope_designed_per_deg: float | None
    slope_printed_per_deg: float | None

    @reported
    def slope_lost_percent(self) -> float | None:
        """Loss of slope in per cent; negative if the printed lens has the steeper slope."""
        return _lost_percent(self.slope_designed_per_deg, self.slope_printed_per_deg)

    @reported
    def light_lost_percent(self) -> float | None:
        """Loss of light in per cent, summed over all angles."""
        return _lost_percent(float(sum(self.light_designed)), float(sum(self.light_printed)))

    @reported
    def largest_change(self) -> float | None:
        """Largest change of the contrast, with its sign."""
        return None if self._largest_index is None else float(self._change[self._largest_index])

    @reported
    def largest_change_at_deg(self) -> float | None:
        """Angle of the largest change."""
        return None if self._largest_index is None else float(self.angle_deg[self._largest_index])

    @property
    def _change(self) -> FloatArray:
        return self.contrast_printed - self.contrast_designed

    @property
    def _largest_index(self) -> int | None:
        change = np.abs(self._change)
        return int(np.nanargmax(change)) if np.isfinite(change).any() else None


@dataclass(frozen=True, eq=False)
class PrintLoss:
    """Responses with the design's own emitter and, if that is a point, with a chip of `CHIP_MM`."""

    own: EmitterLoss
    chip: EmitterLoss | None
    rays: int = DEFAULT_RAYS

    @property
    def real(self) -> EmitterLoss:
        """Responses of the emitter of finite width: the chip, or the design's own."""
        return self.chip or self.own


def print_loss(sensor: Sensor, profile: MeasuredProfile, progress: Progress | None = None) -> PrintLoss:
    """Compare the responses of a sensor with its designed lens and with a printed profile in place of the lens.

    Raises
    ------
    DesignError
        If the lens is not the designed lens of a Y, or a body cannot be built.
    """
    sensor.check_pair()
    own = _loss(sensor, profile)
    if progress is not None:
        progress(0.75)
    if own.width_mm > 0.0:
        return PrintLoss(own, None)
    return PrintLoss(own, _loss(Sensor.of(with_values(sensor.design, {"emitter.width_mm": CHIP_MM})), profile))


def _loss(sensor: Sensor, profile: MeasuredProfile) -> EmitterLoss:
    if not isinstance(sensor.cut, DesignedLens):
        limit = "cannot be replaced by a printed profile: only a designed lens of a Y can"
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit=limit, remedy="use --no-response")
    printed = Sensor(sensor.design, sensor.material, measured_lens(sensor.cut, profile))
    angles = subsample(sensor.design.motion.angles_deg(), MAX_ANGLES)
    before, after = (lens_sensor.power_of_rays(angles, DEFAULT_RAYS) for lens_sensor in (sensor, printed))
    return EmitterLoss(
        width_mm=sensor.light.width_mm,
        angle_deg=before.angle_deg,
        contrast_designed=before.contrast,
        contrast_printed=after.contrast,
        light_designed=before.right + before.left,
        light_printed=after.right + after.left,
        slope_designed_per_deg=_slope(sensor),
        slope_printed_per_deg=_slope(printed),
    )


def _slope(sensor: Sensor) -> float | None:
    low, high = sensor.power_of_rays([-SLOPE_DEG, SLOPE_DEG], DEFAULT_RAYS).contrast
    slope = float((high - low) / (2.0 * SLOPE_DEG))
    return slope if np.isfinite(slope) else None


def _lost_percent(designed: float | None, printed: float | None) -> float | None:
    return None if not designed or printed is None else 100.0 * (1.0 - printed / designed)
