"""What the numbers mean for someone who wants to print this sensor, in plain words.

Every sentence is computed from the study; none is printed when the study does not support it.
"""

from solen.lens import OvalLens
from solen.material import Optical
from solen.report.design.as_printed import printed_sentences
from solen.report.design.practical import (
    budget_words,
    chip_words,
    index_words,
    null_words,
    signed,
    space_words,
    without_sign,
)
from solen.sensor import SATURATED, Case, DesignStudy
from solen.sensor.index_offset import steps
from solen.sensor.practice import CHIP_MM


def findings(study: DesignStudy) -> list[tuple[str, str]]:
    """Headings and sentences, the most important first."""
    sentences = [
        ("The signal", _signal(study)),
        ("As printed", " ".join(printed_sentences(study.as_printed)) if study.as_printed else ""),
        ("Range", _range(study.case)),
        ("A real chip", chip_words(study.practice) if study.practice else ""),
        ("Alignment", _alignment(study)),
        ("Index", _index(study)),
        ("In space", space_words(study)),
        ("Light", _light(study)),
        ("Not in these numbers", _limits(study)),
    ]
    return [(heading, text) for heading, text in sentences if text]


def warnings(study: DesignStudy) -> list[str]:
    """What must be known before anything else, as sentences."""
    return [f"{text[0].upper()}{text[1:].rstrip('.')}." for text in study.warnings]


def headline(study: DesignStudy) -> str:
    """One sentence."""
    summary = study.case.summary
    start = f"{signed(summary.contrast_from)} at {summary.from_deg:+g}°"
    if summary.from_deg == summary.to_deg:
        return f"The contrast between the two receivers is {start}."
    end = f"{signed(summary.contrast_to)} at {summary.to_deg:+g}°"
    return f"The contrast between the two receivers runs from {start} to {end}."


def _signal(study: DesignStudy) -> str:
    summary, sentences = study.case.summary, [headline(study)]
    if study.with_lens is None:
        sentences.append("This design has no lens.")
    elif study.no_lens is not None:
        flat = study.no_lens.summary
        ends = f"{signed(flat.contrast_from)} to {signed(flat.contrast_to)}"
        sentences.append(f"Without the lens it runs from {ends}.")
    first, last = summary.contrast_from, summary.contrast_to
    if first is not None and last is not None and first != last:
        side = "right" if first > last else "left"
        sentences.append(f"Turning to the right (a negative angle) brightens the {side} receiver.")
    return " ".join(sentences)


def _range(case: Case) -> str:
    summary = case.summary
    if not summary.received_share > 0.0:
        return "No light reaches the receivers at any angle."
    if summary.null_deg is None:
        return "Both receivers never see the same in this range: there is no null to measure from."
    balance = f"Both receivers see the same at {without_sign(summary.null_deg):.2f}°"
    if summary.slope_per_deg is not None:
        balance += f"; there the contrast changes by {abs(summary.slope_per_deg):.2g} per degree"
    if summary.saturation_deg is None:
        return f"{balance}. It stays below {SATURATED} in this range."
    return (
        f"{balance}. About {summary.saturation_deg:.2f}° away it first exceeds {SATURATED}: where it does, the two "
        "signals tell the direction of the motion, but hardly its amplitude."
    )


def _light(study: DesignStudy) -> str:
    summary, sensor = study.case.summary, study.case.sensor
    emitter, lens = sensor.design.emitter, sensor.cut
    half_cone_deg = sensor.light.cone_deg / 2
    budget = budget_words(study)
    text = f"On average {summary.received_share:.1%} of the emitted light reaches the receivers."
    text += f" {budget}" if budget else ""
    if lens is None:
        return text
    if emitter.offset_mm == 0.0 and lens.acceptance_deg < half_cone_deg:
        text += (
            f" The face accepts ±{lens.acceptance_deg:.1f}° of the emitter's ±{half_cone_deg:g}°; "
            "the rest passes beside it."
        )
    if emitter.offset_mm == 0.0 and isinstance(lens, OvalLens) and lens.acceptance_deg <= half_cone_deg:
        text += (
            f" At the lens's edge light arrives at {lens.edge_incidence_deg:.1f}° to the normal: "
            "a rounded or rough edge costs light there first."
        )
    return text


def _alignment(study: DesignStudy) -> str:
    """What the lens makes of a decentre and of a chip, and what a decentre does to the null."""
    lens, practice, sentences = study.case.sensor.cut, study.practice, []
    if isinstance(lens, OvalLens):
        own_mm = study.case.sensor.light.width_mm
        width_mm = own_mm or CHIP_MM
        sentences.append(
            f"The lens magnifies {lens.magnification:.1f} times: moving the emitter by 0.01 mm across the axis moves "
            f"the focal spot by {0.01 * lens.magnification:.2f} mm, and {'the' if own_mm else 'a'} chip "
            f"{width_mm:g} mm wide makes a spot about {width_mm * lens.magnification:.1f} mm wide."
        )
    if practice is not None and (words := null_words(practice)):
        sentences.append(words)
    if sentences and (offset_mm := study.design.emitter.offset_mm):
        sentences.append(f"The design's emitter is {offset_mm:g} mm off its place.")
    return " ".join(sentences)


def _index(study: DesignStudy) -> str:
    """Where another index puts the focus, and what it does to the response."""
    lens, material = study.case.sensor.cut, study.case.sensor.material
    known = f"The index is {material.index:.6g} ± {material.u_index:.2g} (standard)." if material.u_index else ""
    focus = _focuses(lens, material) if isinstance(lens, OvalLens) else ""
    return " ".join(filter(None, (known, focus, index_words(study))))


def _focuses(lens: OvalLens, material: Optical) -> str:
    """Where the lens focuses in the material it is made of, and in one whose index is off."""
    index = material.index
    if abs(index - lens.design_index) > 1e-9:
        paraxial, marginal = lens.paraxial_focus_mm(index), lens.marginal_focus_mm(index)
        return (
            f"The lens is cut for {lens.design_index:.6g} but the material has {index:.6g}: rays near the axis cross "
            f"it {_focus(paraxial)}, edge rays {_focus(marginal)}, where {lens.focus_mm:g} mm was asked for."
        )
    sentences = []
    for step, _ in steps(material):
        if step != 0.0:
            near, best = _focus(lens.paraxial_focus_mm(index + step)), _focus(lens.best_focus_mm(index + step))
            off = f"{abs(step):.2g} {'lower' if step < 0.0 else 'higher'}"
            sentences.append(f"{off}, rays near the axis would cross it {near}, and the smallest spot would lie {best}")
    return f"If the print's index were {'; '.join(sentences)}."


def _limits(study: DesignStudy) -> str:
    material = study.case.sensor.material
    absorption, u = material.absorption_per_mm, material.u_absorption_per_mm
    loss = (
        f"the material absorbs {absorption:g}{f' ± {u:.1g}' if u else ''} per mm"
        if absorption > 0
        else "no absorption was given, so none is counted"
    )
    rough = study.case.sensor.scene().is_random
    faces = "faces scatter only where the design says so" if rough else "perfectly smooth faces, no scatter"
    return f"{_rays(study)}; {faces}, no diffraction; {loss}. " + _arms(study)


def _rays(study: DesignStudy) -> str:
    """In what dimension the numbers are."""
    if study.design.trace.dimension == "extruded":
        return "Rays in space, in a body of the same outline at every height"
    if study.practice is not None and study.practice.in_space is not None:
        return "Rays in the plane only, but for what is said to be in space"
    return "Rays in the plane only, whatever the thickness"


def _arms(study: DesignStudy) -> str:
    if study.case.sensor.is_drawn:
        return "The outline is as drawn."
    angle = "assumed to continue the stem's edge" if study.design.body.arm_angle_deg is None else "as given"
    return f"The arms' angle is {angle}."


def _focus(focus_mm: float | None) -> str:
    return "nowhere behind the lens" if focus_mm is None else f"at {focus_mm:.1f} mm"
