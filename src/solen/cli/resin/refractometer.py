"""The command that extends an index from a refractometer to other wavelengths."""

from collections.abc import Iterator

from solen.cli.app import lines, short
from solen.cli.resin.index import evaluated_lines
from solen.material.index.refractometer import RefractometerIndex
from solen.pipeline.resin.refractometer import refractometer as refractometer

_SHOWN_NM = (450.0, 500.0, 650.0, 750.0, 860.0, 950.0)


@lines.register
def _(index: RefractometerIndex) -> Iterator[str]:
    count = index.measured_n.size
    yield f"index from {count} measured value{'s' * (count > 1)} and the dispersion of polymers"
    yield f"  n_D (589.3 nm)  {index.n_D:.5f} ± {short(index.u_n_D)}"
    yield f"  Abbe number     {index.abbe:.1f} ± {index.u_abbe:.1f}"
    for nm, n, u_n in zip(_SHOWN_NM, *index.fit.indices(_SHOWN_NM), strict=True):
        yield f"  {nm:6g} nm       {n:.5f} ± {short(u_n)}"
    yield from evaluated_lines(index.at, index.led)
