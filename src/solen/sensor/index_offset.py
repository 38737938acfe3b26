"""Response in a material of another index, the lens as it is cut: n − u and n + u, with the chip.

The idea: a designer must know how far the curve moves, not how far the focus does. Where the index has a standard
uncertainty u, that is the step; where it has none, `INDEX_STEP` is. The change is largest where the response is steep,
so angles near the null are traced first, then angles about the largest change found. A symmetric response is traced on
one side.

The interface: `index_offsets` of a sensor and its known response, which returns an `IndexOffset` for each step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.material import Optical, Tabulated
from solen.parts import Light
from solen.results import HIDDEN, Result, reported
from solen.sensor.response import Response, Shift, shift
from solen.sensor.sensor import Sensor

INDEX_STEP = 0.01
"""A usual error of an index: a reflectance good to 0.001 gives it to 0.008."""
NEAR_DEG = 1.0
"""Angle at which the response is compared, beside the ends."""
STANDARD_ERROR = 1e-3
"""To what standard error of a receiver's power rays in space and scattered light are sampled here."""
REACHES = (0.0, 1 / 6, 1 / 3, 1.0)
"""Where it is compared first, as shares of the way from the null to an end."""
SYMMETRIC = 3.0
"""How many times its uncertainty the sum of the contrasts at opposite angles may be in a symmetric response."""

Angles = Sequence[float]


@dataclass(frozen=True, eq=False, repr=False)
class IndexOffset(Result):
    """Response with the chip where the material's index is off by ``step`` and the lens stays as it is cut.

    Attributes
    ----------
    step, index
        Offset of the index, and the index with it.
    by_uncertainty
        Whether the step is the standard uncertainty of the index.
    response, base
        Response with the offset, and of the design with the same chip at the same angles; of a symmetric design at
        angles up to 0 alone.
    shift
        Largest change of the contrast; None without light.
    """

    step: float
    index: float
    by_uncertainty: bool
    response: Response
    base: Response = field(metadata=HIDDEN)
    shift: Shift | None

    @reported
    def change(self) -> FloatArray:
        """Change of the contrast at each angle."""
        return self.response.contrast - self.base.contrast


def index_offsets(sensor: Sensor, known: Response, beside: Angles = ()) -> tuple[IndexOffset, ...]:
    """Responses with the index off by its standard uncertainty, or by `INDEX_STEP` where it has none.

    Parameters
    ----------
    sensor
        The sensor with its chip.
    known
        Its response in power, as far as it is known.
    beside
        Angles to trace in any case.
    """
    taken = [(step, stated) for step, stated in steps(sensor.material) if step != 0.0]
    others = [replace(sensor, material=_offset(sensor.material, step, sensor.light)) for step, _ in taken]
    angles = _first_angles(known, beside)
    base, responses = swept(sensor, angles, known), [swept(other, angles) for other in others]
    angles = sorted({*angles, *_about_the_largest(base, responses)})
    base = swept(sensor, angles, base.joined(known))
    responses = [swept(other, angles, response) for other, response in zip(others, responses, strict=True)]
    return tuple(
        IndexOffset(step, other.material.index, stated, response, base, shift(response, base))
        for (step, stated), other, response in zip(taken, others, responses, strict=True)
    )


def steps(material: Optical) -> list[tuple[float, bool]]:
    """Offsets of an index: lower, none, higher; and whether they are its standard uncertainty."""
    stated = bool(material.u_index)
    size = material.u_index or INDEX_STEP
    return [(step, stated and step != 0.0) for step in (-size, 0.0, size) if material.index + step >= 1.0]


def swept(sensor: Sensor, angles: Angles, known: Response | None = None) -> Response:
    """Response at angles; those of a known response are not traced again."""
    if known is None:
        return sensor.power(angles, standard_error=STANDARD_ERROR)
    there = set(known.angle_deg.tolist())
    old = known.part([known.at(angle) for angle in angles if angle in there])
    missing = [angle for angle in angles if angle not in there]
    return old.joined(sensor.power(missing, standard_error=STANDARD_ERROR)) if missing else old


def _first_angles(known: Response, beside: Angles) -> Angles:
    """Known angles near the null and at the ends; on one side of a symmetric response."""
    there = known.angle_deg.tolist()
    null = known.null_deg()
    middle = (there[0] + there[-1]) / 2 if null is None else null
    chosen = {*beside}
    for end in (there[0], there[-1]):
        chosen |= {there[known.at(middle + share * (end - middle))] for share in REACHES}
    one_side = _is_symmetric(known)
    return sorted(angle for angle in chosen if angle <= 0.0 or not one_side)


def _is_symmetric(known: Response) -> bool:
    """Whether each angle's contrast is the opposite of the opposite angle's, as far as it is known."""
    other = known.part(range(len(known.angle_deg))[::-1])
    if len(known.angle_deg) < 3 or not np.array_equal(known.angle_deg, -other.angle_deg):
        return False
    u = SYMMETRIC * (known.u_contrast + other.u_contrast)
    return bool(np.all(np.abs(known.contrast + other.contrast) <= u))


def _about_the_largest(base: Response, responses: Sequence[Response]) -> Angles:
    """Angles halfway from that of the largest change to its neighbours."""
    changes = [change for response in responses if (change := shift(response, base)) is not None]
    if not changes:
        return []
    angles = base.angle_deg.tolist()
    place = base.at(max(changes, key=lambda change: change.contrast).angle_deg)
    return [(angles[place] + angles[i]) / 2 for i in (place - 1, place + 1) if 0 <= i < len(angles)]


def _offset(material: Optical, step: float, light: Light) -> Optical:
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
