"""The command for a soft body under load, and the printed lines of a response under load."""

import math
from collections.abc import Iterator

from solen.cli.app import lines, short
from solen.pipeline.design.deform import deform as deform
from solen.sensor.loaded import Deformation, LoadedStudy
from solen.sensor.traced import value_text

MAX_ROWS = 12
ROUND_OFF = 1e-9
"""Largest rounding error: relative to the largest value of the same quantity, or in mm for a length."""


@lines.register
def _(result: Deformation) -> Iterator[str]:
    x, z = map(_rounded, result.shift_mm)
    max_force = max(math.hypot(*reaction.force_N) for reaction in result.reactions)
    max_moment = max(abs(reaction.moment_Nmm) for reaction in result.reactions)
    yield f"{result.name}, {result.drives} at {value_text(result)}"
    yield f"  emitter and lens rotate by {result.turn_deg:+.4g} deg and move by {x:+.4g}, {z:+.4g} mm (x, z)"
    yield f"  largest strain {result.strain_largest:.3g}; bulge of the walls, neglected: {result.bulge_mm:.2g} mm"
    for reaction in result.reactions:
        fx, fz = (_rounded(force, max_force) for force in reaction.force_N)
        x, z = map(_rounded, reaction.about_mm)
        moment = f"{_rounded(reaction.moment_Nmm, max_moment):+.3g} N mm about {x:.3g}, {z:.3g}"
        yield f"  {reaction.name:12} {math.hypot(fx, fz):.3g} N (x {fx:+.3g}, z {fz:+.3g}), {moment}"
    for contact in result.contacts:
        force = f"{contact.force_N:.3g} N in its direction of motion and up to {contact.pressure_MPa:.3g} MPa"
        depth = f"{contact.depth_mm:.3g} mm after first contact"
        yield f"  {contact.name}, {depth}, presses on {contact.face} with {force}"


def _rounded(value: float, scale: float = 1.0) -> float:
    """Return a number, or 0 if it is only a rounding error."""
    return value if abs(value) > ROUND_OFF * scale else 0.0


@lines.register
def _(study: LoadedStudy) -> Iterator[str]:
    columns = {
        "deg": study.angle_deg,
        "mm": study.depth_mm,
        "N": study.force_N,
        "N mm": study.moment_Nmm,
        "turn deg": study.turn_deg,
        "contrast": study.contrast,
        "u": study.u_contrast,
        "rigid": study.rigid_contrast,
        **{f"{name} V": study.voltage_V[:, i] for i, name in enumerate(study.receivers)},
    }
    table = {name: values for name, values in columns.items() if values is not None}
    yield f"{study.design.name}, against {study.drives}"
    yield "  " + "".join(f"{name:>10}" for name in table)
    step = max(1, math.ceil(len(study.values) / MAX_ROWS))
    for row in range(0, len(study.values), step):
        cells = (short(values[row]) if name == "u" else f"{values[row]:.4g}" for name, values in table.items())
        yield "  " + "".join(f"{cell:>10}" for cell in cells)
    yield "  V: more light gives a lower voltage"
    if study.rigid_refused is not None:
        yield f"no rigid result: {study.rigid_refused}"
    if study.planes is not None:
        yield f"the contrasts in plane strain and plane stress differ by up to {study.planes.apart:.3f}"
