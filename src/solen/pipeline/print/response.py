"""The response of a sensor with the lens that was designed beside the same with the one that is printed.

Both are traced by power with the same fan of rays, so that what differs is the lens. Whether any response is lost is
told as the contrast at each angle, its slope about the balance point, and the light that the receivers get. A point
emitter shows every ripple of a lens, and none is a point: beside it a small chip is compared.
"""

from collections.abc import Sequence
from typing import Any

from solen.arrays import Progress
from solen.errors import DesignError, SolenError
from solen.lens import OvalLens
from solen.lens.build import measured_lens
from solen.lens.measured import MeasuredProfile
from solen.sensor import Sensor
from solen.sensor.practice import CHIP_MM
from solen.sensor.response import contrast, powers
from solen.spec import with_values

RAYS = 2**14
MOST_ANGLES = 13
SLOPE_DEG = 0.1
"""Angle to either side of 0 over which the slope about the balance is taken."""


def response(
    sensor: Sensor, profile: MeasuredProfile, progress: Progress | None = None
) -> tuple[dict[str, Any] | None, list[str]]:
    """Contrast by angle of the designed and the printed lens; or None, and why there is none."""
    try:
        sensor.check_pair()
        width_mm = sensor.light.width_mm
        found = _compared(sensor, with_profile(sensor, profile))
        if progress is not None:
            progress(0.75)
        chip = None
        if width_mm == 0.0:
            wide = Sensor.of(with_values(sensor.design, {"emitter.width_mm": CHIP_MM}))
            chip = {"width_mm": CHIP_MM, **_compared(wide, with_profile(wide, profile))}
        return {"width_mm": width_mm, **found, "chip": chip}, []
    except SolenError as bad:
        return None, [f"no response: {bad}"]


def with_profile(sensor: Sensor, profile: MeasuredProfile) -> Sensor:
    """The same sensor with a profile for its lens; `DesignError` where it has no oval to hold it against."""
    if not isinstance(sensor.cut, OvalLens):
        limit = "a printed profile is traced in place of a Cartesian oval of a Y"
        raise DesignError("lens", value=sensor.design.lens.shape, limit=limit, remedy="leave the response out")
    return Sensor(sensor.design, sensor.material, measured_lens(sensor.cut, profile))


def _compared(designed: Sensor, printed: Sensor) -> dict[str, Any]:
    angles = [*_some(designed.design.motion.angles_deg()), -SLOPE_DEG, SLOPE_DEG]
    found: dict[str, list[tuple[float, float]]] = {}
    for name, one in (("designed", designed), ("printed", printed)):
        read = [powers(one.trace(angle, "power", RAYS)) for angle in angles]
        found[name] = [(reading["right"], reading["left"]) for reading in read]
    contrasts = {name: [contrast(*pair) for pair in pairs] for name, pairs in found.items()}
    light = {name: [right + left for right, left in pairs] for name, pairs in found.items()}
    slopes = {name: _slope(values[-2], values[-1]) for name, values in contrasts.items()}
    return {
        "rays": RAYS,
        "angle_deg": angles[:-2],
        "contrast": {name: values[:-2] for name, values in contrasts.items()},
        "light": {name: values[:-2] for name, values in light.items()},
        "slope_per_deg": slopes,
        "slope_lost_percent": _lost(slopes["designed"], slopes["printed"]),
        "light_lost_percent": _lost(sum(light["designed"][:-2]), sum(light["printed"][:-2])),
        "largest_change": _largest(angles[:-2], contrasts),
    }


def _some(angles_deg: Sequence[float]) -> list[float]:
    """At most `MOST_ANGLES` of the angles, evenly, first and last among them."""
    count = min(MOST_ANGLES, len(angles_deg))
    places = {round(i * (len(angles_deg) - 1) / max(count - 1, 1)) for i in range(count)}
    return [angles_deg[place] for place in sorted(places)]


def _slope(before: float | None, behind: float | None) -> float | None:
    return None if before is None or behind is None else (behind - before) / (2.0 * SLOPE_DEG)


def _lost(designed: float | None, printed: float | None) -> float | None:
    """Share in percent that is less; below 0 where there is more."""
    return None if not designed or printed is None else 100.0 * (1.0 - printed / designed)


def _largest(angles: list[float], contrasts: dict[str, list[float | None]]) -> dict[str, float] | None:
    pairs = zip(angles, contrasts["designed"], contrasts["printed"], strict=False)
    changes = [(angle, there - here) for angle, here, there in pairs if here is not None and there is not None]
    if not changes:
        return None
    angle, change = max(changes, key=lambda one: abs(one[1]))
    return {"angle_deg": angle, "contrast": change}
