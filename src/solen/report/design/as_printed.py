"""A lens as it was printed, beside the one that was asked for: numbers as plain data, and sentences.

A value that does not exist is None; every sentence is computed.
"""

import math
from typing import Any

import numpy as np

from solen.lens import MeasuredLens
from solen.report.plain import number
from solen.sensor import Comparison, Printed

RESOLVED = 2.0
"""How many times its uncertainty a difference must be to be told of as one."""


def measured_numbers(lens: MeasuredLens, index: float) -> dict[str, Any]:
    """What a measured lens is beside the designed one, how closely it is known, and where it focuses."""
    fit, spot = lens.fit, lens.best_spot(index)
    deviation, smooth, (low, high) = fit.deviation, fit.smooth, fit.reach_mm
    return {
        "profile_name": fit.profile.name,
        "edge": fit.profile.edge,
        "simulated": fit.profile.simulated,
        "points": int(fit.points[0].size),
        "measured_from_mm": low,
        "measured_to_mm": high,
        "u_um": fit.u_rms_um,
        "scatter_um": fit.scatter_um,
        "smoothed_parameters": smooth.parameters,
        "smoothed_over_mm": smooth.resolution,
        "smoothed_residual": smooth.residual,
        "u_correlation_mm": fit.correlation_mm,
        "u_normal_mrad": fit.u_slope_mrad,
        "deviation_rms_um": deviation.rms_um,
        "deviation_max_um": deviation.max_um,
        "deviation_max_x_mm": deviation.max_x_mm,
        "shift_x_um": deviation.shift_um[0],
        "shift_z_um": deviation.shift_um[1],
        "turn_mrad": deviation.turn_mrad,
        "deviation_rest_rms_um": deviation.rest_um,
        "design_index": lens.designed.design_index,
        "material_index": index,
        "focus_mm": lens.designed.focus_mm,
        "best_focus_mm": None if spot is None else spot.z_mm,
        "u_best_focus_mm": lens.u_best_focus_mm(index),
        "spot_rms_mm": None if spot is None else spot.rms_mm,
        "spot_x_mm": None if spot is None else spot.x_mm,
        "designed_best_focus_mm": lens.designed.best_focus_mm(index),
        "sources": [dict(source) for source in fit.profile.sources],
    }


def printed_numbers(found: Printed) -> dict[str, Any]:
    """What lies between the designed lens and the printed one, at some of the angles."""
    return {
        "told": found.told,
        "simulated": found.simulated,
        "draws": found.draws,
        "u_correlation_mm": found.lens.fit.correlation_mm,
        "emitter": _comparison(found.own),
        "chip": None if found.chip is None else _comparison(found.chip),
    }


def printed_summary(found: Printed) -> dict[str, Any]:
    """The few numbers of it that one asks for first."""
    left_out = ("angle_deg", "designed", "printed", "difference", "u_difference")
    numbers = {name: printed_numbers(found)[name] for name in ("emitter", "chip")}
    short = {
        name: None if one is None else {key: value for key, value in one.items() if key not in left_out}
        for name, one in numbers.items()
    }
    return {"told": found.told, "simulated": found.simulated, **short}


def _comparison(found: Comparison) -> dict[str, Any]:
    largest, (before, after) = found.largest, found.null_deg
    received = found.received
    at_largest = None
    if largest is not None:
        at_largest = {
            "angle_deg": float(found.designed.angle_deg[largest]),
            "difference": number(found.difference[largest]),
            "u": number(found.u_difference[largest]),
        }
    return {
        "width_mm": found.width_mm,
        "angle_deg": found.designed.angle_deg.tolist(),
        "designed": [number(value) for value in found.designed.contrast],
        "printed": [number(value) for value in found.printed.contrast],
        "difference": [number(value) for value in found.difference],
        "u_difference": [number(value) for value in found.u_difference],
        "largest": at_largest,
        "null_designed_deg": before,
        "null_printed_deg": after,
        "null_shift_deg": found.null_shift_deg,
        "u_null_shift_deg": found.u_null_deg,
        "received_designed": received[0],
        "received_printed": received[1],
    }


def printed_lines(found: Printed) -> list[str]:
    """What printing did to the lens and to the response, a sentence each."""
    deviation, fit = found.lens.fit.deviation, found.lens.fit
    more = "more" if deviation.max_um > 0.0 else "less"
    lines = [
        f"The lens {found.told} lies {deviation.rms_um:.3g} µm (root mean square) from the designed oval, at most "
        f"{abs(deviation.max_um):.3g} µm ({more} material, at x = {deviation.max_x_mm:.2f} mm); its points are known "
        f"to {fit.u_rms_um:.2g} µm and were smoothed over {fit.smooth.resolution:.2g} mm."
    ]
    for one in (found.own, found.chip):
        if one is not None:
            lines += _sentences(one)
    return lines


def _sentences(one: Comparison) -> list[str]:
    emitter = f"With a chip {one.width_mm:g} mm wide" if one.width_mm > 0.0 else "With a point for an emitter"
    if one.largest is None:
        return [f"{emitter} no light reaches the receivers."]
    difference, u = float(one.difference[one.largest]), float(one.u_difference[one.largest])
    at = f"{float(one.designed.angle_deg[one.largest]):+g}°"
    seen = "" if np.any(np.abs(one.difference) > RESOLVED * one.u_difference) else ", which is not resolved"
    told = [f"{emitter} the contrast differs by up to {_signed(difference, u)}, at {at}{seen}."]
    if one.null_shift_deg is not None and one.u_null_deg is not None:
        told.append(f"The balance point moves by {_signed(one.null_shift_deg, one.u_null_deg)}°.")
    before, after = one.received
    told.append(f"The receivers get {after:.2%} of the light, as designed {before:.2%}.")
    return [" ".join(told)]


def _signed(value: float, u: float) -> str:
    """A value and its uncertainty to two digits of that, no zero with a sign."""
    digits = int(np.clip(1 - math.floor(math.log10(u)), 0, 9)) if u > 0.0 else 4
    rounded = round(value, digits)
    return f"{rounded:{'+' if rounded else ''}.{digits}f} ± {u:.{digits}f}"
