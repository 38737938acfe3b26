"""What `solen print inspect` does: a picture of a printed lens laid on its design, from files to plain data and a figure."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from solen import files
from solen.curve import Curve
from solen.errors import DataError
from solen.geometry import Body
from solen.lens import OvalLens
from solen.metrology import Image, read_image
from solen.metrology.nominal import Ideal
from solen.metrology.comparison import Rival, cautions, nearest
from solen.metrology.outline import NamedEdge, Outline, measure
from solen.metrology.raster import check_vision
from solen.metrology.profile import front_profile
from solen.metrology.registration import Registration
from solen.pipeline.design.commands import open_design
from solen.pipeline.outputs import check_figure, check_out
from solen.plane import Rigid
from solen.sensor import Sensor
from solen.spec import Design, with_values

PAPER_INDICES = (1.44, 1.49, 1.54)
PAPER_MM = (1.0, 20.0, 2.0)
"""Emitter's distance, focus and half width of the paper's lenses."""
EDGE_BIAS_PX = 0.05
"""What uneven light and a camera's curve of grey values may shift an edge by: systematic, and not seen in scatter."""


def inspect(
    picture: Path,
    design: Path,
    assignments: Sequence[str] = (),
    *,
    um_per_px: float | None = None,
    u_um_per_px: float | None = None,
    against: Sequence[Path] = (),
    edge: str = "auto",
    figure: Path | None = None,
    out: Path | None = None,
) -> dict[str, Any]:
    """Outline of a printed lens from a picture, its deviations from the design, and the nearest of several designs.

    Parameters
    ----------
    picture
        Any file that `solen.metrology.read_image` takes.
    design
        The design file of the part.
    assignments
        ``key=value`` of the design.
    um_per_px, u_um_per_px
        Size of a pixel in µm and its standard uncertainty, in place of what the file says.
    against
        Other design files that the outline is compared with; without any, the paper's three indices where the design
        has the paper's lens.
    edge
        Which edge of a thick transparent part to take: ``auto``, ``outer``, ``inner``, ``sharper``.
    figure, out
        Where to draw the result, and where to write the measured profile.

    Raises
    ------
    SolenError
        Where the picture has no scale or shows no such lens, the design has none, or a file cannot be written.
    """
    check_figure(figure)
    check_out(out)
    check_vision("solen print inspect")
    one = open_design(design, assignments)
    ideal = ideal_of(one)
    others = _others(one, ideal, against)
    image = read_image(picture, um_per_px, u_um_per_px)
    outline = measure(image, ideal, edge)
    edge_px, u_scale = outline.chosen.edge, _u_scale(image)
    rivals = nearest(
        edge_px.points_px[edge_px.kept], edge_px.u_px[edge_px.kept], outline.chosen.registration.pose, others, u_scale
    )
    found = _told(image, one, outline, rivals)
    contents: dict[Path, files.Content] = {}
    if out is not None:
        contents[out] = front_profile(outline, image, one.name, found["warnings"]).encode()
    if figure is not None:
        from solen.report import canvas
        from solen.report.print.inspect import inspect_figure

        drawn = inspect_figure(image, outline, ideal, rivals)
        contents[figure] = canvas.encoded(drawn, figure.suffix.lower(), "inspect")
    files.write_all(contents)
    written = (("out", out), ("figure", figure))
    return found | {name: str(path) for name, path in written if path is not None}


LOWEST_OF = 2001
"""Points among which the lowest of a drawn front is sought: its vertex."""


def ideal_of(design: Design, name: str | None = None) -> Ideal:
    """Front that a design asks for, with the walls beside it; `DataError` where it has no lens of a known front."""
    sensor = Sensor.of(design)
    name = name or design.name
    if sensor.is_drawn:
        return _drawn(name, sensor.body())
    if not sensor.has_lens:
        raise DataError(name, limit="has no lens to compare a picture with", remedy="inspect a design with a lens")
    body = sensor.body()
    walls = {face.name: face.curve for face in body.all_faces}
    left, right = (walls.get(f"stem-{side}") for side in ("left", "right"))
    front = sensor.lens.front
    beside: list[Curve | None] = []
    for wall, end in ((left, front.start), (right, front.end)):
        if wall is None:
            beside.append(None)
            continue
        near = np.hypot(*np.subtract(wall.start, end)) <= np.hypot(*np.subtract(wall.end, end))
        beside.append(wall if near else wall.reversed())
    return Ideal.of(name, front, *beside)


def _drawn(name: str, body: Body) -> Ideal:
    """Front of a drawn body: its one face that is called lens, turned and moved to where that of a Y lies."""
    fronts = [face for face in body.all_faces if face.part == "lens"]
    if len(fronts) != 1:
        limit = f"has {len(fronts)} faces called lens; one is needed to compare a picture with"
        raise DataError(name, limit=limit, remedy="draw the front as one path on a layer called lens")
    curve = fronts[0].curve
    (x0, z0), (x1, z1) = curve.start, curve.end
    level = curve.moved(Rigid.about((x0, z0), -math.degrees(math.atan2(z1 - z0, x1 - x0))))
    lowest = float(level.points(np.linspace(0.0, 1.0, LOWEST_OF))[:, 1].min())
    middle = 0.5 * (level.start[0] + level.end[0])
    return Ideal.of(name, level.moved(Rigid(shift=(-middle, -lowest))))


def _others(design: Design, ideal: Ideal, against: Sequence[Path]) -> list[Ideal]:
    """The designs to compare with, the design's own first."""
    if against:
        others = []
        for path in against:
            other = open_design(path)
            others.append(ideal_of(other, other.name if other.name != design.name else path.stem))
        return _distinct([ideal, *others])
    lens = Sensor.of(design).cut
    if not isinstance(lens, OvalLens) or (lens.distance_mm, lens.focus_mm, lens.half_width_mm) != PAPER_MM:
        return [ideal]
    papers = []
    for index in PAPER_INDICES:
        changed = with_values(design, {"lens.design_index": index})
        papers.append(ideal_of(changed, f"n = {index}"))
    known = [index for index in PAPER_INDICES if abs(index - lens.design_index) < 1e-9]
    return papers if known else [Ideal(f"n = {lens.design_index:.6g}", *_lines(ideal)), *papers]


def _lines(ideal: Ideal) -> tuple[Any, Any, Any]:
    return ideal.front_mm, ideal.left_mm, ideal.right_mm


def _distinct(ideals: list[Ideal]) -> list[Ideal]:
    """The same with a number behind names that two of them have."""
    seen: dict[str, int] = {}
    found = []
    for one in ideals:
        seen[one.name] = seen.get(one.name, 0) + 1
        again = seen[one.name]
        found.append(one if again == 1 else Ideal(f"{one.name} ({again})", *_lines(one)))
    return found


def _u_scale(image: Image) -> float:
    """Relative standard uncertainty of the scale; 0 where nobody states one."""
    return 0.0 if image.scale.u_um_per_px is None else image.scale.u_um_per_px / image.um_per_px


def _told(image: Image, design: Design, outline: Outline, rivals: Sequence[Rival]) -> dict[str, Any]:
    chosen = outline.chosen
    laid = chosen.registration
    return {
        "design": design.name,
        "um_per_px": image.um_per_px,
        "scale": image.scale.as_dict(),
        "edge": chosen.name,
        "rotation_deg": (laid.pose.rotation_deg + 180.0) % 360.0 - 180.0,
        "u_rotation_deg": float(np.hypot(laid.u_rotation_deg, _bias_deg(laid, image))),
        "vertex_px": list(laid.pose.vertex_px),
        "u_shift_um": [float(np.hypot(u, EDGE_BIAS_PX * image.um_per_px)) for u in laid.u_shift_um],
        "mirrored": laid.pose.mirrored,
        "blur_px": chosen.edge.blur,
        "contrast": chosen.edge.contrast,
        "points_used": len(laid.off_um),
        "points_rejected": {reason: count for reason, count in chosen.edge.rejected.items() if count},
        "seen": outline.seen,
        "measured_x_mm": list(outline.ends_x_mm),
        "deviation_um": deviation(chosen, image),
        "width_mm": outline.width_mm,
        "scale_check": {
            "factor": laid.scale_factor,
            "u_factor": laid.u_scale_factor,
            "note": "factor by which the outline would have to grow to lie best on the design; it is not applied, as "
            "an error of scale and one of curvature look alike",
        },
        "nearest": rivals[0].name,
        "likelihood": {rival.name: _rival(rival) for rival in rivals},
        "edges": [_edge(one, outline.chosen) for one in outline.edges],
        "outline_mm": np.round(laid.points_mm, 7).tolist(),
        "outline_deviation_um": np.round(laid.off_um, 4).tolist(),
        "outline_u_um": np.round(laid.u_um, 4).tolist(),
        "simulated": image.provenance.simulated,
        "sources": [image.provenance.as_dict()],
        "warnings": [*image.warnings, *outline.warnings, *_about(image, laid), *cautions(rivals, _u_scale(image))],
    }


def _bias_deg(laid: Registration, image: Image) -> float:
    """Rotation that an edge's bias, of one sign on the left and of the other on the right, makes."""
    return float(np.degrees(2e-3 * EDGE_BIAS_PX * image.um_per_px / max(np.ptp(laid.points_mm[:, 0]), 1e-9)))


def deviation(chosen: NamedEdge, image: Image) -> dict[str, Any]:
    """Numbers of the deviations in µm, positive where the print stands out of the design, with their uncertainty.

    The root mean square of a perfect print would be that of the edges' own scatter: ``rms_beyond_noise`` is without
    it, and ``u_rms`` reaches that far. The largest of many deviations is the one that scatter made largest: the
    interval of the maximum holds for all places at once.
    """
    laid = chosen.registration
    off, u_scale = laid.off_um, _u_scale(image)
    scatter_um = chosen.edge.u_px[chosen.edge.kept][laid.used] * image.um_per_px
    bias = EDGE_BIAS_PX * image.um_per_px
    rms = laid.rms_um
    by_scale = float(np.mean(off * laid.by_scale_um)) / max(rms, 1e-9)
    noise = float(np.sqrt(np.mean(laid.u_um**2) / max(laid.independent, 1.0)))
    worst = int(np.argmax(np.abs(off)))
    u_max = float(np.hypot(laid.u_um[worst], bias))
    beyond = float(np.sqrt(max(rms**2 - float(np.mean(scatter_um**2)), 0.0)))
    of_all = float(ndtri(1.0 - 0.025 / len(off)))
    return {
        "rms": rms,
        "u_rms": float(np.sqrt(noise**2 + (by_scale * u_scale) ** 2 + bias**2 + (rms - beyond) ** 2)),
        "rms_beyond_noise": beyond,
        "max": float(off[worst]),
        "u_max": u_max,
        "max_interval95": [float(off[worst]) - of_all * u_max, float(off[worst]) + of_all * u_max],
        "max_at_x_mm": float(laid.points_mm[worst, 0]),
        "mean": float(np.mean(off)),
        "highest": float(off.max()),
        "lowest": float(off.min()),
        "p95": float(np.quantile(np.abs(off), 0.95)),
        "u": float(np.hypot(np.sqrt(np.mean(laid.u_um**2)), bias)),
        "rms_per_percent_of_scale": 0.01 * float(np.sqrt(np.mean(laid.by_scale_um**2))),
        "independent_values": laid.independent,
    }


def _rival(rival: Rival) -> dict[str, Any]:
    return {
        "probability": rival.probability,
        "rms_um": rival.registration.rms_um,
        "scale_factor": rival.scale_factor,
        "rms_um_at_that_scale": rival.scaled_rms_um,
    }


def _edge(one: NamedEdge, chosen: NamedEdge) -> dict[str, Any]:
    laid = one.registration
    return {
        "name": one.name,
        "chosen": one is chosen,
        "in_focus": one.sharpest,
        "blur_px": one.edge.blur,
        "contrast": one.edge.contrast,
        "points_used": len(laid.off_um),
        "deviation_um": {"rms": laid.rms_um, "mean": float(np.mean(laid.off_um))},
        "outwards_of_chosen_um": _gap_um(one, chosen),
    }


def _gap_um(one: NamedEdge, chosen: NamedEdge) -> float | None:
    """Median distance from the chosen edge, positive outwards; None where they share no place."""
    both = one.edge.kept & chosen.edge.kept
    if one is chosen or not both.any():
        return 0.0 if one is chosen else None
    px = np.sum((one.edge.points_px - chosen.edge.points_px) * chosen.edge.normals, axis=1)[both]
    return float(np.median(px)) * chosen.registration.pose.um_per_px


def _about(image: Image, laid: Registration) -> list[str]:
    """What the scale leaves open."""
    found = []
    percent = 0.01 * float(np.sqrt(np.mean(laid.by_scale_um**2)))
    if image.scale.u_um_per_px is None:
        found.append(
            f"no uncertainty of the scale is stated (--u-um-per-px), so none is in the deviations: 1 % of it changes "
            f"them by {percent:.2g} µm (rms)"
        )
    off = abs(laid.scale_factor - 1.0)
    if off > 0.01 and off > 3.0 * laid.u_scale_factor:
        found.append(
            f"the outline would lie better on the design were it {100.0 * (laid.scale_factor - 1.0):+.2f} % larger: "
            "the scale is off, or the print's curvature, or it lies tilted; this picture cannot tell which"
        )
    return found


__all__ = ["deviation", "ideal_of", "inspect"]
