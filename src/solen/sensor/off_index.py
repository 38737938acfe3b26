"""What an index that is off does to the response: the chip in a material of n − u and of n + u, the lens as it is cut.

The idea: what a designer must know is how far the curve moves, and not how far the focus does. Where the index carries
a standard uncertainty u, that is the step; where it carries none, a step of `INDEX_STEP` is a comparison. The change is
largest where the response is steep, so it is looked at near the balance point first, and then more closely about the
angle of the largest change found. A response that is the same on both sides is traced on one.

The interface: `off_indices` of a sensor and what is known of its response, which returns an `OffIndex` for each step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solen.material import Optical, Tabulated
from solen.parts import Light
from solen.sensor.response import Response, Shift, shift
from solen.sensor.sensor import Sensor

INDEX_STEP = 0.01
"""How far off an index can easily be: a reflectance good to 0.001 gives it to 0.008."""
NEAR_DEG = 1.0
"""Angle at which an index that is off is looked at, beside the ends."""
STANDARD_ERROR = 1e-3
"""To what standard error of a receiver's power rays in space and scattered light are sampled here."""
REACHES = (0.0, 1 / 6, 1 / 3, 1.0)
"""Where it is looked at first, as shares of the way from the balance point to an end."""
SAME_SIDES = 3.0
"""How many times its uncertainty the sum of the contrasts at two opposite angles may be where both sides are the same.
"""

Angles = Sequence[float]


@dataclass(frozen=True)
class OffIndex:
    """Response with the chip where the material's index is off by ``step`` and the lens stays as it is cut.

    Attributes
    ----------
    step, index
        By how much, and what it then is.
    known
        Whether the step is the standard uncertainty of the index.
    response, base
        Response there, and of the design with the same chip at the same angles. Where both sides of the design are the
        same, only angles up to 0 are among them.
    shift
        How far the first lies from the second at most; None without light.
    """

    step: float
    index: float
    known: bool
    response: Response
    base: Response
    shift: Shift | None


def off_indices(sensor: Sensor, known: Response, beside: Angles = ()) -> tuple[OffIndex, ...]:
    """Responses with the index off by its standard uncertainty, or by `INDEX_STEP` where it carries none.

    Parameters
    ----------
    sensor
        The sensor with its chip.
    known
        What is known of its response in power.
    beside
        Angles to look at in any case.
    """
    taken = [(step, stated) for step, stated in steps(sensor.material) if step != 0.0]
    others = [replace(sensor, material=_off(sensor.material, step, sensor.light)) for step, _ in taken]
    angles = _first_angles(known, beside)
    base, found = swept(sensor, angles, known), [swept(other, angles) for other in others]
    angles = sorted({*angles, *_about_the_largest(base, found)})
    base = swept(sensor, angles, base.joined(known))
    found = [swept(other, angles, one) for other, one in zip(others, found, strict=True)]
    return tuple(
        OffIndex(step, other.material.index, stated, one, base, shift(one, base))
        for (step, stated), other, one in zip(taken, others, found, strict=True)
    )


def steps(material: Optical) -> list[tuple[float, bool]]:
    """How far an index is taken to be off: lower, not at all, higher; whether by its standard uncertainty."""
    stated = bool(material.u_index)
    size = material.u_index or INDEX_STEP
    return [(step, stated and step != 0.0) for step in (-size, 0.0, size) if material.index + step >= 1.0]


def swept(sensor: Sensor, angles: Angles, known: Response | None = None) -> Response:
    """Response at angles; what is known of it is not traced again."""
    if known is None:
        return sensor.power(angles, standard_error=STANDARD_ERROR)
    there = set(known.angle_deg.tolist())
    old = known.part([known.at(angle) for angle in angles if angle in there])
    missing = [angle for angle in angles if angle not in there]
    return old.joined(sensor.power(missing, standard_error=STANDARD_ERROR)) if missing else old


def _first_angles(known: Response, beside: Angles) -> Angles:
    """Angles near the balance point and at the ends, of those that are known; on one side where both are the same."""
    there = known.angle_deg.tolist()
    null = known.null_deg()
    middle = (there[0] + there[-1]) / 2 if null is None else null
    chosen = {*beside}
    for end in (there[0], there[-1]):
        chosen |= {there[known.at(middle + share * (end - middle))] for share in REACHES}
    one_side = _is_the_same_on_both_sides(known)
    return sorted(angle for angle in chosen if angle <= 0.0 or not one_side)


def _is_the_same_on_both_sides(known: Response) -> bool:
    """Whether each angle's contrast is the opposite of the opposite angle's, as far as it is known."""
    other = known.part(range(len(known.angle_deg))[::-1])
    if len(known.angle_deg) < 3 or not np.array_equal(known.angle_deg, -other.angle_deg):
        return False
    u = SAME_SIDES * (known.u_contrast + other.u_contrast)
    return bool(np.all(np.abs(known.contrast + other.contrast) <= u))


def _about_the_largest(base: Response, found: Sequence[Response]) -> Angles:
    """Angles halfway from that of the largest change to its neighbours."""
    changes = [one for one in (shift(response, base) for response in found) if one is not None]
    if not changes:
        return []
    angles = base.angle_deg.tolist()
    place = base.at(max(changes, key=lambda one: one.contrast).angle_deg)
    return [(angles[place] + angles[i]) / 2 for i in (place - 1, place + 1) if 0 <= i < len(angles)]


def _off(material: Optical, step: float, light: Light) -> Optical:
    """The material with its index off by a step, at all wavelengths of a light."""
    dispersion = material.dispersion
    if dispersion is None or not light.spectrum:
        return replace(material, index=material.index + step, dispersion=None)
    lines = sorted({light.wavelength_nm, *(nm for nm, _ in light.spectrum)})
    values = [dispersion.index(nm) + step for nm in lines]
    if len(lines) == 1:
        lines, values = [*lines, lines[0] + 1.0], [*values, values[0]]
    moved = Tabulated(kind="table", wavelength_nm=tuple(lines), n=tuple(values))
    return replace(material, index=material.index + step, dispersion=moved)
