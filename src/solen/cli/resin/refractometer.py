"""The command of a refractometer: from an index at one wavelength or a few to n against wavelength."""

from collections.abc import Iterator
from typing import Annotated

from solen.cli.app import FLAT, Out, lines, short
from solen.cli.resin.index import evaluated_lines
from solen.material.index.refractometer import RefractometerIndex, RefractometerOptions
from solen.report.options import FigureOptions
from solen.results import Outcome

_SHOWN_NM = (450.0, 500.0, 650.0, 750.0, 860.0, 950.0)


def refractometer(
    n: list[float],
    /,
    *,
    options: Annotated[RefractometerOptions, FLAT],
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[RefractometerIndex]:
    """Extend an index that a refractometer or an ellipsometer measured over wavelength, by what polymers share.

    Parameters
    ----------
    n
        Measured index, or indices at several wavelengths.
    """
    from solen.pipeline.resin import refractometer as pipeline

    return pipeline.refractometer(n, options, out=out, figure=figure)


@lines.register
def _(index: RefractometerIndex) -> Iterator[str]:
    yield f"index from {index.measured_n.size} measured and the dispersion of polymers"
    yield f"  n_D (589.3 nm)  {index.n_D:.5f} ± {short(index.u_n_D)}"
    yield f"  Abbe number     {index.abbe:.1f} ± {index.u_abbe:.1f}"
    for nm, n, u_n in zip(_SHOWN_NM, *index.fit.along(_SHOWN_NM), strict=True):
        yield f"  {nm:6g} nm       {n:.5f} ± {short(u_n)}"
    yield from evaluated_lines(index.at, index.led)
