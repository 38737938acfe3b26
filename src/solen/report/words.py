"""What the numbers mean for someone who wants to print this sensor, in plain words.

Every sentence is computed from the study; none is printed when the study does not support it.
"""

from solen.lens import OvalLens
from solen.report.results import summary
from solen.sensor import SATURATED, Case, Study

CHIP_MM = 0.2
"""Width of a small LED chip, to say what a lens makes of it."""
INDEX_STEP = 0.01
"""How far off an index can easily be: a reflectance good to 0.001 gives it to 0.008."""


def findings(study: Study) -> list[tuple[str, str]]:
    """Headings and sentences, the most important first."""
    told = [("The signal", _signal(study)), ("Range", _range(study.case)), ("Light", _light(study))]
    sensor = study.case.sensor
    if isinstance(sensor.cut, OvalLens):
        told += [("Alignment", _alignment(study, sensor.cut)), ("Index", _index(sensor.cut, sensor.material.index))]
    return [*told, ("Not in these numbers", _limits(study))]


def headline(study: Study) -> str:
    """One sentence."""
    found = summary(study.case)
    start = f"{_signed(found['contrast_from'])} at {found['from_deg']:+g}°"
    if found["from_deg"] == found["to_deg"]:
        return f"The contrast between the two receivers is {start}."
    end = f"{_signed(found['contrast_to'])} at {found['to_deg']:+g}°"
    return f"The contrast between the two receivers runs from {start} to {end}."


def _signal(study: Study) -> str:
    found, sentences = summary(study.case), [headline(study)]
    if study.lens is None:
        sentences.append("This design has no lens.")
    elif study.flat is not None:
        flat = summary(study.flat)
        ends = f"{_signed(flat['contrast_from'])} to {_signed(flat['contrast_to'])}"
        sentences.append(f"Without the lens it runs from {ends}.")
    first, last = found["contrast_from"], found["contrast_to"]
    if first is not None and last is not None and first != last:
        side = "right" if first > last else "left"
        sentences.append(f"Turning to the right (a negative angle) brightens the {side} receiver.")
    return " ".join(sentences)


def _range(case: Case) -> str:
    found = summary(case)
    if not found["received_share"] > 0.0:
        return "No light reaches the receivers at any angle."
    if found["null_deg"] is None:
        return "Both receivers never see the same in this range: there is no balance point to measure from."
    balance = f"Both receivers see the same at {_zero(found['null_deg']):.2f}°"
    if found["slope_per_deg"] is not None:
        balance += f"; there the contrast changes by {abs(found['slope_per_deg']):.2g} per degree"
    if found["saturation_deg"] is None:
        return f"{balance}. It stays below {SATURATED} in this range."
    return (
        f"{balance}. About {found['saturation_deg']:.2f}° away it first exceeds {SATURATED}: where it does, the two "
        "signals tell the direction of the motion, but hardly its amplitude."
    )


def _light(study: Study) -> str:
    found, sensor = summary(study.case), study.case.sensor
    emitter, lens = sensor.design.emitter, sensor.cut
    half_cone_deg = sensor.light.cone_deg / 2
    text = f"On average {found['received_share']:.1%} of the emitted light reaches the receivers."
    if lens is None:
        return text
    if emitter.offset_mm == 0.0 and lens.acceptance_deg < half_cone_deg:
        text += (
            f" The face accepts ±{lens.acceptance_deg:.1f}° of the emitter's ±{half_cone_deg:g}°; "
            "the rest passes beside it."
        )
    if emitter.offset_mm == 0.0 and isinstance(lens, OvalLens) and lens.acceptance_deg <= half_cone_deg:
        text += (
            f" At the lens's edge light arrives at {lens.edge_incidence_deg():.1f}° to the normal: "
            "a rounded or rough edge costs light there first."
        )
    return text


def _alignment(study: Study, lens: OvalLens) -> str:
    offset_mm, spot_mm = study.design.emitter.offset_mm, CHIP_MM * lens.magnification
    place = f"{offset_mm:g} mm off the axis" if offset_mm else "exactly in its place"
    return (
        f"The lens magnifies {lens.magnification:.1f} times: moving the emitter by 0.01 mm across the axis moves the "
        f"focal spot by {0.01 * lens.magnification:.2f} mm, and a chip {CHIP_MM} mm wide makes a spot about "
        f"{spot_mm:.1f} mm wide. These numbers are for a point emitter {place}: a real LED gives a softer curve, and "
        "one that is glued on elsewhere a shifted one."
    )


def _index(lens: OvalLens, index: float) -> str:
    if abs(index - lens.design_index) > 1e-9:
        paraxial, marginal = lens.paraxial_focus_mm(index), lens.marginal_focus_mm(index)
        return (
            f"The lens is cut for {lens.design_index:.6g} but the material has {index:.6g}: rays near the axis cross "
            f"it {_focus(paraxial)}, edge rays {_focus(marginal)}, where {lens.focus_mm:g} mm was asked for."
        )
    low, high = (lens.paraxial_focus_mm(index + step) for step in (-INDEX_STEP, INDEX_STEP))
    return (
        f"If the print's index were {INDEX_STEP} lower, rays near the axis would cross it {_focus(low)}; "
        f"{INDEX_STEP} higher, {_focus(high)}. What that does to the response: "
        f"--set lens.design_index={lens.design_index:.6g} --set material.index={index + INDEX_STEP:.6g}."
    )


def _limits(study: Study) -> str:
    absorption = study.case.sensor.material.absorption_per_mm
    loss = (
        f"the material absorbs {absorption:g} per mm"
        if absorption > 0
        else "no absorption was given, so none is counted"
    )
    return (
        f"Rays in the plane only, whatever the thickness; perfectly smooth faces, no scatter, no diffraction; {loss}. "
        + _arms(study)
    )


def _arms(study: Study) -> str:
    if study.case.sensor.is_drawn:
        return "The outline is as drawn."
    angle = "assumed to continue the stem's edge" if study.design.body.arm_angle_deg is None else "as given"
    return f"The arms' angle is {angle}."


def _focus(focus_mm: float | None) -> str:
    return "nowhere behind the lens" if focus_mm is None else f"at {focus_mm:.1f} mm"


def _signed(value: float | None) -> str:
    return "no light" if value is None else f"{_zero(value):+.3f}"


def _zero(value: float) -> float:
    """The value, without the sign of a zero."""
    return 0.0 if abs(value) < 5e-4 else value
