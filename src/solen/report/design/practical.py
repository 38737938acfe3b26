"""What a study found about the design's neighbours, in words and rows: a real chip, a decentre, another index, space.

Every sentence is computed; where the study has no such number, there is none.
"""

from typing import Any, NamedTuple

from solen.lens import OvalLens
from solen.sensor import DesignStudy, Extent, InSpace, Practice, Response
from solen.sensor.index_offset import NEAR_DEG

SHOWN_SHARE = 5e-4
"""Share of the light from which on a sentence names it."""
STRONGER = 0.02
"""Difference of two contrasts that is put down to the lens."""
PARTS = {
    "right": "right receiver",
    "left": "left receiver",
    "beside": "passes beside lens and body",
    "above_below": "passes above or below them",
    "reflected": "is reflected and never enters",
    "leaked": "leaves through top or bottom",
    "escaped": "leaves elsewhere",
    "absorbed": "is absorbed",
    "truncated": "was followed no further",
}
"""Parts of the budget in words."""


class IndexRow(NamedTuple):
    """An index of the material in words, the contrasts that it makes, and where rays near the axis and all focus."""

    text: str
    contrasts: list[float | None]
    foci: list[float | None]


class IndexRows(NamedTuple):
    """Contrast at some angles, and foci in mm by their names, for each index of the material."""

    angles: list[float]
    foci: list[str]
    rows: list[IndexRow]


def budget_rows(study: DesignStudy) -> list[tuple[str, float]]:
    """Where the light goes at rest, by parts, with their uncertainty; empty where that is not known."""
    budget = None if study.practice is None else study.practice.budget
    if budget is None:
        return []
    in_space = study.design.trace.dimension == "extruded"
    parts = [name for name in PARTS if in_space or name not in ("above_below", "leaked")]
    return [*((PARTS[name], getattr(budget, name)) for name in parts), ("uncertainty of a share", budget.u)]


def index_rows(study: DesignStudy) -> IndexRows:
    """Contrast with the chip at the ends and near the middle, and foci of the lens, by the index of the material."""
    practice = study.practice
    if practice is None or not practice.index:
        return IndexRows([], [], [])
    base = practice.index[0].base
    there = base.angle_deg.tolist()
    angles = sorted({there[0], *(near for near in (-NEAR_DEG, NEAR_DEG) if near in there), there[-1]} - {0.0})
    index = study.case.sensor.material.index
    parts = [(index, f"{index:.6g} (this design)", base)]
    for one in practice.index:
        note = " (its standard uncertainty)" if one.by_uncertainty else ""
        parts.append((one.index, f"{one.index:.6g}: off by {one.step:+.2g}{note}", one.response))
    parts.sort(key=lambda row: row[0])
    lens = study.case.sensor.cut
    oval = lens if isinstance(lens, OvalLens) else None
    rows = [IndexRow(text, [response.contrast_at(a) for a in angles], _foci(oval, at)) for at, text, response in parts]
    return IndexRows(angles, ["focus near the axis (mm)", "smallest spot (mm)"] if oval else [], rows)


def _foci(lens: OvalLens | None, index: float) -> list[float | None]:
    return [] if lens is None else [lens.paraxial_focus_mm(index), lens.best_focus_mm(index)]


def chip_words(practice: Practice) -> str:
    """The response with a chip beside that of a point; empty without both."""
    chip, point, extent = practice.chip, practice.point, practice.emitter
    if chip is None or point is None:
        return ""
    ends = [float(chip.angle_deg[0]), float(chip.angle_deg[-1])]
    ends = ends if ends[0] != ends[1] else ends[:1]
    inner = _inner(chip)
    angles = sorted({*ends, *([inner] if inner is not None else [])})
    values = [(angle, chip.contrast_at(angle), point.contrast_at(angle)) for angle in angles]
    if any(a is None or b is None for _, a, b in values):
        return ""
    if extent.kind == "own":
        start, second = f"The chip is {extent.width_mm:g} mm wide: the contrast is", "with a point in its place"
    else:
        start = f"With a chip {extent.width_mm:g} mm wide in place of the point, for comparison, the contrast is"
        second = "with the point"
    parts = [f"{signed(value)} at {angle:+g}° ({second} {signed(other)})" for angle, value, other in values]
    return f"{start} {_listed(parts)}."


def null_words(practice: Practice) -> str:
    """How far a decentre moves the null; empty where that is not known."""
    shift = practice.null_shift
    if shift is None:
        return ""
    return (
        f"With {_chip(practice.emitter)} the null moves by {shift.shift_deg:+.3f}° (± {shift.u_shift_deg:.1g}°) when "
        f"the emitter is moved by {shift.step_mm:g} mm towards +x."
    )


def index_words(study: DesignStudy) -> str:
    """What another index does to the response; empty without light."""
    angles, _, rows = index_rows(study)
    practice = study.practice
    if practice is None or not rows or any(value is None for row in rows for value in row.contrasts):
        return ""
    shown = [i for i, angle in enumerate(angles) if angle <= 0.0] or [0]
    parts = []
    for i in shown:
        values = _listed([f"{signed(row.contrasts[i])} for {row.text.split()[0].rstrip(':')}" for row in rows])
        parts.append(f"at {angles[i]:+g}° the contrast is {values}")
    fixed = " and the lens stays as it is cut" if isinstance(study.case.sensor.cut, OvalLens) else ""
    text = f"With {_chip(practice.emitter)}, where the material's index is off{fixed}: {'; '.join(parts)}."
    return " ".join(filter(None, (text, _shift_words(practice))))


def _shift_words(practice: Practice) -> str:
    """How far the index and the chip move the response."""
    moved, chip = practice.index_shift, practice.chip_shift
    if moved is None:
        return ""
    text = f"Over the motion the contrast moves by at most {moved.contrast:.3f} (at {moved.angle_deg:+.3g}°)"
    if chip is None:
        return f"{text}."
    name = _chip(practice.emitter)
    return f"{text}; {name} alone moves it from a point's by up to {chip.contrast:.3f} (at {chip.angle_deg:+.3g}°)."


def budget_words(study: DesignStudy) -> str:
    """Where the light goes at rest; empty where that is not known."""
    rows = [(text, share) for text, share in budget_rows(study)[:-1] if share >= SHOWN_SHARE]
    if not rows:
        return ""
    words = {PARTS["right"]: "reaches the right receiver", PARTS["left"]: "reaches the left one"}
    parts = [f"{share:.1%} {words.get(text, text)}" for text, share in rows]
    return f"Of the emitter's light, at rest: {_listed(parts)}."


def space_words(study: DesignStudy) -> str:
    """The same chip in the plane and in space; empty without light."""
    in_space = None if study.practice is None else study.practice.in_space
    if in_space is None:
        return ""
    same = in_space.same
    ends = sorted({float(in_space.plane.angle_deg[0]), float(in_space.plane.angle_deg[-1])})
    pairs = [(angle, in_space.plane.contrast_at(angle), same.contrast_at(angle)) for angle in ends]
    if any(one is None or other is None for _, one, other in pairs):
        return ""
    parts = [f"{signed(one)} and {signed(other)} at {angle:+g}°" for angle, one, other in pairs]
    sampled = "" if all(trace.method == "adaptive" for trace in same.traces) else ", sampled"
    plane, space, angles = in_space.plane.received_share, same.received_share, len(in_space.plane.angle_deg)
    text = (
        f"{_emitter(in_space)} gives, by rays in the plane and by rays in space in a body {in_space.thickness_mm:g} mm "
        f"thick, a contrast of {_listed(parts)} (± {same.largest_u_contrast:.1g}{sampled}). Of its light "
        f"{plane:.1%} and {space:.1%} are received{f', the mean of {angles} angles' if angles > 1 else ''}."
    )
    weaker = all(abs(one or 0.0) - abs(other or 0.0) > STRONGER for _, one, other in pairs)
    if weaker and isinstance(study.case.sensor.cut, OvalLens):
        text += " Rays that leave the plane see a lens that focuses shorter."
    return text


def _emitter(in_space: InSpace) -> str:
    if in_space.emitter.kind == "file":
        return "The design's file of rays"
    size = f"A chip of {in_space.emitter.width_mm:g} × {in_space.emitter.height_mm:g} mm"
    pattern = "with its pattern in a table" if in_space.pattern == "table" else in_space.pattern
    fan = " (in place of the design's fan, which has no light out of the plane)" if in_space.pattern_replaced else ""
    return f"{size}, {pattern} within ±{in_space.cone_deg / 2:g}°{fan},"


def _chip(extent: Extent) -> str:
    if extent.kind == "file":
        return "the design's emitter"
    return f"the chip {extent.width_mm:g} mm wide" if extent.kind == "own" else f"a chip {extent.width_mm:g} mm wide"


def _inner(response: Response) -> float | None:
    """The angle near the middle that a sentence names, where the response has it."""
    angles: Any = response.angle_deg.tolist()
    return next((near for near in (-NEAR_DEG, NEAR_DEG) if near in angles), None)


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def signed(value: float | None) -> str:
    """A contrast with its sign; none for a zero."""
    return "no light" if value is None else f"{without_sign(value):+.3f}"


def without_sign(value: float) -> float:
    """The value, without the sign of a zero."""
    return 0.0 if abs(value) < 5e-4 else value
