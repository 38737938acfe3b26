"""Options of a search for a straighter response: goals, conditions, and free parameters.

Public name: `straightness_options`.
"""

import math

from solen.explore.optimise.options import OptimiseOptions
from solen.sensor import Sensor, why_inert
from solen.sensor.numbers import number
from solen.spec import Design

KEYS = ("lens.focus_mm", "lens.half_width_mm", "emitter.distance_mm", "body.arm_width_mm", "body.stem_length_mm")
"""Parameters that change the curvature of a response and can be chosen freely for a print."""
RANGE_FRACTION = 0.25
"""Largest change of each parameter in either direction, as a fraction of its value."""
KNOT_RANGE_UM = 40.0
"""Largest change in the height of the knots of a free form, in either direction."""
GOALS = {"minimise": ("linearity_percent",), "maximise": ("abs(slope_per_deg)",)}
CONDITIONS = ("light >= 0.9*base", "range_deg >= 0.95*base")
"""Conditions that exclude a response that is straight because it has hardly any signal."""


def straightness_options(design: Design) -> OptimiseOptions:
    """Return options of a search for a front of straight and steep responses that retain light and range.

    The free parameters are those of `KEYS` that affect the light, and the knots of a free form.
    """
    sensor = Sensor.of(design)
    free = [_around(key, number(sensor, key)) for key in KEYS if not why_inert(sensor, key)]
    if sensor.has_lens and design.lens.shape == "spline" and not sensor.is_measured:
        knots = enumerate(design.lens.knots_um or ())
        free += [f"lens.knots_um[{k}]={value - KNOT_RANGE_UM:g}:{value + KNOT_RANGE_UM:g}" for k, value in knots]
    return OptimiseOptions(**GOALS, subject_to=CONDITIONS, free=tuple(free))


def _around(key: str, value: float) -> str:
    low, high = sorted((value * (1.0 - RANGE_FRACTION), value * (1.0 + RANGE_FRACTION)))
    return f"{key}={_length_text(low)}:{_length_text(high)}"


def _length_text(value: float) -> str:
    """Format a length with three significant digits, without an exponent."""
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}" if value else "0"
