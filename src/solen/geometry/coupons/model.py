"""A coupon: features with nominal positions and sizes on a slab, and the interpretation of the source.

A coupon lies on the build plate and is viewed from above, with x to the right, y up and the origin at the centre;
heights are measured from the plate. A `Feature` is a round or rectangular column or hole; a `Gap` is the free distance
between two columns, a `Step` the height difference between two columns. A `Stage` is one print run; most coupons have a
single one. A `Reading` is the interpretation of a statement of the source that is ambiguous or contradictory.

All these classes are frozen dataclasses of plain numbers; `solen.fabricate` makes solids from them, and
`solen.metrology` matches measurements to them.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Any, ClassVar, Literal

from pydantic import ConfigDict, TypeAdapter, ValidationError

from solen.errors import DataError, SpecError
from solen.spec.strict import option_refusal

Kind = Literal["pillar", "hole", "mark", "disc", "layer", "cube", "guide", "ledge"]
MAX_SIZE_MM = 1e3
TOUCH_MM = 1e-6
"""Features closer than this touch."""


class _FileTable:
    """An object in a coupon file; unknown keys are rejected."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


@dataclass(frozen=True)
class Feature(_FileTable):
    """A column or a hole of nominal size.

    Attributes
    ----------
    name
        Name, unique within its coupon: ``d-0.30``.
    kind
        Kind of feature; a ``mark`` orients an image and is not evaluated.
    x_mm, y_mm
        Position of the centre.
    width_mm, depth_mm
        Extent along x and y; both equal the diameter of a round feature.
    from_mm, to_mm
        Heights above the plate, or above the zero of the stage; for a hole, heights of the faces of the material.
    round
        Whether the feature is a circle rather than a rectangle.
    bevel_mm
        Legs of the bevel at the rear right corner (+x, +y) of a rectangle; 0 for none.
    stage
        Name of the run in which it is printed.
    exposure_s
        Exposure time, if different from that of the layers.
    grey
        Grey level of its pixels as a fraction of the full level; None for the full level.
    """

    name: str
    kind: Kind
    x_mm: float
    y_mm: float
    width_mm: float
    depth_mm: float
    from_mm: float
    to_mm: float
    round: bool = True
    bevel_mm: float = 0.0
    stage: str = ""
    exposure_s: float | None = None
    grey: float | None = None

    @property
    def height_mm(self) -> float:
        """Height of a column, or depth of a hole."""
        return self.to_mm - self.from_mm

    @property
    def is_stacked(self) -> bool:
        """Whether the feature is a layer of a bar, on top of another layer."""
        return self.kind == "ledge" and self.from_mm > 0.0

    @property
    def diameter_mm(self) -> float:
        """Diameter of a round feature; width of any other."""
        return self.width_mm

    def must_clear(self, other: "Feature") -> bool:
        """Return whether two features must not overlap as seen from above; layers of a bar at different heights may."""
        if self.kind != "ledge" or other.kind != "ledge":
            return True
        return self.from_mm < other.to_mm - TOUCH_MM and other.from_mm < self.to_mm - TOUCH_MM

    def distance_mm(self, other: "Feature") -> float:
        """Return the free distance to another feature as seen from above; negative if they overlap.

        The distance is exact for two circles; next to a rectangle, a circle is treated as its bounding square.
        """
        dx, dy = abs(self.x_mm - other.x_mm), abs(self.y_mm - other.y_mm)
        if self.round and other.round:
            return math.hypot(dx, dy) - 0.5 * (self.width_mm + other.width_mm)
        free_x, free_y = dx - 0.5 * (self.width_mm + other.width_mm), dy - 0.5 * (self.depth_mm + other.depth_mm)
        if free_x > 0.0 and free_y > 0.0:
            return math.hypot(free_x, free_y)
        return max(free_x, free_y)


@dataclass(frozen=True)
class Gap(_FileTable):
    """Free distance between two columns, given by their names."""

    name: str
    between: tuple[str, str]
    gap_mm: float


@dataclass(frozen=True)
class Step(_FileTable):
    """Height difference between two neighbouring columns, the lower one first, given by their names."""

    name: str
    between: tuple[str, str]
    step_mm: float


@dataclass(frozen=True)
class Slab(_FileTable):
    """Rectangular base centred on the origin, from the plate upwards, with a chamfered rear right corner (+x, +y)."""

    width_mm: float
    depth_mm: float
    thickness_mm: float
    bevel_mm: float = 0.0


@dataclass(frozen=True)
class Stage(_FileTable):
    """One print run.

    ``z_offset_mm`` is the additional distance between the build platform and the floor of the vat at the first layer;
    ``note`` describes the preparation of the run.
    """

    name: str = ""
    z_offset_mm: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Reading(_FileTable):
    """A statement of the source (``printed``) and its interpretation (``taken``)."""

    about: str
    printed: str
    taken: str


@dataclass(frozen=True)
class Coupon(_FileTable):
    """A part to be printed and measured; it is checked when it is created.

    Attributes
    ----------
    name, title
        Name, such as ``group-a``, and a description.
    features
        Columns and holes.
    slab
        The base that carries or contains the features; None for separate parts.
    gaps, steps
        Gaps and steps between the features.
    stages
        Print runs.
    readings
        Interpretations of the source.
    cautions
        Instructions and warnings for printing and measuring the coupon.

    Raises
    ------
    SpecError
        If a size is not above 0, a feature extends beyond the slab, or two features overlap.
    """

    name: str
    title: str
    features: tuple[Feature, ...]
    slab: Slab | None = None
    gaps: tuple[Gap, ...] = ()
    steps: tuple[Step, ...] = ()
    stages: tuple[Stage, ...] = (Stage(),)
    readings: tuple[Reading, ...] = ()
    cautions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.features:
            raise SpecError(f"coupon {self.name}", limit="has no features, but requires at least one")
        if self.slab is not None:
            _check_sizes(f"{self.name} slab", self.slab.width_mm, self.slab.depth_mm, self.slab.thickness_mm)
            if not 0.0 <= self.slab.bevel_mm < min(self.slab.width_mm, self.slab.depth_mm):
                raise SpecError(
                    f"{self.name} bevel_mm",
                    value=self.slab.bevel_mm,
                    limit="must be smaller than the sides of the slab",
                )
        for feature in self.features:
            self._check(feature)
        name, count = Counter(feature.name for feature in self.features).most_common(1)[0]
        if count > 1:
            limit = f"{count} features are named {name}"
            raise SpecError(f"coupon {self.name}", limit=limit, remedy="specify each size only once")
        for first, second in combinations(self.features, 2):
            if first.stage == second.stage and first.must_clear(second) and first.distance_mm(second) < TOUCH_MM:
                limit = f"{first.name} and {second.name} overlap"
                raise SpecError(f"coupon {self.name}", limit=limit, remedy="increase their distance")

    def _check(self, feature: Feature) -> None:
        subject = f"{self.name} {feature.name}"
        _check_sizes(subject, feature.width_mm, feature.depth_mm, feature.height_mm)
        if not (math.isfinite(feature.x_mm) and math.isfinite(feature.y_mm)):
            limit = f"is at {feature.x_mm}, {feature.y_mm} mm, but its position must be finite"
            raise SpecError(subject, limit=limit)
        if feature.exposure_s is not None and not 0.0 < feature.exposure_s < math.inf:
            raise SpecError(f"{subject} exposure_s", value=feature.exposure_s, limit="must be above 0")
        if feature.grey is not None and not 0.0 < feature.grey <= 1.0:
            raise SpecError(f"{subject} grey", value=feature.grey, limit="must be above 0 and at most 1")
        if self.slab is None:
            return
        excess_x = abs(feature.x_mm) + 0.5 * feature.width_mm - 0.5 * self.slab.width_mm
        excess_y = abs(feature.y_mm) + 0.5 * feature.depth_mm - 0.5 * self.slab.depth_mm
        if max(excess_x, excess_y) > -TOUCH_MM:
            size = f"{self.slab.width_mm:g} x {self.slab.depth_mm:g} mm"
            raise SpecError(subject, limit=f"does not fit on the slab of {size}", remedy="reduce its size")

    def feature(self, name: str) -> Feature:
        """Return the feature with a given name; raise `KeyError` if there is none."""
        return {feature.name: feature for feature in self.features}[name]

    def of_kind(self, kind: Kind) -> tuple[Feature, ...]:
        """Return the features of a kind."""
        return tuple(feature for feature in self.features if feature.kind == kind)

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Extent along x and y, and the maximum height within a stage."""
        if self.slab is not None:
            width, depth = self.slab.width_mm, self.slab.depth_mm
        else:
            width = 2.0 * max(abs(feature.x_mm) + 0.5 * feature.width_mm for feature in self.features)
            depth = 2.0 * max(abs(feature.y_mm) + 0.5 * feature.depth_mm for feature in self.features)
        return width, depth, max(feature.to_mm for feature in self.features)

    @property
    def measured_kinds(self) -> tuple[str, ...]:
        """Kinds that an image or a height map can show: some of ``pillar``, ``hole``, ``gap`` and ``step``."""
        kinds = [kind for kind in ("pillar", "hole") if any(feature.kind == kind for feature in self.features)]
        return (*kinds, *(["gap"] if self.gaps else []), *(["step"] if self.steps else []))


def _check_sizes(what: str, *sizes_mm: float) -> None:
    for size in sizes_mm:
        if not 0.0 < size <= MAX_SIZE_MM:
            limit = f"must be above 0 and at most {MAX_SIZE_MM:g} mm"
            raise SpecError(f"{what} size", value=size, limit=limit, remedy="check its dimensions")


def coupon_of(data: Any, what: str) -> Coupon:
    """Return the coupon from parsed JSON; ``what`` names the source in errors.

    Raises
    ------
    DataError
        If a key is missing or unknown, a value has the wrong type, or the coupon is impossible.
    """
    try:
        return TypeAdapter(Coupon).validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        refusal = option_refusal(error)
        path = error.errors()[0]["loc"]
        where = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")
    except SpecError as error:
        refusal, where = error, error.what
    raise DataError(f"{what}: {where}", value=refusal.value, limit=refusal.limit, remedy=refusal.remedy)


def unique_names(names: Iterable[str], suffix: Callable[[int], str] = str) -> list[str]:
    """Return the names, with a suffix on repeated names: ``t-1s``, ``t-1s-2``."""
    counts: Counter[str] = Counter()
    numbered = []
    for name in names:
        counts[name] += 1
        numbered.append(name if counts[name] == 1 else f"{name}-{suffix(counts[name])}")
    return numbered
