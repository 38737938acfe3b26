"""Coupons with raised features: diameters (group A), gaps (group B) and heights (group C) of pillars; z reference.

Cylinders are on a slab of 0.8 mm. Rows are along x, with features in the order of the source. By default three discs of
1 mm mark the slab: two at its left end and one at the right front, an arrangement that no rotation or reflection maps
onto itself.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

from solen.geometry.coupons.model import Coupon, Feature, Gap, Reading, Slab, Step
from solen.geometry.coupons.options import CouponOptions

BASE_MM, PILLAR_HEIGHT_MM, MARGIN_MM = 0.8, 3.0, 1.0
MARK_MM = 1.0
GROUP_A_MM = (1.00, 0.80, 0.60, 0.50, 0.40, 0.30, 0.25, 0.20, 0.18, 0.16, 0.14, 0.12, 0.10, 0.08, 0.06)
GROUP_B_MM = (0.50, 0.30, 0.20, 0.15, 0.12, 0.10, 0.08, 0.06, 0.05, 0.04, 0.03, 0.02)
GROUP_B_DIAMETER_MM, GROUP_C_DIAMETER_MM = 0.30, 0.50
GROUP_C_MM = ((0.1, 1.0, 0.1), (0.2, 0.5, 0.05), (0.2, 0.5, 0.025))
GROUP_C_LITERAL_MM = ((0.1, 1.0, 0.1), (0.2, 0.5, 0.5), (0.2, 0.5, 0.25))
REFERENCE_MM = {"literal": (1.000, 1.025, 0.025), "staircase": (1.000, 1.025, 1.050)}
PAIRS_PER_ROW = 4

Row = list[Feature]


def group_a(options: CouponOptions = CouponOptions(), diameters_mm: Sequence[float] = GROUP_A_MM) -> Coupon:
    """Return cylinders of 3 mm height and decreasing diameter, to find the smallest that remains upright."""
    sizes = [(f"d-{size:g}", size, PILLAR_HEIGHT_MM) for size in diameters_mm]
    row = _row(sizes, [options.spacing_mm] * (len(sizes) - 1), 0.0)
    readings = (
        Reading("arrangement", "arrays of raised cylindrical features", f"one row, {options.spacing_mm:g} mm apart"),
    )
    return _on_slab("group-a", "pillars of decreasing diameter", [row], options, readings=readings)


def group_b(
    options: CouponOptions = CouponOptions(),
    gaps_mm: Sequence[float] = GROUP_B_MM,
    diameter_mm: float = GROUP_B_DIAMETER_MM,
) -> Coupon:
    """Return cylinders of one diameter at decreasing gaps, to find the smallest gap that remains open."""
    pairs = options.gap_reading == "pairs"
    rows, gaps = (_pairs if pairs else _single_row)(gaps_mm, diameter_mm, options)
    taken = "separate pairs, so that a merged pair does not affect the others"
    readings = (
        Reading(
            "arrangement",
            "arranged with systematically varied edge-to-edge gap values",
            taken if pairs else "one row of thirteen cylinders, with the gaps between neighbours",
        ),
    )
    return _on_slab("group-b", "pillars at decreasing gaps", rows, options, gaps=gaps, readings=readings)


def group_c(
    options: CouponOptions = CouponOptions(),
    rows_mm: Sequence[tuple[float, float, float]] | None = None,
    diameter_mm: float = GROUP_C_DIAMETER_MM,
) -> Coupon:
    """Return cylinders of increasing height, in a row for each (lowest, highest, step), to find the smallest step."""
    literal = options.step_reading == "literal"
    rows_spec = rows_mm if rows_mm is not None else GROUP_C_LITERAL_MM if literal else GROUP_C_MM
    pitch = diameter_mm + options.spacing_mm
    rows, steps = [], []
    for number, (low, high, step) in enumerate(rows_spec, 1):
        heights = heights_mm(low, high, step)
        sizes = [(f"row-{number}-h-{height:g}", diameter_mm, height) for height in heights]
        row = _row(sizes, [options.spacing_mm] * (len(sizes) - 1), -pitch * (number - 1))
        rows.append(row)
        steps += [Step(f"{b.name}-step", (a.name, b.name), step) for a, b in pairwise(row)]
    readings = (
        Reading(
            "steps of the second and third row",
            "heights 0.2 mm - 0.5 mm (0.5 mm steps), heights 0.2 mm - 0.5 mm (0.25 steps)",
            "0.5 and 0.25 mm as written, with which the range contains one height and two heights, respectively"
            if literal
            else "0.05 and 0.025 mm: each step is half the previous one, consistent with the range "
            "and the resolved 25 µm",
        ),
    )
    return _on_slab("group-c", "pillars of increasing height", rows, options, steps=tuple(steps), readings=readings)


def z_reference(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return three square pillars on a slab of 10 x 3.2 x 0.8 mm, for height steps of one layer under a microscope."""
    side, width, depth = 3.0, 10.0, 3.2
    pitch = side + (width - 3 * side) / 4
    heights = REFERENCE_MM[options.reference_reading]
    pillars = tuple(
        Feature(
            f"h-{height:.3f}", "pillar", (number - 1) * pitch, 0.0, side, side, BASE_MM, BASE_MM + height, round=False
        )
        for number, height in enumerate(heights)
    )
    first, second, third = (pillar.name for pillar in pillars)
    steps: tuple[Step, ...] = (Step("first-step", (first, second), heights[1] - heights[0]),)
    if options.reference_reading == "staircase":
        steps += (Step("second-step", (second, third), heights[2] - heights[1]),)
    printed = "heights of 1.000 mm, 1.025 mm, and 0.025 mm"
    taken = {
        "literal": "as written: a step of 25 µm between the first two pillars, and one of 25 µm between the "
        "third pillar and the slab",
        "staircase": "the third height is 1.050 mm: two steps of 25 µm between pillars",
    }
    readings = (Reading("third pillar", printed, taken[options.reference_reading]),)
    slab = Slab(width, depth, BASE_MM)
    cautions = ("the pillars leave no room for a mark: they are in the order of their names along +x",)
    return Coupon("z-reference", "height reference", pillars, slab, steps=steps, readings=readings, cautions=cautions)


def heights_mm(low: float, high: float, step: float) -> list[float]:
    """Return heights from ``low`` to at most ``high`` in equal steps, without accumulated rounding."""
    count = int((high - low) / step + 1e-9) + 1
    return [round(low + number * step, 9) for number in range(count)]


def snapped(position_mm: float, options: CouponOptions) -> float:
    """Round a position to the corners of the printer's pixels, if their size is specified."""
    if options.pitch_um is None:
        return position_mm
    pitch_mm = 1e-3 * options.pitch_um
    return round(round(position_mm / pitch_mm) * pitch_mm, 9)


def _row(sizes: Sequence[tuple[str, float, float]], gaps: Sequence[float], y_mm: float) -> Row:
    """Return cylinders (name, diameter, height) along x from 0, with the gaps between them."""
    row, edge = [], 0.0
    for (name, diameter, height), gap in zip(sizes, [*gaps, 0.0], strict=True):
        x_mm = edge + 0.5 * diameter
        row.append(Feature(name, "pillar", x_mm, y_mm, diameter, diameter, BASE_MM, BASE_MM + height))
        edge += diameter + gap
    return row


def _pairs(gaps_mm: Sequence[float], diameter: float, options: CouponOptions) -> tuple[list[Row], tuple[Gap, ...]]:
    """Return pairs in rows of `PAIRS_PER_ROW`, in which only the gap within a pair is critical."""
    rows: list[Row] = []
    gaps = []
    for start in range(0, len(gaps_mm), PAIRS_PER_ROW):
        row_gaps = gaps_mm[start : start + PAIRS_PER_ROW]
        sizes = [(f"g-{gap:g}-{side}", diameter, PILLAR_HEIGHT_MM) for gap in row_gaps for side in ("left", "right")]
        between = [value for gap in row_gaps for value in (gap, options.spacing_mm)][:-1]
        rows.append(_row(sizes, between, -len(rows) * (diameter + options.spacing_mm)))
        gaps += [Gap(f"g-{gap:g}", (f"g-{gap:g}-left", f"g-{gap:g}-right"), gap) for gap in row_gaps]
    return rows, tuple(gaps)


def _single_row(gaps_mm: Sequence[float], diameter: float, _: CouponOptions) -> tuple[list[Row], tuple[Gap, ...]]:
    """Return a single row, with one more cylinder than gaps."""
    names = [f"c-{number}" for number in range(1, len(gaps_mm) + 2)]
    row = _row([(name, diameter, PILLAR_HEIGHT_MM) for name in names], gaps_mm, 0.0)
    gaps = (Gap(f"g-{gap:g}", (a, b), gap) for gap, (a, b) in zip(gaps_mm, pairwise(names), strict=True))
    return [row], tuple(gaps)


def _on_slab(
    name: str,
    title: str,
    rows: Iterable[Row],
    options: CouponOptions,
    *,
    gaps: tuple[Gap, ...] = (),
    steps: tuple[Step, ...] = (),
    readings: tuple[Reading, ...] = (),
) -> Coupon:
    """Return a coupon with rows of features on a slab, and its marks."""
    features = [feature for row in rows for feature in row]
    left = min(feature.x_mm - 0.5 * feature.width_mm for feature in features)
    right = max(feature.x_mm + 0.5 * feature.width_mm for feature in features)
    low = min(feature.y_mm - 0.5 * feature.depth_mm for feature in features)
    high = max(feature.y_mm + 0.5 * feature.depth_mm for feature in features)
    middle = (0.5 * (left + right), 0.5 * (low + high))
    centred = _centred(features, middle, gaps, options)
    tallest = max(feature.to_mm for feature in features)
    half_width, half_depth = 0.5 * (right - left), 0.5 * (high - low)
    if options.marks:
        centred += _marks(half_width, half_depth, tallest, options)
        half_width += options.spacing_mm + MARK_MM
        half_depth = max(half_depth, _mark_y(half_depth) + 0.5 * MARK_MM)
    slab = Slab(2.0 * (half_width + MARGIN_MM), 2.0 * (half_depth + MARGIN_MM), BASE_MM, options.bevel_mm)
    return Coupon(name, title, tuple(centred), slab, gaps, steps, readings=(*readings, *_mark_readings(options)))


def _centred(features: Row, middle: tuple[float, float], gaps: tuple[Gap, ...], options: CouponOptions) -> Row:
    """Return features relative to the centre, rounded to pixels; two that form a gap are shifted together."""
    neighbours = {gap.between[1]: gap.between[0] for gap in gaps}
    shifts: dict[str, float] = {}
    centred = []
    for feature in features:
        x, y = feature.x_mm - middle[0], feature.y_mm - middle[1]
        shifts[feature.name] = (
            shifts[neighbours[feature.name]] if feature.name in neighbours else snapped(x, options) - x
        )
        centred.append(replace(feature, x_mm=x + shifts[feature.name], y_mm=snapped(y, options)))
    return centred


def _mark_y(half_depth: float) -> float:
    return max(half_depth - 0.5 * MARK_MM, MARK_MM)


def _marks(half_width: float, half_depth: float, top_mm: float, options: CouponOptions) -> list[Feature]:
    """Return three discs as high as the highest feature, so that all are in focus together."""
    x, y = half_width + options.spacing_mm + 0.5 * MARK_MM, _mark_y(half_depth)
    positions = (("mark-1", -x, y), ("mark-2", -x, -y), ("mark-3", x, -y))
    return [
        Feature(name, "mark", snapped(x, options), snapped(y, options), MARK_MM, MARK_MM, BASE_MM, top_mm)
        for name, x, y in positions
    ]


def _mark_readings(options: CouponOptions) -> tuple[Reading, ...]:
    """Return the interpretation about marks, which solen adds to the coupon of the source."""
    additions = ["three round marks of 1 mm"] if options.marks else []
    additions += [f"a corner chamfered by {options.bevel_mm:g} mm"] if options.bevel_mm else []
    return (Reading("marks", "none", f"{' and '.join(additions)}, to orient an image"),) if additions else ()
