"""Fidelity of a printed coupon: a picture or z map in; sizes, the smallest resolved ones and a figure out."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from solen.errors import SpecError
from solen.fabricate.coupons import read_job
from solen.geometry.coupons import Coupon, CouponOptions, layout
from solen.metrology import read_image
from solen.metrology.coupons import Fidelity, Limit, Measured, measure
from solen.metrology.zmap import is_text, read_z_map
from solen.pipeline.outputs import check_figure, check_out, leave
from solen.spec.toml import parse_assignment

CALIBRATES = ("pillar", "hole", "gap", "step")


def fidelity(
    path: Path,
    coupon: str | None = None,
    *,
    job: Path | None = None,
    um_per_px: float | None = None,
    u_um_per_px: float | None = None,
    z_um: float | None = None,
    assignments: Sequence[str] = (),
    figure: Path | None = None,
    out: Path | None = None,
) -> dict[str, Any]:
    """Sizes of a printed coupon from its picture or z map, and the smallest features that are resolved.

    Parameters
    ----------
    path
        Picture, or with ``z_um`` a z map.
    coupon
        Name of the coupon; a job tells it by itself.
    job
        Job file of the coupon; by default the coupon is laid out with ``assignments``.
    um_per_px, u_um_per_px
        Size of a pixel and its standard uncertainty, where the file does not say them.
    z_um
        Height of one level of a z map.
    assignments
        ``key=value`` of the coupon's parameters, where there is no job.
    figure, out
        Where to draw the result, and where to write it.

    Raises
    ------
    SolenError
        Where the files cannot be read, or the coupon is not found in the picture.
    """
    check_figure(figure)
    check_out(out)
    chosen = _chosen(coupon, job, assignments)
    if z_um is None and is_text(path):
        raise SpecError("--z-um", limit="is missing: a table of numbers is a z map", remedy="give µm for one unit")
    warnings: tuple[str, ...]
    if z_um is None:
        image = read_image(path, um_per_px, u_um_per_px)
        grey, scale, source, warnings = image.grey, image.scale, image.provenance, image.warnings
        found = measure(grey, scale, chosen, ceiling=image.ceiling, what=str(path))
    else:
        z_map = read_z_map(path, z_um, um_per_px, u_um_per_px)
        grey, scale, source, warnings = z_map.grey, z_map.scale, z_map.provenance, z_map.warnings
        found = measure(grey, scale, chosen, z_mm=z_map.z_mm, what=str(path))
    data = {
        "coupon": chosen.name,
        "simulated": source.simulated,
        "image": "picture" if z_um is None else "z map",
        "um_per_px": scale.um_per_px,
        "scale": scale.as_dict(),
        "minimum": {limit.kind: _limit(limit) for limit in found.limits},
        "features": [
            _told(one, chosen) for one in found.measured if one.kind in CALIBRATES and one.resolved is not None
        ],
        "undecided": [_told(one, chosen) for one in found.measured if one.kind in CALIBRATES and one.resolved is None],
        "marks": [_told(one, chosen) for one in found.measured if one.kind == "mark"],
        "heights": _heights(chosen, found),
        "placement": _placement(found),
        "blur_um": found.blur_um,
        "pitch_ratio": found.pitch_ratio,
        "u_pitch_ratio": found.u_pitch_ratio,
        "sources": [source.as_dict()],
        "warnings": [*warnings, *found.warnings],
    }

    def draw() -> Any:
        from solen.report.print.fidelity import fidelity_figure

        return fidelity_figure(grey, chosen, found, source)

    return leave(data, "fidelity", out, figure, draw)


def _chosen(name: str | None, job: Path | None, assignments: Sequence[str]) -> Coupon:
    """The coupon that a job or the options tell."""
    if job is None:
        if name is None:
            raise SpecError("--coupon", limit="is missing", remedy="name the coupon, or give its --job")
        return layout(name, CouponOptions(**dict(map(parse_assignment, assignments))))
    if assignments:
        raise SpecError("--set", limit="has no effect beside --job, which holds the layout", remedy="leave one out")
    coupon, _ = read_job(job)
    if name is not None and name != coupon.name:
        raise SpecError("--coupon", value=name, limit=f"the job is one of {coupon.name}", remedy="leave it out")
    return coupon


def _told(one: Measured, coupon: Coupon) -> dict[str, Any]:
    """A feature as plain data; of a gap also the nominal diameter of its pillars."""
    beside = {gap.name: coupon.feature(gap.between[0]).diameter_mm for gap in coupon.gaps}
    return asdict(one) | ({"diameter_mm": beside[one.name]} if one.kind == "gap" else {})


def _limit(limit: Limit) -> dict[str, Any]:
    return {key: value for key, value in asdict(limit).items() if key != "kind"}


def _heights(coupon: Coupon, found: Fidelity) -> list[dict[str, Any]]:
    return [
        {"name": name, "nominal_mm": coupon.feature(name).height_mm, "measured_mm": one.height_mm, "u_mm": one.u_mm}
        for name, one in found.heights.items()
    ]


def _placement(found: Fidelity) -> dict[str, Any]:
    placement = found.registration.placement
    return {
        "angle_deg": placement.angle_deg,
        "middle_px": list(placement.middle_px),
        "px_per_mm": placement.px_per_mm,
        "mirrored": placement.mirrored if found.registration.oriented else None,
        "bright": found.registration.bright,
        "matched": len(found.registration.matched),
        "rms_mm": found.registration.rms_mm,
    }
