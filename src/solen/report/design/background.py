"""Background to the summary: the lens, the light budget, and the limits of the results.

Every sentence is computed from the study and is omitted if the study does not support it.
"""

from solen.lens import DesignedLens, OvalLens
from solen.material import Optical
from solen.report.design.as_printed import printed_sentences
from solen.report.design.summary import measured
from solen.sensor import DesignStudy, tolerance_of
from solen.sensor.effects import index_offsets
from solen.sensor.loaded import LoadedStudy
from solen.sensor.network import NetworkStudy
from solen.sensor.practice import CHIP_MM

AnyStudy = DesignStudy | LoadedStudy | NetworkStudy
MIN_FRACTION = 5e-4
"""Smallest fraction of the light that is mentioned."""
PARTS = {
    "right": "right receiver",
    "left": "left receiver",
    "beside": "passes by the lens and the body",
    "above_below": "passes above or below the lens and the body",
    "reflected": "is reflected and never enters the body",
    "leaked": "leaves through the top or the bottom",
    "escaped": "leaves elsewhere",
    "absorbed": "is absorbed",
    "truncated": "was not traced further",
}
"""Names of the parts of the light budget."""


def findings(study: DesignStudy) -> list[tuple[str, str]]:
    """Return headings and sentences, in order of importance."""
    rows = [
        ("As printed", " ".join(printed_sentences(study.as_printed)) if study.as_printed else ""),
        ("Light", _light(study)),
        ("Alignment", _alignment(study)),
        ("Focus", _focus_text(study)),
        ("Not included in these results", _limits(study)),
    ]
    return [(heading, text) for heading, text in rows if text]


def warnings(study: AnyStudy) -> list[str]:
    """Return the warnings as sentences."""
    return [f"{text[0].upper()}{text[1:].rstrip('.')}." for text in study.warnings]


def budget_rows(study: DesignStudy) -> list[tuple[str, float]]:
    """Return the fractions of the light at rest, and their uncertainty as the last row; empty if they are unknown."""
    budget = None if study.practice is None else study.practice.budget
    if budget is None:
        return []
    in_space = study.design.trace.dimension == "extruded"
    parts = [name for name in PARTS if in_space or name not in ("above_below", "leaked")]
    return [*((PARTS[name], getattr(budget, name)) for name in parts), ("uncertainty of a fraction", budget.u)]


def _light(study: DesignStudy) -> str:
    sensor = study.case.sensor
    emitter, lens = sensor.design.emitter, sensor.cut
    half_cone_deg = sensor.light.cone_deg / 2
    text = _budget_text(study)
    if lens is None or emitter.offset_mm != 0.0:
        return text
    if lens.acceptance_deg < half_cone_deg:
        text += (
            f" In the plane, the lens accepts ±{lens.acceptance_deg:.1f}° of the emitter's ±{half_cone_deg:g}°; "
            "the remainder passes by the lens."
        )
    if isinstance(lens, DesignedLens) and lens.acceptance_deg <= half_cone_deg:
        text += (
            f" At the edge of the lens, the angle of incidence is {lens.edge_incidence_deg:.1f}°: "
            "a rounded or rough edge loses light there first."
        )
    return text.strip()


def _budget_text(study: DesignStudy) -> str:
    """Return a sentence on the light budget at rest; empty if it is unknown."""
    rows = [(text, fraction) for text, fraction in budget_rows(study)[:-1] if fraction >= MIN_FRACTION]
    if not rows:
        return ""
    verbs = {PARTS["right"]: "reaches the right receiver", PARTS["left"]: "reaches the left receiver"}
    parts = [f"{fraction:.1%} {verbs.get(text, text)}" for text, fraction in rows]
    return f"Of the emitter's light at rest, {_listed(parts)}."


def _alignment(study: DesignStudy) -> str:
    """Return sentences on the effects of a decentred emitter and of an extended chip on the focus."""
    lens, sentences = study.case.sensor.cut, []
    if isinstance(lens, OvalLens):
        chip_mm = study.case.sensor.light.width_mm
        width_mm = chip_mm or CHIP_MM
        sentences.append(
            f"The magnification of the lens is {lens.magnification:.1f}: if the emitter is shifted by 0.01 mm across "
            f"the axis, the focal spot moves by {0.01 * lens.magnification:.2f} mm, and {'the' if chip_mm else 'a'} "
            f"chip {width_mm:g} mm wide gives a spot about {width_mm * lens.magnification:.1f} mm wide."
        )
    if offset_mm := study.design.emitter.offset_mm:
        sentences.append(f"The design's emitter is decentred by {offset_mm:g} mm.")
    return " ".join(sentences)


def _focus_text(study: DesignStudy) -> str:
    """Return sentences on the focus in the lens material and in a material with another index."""
    sensor = study.case.sensor
    lens, material = sensor.cut, sensor.material
    uncertainty = ""
    if material.u_index:
        uncertainty = f"The index is {measured(material.index, material.u_index, sign=False)} (standard uncertainty)."
    if not isinstance(lens, OvalLens):
        return uncertainty
    return f"{uncertainty} {_index_text(lens, material, tolerance_of(sensor, 'material.index')[0])}".strip()


def _index_text(lens: OvalLens, material: Optical, tolerance: float) -> str:
    index = material.index
    if abs(index - lens.design_index) > 1e-9:
        paraxial, marginal = lens.paraxial_focus_mm(index), lens.marginal_focus_mm(index)
        return (
            f"The lens is designed for an index of {lens.design_index:.6g}, but the material has {index:.6g}: "
            f"paraxial rays cross the axis {_focus(paraxial)}, edge rays {_focus(marginal)}, and the specified focus "
            f"is at {lens.focus_mm:g} mm."
        )
    parts = []
    for step, _ in index_offsets(material, tolerance):
        if step != 0.0:
            paraxial, best = lens.paraxial_focus_mm(index + step), lens.best_focus_mm(index + step)
            change = f"{abs(step):.2g} {'lower' if step < 0.0 else 'higher'}"
            crossing = f"paraxial rays would cross the axis {_focus(paraxial)}"
            parts.append(f"{change}, {crossing}, and the smallest spot would be {_focus(best)}")
    return f"If the print's index were {'; '.join(parts)}. The focus shifts strongly, the response only slightly."


def _limits(study: DesignStudy) -> str:
    material = study.case.sensor.material
    absorption, u = material.absorption_per_mm, material.u_absorption_per_mm
    loss = (
        f"the material absorbs {absorption:g}{f' ± {u:.1g}' if u else ''} per mm"
        if absorption > 0
        else "no absorption is specified, so none is included"
    )
    rough = study.case.sensor.scene().is_random
    faces = "only the faces specified in the design scatter" if rough else "perfectly smooth faces, no scatter"
    rays = "Rays in space, in a body with the same outline at every height"
    if study.design.lens.in_space:
        rays = "Rays in space, sampled, through a lens that is not a cylinder, as designed (none has been printed yet)"
    if study.design.trace.dimension == "2d":
        rays = "Rays in the plane only, unless marked otherwise"
    return f"{rays}; {faces}, no diffraction; {loss}. {_arms(study)}"


def _arms(study: DesignStudy) -> str:
    if study.case.sensor.is_drawn:
        return "The outline is as drawn."
    is_default = study.design.body.arm_angle_deg is None
    return f"The arms {'are assumed to continue the edge of the stem' if is_default else 'have the specified angle'}."


def _focus(focus_mm: float | None) -> str:
    return "nowhere behind the lens" if focus_mm is None else f"at {focus_mm:.1f} mm"


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
