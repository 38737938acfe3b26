"""Summary of a design: expected response, effects of the tolerances, and advice.

`solen run` prints these lines, and the report begins with them. Every value is computed and has as many digits as its
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
    "material.index": "index of the print, same lens shape",
    "material.absorption_per_mm": "absorption",
    "body.arm_width_mm": "width of the arms",
    "receivers.gap_mm": "air gap before the receivers",
}
ADVICE = {
    "emitter.offset_mm": "Centre the emitter under a microscope, then measure the null: an offset of {by} {shift}.",
    "emitter.width_mm": "Measure the LED chip: a width change of {by} changes the contrast by {change}.",
    "emitter.distance_mm": "Keep the specified emitter distance: an error of {by} changes the contrast by {change}.",
    "material.index": "Measure the index of the printed material: an error of {by} changes the contrast by {change}.",
    "material.absorption_per_mm": "Measure the loss of printed guides: an absorption of {by} costs {light} of the "
    "light.",
    "body.arm_width_mm": "Check the width of the printed arms: an error of {by} changes the contrast by {change}.",
    "receivers.gap_mm": "Check the gap in front of the receivers: an error of {by} changes the contrast by {change}.",
    JOIN: "Determine how the turned lens joins the stem, or blacken the joins (a [[wall]] on them): {by} changes the "
    "contrast by {change}.",
    HOLD: "Specify the supports of the body: if a soft body is supported at {by}, the contrast changes by {change}.",
}
LENS_NAMES = {"cartesian-oval": "cylinder", "layered": "layered", "line-focus": "line focus"}
MIN_CHANGE = 0.005
"""Smallest change of the contrast that leads to advice; for the relative change of the light, ten times as much."""
MAX_ADVICE, MAX_DIGITS = 4, 4


class EffectRow(NamedTuple):
    """Effect of a parameter: its name, its deviation, and the changes of null, contrast and light."""

    name: str
    by: str
    null: str
    contrast: tuple[str, ...]
    light: str


def measured(value: float | None, u: float | None, *, sign: bool = True) -> str:
    """Format a value with one or two digits of its uncertainty; with "about" if the uncertainty is infinite."""
    if value is None or not math.isfinite(value):
        return "none"
    if u == math.inf:
        return f"about {value:.1g}"
    if u is None or not u > 0.0 or not math.isfinite(u):
        return f"{_unsigned(value, 5e-5):{'+' if sign and abs(value) > 5e-5 else ''}.4g}"
    power = math.floor(math.log10(u))
    digits = min(max(-power + (u / 10.0**power < 2.95), 0), MAX_DIGITS)
    rounded = _unsigned(round(value, digits), 0.0)
    u_text = f"{u:.{digits}f}" if u > 0.5 * 10.0**-digits else f"< {10.0**-digits:.{digits}f}"
    return f"{rounded:{'+' if sign and rounded else ''}.{digits}f} ± {u_text}"


def expected(study: DesignStudy) -> list[tuple[str, str]]:
    """Return headings and sentences on the expected response, also without a lens, as in the paper, and as built."""
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
        rows.append((f"as built ({emitter_text(study)})", f"{_ends(built.response)}; {slope} per degree at the null"))
    if practice is not None and practice.paper is not None:
        saturation_deg = practice.paper.saturation_deg()
        saturated = "" if saturation_deg is None else f"; above {SATURATION_CONTRAST:g} from {saturation_deg:.2f}° on"
        rows.append(("as in the paper (point source in the plane)", f"{_ends(practice.paper)}{saturated}"))
    return rows


def effect_rows(practice: Practice | None) -> tuple[list[float], list[EffectRow]]:
    """Return angles, and the effect at these angles of each parameter that deviates by its tolerance, largest first."""
    if practice is None or not practice.effects:
        return [], []
    angles = sorted({float(angle) for effect in practice.effects for angle in effect.angle_deg})
    angles = [angle for angle in angles if angle != 0.0 or len(angles) == 1]
    return angles, [_effect_row(effect, angles) for effect in practice.effects]


def advice(study: DesignStudy) -> list[str]:
    """Return advice in order of importance."""
    sentences = []
    summary = study.case.summary
    if study.practice is not None:
        for effect in study.practice.effects:
            is_absorption = effect.key == "material.absorption_per_mm"
            dims = is_absorption and abs(effect.received) > 10.0 * MIN_CHANGE
            if dims or (effect.resolved and effect.largest >= MIN_CHANGE):
                sentences.append(_advice(effect))
    if summary.saturation_deg is not None:
        text = (
            f"Use the sensor within {summary.saturation_deg:.2g}° of the null: outside this range, only the direction"
        )
        sentences.insert(0, f"{text} is known; a larger chip widens the range.")
    return list(dict.fromkeys(sentences))[:MAX_ADVICE]


def lens_table(practice: Practice | None) -> list[tuple[str, ...]]:
    """Return a table of the design with each kind of lens, headings first; empty without a comparison."""
    choice = None if practice is None else practice.lenses
    if choice is None or len(choice.lenses) < 2:
        return []
    first = choice.lenses[0]
    nearest = min(range(len(first.angle_deg)), key=lambda i: abs(first.angle_deg[i] - first.off_deg))
    columns = sorted({0, nearest, len(first.angle_deg) - 1})
    angles = [f"contrast at {first.angle_deg[i]:+.3g}°" for i in columns]
    displaced = f"at {first.off_deg:+.3g}°, {choice.y_off_mm:g} mm off in y"
    slope = f"mean slope per degree within ±{first.within_deg:.2g}°"
    heads = ("lens", *angles, displaced, slope, "light", "nonlinearity")
    return [heads, *(_lens_row(lens, columns, choice.own) for lens in choice.lenses)]


def lens_sentences(practice: Practice | None) -> list[str]:
    """Return sentences on whether another lens is worthwhile; empty without a comparison."""
    choice = None if practice is None else practice.lenses
    if choice is None or choice.layers_pay is None:
        return []
    cylinder, layered = choice.of(CYLINDER), choice.of(LAYERED)
    if cylinder is None or layered is None:
        return []
    return [*_layered_sentences(choice, layered, cylinder), _linearity_sentence(layered, cylinder)]


def emitter_text(study: DesignStudy) -> str:
    """Return a description of the emitter in the sensor as built."""
    built = None if study.practice is None else study.practice.built
    if built is None:
        return "in the plane" if study.design.trace.dimension == "2d" else "in space"
    if built.emitter.kind == "file":
        return "the design's ray file, in space"
    size = f"chip {built.emitter.width_mm:g} × {built.emitter.height_mm:g} mm"
    pattern = "tabulated pattern" if built.pattern == "table" else built.pattern
    return f"{size}, {pattern} within ±{built.cone_deg / 2:g}°, in space"


def _ends(response: Response) -> str:
    """Return the contrast at both ends of the motion."""
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
        f"{summary.saturation_deg:.2f}° to each side of the null; outside, the contrast exceeds "
        f"±{SATURATION_CONTRAST:g}"
    )


def _lens_row(lens: LensFigures, columns: list[int], design_shape: str) -> tuple[str, ...]:
    contrasts = [measured(float(lens.contrast[i]), float(lens.u_contrast[i])) for i in columns]
    name = f"{LENS_NAMES[lens.shape]}{' as given' if lens.given else ''}"
    return (
        f"{name}{' (this design)' if lens.shape == design_shape else ''}",
        *contrasts,
        measured(lens.off_contrast, lens.u_off_contrast),
        measured(lens.slope_per_deg, lens.u_slope_per_deg),
        f"{measured(100 * lens.received, 100 * lens.u_received, sign=False)} %",
        f"{measured(100 * lens.nonlinearity, 100 * lens.u_nonlinearity, sign=False)} %",
    )


def _layered_sentences(choice: LensChoice, layered: LensFigures, cylinder: LensFigures) -> list[str]:
    """Return sentences on whether the layered lens is worthwhile, and on what it requires."""
    gain = measured(choice.gain, choice.u_gain, sign=False)
    values = f"contrast {abs(layered.off_contrast):.2f} instead of {abs(cylinder.off_contrast):.2f}"
    signal = f"the signal is {gain} times that of the cylinder ({values})"
    signal += f" at {layered.off_deg:+.3g}° with the emitter {choice.y_off_mm:g} mm off in y"
    name = "layered lens as given" if layered.given else "layered lens"
    if layered.given:
        signal += ", to the less favourable side; the cylinder is as designed"
    if not choice.layers_pay:
        return [f"The {name} is not worthwhile for this design: {signal}."]
    requirement = f"It requires a known chip, centred within about {choice.y_off_mm:g} mm in y."
    if not layered.given:
        requirement += " None has been printed yet; solen print predict computes how a printer would reproduce it."
    return [f"The {name} is worthwhile for small angles: {signal}.", requirement]


def _linearity_sentence(layered: LensFigures, cylinder: LensFigures) -> str:
    """Return a sentence on which response is more linear."""
    best, other = sorted((cylinder, layered), key=lambda lens: lens.nonlinearity)
    values = f"deviation from a straight line {100 * best.nonlinearity:.0f} %, against {100 * other.nonlinearity:.0f} %"
    if other.nonlinearity - best.nonlinearity <= other.u_nonlinearity + best.u_nonlinearity:
        return f"Neither response is significantly more linear: {values}."
    name = "cylinder" if best is cylinder else "layered lens"
    return f"For a more linear response, use the {name}: {values}."


def _effect_row(effect: Effect, angles: list[float]) -> EffectRow:
    known = effect.angle_deg.tolist()
    changes = [
        measured(float(effect.contrast[known.index(angle)]), float(effect.u_contrast[known.index(angle)]))
        if angle in known
        else "–"
        for angle in angles
    ]
    moved = effect.null_deg is not None and abs(effect.null_deg) > (effect.u_null_deg or 0.0)
    null = f"{measured(effect.null_deg, effect.u_null_deg)}°" if moved else "–"
    light = f"{measured(100 * effect.received, 100 * effect.u_received)} %"
    return EffectRow(_name(effect), _deviation(effect), null, tuple(changes), light)


def _name(effect: Effect) -> str:
    if effect.key == HOLD:
        return f"soft body supported at {HOLDS[str(effect.value)]}"
    if effect.key == JOIN:
        return f"turned lens joined by {'smooth sides' if effect.value == 'smooth' else f'a {effect.value}'}"
    return NAMES.get(effect.key, effect.key)


def _deviation(effect: Effect) -> str:
    """Return the deviation of a parameter with its unit."""
    if effect.tolerance is None:
        return "instead"
    unit, value = effect.key.rpartition(".")[2].rpartition("_")[2], effect.tolerance
    if effect.key.endswith("_per_mm"):
        return f"{value:g} per mm"
    if unit == "mm":
        return f"{1e3 * value:g} µm" if value < 0.1 else f"{value:g} mm"
    return f"{value:.2g}" + {"deg": "°", "nm": " nm"}.get(unit, "")


def _advice(effect: Effect) -> str:
    largest = int(np.nanargmax(np.abs(effect.contrast)))
    change = f"{abs(effect.contrast[largest]):.2g} at {effect.angle_deg[largest]:+.3g}°"
    no_null = f"changes the contrast by {change}"
    shift = no_null if effect.null_deg is None else f"moves the null by {abs(effect.null_deg):.2g}°"
    by = f"a {effect.value} join" if effect.key == JOIN else _deviation(effect)
    by = HOLDS[str(effect.value)] if effect.key == HOLD else by
    text = ADVICE.get(effect.key, f"{effect.key}: a deviation of {{by}} changes the contrast by {{change}}.")
    return text.format(by=by, change=change, shift=shift, light=f"{abs(effect.received):.0%}")


def _unsigned(value: float, small: float) -> float:
    """Return a value, with negative zero replaced by zero."""
    return 0.0 if abs(value) <= small else value
