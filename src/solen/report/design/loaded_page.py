"""The report of a soft body under load: its response, its shape, and the assumptions about it."""

from solen.fabricate import SolidFiles
from solen.geometry.displaced import GROUND
from solen.mechanics.design import LoadedState, material_of
from solen.report.design.html import NO_SOLID, page
from solen.report.design.loaded import columns, ends_of, forces
from solen.report.design.summary import measured
from solen.sensor.loaded import LoadedStudy
from solen.spec import Design
from solen.spec.soft import Press

ENDS = (0, -1)
REACTIONS = ("on the body", "force x (N)", "force z (N)", "moment (N mm)", "about x (mm)", "z (mm)")
ALWAYS = [
    ("Time", "No delay: the body springs back at once and follows every load immediately."),
    ("Rest", "The body at rest has the drawn shape and is free of stress; weight and shrinkage are neglected."),
    ("Index", "Strain does not change it."),
    ("Touching itself", "A design whose walls would touch is rejected."),
]
"""Assumptions made about every soft body."""


def html(study: LoadedStudy, drawn: dict[str, str], solid: SolidFiles = NO_SOLID) -> str:
    """Return the HTML text of the report with the figures of `solen.report.design.loaded`, and links to the solid."""
    table = columns(study)
    first, last = ends_of(study)
    return page(
        "loaded.html",
        study,
        drawn,
        solid,
        lead=f"a soft body under load, from {study.drives} = {first} to {last}",
        expected=expected(study),
        has_forces=forces(study) is not None,
        last=f"{study.drives} = {last}",
        reactions=[REACTIONS, *_reactions(study.states[-1])],
        assumed=assumed(study.design),
        table=table,
        rows=list(zip(*(values.tolist() for values in table.values()), strict=True)),
    )


def expected(study: LoadedStudy) -> list[tuple[str, str]]:
    """Return the response in words, by heading."""
    contrasts = [measured(float(study.contrast[i]), float(study.u_contrast[i])) for i in ENDS]
    rows = [("contrast", _at_ends(study, contrasts)), ("were it rigid", _rigid(study))]
    if study.planes is not None and study.planes.apart is not None:
        spread = f"plane strain and plane stress differ by up to {study.planes.apart:.3f} in the contrast"
        rows.append(("model", f"{spread}; a real part is between the two"))
    if (driven := forces(study)) is not None:
        across, along, label_x, label_y = driven
        unit = label_x.partition("(")[2].rstrip(")")
        rows.append(("load", f"{label_y}: " + ", ".join(f"{along[i]:+.3g} at {across[i]:.3g} {unit}" for i in ENDS)))
    for name, volts in zip(study.receivers, study.voltage_V.T, strict=True):
        rows.append((f"{name} receiver", _at_ends(study, [f"{volts[i]:.3f} V" for i in ENDS])))
    return [*rows, ("shape", _shape(study))]


def assumed(design: Design) -> list[tuple[str, str]]:
    """Return the assumptions about a design's body, by heading."""
    material, plane, emitter_on = material_of(design), design.mechanics.plane, design.motion.emitter_on
    along_y = "there is no displacement along y" if plane == "strain" else "the body is free to move along y"
    model = f"{material.kind}, shear modulus {material.shear_modulus_MPa:.3g} MPa, Poisson's ratio {material.poisson:g}"
    held = dict.fromkeys(f"{hold.name} ({hold.face}, {hold.kind})" for hold in design.hold)
    rows = [
        (
            "Plane",
            f"Plane {plane}: {along_y}, and walls stay vertical. The body is {design.body.thickness_mm:g} mm thick.",
        ),
        ("Material", f"{model}, uniform."),
        ("Holds", f"{', '.join(held)}, and nothing else."),
        ("Emitter", "Stands still." if emitter_on == GROUND else f"Goes with {emitter_on}."),
    ]
    if design.press:
        rows.append(("Fingers", f"Rigid, round and without friction: {', '.join(map(_finger, design.press))}."))
    if design.pull:
        rows.append(("Pulls", "Their direction is fixed in space while the body rotates."))
    return rows + ALWAYS


def _at_ends(study: LoadedStudy, texts: list[str]) -> str:
    pairs = zip(texts, ends_of(study), strict=True)
    return ", ".join(dict.fromkeys(f"{text if text != 'none' else 'no light'} at {where}" for text, where in pairs))


def _rigid(study: LoadedStudy) -> str:
    if study.rigid_contrast is None:
        return f"not available: {study.rigid_refused}"
    texts = [measured(round(float(study.rigid_contrast[i]), 3), None) for i in ENDS]
    return f"{_at_ends(study, texts)}: the lens turned by the same angle, on a body that does not deform"


def _shape(study: LoadedStudy) -> str:
    bulge_mm = max(state.deformed.bulge_mm for state in study.states)
    strain = 100.0 * float(abs(study.strain_largest).max())
    return (
        f"strains up to {strain:.2g} %, rotations up to {float(abs(study.lens_turn_deg).max()):.2g}°; walls assumed "
        f"upright, to {bulge_mm:.1g} mm, and within about {float(study.off_mm.max()):.1g} mm of the elements"
    )


def _finger(press: Press) -> str:
    """Describe a finger and the optical medium at its contact."""
    skin = "dry" if press.index is None else f"of index {press.index:g}"
    back = "its back free" if press.backing is None else f"backed at {press.backing}"
    return f"{press.name} ({press.face}, radius {press.radius_mm:g} mm, {skin}, {back})"


def _reactions(state: LoadedState) -> list[tuple[str | float, ...]]:
    return [
        (reaction.name, *reaction.force_N, reaction.moment_Nmm, *reaction.about_mm)
        for reaction in state.deformed.reactions
    ]
