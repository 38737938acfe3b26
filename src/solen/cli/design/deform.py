"""The command that shows a soft body under load, and the lines of a response under load."""

import math
from collections.abc import Iterator

from solen.cli.app import lines, short
from solen.pipeline.design.deform import deform as deform
from solen.sensor.loaded import Deformation, LoadedStudy
from solen.sensor.traced import value_text

MAX_ROWS = 12
ROUND_OFF = 1e-9
"""Threshold, relative to the largest value of the same quantity or in mm, below which a value is a rounding error."""


@lines.register
def _(result: Deformation) -> Iterator[str]:
    x, z = (_rounded(shift) for shift in result.shift_mm)
    newtons = max(math.hypot(*reaction.force_N) for reaction in result.reactions)
    moments = max(abs(reaction.moment_Nmm) for reaction in result.reactions)
    yield f"{result.name}, {result.drives} at {value_text(result)}"
    yield (f"  emitter and lens rotate by {result.turn_deg:+.4g} deg, move by {x:+.4g}, {z:+.4g} mm (x, z)")
    yield (f"  largest strain {result.strain_largest:.3g}; walls assumed vertical to within {result.bulge_mm:.2g} mm")
    for reaction in result.reactions:
        fx, fz = (_rounded(force, newtons) for force in reaction.force_N)
        x, z = (_rounded(at) for at in reaction.about_mm)
        about = f"{_rounded(reaction.moment_Nmm, moments):+.3g} N mm about {x:.3g}, {z:.3g}"
        yield f"  {reaction.name:12} {math.hypot(fx, fz):.3g} N (x {fx:+.3g}, z {fz:+.3g}), {about}"
    for touch in result.contacts:
        pushed = f"{touch.force_N:.3g} N along its push, up to {touch.pressure_MPa:.3g} MPa"
        yield f"  {touch.name}, {touch.depth_mm:.3g} mm beyond first contact, presses {touch.face} with {pushed}"


def _rounded(value: float, size: float = 1.0) -> float:
    """Return a number, or 0 if it is only a rounding error."""
    return value if abs(value) > ROUND_OFF * size else 0.0


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
    shown = {name: values for name, values in columns.items() if values is not None}
    yield f"{study.design.name}, against {study.drives}"
    yield "  " + "".join(f"{name:>10}" for name in shown)
    every = max(1, math.ceil(len(study.values) / MAX_ROWS))
    for row in range(0, len(study.values), every):
        cells = (short(values[row]) if name == "u" else f"{values[row]:.4g}" for name, values in shown.items())
        yield "  " + "".join(f"{cell:>10}" for cell in cells)
    yield "  volts: brighter is lower"
    if study.rigid_refused is not None:
        yield f"no rigid result: {study.rigid_refused}"
    if study.planes is not None:
        yield f"plane strain and plane stress differ by up to {study.planes.apart:.3f} in the contrast"
