"""The sheet that a layer stays on, from what the command line says of it.

The idea: a sheet is named by a resin of the library, a resin file, or its index. What it was measured against, the
bare sheet or air, cannot be told from a file and is asked for.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.material.index.layered import Setup
from solen.material.index.stack import Substrate
from solen.material.resin import Resin, library_resin, load_resin
from solen.spec.strict import told_of

if TYPE_CHECKING:
    from solen.pipeline.resin.indexroute import IndexOptions

SIDES = ("layer", "substrate")
_NM_PER_MM = 1e6


def check_substrate(options: "IndexOptions") -> None:
    """`SpecError` where what is said of a substrate is not enough, or is said of a layer without one."""
    if options.substrate is None:
        if options.baseline == "substrate" and options.mode != "as-published":
            remedy = "say --substrate pet and --substrate-thickness-um; or measure a layer that was peeled off, in air"
            raise SpecError("--substrate", limit="is missing beside --baseline substrate", remedy=remedy)
        for name, value in (
            ("--substrate-thickness-um", options.substrate_thickness_um),
            ("--u-substrate-n", options.u_substrate_n),
            ("--side", options.side),
            ("--r-baseline", options.r_baseline),
        ):
            if value is not None:
                raise SpecError(name, limit="is of a layer on a substrate", remedy="say --substrate, or leave it out")
        return
    if options.baseline is None:
        remedy = "say substrate where the 100 % was taken on the bare sheet, air where it was taken on nothing"
        raise SpecError("--baseline", limit="is missing beside --substrate", remedy=remedy)
    if options.substrate_thickness_um is None:
        raise SpecError("--substrate-thickness-um", limit="is missing beside --substrate", remedy="measure the sheet")
    if options.mode in {"absorptance", "as-published"}:
        limit = "knows no substrate"
        raise SpecError("--mode", value=options.mode, limit=limit, remedy="take measured or lossless")


def setup_of(options: "IndexOptions", wavelength_nm: FloatArray) -> Setup:
    """How the layer was measured, with the sheet's index and absorption at the wavelengths of the spectra.

    Raises
    ------
    SpecError, DataError
        Where the sheet is not known, or not at all of the wavelengths.
    """
    assert options.substrate is not None  # noqa: S101  there is a substrate, or this is not asked for
    assert options.substrate_thickness_um is not None  # noqa: S101
    n, u_n, k = _sheet(options.substrate, wavelength_nm)
    if options.u_substrate_n is not None:
        u_n = np.full(n.shape, options.u_substrate_n)
    return Setup(
        Substrate(n, k, options.substrate_thickness_um, u_n=u_n),
        side="substrate" if options.side == "substrate" else "layer",
        baseline="substrate" if options.baseline == "substrate" else "air",
        baseline_r="substrate" if options.r_baseline == "substrate" else "air",
    )


def _sheet(name: str, wavelength_nm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Index, its standard uncertainty (0 where none is known) and extinction of a sheet."""
    stated = _number(name)
    if stated is not None:
        if not 1.0 < stated < 3.0:
            raise SpecError(
                "--substrate", value=stated, limit="must be a name, a file, or an index above 1 and below 3"
            )
        flat = np.full(wavelength_nm.shape, stated)
        return flat, np.zeros(flat.shape), np.zeros(flat.shape)
    resin = _resin(name)
    with told_of(f"substrate {resin.name}"):
        n = np.array([resin.index.index(float(nm)) for nm in wavelength_nm])
        u_n = np.array([resin.index.u_index(float(nm)) or 0.0 for nm in wavelength_nm])
    return n, u_n, resin.loss.absorption_per_mm * wavelength_nm / (4.0 * np.pi * _NM_PER_MM)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _resin(name: str) -> Resin:
    return load_resin(Path(name)) if name.endswith(".toml") else library_resin(name)
