"""The report on a soft body under load: its response, its shape, and the assumptions."""

from solen.fabricate import SolidFiles
from solen.geometry.displaced import GROUND
from solen.mechanics.design import LoadedState, material_of
from solen.report.design.html import NO_SOLID, page
from solen.report.design.loaded import columns, end_values, load_curve
from solen.report.design.summary import measured
from solen.sensor.loaded import LoadedStudy
from solen.spec import Design
from solen.spec.soft import Press

ENDS = (0, -1)
REACTIONS = ("on the body", "force x (N)", "force z (N)", "moment (N mm)", "about x (mm)", "z (mm)")
GENERAL_ASSUMPTIONS = [
    ("Time", "The body is elastic and follows every load immediately, without delay or creep."),
    ("Rest", "The body at rest has the drawn shape and is free of stress; weight and shrinkage are neglected."),
    ("Index", "Strain does not change the refractive index."),
    ("Self-contact", "A design whose walls would touch each other is rejected."),
]
"""Assumptions made for every soft body."""


def html(study: LoadedStudy, drawn: dict[str, str], solid: SolidFiles = NO_SOLID) -> str:
    """Return the HTML text of the report with the figures of `solen.report.design.loaded`, and links to the solid."""
    table = columns(study)
    first, last = end_values(study)
    return page(
        "loaded.html",
        study,
        drawn,
        solid,
        lead=f"a soft body under load, from {study.drives} = {first} to {last}",
        expected=expected(study),
        has_forces=load_curve(study) is not None,
        last=f"{study.drives} = {last}",
        reactions=[REACTIONS, *_reactions(study.states[-1])],
        assumptions=assumptions(study.design),
        table=table,
        rows=list(zip(*(values.tolist() for values in table.values()), strict=True)),
    )


def expected(study: LoadedStudy) -> list[tuple[str, str]]:
    """Return headings and sentences on the expected response."""
    contrasts = [measured(float(study.contrast[i]), float(study.u_contrast[i])) for i in ENDS]
    rows = [("contrast", _at_ends(study, contrasts)), ("as a rigid body", _rigid(study))]
    if study.planes is not None and study.planes.apart is not None:
        difference = f"the contrasts in plane strain and plane stress differ by up to {study.planes.apart:.3f}"
        rows.append(("model", f"{difference}; a real part is between the two"))
    if (load := load_curve(study)) is not None:
        x, y, label_x, label_y = load
        unit = label_x.partition("(")[2].rstrip(")")
        rows.append(("load", f"{label_y}: " + ", ".join(f"{y[i]:+.3g} at {x[i]:.3g} {unit}" for i in ENDS)))
    for name, volts in zip(study.receivers, study.voltage_V.T, strict=True):
        rows.append((f"{name} receiver", _at_ends(study, [f"{volts[i]:.3f} V" for i in ENDS])))
    return [*rows, ("shape", _shape(study))]


def assumptions(design: Design) -> list[tuple[str, str]]:
    """Return headings and sentences on the assumptions about the body of a design."""
    material, plane, emitter_on = material_of(design), design.mechanics.plane, design.motion.emitter_on
    along_y = "there is no displacement along y" if plane == "strain" else "the body is free to deform along y"
    model = f"{material.kind}, shear modulus {material.shear_modulus_MPa:.3g} MPa, Poisson's ratio {material.poisson:g}"
    holds = dict.fromkeys(f"{hold.name} ({hold.face}, {hold.kind})" for hold in design.hold)
    thickness = f"The body is {design.body.thickness_mm:g} mm thick."
    rows = [
        ("Plane", f"Plane {plane}: {along_y}, and walls remain vertical. {thickness}"),
        ("Material", f"{model}, uniform."),
        ("Holds", f"Only {', '.join(holds)}."),
        ("Emitter", "Stationary." if emitter_on == GROUND else f"Moves with {emitter_on}."),
    ]
    if design.press:
        rows.append(("Fingers", f"Rigid, round and frictionless: {', '.join(map(_finger, design.press))}."))
    if design.pull:
        rows.append(("Pulls", "Their direction remains fixed in space if the body rotates."))
    return rows + GENERAL_ASSUMPTIONS


def _at_ends(study: LoadedStudy, texts: list[str]) -> str:
    pairs = zip(texts, end_values(study), strict=True)
    return ", ".join(dict.fromkeys(f"{text if text != 'none' else 'no light'} at {value}" for text, value in pairs))


def _rigid(study: LoadedStudy) -> str:
    if study.rigid_contrast is None:
        return f"not available: {study.rigid_refused}"
    texts = [measured(round(float(study.rigid_contrast[i]), 3), None) for i in ENDS]
    return f"{_at_ends(study, texts)}: with the lens turned by the same angle, on a body that does not deform"


def _shape(study: LoadedStudy) -> str:
    bulge_mm = max(state.deformed.bulge_mm for state in study.states)
    strain = 100.0 * float(abs(study.strain_largest).max())
    rotation_deg = float(abs(study.lens_turn_deg).max())
    return (
        f"strains up to {strain:.2g} %, rotations up to {rotation_deg:.2g}°; errors of the shape: {bulge_mm:.1g} mm "
        "since walls are assumed to remain vertical, and about "
        f"{float(study.off_mm.max()):.1g} mm from the finite elements"
    )


def _finger(press: Press) -> str:
    """Return a description of a finger, of the optical contact, and of the support behind the finger's face."""
    contact = "dry" if press.index is None else f"index {press.index:g}"
    backing = "no support behind" if press.backing is None else f"supported at {press.backing}"
    return f"{press.name} ({press.face}, radius {press.radius_mm:g} mm, {contact}, {backing})"


def _reactions(state: LoadedState) -> list[tuple[str | float, ...]]:
    return [
        (reaction.name, *reaction.force_N, reaction.moment_Nmm, *reaction.about_mm)
        for reaction in state.deformed.reactions
    ]
