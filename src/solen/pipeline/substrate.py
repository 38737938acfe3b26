"""The sheet that a layer was measured on, as it is named on the command line.

The idea: an error of the sheet's index goes over into the layer's one to one, so the sheet is always named: a number, a
resin of the library or its file, or an entry of the literature. Nothing is taken for a usual PET.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from solen.errors import DataError, SpecError
from solen.material import Resin, library_resin, load_resin
from solen.material import library as resins
from solen.material.index.layered import Setup
from solen.material.index.literature import Material, materials
from solen.material.index.slab import FloatArray
from solen.material.index.stack import Baseline, Side, Substrate
from solen.pipeline.outputs import check_choice

SIDES: tuple[Side, ...] = ("layer", "substrate")
BASELINES: tuple[Baseline, ...] = ("air", "substrate")
MM_PER_NM = 1e-6

C = TypeVar("C", bound=str)


@dataclass(frozen=True)
class SubstrateOptions:
    """What was said of the sheet; None is what was not.

    Attributes
    ----------
    name
        A number for its index, a resin of the library or a resin's .toml, or words of an entry of the literature.
    u_n, k
        Standard uncertainty of its index; its extinction coefficient.
    thickness_um, u_thickness_um
        Of the sheet.
    side
        Which the light met first, layer or substrate.
    baseline_r
        What the 100 % of R was taken on: air (a calibrated mirror) or the bare substrate.
    """

    name: str | None = None
    u_n: float | None = None
    k: float | None = None
    thickness_um: float | None = None
    u_thickness_um: float | None = None
    side: str | None = None
    baseline_r: str | None = None

    @property
    def stated(self) -> bool:
        """Whether anything was said."""
        return any(value is not None for value in vars(self).values())

    def setup(self, wavelength_nm: FloatArray, baseline: Baseline) -> Setup:
        """Layer and sheet as they were measured.

        Raises
        ------
        SpecError, DataError
            Where something is missing, is not there, or is not known at these wavelengths.
        """
        if self.name is None or self.thickness_um is None:
            option = "--substrate" if self.name is None else "--substrate-thickness-um"
            raise SpecError(option, limit="is missing", remedy="say what the layer lies on and how thick that is")
        found = _named(self.name, wavelength_nm)
        sheet = Substrate(
            n=found.n,
            k=found.k if self.k is None else self.k,
            thickness_um=self.thickness_um,
            u_n=found.u_n if self.u_n is None else self.u_n,
            u_thickness_um=self.u_thickness_um or 0.0,
        )
        return Setup(
            sheet,
            _choice("--side", self.side or "layer", SIDES),
            baseline,
            _choice("--baseline-r", self.baseline_r or "air", BASELINES),
        )


@dataclass(frozen=True)
class _Sheet:
    n: FloatArray
    u_n: float
    k: FloatArray


def _choice(option: str, value: str, choices: tuple[C, ...]) -> C:
    """The choice that a text is; `SpecError` where it is none."""
    for one in choices:
        if one == value:
            return one
    check_choice(option, value, choices)
    raise AssertionError


def _named(name: str, wavelength_nm: FloatArray) -> _Sheet:
    """Index, its uncertainty and extinction at wavelengths, of a sheet that is named."""
    none = np.zeros(wavelength_nm.shape)
    try:
        return _Sheet(float(name) + none, 0.0, none)
    except ValueError:
        pass
    if name in resins() or name.endswith(".toml"):
        return _of_resin(library_resin(name) if name in resins() else load_resin(name), wavelength_nm)
    entry = _entry(name)
    n = entry.index(wavelength_nm, extended=True)
    if not np.isfinite(n).all():
        limit = "is known from 400 to 1000 nm, and the spectra reach beyond"
        raise DataError(f"substrate {entry.name}", limit=limit, remedy="name a resin's file that reaches as far")
    return _Sheet(n, 0.0, none)


def _of_resin(resin: Resin, wavelength_nm: FloatArray) -> _Sheet:
    n = np.array([resin.index.index(float(nm)) for nm in wavelength_nm])
    u_n = max(resin.index.u_index(float(nm)) or 0.0 for nm in wavelength_nm)
    return _Sheet(n, u_n, resin.loss.absorption_per_mm * wavelength_nm * MM_PER_NM / (4.0 * np.pi))


def _entry(name: str) -> Material:
    """Entry of the literature whose name has these words; `DataError` where none has, or several."""
    words = name.casefold().split()
    found = [one for one in materials() if all(word in one.name.casefold() for word in words)]
    if len(found) == 1:
        return found[0]
    limit = (
        f"may be {'; '.join(one.name for one in found)}" if found else "is no index, no resin and not in the literature"
    )
    remedy = "add words until one is left" if found else "state its index as a number, with --u-substrate-n"
    raise DataError("--substrate", value=name, limit=limit, remedy=remedy)
