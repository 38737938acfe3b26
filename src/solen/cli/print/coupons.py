"""The command of coupons: parts that are printed to be measured."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.cli.app import FLAT, lines
from solen.errors import SpecError
from solen.fabricate.coupons import CouponOutput, CouponSet, coupon_set
from solen.geometry.coupons import CouponOptions
from solen.ranks import ranked
from solen.report.options import FigureOptions
from solen.results import Outcome


def coupons(
    *,
    out: Path | None = None,
    only: str | None = None,
    listing: Annotated[bool, Parameter(name="--list")] = False,
    options: Annotated[CouponOptions, FLAT] = CouponOptions(),
    output: Annotated[CouponOutput, FLAT] = CouponOutput(),
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[CouponSet]:
    """Write the coupons that show what a printer and a resin can do: STL, 3MF, plan and job of each.

    Parameters
    ----------
    out
        Folder for the files; made if need be.
    only
        Some coupons, with commas: group-a, group-b, group-c, holes, z-reference, cure-discs, film-layer, cubes, guides.
    listing
        List the coupons and what was read into their source; write nothing.
    """
    from solen.pipeline.print import coupons as pipeline

    if listing:
        return Outcome(coupon_set(only, options))
    if out is None:
        raise SpecError("--out", limit="is missing", remedy="name a folder, or --list the coupons")
    return pipeline.coupons(out, only, options, output, figure=figure)


@lines.register
def _(result: CouponSet) -> Iterator[str]:
    for coupon in result.coupons:
        if coupon.parts:
            volume = sum(part.volume_mm3 for part in coupon.parts)
            yield f"{coupon.name}: {coupon.features} features, {volume:.5g} mm3"
        else:
            yield f"{coupon.name}: {coupon.title}; {' x '.join(f'{side:.4g}' for side in coupon.size_mm)} mm"
            for reading in coupon.readings:
                yield f'  {reading.about}: printed "{reading.printed}"; taken: {reading.taken}'
        yield from (f"  {warning}" for warning in ranked(coupon.warnings))
