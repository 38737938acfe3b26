"""Parameters of the coupons, and the readings of what their source leaves open or prints twice in two ways.

The source is the Methods section of the paper on 3D-printed soft optical sensors with a lens. Four of its statements
cannot be printed as they stand; each is a choice here, and the default is explained in the coupon's `Reading`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args, get_type_hints

from solen.errors import SpecError
from solen.spec.strict import nearest

HoleReading = Literal["repeats", "even", "tenths"]
StepReading = Literal["halving", "literal"]
ReferenceReading = Literal["literal", "staircase"]
GapReading = Literal["pairs", "row"]

MAY_BE_ZERO = {"bevel_mm", "burn_in_layers"}
LARGEST = 1e6
MOST = {"cubes": 100, "burn_in_layers": 1000}


@dataclass(frozen=True)
class Choices:
    """Parameters of all coupons; checked as they are made.

    Attributes
    ----------
    hole_reading
        Eight holes "1.40–1.65 mm (steps of 0.1 mm)": ``repeats`` takes steps of 0.05 mm with the first and the last
        size twice, ``even`` eight even steps over the span, ``tenths`` steps of 0.1 mm from 1.40 mm on.
    step_reading
        Group C "heights 0.2 mm - 0.5 mm (0.5 mm steps) … (0.25 steps)": ``halving`` takes steps of 0.05 and 0.025 mm,
        ``literal`` those that are printed, of which the range holds one height each.
    reference_reading
        Pillars of "1.000 mm, 1.025 mm, and 0.025 mm": ``literal``, or ``staircase`` with 1.050 mm as the third.
    gap_reading
        Twelve gaps between cylinders: as separate ``pairs``, or in one ``row`` of thirteen.
    spacing_mm
        Free distance of features that are to stand alone.
    bevel_mm
        Legs of the bevelled corner that orients a slab; 0 leaves it out.
    marks
        Whether slabs with pillars carry three round marks by which an image is oriented.
    layer_um
        Layer thickness, for heights told in layers and for the single layer.
    pitch_um
        Pixel of the printer; where given, the middles of all features lie on its corners, so that all are drawn alike.
    exposure_s, burn_in_layers, burn_in_s, irradiance_mW_per_cm2
        Exposure of the layers, and of the first ones.
    disc_exposures_s
        Exposures of the cure discs, in the order of printing.
    film_mm, film_side_mm
        Thickness of the film under the single layer, and side of the layer.
    cubes, cube_mm
        Number and side of the compression cubes.
    guide_lengths_mm, guide_width_mm, guide_height_mm
        Guides for the cut-back.
    """

    hole_reading: HoleReading = "repeats"
    step_reading: StepReading = "halving"
    reference_reading: ReferenceReading = "literal"
    gap_reading: GapReading = "pairs"
    spacing_mm: float = 1.0
    bevel_mm: float = 0.6
    marks: bool = True
    layer_um: float = 25.0
    pitch_um: float | None = None
    exposure_s: float = 2.0
    burn_in_layers: int = 6
    burn_in_s: float = 3.0
    irradiance_mW_per_cm2: float = 13.0
    disc_exposures_s: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    film_mm: float = 0.1
    film_side_mm: float = 20.0
    cubes: int = 5
    cube_mm: float = 10.0
    guide_lengths_mm: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
    guide_width_mm: float = 3.0
    guide_height_mm: float = 3.0

    def __post_init__(self) -> None:
        hints = get_type_hints(type(self))
        for one in fields(self):
            value = getattr(self, one.name)
            _check_one(one.name, value, get_args(hints[one.name]), zero=one.name in MAY_BE_ZERO)
        for name in ("disc_exposures_s", "guide_lengths_mm"):
            if not getattr(self, name):
                raise SpecError(name, value="none", limit="needs one number at least")


def chosen(values: Mapping[str, object]) -> Choices:
    """Choices with some values set, by name, as TOML would hold them.

    Raises
    ------
    SpecError
        Where a name is unknown, or a value is of another kind or out of range.
    """
    usual = Choices()
    known = {one.name: getattr(usual, one.name) for one in fields(Choices)}
    for name in values:
        if name not in known:
            near = nearest(name, known)
            raise SpecError(name, limit="unknown parameter of coupons", remedy=f"did you mean {near}?" if near else "")
    return replace(usual, **{name: _like(name, known[name], value) for name, value in values.items()})


def _like(name: str, usual: object, value: object) -> Any:
    """A value as its parameter holds it; a list becomes a tuple, a whole number one with a point."""
    if isinstance(usual, tuple):
        numbers = value if isinstance(value, list | tuple) else [value]
        return tuple(_number(name, one) for one in numbers)
    if isinstance(usual, bool):
        if not isinstance(value, bool):
            raise SpecError(name, value=value, limit="must be true or false")
        return value
    if isinstance(usual, str):
        return str(value)
    if isinstance(usual, int):
        if isinstance(value, bool) or not isinstance(value, int):
            raise SpecError(name, value=value, limit="must be a whole number")
        return value
    return None if value is None else _number(name, value)


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SpecError(name, value=value, limit="must be a number")
    return float(value)


def _check_one(what: str, value: object, choices: tuple[object, ...], *, zero: bool) -> None:
    """`SpecError` for a number that is not positive and finite, or a word that is none of its choices."""
    if isinstance(value, str) and value not in choices:
        raise SpecError(what, value=value, limit=f"must be one of {', '.join(map(str, choices))}")
    numbers = value if isinstance(value, tuple) else (value,)
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, int | float):
            continue
        if not (math.isfinite(number) and (number > 0 or (zero and number == 0)) and number <= LARGEST):
            least = "at least 0" if zero else "above 0"
            raise SpecError(what, value=number, limit=f"must be {least} and at most {LARGEST:g}")
    if what in MOST and isinstance(value, int) and value > MOST[what]:
        raise SpecError(what, value=value, limit=f"must be at most {MOST[what]}")
