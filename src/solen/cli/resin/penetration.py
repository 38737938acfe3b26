"""The command for the penetration depth, from an absorbance spectrum."""

import math
from collections.abc import Iterator

from solen.cli.app import lines
from solen.material.cure.penetration import Penetration
from solen.pipeline.resin.penetration import penetration as penetration


@lines.register
def _(penetration: Penetration) -> Iterator[str]:
    if penetration.Dp_um is not None:
        u = "" if penetration.u_Dp_um is None else f" ± {penetration.u_Dp_um:.2g}"
        shallow, deep = penetration.depths_um
        yield f"Dp {penetration.Dp_um:.4g}{u} µm at the surface (lamp: {penetration.lamp})"
        yield (
            f"Dp {penetration.between_Dp_um:.4g} µm between {shallow:g} and {deep:g} µm, as from a working curve "
            "of discs of these thicknesses"
        )
    pairs = zip(penetration.spectral_Dp_um.tolist(), penetration.wavelength_nm.tolist(), strict=True)
    if known := [(Dp_um, nm) for Dp_um, nm in pairs if math.isfinite(Dp_um)]:
        yield "shortest Dp of a single wavelength: {:.4g} µm, at {:g} nm".format(*min(known))
