"""Files of coupons: the solids, job and plan of each coupon, and a summary.

`coupon_set` returns the summary; `written_coupons` also returns the files, according to `CouponOutput`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from solen.errors import SpecError
from solen.fabricate.coupons.job import as_job, cautions, job_sha256
from solen.fabricate.coupons.plan import as_plan
from solen.fabricate.coupons.solid import coupon_parts
from solen.fabricate.export import MeshSize
from solen.fabricate.label import Label
from solen.fabricate.mesh import mesh_of
from solen.fabricate.meshfiles import as_stl, as_threemf
from solen.fabricate.step import as_step, check_kernel
from solen.geometry.coupons import Coupon, CouponOptions, Reading, layouts
from solen.parts import printer_of
from solen.ranks import Caution
from solen.results import HIDDEN, Result
from solen.spec.strict import Options

Side = Annotated[float, Field(gt=0, lt=math.inf)]


class CouponOutput(Options):
    """Options for the files of coupons."""

    printer: str | None = None
    """Printer, which specifies the plate and the pixel size: name in the library, or a printer file."""
    plate_mm: tuple[Side, Side] | None = None
    """Width and depth of the build plate, on which each coupon must fit."""
    step: bool = False
    """Also write STEP files of the exact solids (requires the extra cad)."""
    tolerance_mm: float = 1e-3
    """Maximum deviation of a mesh from the exact walls, 1e-4 to 1."""


@dataclass(frozen=True)
class CouponPart:
    """A part that is printed in one run, with its exact volume and its mesh."""

    name: str
    volume_mm3: float
    mesh: MeshSize


@dataclass(frozen=True)
class CouponSummary:
    """Summary of a coupon: size, numbers of features, gaps and steps, and interpretations of its published source.

    ``parts`` are the parts with files; ``warnings`` list what the printer cannot resolve.
    """

    name: str
    title: str
    sha256: str
    size_mm: tuple[float, float, float]
    features: int
    gaps: int
    steps: int
    readings: tuple[Reading, ...]
    parts: tuple[CouponPart, ...]
    warnings: tuple[Caution, ...]

    @classmethod
    def of(cls, coupon: Coupon, options: CouponOptions, parts: Sequence[CouponPart] = ()) -> "CouponSummary":
        """Return the summary of a coupon with the options of its layout."""
        return cls(
            name=coupon.name,
            title=coupon.title,
            sha256=job_sha256(coupon, options),
            size_mm=coupon.size_mm,
            features=len(coupon.features),
            gaps=len(coupon.gaps),
            steps=len(coupon.steps),
            readings=coupon.readings,
            parts=tuple(parts),
            warnings=tuple(cautions(coupon, options)),
        )


class CouponSet(Result):
    """Coupons with their options and layouts; the layouts are omitted from JSON."""

    coupons: tuple[CouponSummary, ...]
    options: CouponOptions
    layouts: tuple[Coupon, ...] = field(metadata=HIDDEN)


def coupon_set(only: str | None = None, options: CouponOptions = CouponOptions()) -> CouponSet:
    """Return the summary of coupons, without files; ``only`` is a list of names separated by commas, or ``all``."""
    coupons = tuple(layouts(only, options))
    return CouponSet(tuple(CouponSummary.of(coupon, options) for coupon in coupons), options, coupons)


def written_coupons(
    only: str | None = None, options: CouponOptions = CouponOptions(), output: CouponOutput = CouponOutput()
) -> tuple[CouponSet, dict[str, bytes]]:
    """Return the summary of coupons and their files (STL, 3MF, job and plan), keyed by name.

    Raises
    ------
    SolenError
        If a coupon cannot be made or does not fit on the plate, or an extra is not installed.
    """
    if output.step:
        check_kernel()
    plate_mm = output.plate_mm
    if output.printer is not None:
        printer = printer_of(output.printer)
        plate_mm = plate_mm or printer.size_mm[:2]
        options = options.model_copy(update={"pitch_um": options.pitch_um or max(printer.pitches_mm) * 1000.0})
    coupons = layouts(only, options)
    for coupon in coupons:
        _check_plate(coupon, plate_mm or (math.inf, math.inf))
    files: dict[str, bytes] = {}
    summaries = [_add_files(coupon, options, output, files) for coupon in coupons]
    return CouponSet(tuple(summaries), options, tuple(coupons)), files


def _add_files(coupon: Coupon, options: CouponOptions, output: CouponOutput, files: dict[str, bytes]) -> CouponSummary:
    """Add the files of a coupon to ``files``, and return its summary."""
    label = Label(coupon.name, job_sha256(coupon, options), f"coupon: {coupon.title}")
    stages, parts = {}, []
    for stage, part in coupon_parts(coupon).items():
        mesh = mesh_of(part, output.tolerance_mm)
        solids = {"stl": as_stl(mesh, label), "3mf": as_threemf(mesh, label)}
        if output.step:
            solids["step"] = as_step(part, label)
        files |= {f"{part.name}.{kind}": content for kind, content in solids.items()}
        stages[stage] = {kind: f"{part.name}.{kind}" for kind in solids}
        parts.append(CouponPart(part.name, part.volume_mm3, MeshSize.of(mesh, part)))
    files[f"{coupon.name}.json"] = as_job(coupon, options, stages)
    files[f"{coupon.name}.svg"] = as_plan(coupon, label)
    return CouponSummary.of(coupon, options, parts)


def _check_plate(coupon: Coupon, plate_mm: tuple[float, float]) -> None:
    """Raise `SpecError` if a coupon does not fit on the build plate, even if it is rotated by 90 degrees."""
    width, depth, _ = coupon.size_mm
    if max(width, depth) > max(plate_mm) or min(width, depth) > min(plate_mm):
        size, plate = f"{width:g} x {depth:g} mm", f"{plate_mm[0]:g} x {plate_mm[1]:g} mm"
        limit = f"is {size} and does not fit on a plate of {plate}"
        raise SpecError(f"coupon {coupon.name}", limit=limit, remedy="omit this coupon with --only")
