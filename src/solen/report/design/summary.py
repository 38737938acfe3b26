"""The design summary: what to expect, what matters, and what to do.

The command prints these lines and the report begins with them. Every value is computed, with as many digits as its
uncertainty justifies.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.sensor import SATURATION_CONTRAST, DesignStudy, Effect, LensChoice, LensFigures, Practice, Response, Summary
from solen.sensor.effects import HOLD, HOLDS, JOIN
from solen.sensor.lens_choice import CYLINDER, LAYERED

NAMES = {
    "emitter.offset_mm": "decentre of the emitter",
    "emitter.width_mm": "width of the chip",
    "emitter.distance_mm": "distance of the emitter",
    "material.index": "index of the print, the lens as cut",
    "material.absorption_per_mm": "absorption",
    "body.arm_width_mm": "width of the arms",
    "receivers.gap_mm": "air gap before the receivers",
}
ADVICE = {
    "emitter.offset_mm": "Centre the emitter under a microscope, then measure the null: an offset "
    "of {by} moves it by {null}.",
    "emitter.width_mm": "Measure the LED chip: a width change of {by} changes the contrast by {change}.",
    "emitter.distance_mm": "Hold the emitter at its distance: an error of {by} changes the contrast by {change}.",
    "material.index": "Measure the index of the printed material: an error of {by} changes the contrast by {change}.",
    "material.absorption_per_mm": "Measure the loss of the print on guides: an absorption of {by} "
    "costs {light} of the light.",
    "body.arm_width_mm": "Print the arms to width: an error of {by} changes the contrast by {change}.",
    "receivers.gap_mm": "Hold the gap before the receivers: an error of {by} changes the contrast by {change}.",
    JOIN: "Determine how the turned lens joins the stem, or blacken the joins (a [[wall]] on them): {by} changes the "
    "contrast by {change}.",
    HOLD: "State how the body is held: a soft body held by {by} changes the contrast by {change}.",
}
LENSES = {"cartesian-oval": "cylinder", "layered": "layered", "line-focus": "line focus"}
WORTH = 0.005
"""Advice is given if the contrast changes by more than this, or the light by more than ten times this fraction."""
MAX_ADVICE, MAX_DIGITS = 4, 4


class Matter(NamedTuple):
    """A parameter that deviates: its name, its deviation, and the effect on null, contrast and light."""

    name: str
    by: str
    null: str
    contrast: tuple[str, ...]
    light: str


def measured(value: float | None, u: float | None, *, sign: bool = True) -> str:
    """Format a value with one or two digits of its uncertainty; write "about" if the uncertainty is infinite."""
    if value is None or not math.isfinite(value):
        return "none"
    if u == math.inf:
        return f"about {value:.1g}"
    if u is None or not u > 0.0 or not math.isfinite(u):
        return f"{_unsigned(value, 5e-5):{'+' if sign and abs(value) > 5e-5 else ''}.4g}"
    power = math.floor(math.log10(u))
    digits = min(max(-power + (u / 10.0**power < 2.95), 0), MAX_DIGITS)
    rounded = _unsigned(round(value, digits), 0.0)
    shown = f"{u:.{digits}f}" if u > 0.5 * 10.0**-digits else f"< {10.0**-digits:.{digits}f}"
    return f"{rounded:{'+' if sign and rounded else ''}.{digits}f} ± {shown}"


def expected(study: DesignStudy) -> list[tuple[str, str]]:
    """Return the expected response by heading, including the responses without a lens, as in the paper and as built."""
    case, summary = study.case, study.case.summary
    light = measured(100 * summary.received_share, 200 * summary.u_power, sign=False)
    rows = [
        ("contrast", f"{_ends(case.power)}{_side(summary)}"),
        ("slope", _slope(summary)),
        ("range", _range(summary)),
        ("light", f"{light} % of the emitted power is received"),
    ]
    if study.with_lens is not None and study.no_lens is not None:
        rows.append(("without the lens", _ends(study.no_lens.power)))
    practice = study.practice
    if practice is not None and practice.built is not None and not practice.built.is_design:
        built = practice.built
        slope = measured(built.slope_per_deg, built.u_slope_per_deg)
        rows.append((f"as built ({emitter_words(study)})", f"{_ends(built.response)}; {slope} per degree at the null"))
    if practice is not None and practice.paper is not None:
        saturated = practice.paper.saturation_deg()
        beyond = "" if saturated is None else f"; above {SATURATION_CONTRAST:g} from {saturated:.2f}° on"
        rows.append(("as in the paper (point, plane)", f"{_ends(practice.paper)}{beyond}"))
    return rows


def matters(practice: Practice | None) -> tuple[list[float], list[Matter]]:
    """Return the angles and each parameter's effect there when it deviates by its tolerance, largest effect first."""
    if practice is None or not practice.effects:
        return [], []
    angles = sorted({float(angle) for effect in practice.effects for angle in effect.angle_deg})
    angles = [angle for angle in angles if angle != 0.0 or len(angles) == 1]
    return angles, [_matter(effect, angles) for effect in practice.effects]


def advice(study: DesignStudy) -> list[str]:
    """Return advice in order of importance."""
    sentences = []
    summary = study.case.summary
    if study.practice is not None:
        for effect in study.practice.effects:
            light = abs(effect.received) > 10.0 * WORTH
            if (effect.resolved and effect.largest >= WORTH) or (light and effect.key == "material.absorption_per_mm"):
                sentences.append(_advised(effect))
    if summary.saturation_deg is not None:
        text = f"Use it within {summary.saturation_deg:.2g}° of the null: beyond it, only the direction is known"
        sentences.insert(0, f"{text}; a larger chip widens this range.")
    return list(dict.fromkeys(sentences))[:MAX_ADVICE]


def lens_table(practice: Practice | None) -> list[tuple[str, ...]]:
    """Return a table of the design with each kind of lens, headings first; return an empty one without a comparison."""
    choice = None if practice is None else practice.lenses
    if choice is None or len(choice.lenses) < 2:
        return []
    first = choice.lenses[0]
    by_size = sorted(range(len(first.angle_deg)), key=lambda i: abs(first.angle_deg[i] - first.off_deg))
    places = sorted({0, by_size[0], len(first.angle_deg) - 1})
    angles = [f"contrast at {first.angle_deg[i]:+.3g}°" for i in places]
    off = f"at {first.off_deg:+.3g}°, {choice.y_off_mm:g} mm off in y"
    slope = f"mean slope per degree within ±{first.within_deg:.2g}°"
    heads = ("lens", *angles, off, slope, "light", "nonlinearity")
    return [heads, *(_lens_row(lens, places, choice.own) for lens in choice.lenses)]


def lens_words(practice: Practice | None) -> list[str]:
    """Say whether another lens is worthwhile; return nothing without a comparison."""
    choice = None if practice is None else practice.lenses
    if choice is None or choice.layers_pay is None:
        return []
    cylinder, layered = choice.of(CYLINDER), choice.of(LAYERED)
    if cylinder is None or layered is None:
        return []
    return [*_pays(choice, layered, cylinder), _straight(layered, cylinder)]


def emitter_words(study: DesignStudy) -> str:
    """Describe the emitter in the sensor as built."""
    built = None if study.practice is None else study.practice.built
    if built is None:
        return "in the plane" if study.design.trace.dimension == "2d" else "in space"
    if built.emitter.kind == "file":
        return "the design's ray file, in space"
    size = f"chip {built.emitter.width_mm:g} × {built.emitter.height_mm:g} mm"
    pattern = "tabulated pattern" if built.pattern == "table" else built.pattern
    return f"{size}, {pattern} within ±{built.cone_deg / 2:g}°, in space"


def _ends(response: Response) -> str:
    """Describe the contrast at both ends of the motion."""
    ends = sorted({0, len(response.angle_deg) - 1})
    values = [
        (measured(float(response.contrast[i]), float(response.u_contrast[i])), response.angle_deg[i]) for i in ends
    ]
    return ", ".join(f"{value if value != 'none' else 'no light'} at {angle:+g}°" for value, angle in values)


def _side(summary: Summary) -> str:
    first, last = summary.contrast_from, summary.contrast_to
    if first is None or last is None or first == last:
        return ""
    return f"; a turn to the right (negative) brightens the {'right' if first > last else 'left'} receiver"


def _slope(summary: Summary) -> str:
    if not summary.received_share > 0.0:
        return "no light reaches the receivers"
    if summary.null_deg is None or summary.slope_per_deg is None:
        return "there is no null in this range"
    null = "0° by symmetry" if summary.u_null_deg == 0.0 else f"{measured(summary.null_deg, summary.u_null_deg)}°"
    return f"{measured(summary.slope_per_deg, summary.u_slope_per_deg)} per degree at the null, {null}"


def _range(summary: Summary) -> str:
    if summary.null_deg is None:
        return "none, as there is no null"
    if summary.saturation_deg is None:
        return (
            f"all of {summary.from_deg:+g}° to {summary.to_deg:+g}°: the contrast stays within ±{SATURATION_CONTRAST:g}"
        )
    return (
        f"{summary.saturation_deg:.2f}° to each side of the null; beyond, the contrast exceeds ±{SATURATION_CONTRAST:g}"
    )


def _lens_row(lens: LensFigures, places: list[int], own: str) -> tuple[str, ...]:
    contrasts = [measured(float(lens.contrast[i]), float(lens.u_contrast[i])) for i in places]
    return (
        f"{LENSES[lens.shape]}{' as given' if lens.given else ''}{' (this design)' if lens.shape == own else ''}",
        *contrasts,
        measured(lens.off_contrast, lens.u_off_contrast),
        measured(lens.slope_per_deg, lens.u_slope_per_deg),
        f"{measured(100 * lens.received, 100 * lens.u_received, sign=False)} %",
        f"{measured(100 * lens.nonlinearity, 100 * lens.u_nonlinearity, sign=False)} %",
    )


def _pays(choice: LensChoice, layered: LensFigures, cylinder: LensFigures) -> list[str]:
    """Say whether the layered lens is worthwhile, and what it requires."""
    gain = measured(choice.gain, choice.u_gain, sign=False)
    values = f"contrast {abs(layered.off_contrast):.2f} instead of {abs(cylinder.off_contrast):.2f}"
    there = f"signal {gain} times the cylinder's ({values})"
    there += f" at {layered.off_deg:+.3g}° with the emitter {choice.y_off_mm:g} mm off in y"
    name = "layered lens as given" if layered.given else "layered lens"
    if layered.given:
        there += ", to the less favourable side; the cylinder is as designed"
    if not choice.layers_pay:
        return [f"The {name} is not worthwhile here: {there}."]
    asked = f"It requires a known chip, centred within about {choice.y_off_mm:g} mm in y."
    printed = " None has been printed yet; solen print predict computes how a printer would reproduce it."
    return [f"The {name} is worthwhile for small angles: {there}.", asked if layered.given else asked + printed]


def _straight(layered: LensFigures, cylinder: LensFigures) -> str:
    """Say which response is more linear."""
    straight, other = sorted((cylinder, layered), key=lambda lens: lens.nonlinearity)
    by = f"deviation from a straight line {100 * straight.nonlinearity:.0f} % against {100 * other.nonlinearity:.0f} %"
    if other.nonlinearity - straight.nonlinearity <= other.u_nonlinearity + straight.u_nonlinearity:
        return f"Neither response is more linear: {by}."
    return f"For a more linear response use the {LENSES[straight.shape]} lens: {by}.".replace(
        "cylinder lens", "cylinder"
    )


def _matter(effect: Effect, angles: list[float]) -> Matter:
    there = effect.angle_deg.tolist()
    changes = [
        measured(float(effect.contrast[there.index(angle)]), float(effect.u_contrast[there.index(angle)]))
        if angle in there
        else "–"
        for angle in angles
    ]
    moved = effect.null_deg is not None and abs(effect.null_deg) > (effect.u_null_deg or 0.0)
    null = f"{measured(effect.null_deg, effect.u_null_deg)}°" if moved else "–"
    light = f"{measured(100 * effect.received, 100 * effect.u_received)} %"
    return Matter(_name(effect), _by(effect), null, tuple(changes), light)


def _name(effect: Effect) -> str:
    if effect.key == HOLD:
        return f"soft body held by {HOLDS[str(effect.value)]}"
    return (
        f"turned lens joined by a {effect.value}".replace("a smooth", "smooth sides")
        if effect.key == JOIN
        else NAMES.get(effect.key, effect.key)
    )


def _by(effect: Effect) -> str:
    """Describe the deviation of a parameter."""
    if effect.tolerance is None:
        return "instead"
    unit, value = effect.key.rpartition(".")[2].rpartition("_")[2], effect.tolerance
    if effect.key.endswith("_per_mm"):
        return f"{value:g} per mm"
    if unit == "mm":
        return f"{1e3 * value:g} µm" if value < 0.1 else f"{value:g} mm"
    return f"{value:.2g}" + {"deg": "°", "nm": " nm"}.get(unit, "")


def _advised(effect: Effect) -> str:
    place = int(np.nanargmax(np.abs(effect.contrast)))
    change = f"{abs(effect.contrast[place]):.2g} at {effect.angle_deg[place]:+.3g}°"
    null = "nothing" if effect.null_deg is None else f"{abs(effect.null_deg):.2g}°"
    by = f"a {effect.value} join" if effect.key == JOIN else _by(effect)
    by = HOLDS[str(effect.value)] if effect.key == HOLD else by
    text = ADVICE.get(effect.key, f"{effect.key}: a deviation of {{by}} changes the contrast by {{change}}.")
    return text.format(by=by, change=change, null=null, light=f"{abs(effect.received):.0%}")


def _unsigned(value: float, small: float) -> float:
    """Return a value, with negative zero replaced by zero."""
    return 0.0 if abs(value) <= small else value
