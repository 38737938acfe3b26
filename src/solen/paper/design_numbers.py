"""Sizes of shipped designs, coupons and parts, for comparison with the sizes reported in the paper.

Body sizes are measured on the outline and not read from the design, which also checks the geometry.

Public names: `body_sizes`, `u_major_base_mm`, `lens_sizes`, `source_of`, `pivot_deviation_mm`, `settings_of_print`,
`size_of`, `wavelength_nm`, `coupon_sizes` and `peak_nm`.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from solen.curve import ArcLength
from solen.fabricate.process.process_file import default_process
from solen.geometry.coupons import Coupon, layout
from solen.paper.statements import statements
from solen.parts.datasheet import EmitterPart, ReceiverPart, library_part
from solen.parts.printer import library_printer
from solen.plane import Point
from solen.sensor import Sensor

RESOLUTION = ("group-a", "group-b", "group-c", "holes", "z-reference")


def body_sizes(sensor: Sensor) -> dict[str, float]:
    """Return the sizes of a Y-shaped body in mm, between the corners of its undeformed outline."""
    body = sensor.body()
    lens, stem = body.face("lens").curve, body.face("stem-right").curve
    fork, base = body.marks["fork-right"], body.marks["stem-base"]
    length = fork[1] - base[1]
    return {
        "stem-length": length,
        "stem-curve": (abs(fork[0]) - abs(stem.start[0])) / length**2,
        "minor-base": math.dist(lens.start, lens.end),
        "major-base": math.dist(fork, body.marks["fork-left"]),
        "arm-length": ArcLength(body.face("outer-right").curve).length_mm,
        "arm-width": ArcLength(body.face("receiver-right").curve).length_mm,
    }


def u_major_base_mm(sizes: Mapping[str, float]) -> float:
    """Return the standard uncertainty of the width at the fork, from the last digits of the reported dimensions."""
    base, curve, length = (statements()[key].u_value for key in ("minor-base", "stem-curve", "stem-length"))
    length_mm = sizes["stem-length"]
    return math.hypot(base, 2.0 * length_mm**2 * curve, 4.0 * sizes["stem-curve"] * length_mm * length)


def lens_sizes(sensor: Sensor) -> dict[str, float]:
    """Return the half width of a lens and the distance of its vertex from the emitter, in mm."""
    body = sensor.body()
    lens = body.face("lens").curve
    ends = [lens.start[0], lens.end[0]]
    vertex = min(float(point[1]) for point in lens.points(np.linspace(0.0, 1.0, 201)))
    return {"lens-width": 0.5 * (max(ends) - min(ends)), "emitter-distance": vertex - body.emitter.point[1]}


def source_of(sensor: Sensor) -> dict[str, float]:
    """Return the number of rays, the cone in degrees and the wavelength in nm of a design's emitter."""
    emitter = sensor.design.emitter
    return {"rays": float(emitter.rays), "cone": emitter.cone_deg, "wavelength": emitter.wavelength_nm}


def pivot_deviation_mm(sensor: Sensor, angle_deg: float) -> float:
    """Return the distance from the centre of rotation of a lens to the centre of the stem's minor base."""
    at_rest, turned = (sensor.body(angle).face("lens").curve for angle in (0.0, angle_deg))
    return math.dist(
        _fixed_point((at_rest.start, at_rest.end), (turned.start, turned.end)), _middle(at_rest.start, at_rest.end)
    )


def _middle(a: Point, b: Point) -> Point:
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])


def _fixed_point(before: Sequence[Point], after: Sequence[Point]) -> Point:
    """Return the fixed point b / (1 − a) of the rotation w = a z + b, in complex numbers, that maps two points."""
    (p, q), (v, w) = ([complex(*point) for point in points] for points in (before, after))
    a = (w - v) / (q - p)
    centre = (v - a * p) / (1.0 - a)
    return centre.real, centre.imag


def settings_of_print() -> dict[str, float]:
    """Return the layer exposure, the burn-in exposure, and the number of burn-in layers in the default process."""
    settings = default_process().process
    return {
        "layer-exposure": settings.exposure_s,
        "burn-in-exposure": settings.burn_in_s,
        "burn-in-layers": float(settings.burn_in_layers),
    }


def size_of(coupon: str, kind: str) -> float:
    """Return the diameter or side in mm of the first feature of a kind."""
    return next(feature for feature in layout(coupon).features if feature.kind == kind).diameter_mm


def wavelength_nm(printer: str) -> float | None:
    """Return the wavelength of a printer's light, or None if the printer file does not specify it."""
    light = library_printer(printer).wavelength_nm
    return None if light is None else light.nominal


def coupon_sizes() -> dict[str, float]:
    """Return the sizes in mm of the printing-resolution coupons, and their feature counts."""
    a, b, c, holes, reference = map(layout, RESOLUTION)
    diameters, gaps = _diameters(a, "pillar"), sorted(gap.gap_mm for gap in b.gaps)
    steps = sorted({round(step.step_mm, 6) for step in c.steps})
    heights, bores = [pillar.height_mm for pillar in c.of_kind("pillar")], _diameters(holes, "hole")
    return {
        "group-a-number": float(len(diameters)),
        "group-a-largest": diameters[-1],
        "group-a-smallest": diameters[0],
        "group-a-height": _pillar_height(a),
        "group-base": _slab_thickness(a),
        "group-b-number": float(len(gaps)),
        "group-b-largest": gaps[-1],
        "group-b-smallest": gaps[0],
        "group-b-diameter": b.of_kind("pillar")[0].diameter_mm,
        "group-c-diameter": c.of_kind("pillar")[0].diameter_mm,
        "group-c-lowest": min(heights),
        "group-c-highest": max(heights),
        **{f"group-c-step-{number}": step for number, step in zip("123", reversed(steps), strict=True)},
        "holes-number": float(len(holes.of_kind("hole"))),
        "holes-smallest": bores[0],
        "holes-largest": bores[-1],
        "holes-step": float(np.min(np.diff(np.unique(bores)))),
        "holes-length": holes.size_mm[0],
        "holes-width": holes.size_mm[1],
        "holes-thickness": _slab_thickness(holes),
        **_reference(reference),
    }


def _reference(coupon: Coupon) -> dict[str, float]:
    """Return the sizes of the slab whose pillars differ in height by one layer."""
    pillars = sorted(coupon.of_kind("pillar"), key=lambda pillar: pillar.height_mm)
    names = ("lowest", "middle", "highest")
    return {
        "reference-length": coupon.size_mm[0],
        "reference-width": coupon.size_mm[1],
        "reference-thickness": _slab_thickness(coupon),
        "reference-pillar": pillars[0].width_mm,
        **{f"reference-{name}": pillar.height_mm for name, pillar in zip(names, pillars, strict=True)},
    }


def _diameters(coupon: Coupon, kind: str) -> list[float]:
    return sorted(feature.diameter_mm for feature in coupon.features if feature.kind == kind)


def _pillar_height(coupon: Coupon) -> float:
    return coupon.of_kind("pillar")[0].height_mm


def _slab_thickness(coupon: Coupon) -> float:
    return 0.0 if coupon.slab is None else coupon.slab.thickness_mm


def peak_nm(part: str) -> tuple[float, float]:
    """Return the peak wavelength of a part with its standard uncertainty; for a spectrum, from its highest points."""
    sheet = library_part(part)
    if isinstance(sheet, EmitterPart):
        return sheet.peak_nm.nominal, 0.0
    if isinstance(sheet, ReceiverPart) and sheet.spectrum is not None:
        nm, peak = sheet.spectrum.wavelength_nm, int(np.argmax(sheet.spectrum.relative))
        near = nm[max(peak - 1, 0) : peak + 2]
        return nm[peak], (max(near) - min(near)) / math.sqrt(12.0)
    raise ValueError(f"{part} has no peak wavelength")
