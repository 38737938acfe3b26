"""Options of a search for a user who only wants a straighter response: goals, conditions, and free numbers.

Public name: `straightness_options`.
"""

import math

from solen.explore.optimise.options import OptimiseOptions
from solen.sensor import Sensor, why_inert
from solen.sensor.numbers import number
from solen.spec import Design

KEYS = ("lens.focus_mm", "lens.half_width_mm", "emitter.distance_mm", "body.arm_width_mm", "body.stem_length_mm")
"""Numbers that change the curvature of a response and can be chosen freely for a print."""
SHARE = 0.25
"""Largest change of each number to either side, as a fraction of it."""
KNOTS_UM = 40.0
"""Largest change in the height of a free form's knots to either side of the design."""
GOALS = {"minimise": ("linearity_percent",), "maximise": ("abs(slope_per_deg)",)}
CONDITIONS = ("light >= 0.9*base", "range_deg >= 0.95*base")
"""Conditions that exclude a response without signal, which would be straight too."""


def straightness_options(design: Design) -> OptimiseOptions:
    """Return options of a search for a front of straight and steep responses that retain light and range.

    The free numbers are those of `KEYS` that affect the design's light, and the knots of a free form.
    """
    sensor = Sensor.of(design)
    free = [_around(key, number(sensor, key)) for key in KEYS if not why_inert(sensor, key)]
    if sensor.has_lens and design.lens.shape == "spline" and not sensor.is_measured:
        knots = enumerate(design.lens.knots_um or ())
        free += [f"lens.knots_um[{place}]={value - KNOTS_UM:g}:{value + KNOTS_UM:g}" for place, value in knots]
    return OptimiseOptions(**GOALS, subject_to=CONDITIONS, free=tuple(free))


def _around(key: str, value: float) -> str:
    low, high = sorted((value * (1.0 - SHARE), value * (1.0 + SHARE)))
    return f"{key}={_short(low)}:{_short(high)}"


def _short(value: float) -> str:
    """Format a length with its significant digits."""
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}" if value else "0"
