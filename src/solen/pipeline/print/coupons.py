"""Coupons: solids, jobs and plans in one folder, all made before any is written."""

from pathlib import Path

from solen import files
from solen.fabricate.coupons import CouponOutput, CouponSet, written_coupons
from solen.geometry.coupons import CouponOptions
from solen.pipeline.outputs import drawn
from solen.pipeline.print.layers import with_figure
from solen.report.options import FigureOptions
from solen.results import Outcome


def coupons(
    out: Path,
    only: str | None = None,
    options: CouponOptions = CouponOptions(),
    output: CouponOutput = CouponOutput(),
    *,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[CouponSet]:
    """Write STL, 3MF, job and plan of coupons into a folder.

    Parameters
    ----------
    out
        Folder, made if need be; files of the same names are replaced.
    only
        Names, separated by commas; all coupons by default.
    options, output
        Parameters of the coupons, and how they are written.
    figure
        Draw all plans into this file.

    Raises
    ------
    SolenError
        Where a coupon cannot be made or a file not be written; nothing is written then.
    """
    figure.check()
    laid_out, made = written_coupons(only, options, output)
    with files.output_folder(out):
        targets = with_figure({name: out / name for name in made}, figure.figure)
        contents: dict[Path, files.Content] = {targets[name]: content for name, content in made.items()}
        files.write_all(contents | drawn(laid_out, figure, "coupons"))
    return Outcome(laid_out, targets)
