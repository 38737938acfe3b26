"""The command that measures which light grey pixels let through."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.cli.app import FLAT, lines
from solen.fabricate.process import GreyOptions, MeasuredGreys
from solen.results import Outcome


def grey(
    file: Path,
    /,
    *,
    options: Annotated[GreyOptions, FLAT] = GreyOptions(),
    process: Path | None = None,
    sheet: str | None = None,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the process with the greys to this .toml.")] = None,
) -> Outcome[MeasuredGreys]:
    """Measure which light grey pixels let through, from discs of the coupon grey-steps.

    Parameters
    ----------
    file
        A table with the greys (shares, % or 255ths) and the thicknesses of discs that one exposure cured together.
    process
        Process that the greys are added to, and whose Dp turns thickness into light; default: the published settings.
    sheet
        Sheet of a workbook.
    """
    from solen.pipeline.print import grey as pipeline

    return pipeline.grey(file, options, process=process, sheet=sheet, out=out)


@lines.register
def _(measured: MeasuredGreys) -> Iterator[str]:
    yield "  grey   light"
    for grey_, light, u, discs in zip(measured.grey, measured.light, measured.u_light, measured.discs, strict=True):
        yield f"  {grey_:<6.4g} {light:.4f} ± {u:.2g}  ({discs} disc{'' if discs == 1 else 's'})"
    yield f"with Dp = {measured.Dp_um:.4g} ± {measured.u_Dp_um:.2g} µm; exponent of all light ± {measured.u_power:.2g}"
    yield f"an edge drawn in proportion moves by {measured.edge_shift_px:+.3f} pixels on average"
