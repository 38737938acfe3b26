"""Coupons: solids, jobs and plans, written to a folder after all of them have been computed."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.errors import SpecError
from solen.fabricate.coupons import CouponOutput, CouponSet, coupon_set, written_coupons
from solen.geometry.coupons import CouponOptions
from solen.pipeline.options import FLAT
from solen.pipeline.outputs import drawn
from solen.pipeline.print.layers import with_figure
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
    """Write coupons that test a printer and a resin: for each an STL file, a 3MF file, a plan and a job.

    Parameters
    ----------
    out
        Folder for the files; created if missing.
    only
        Coupons to write, separated by commas: group-a, group-b, group-c, holes, z-reference, cure-discs, grey-steps,
        ledges, film-layer, cubes, guides.
    listing
        List the coupons and the assumptions about the published text; write nothing.

    Raises
    ------
    SolenError
        If a coupon cannot be made or a file cannot be written; then nothing is written.
    """
    if listing:
        return Outcome(coupon_set(only, options))
    if out is None:
        raise SpecError("--out", limit="missing", remedy="specify a folder, or --list to list the coupons")
    figure.check()
    result, contents_by_name = written_coupons(only, options, output)
    with files.output_folder(out):
        targets = with_figure({name: out / name for name in contents_by_name}, figure.figure)
        contents: dict[Path, files.Content] = {targets[name]: data for name, data in contents_by_name.items()}
        files.write_all(contents | drawn(result, figure, "coupons"))
    return Outcome(result, targets)
