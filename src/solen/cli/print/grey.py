"""The command that measures the light of grey pixels."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.fabricate.process import MeasuredGreys
from solen.pipeline.print.grey import grey as grey


@lines.register
def _(measured: MeasuredGreys) -> Iterator[str]:
    yield "  grey   light"
    for level, light, u, discs in zip(measured.grey, measured.light, measured.u_light, measured.discs, strict=True):
        yield f"  {level:<6.4g} {light:.4f} ± {u:.2g}  ({discs} disc{'' if discs == 1 else 's'})"
    dp = f"{measured.Dp_um:.4g} ± {measured.u_Dp_um:.2g} µm"
    yield f"for Dp {dp}; common exponent of all values of light 1 ± {measured.u_power:.2g}"
    yield f"mean shift of an edge drawn without correction: {measured.edge_shift_px:+.3f} pixels"
