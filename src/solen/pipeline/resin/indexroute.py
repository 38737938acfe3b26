"""Which way leads from chosen spectra to an index, and what was said of them: the options of `solen resin index`.

The idea: the route follows from what was measured, and what cannot be told from a file, whether A is an absorbance and
what the 100 % was taken on, is asked for. A reading that says nothing of the reflectance gives no measured index.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.errors import DataError, SpecError
from solen.material.index import IndexSpectrum, Length, Reading, is_absorbance, reading, routes
from solen.material.index.fit import FITS
from solen.material.index.layered import lossless_on_substrate, measured_on_substrate
from solen.material.index.literature import POLYMERS
from solen.material.index.routes import MODES
from solen.pipeline.outputs import check_choice, check_wavelength
from solen.pipeline.resin.indexfit import LITERATURE
from solen.pipeline.resin.onsubstrate import SIDES, check_substrate, setup_of
from solen.pipeline.resin.traces import Spectra

BASES = {"log10": float(np.log(10.0)), "ln": 1.0}
ABSORBANCE_KINDS = (*BASES, "absorptance")
BASELINES = ("air", "substrate")
FIT_KINDS = (*FITS, "none")
_MOST_U = 0.1  # an uncertainty of T above this is a percentage without its sign


@dataclass(frozen=True)
class IndexOptions:
    """How `solen.pipeline.resin.index.index` reads a file; None is what was not said.

    Attributes
    ----------
    thickness_um, u_thickness_um
        Of the layer.
    u
        Stated standard uncertainties of ``T``, ``R`` and ``A`` as typed: ``0.003`` or ``0.3%``.
    chosen
        Names of the traces of ``T``, ``R`` and ``A``.
    absorbance_kind, mode, baseline
        Of `ABSORBANCE_KINDS`, `solen.material.index.routes.MODES` and `BASELINES`.
    bandwidth_nm
        Of the monochromator.
    led
        Part of the library, or file of a part or of a spectrum.
    at_nm
        Wavelengths at which n is told, too.
    sheet
        Of a workbook.
    substrate, substrate_thickness_um, u_substrate_n
        The sheet that the layer stays on: a resin of the library, a resin file or an index; its thickness; the standard
        uncertainty of its index.
    side, r_baseline
        Whether the light meets the ``layer`` or the ``substrate`` first, and what the 100 % of R was, of `BASELINES`.
    fit, terms
        Formula that is laid through n, of `FIT_KINDS`, and of how many terms.
    polymers
        Classes of the literature that n is compared with, of `solen.material.index.literature.POLYMERS`.
    literature
        Where their indices are from, of `solen.pipeline.resin.indexfit.LITERATURE`.
    """

    thickness_um: float | None = None
    u_thickness_um: float | None = None
    u: Mapping[str, str | None] = field(default_factory=dict)
    chosen: Mapping[str, Sequence[str]] = field(default_factory=dict)
    absorbance_kind: str | None = None
    mode: str | None = None
    baseline: str | None = None
    bandwidth_nm: float | None = None
    led: str | None = None
    at_nm: Sequence[float] = ()
    sheet: str | None = None
    substrate: str | None = None
    substrate_thickness_um: float | None = None
    u_substrate_n: float | None = None
    side: str | None = None
    r_baseline: str | None = None
    fit: str | None = None
    terms: int | None = None
    polymers: Sequence[str] = ()
    literature: str = "table"

    def check(self) -> None:
        """`SpecError` for what cannot be, before anything is read."""
        choices = {
            "--mode": (self.mode, MODES),
            "--baseline": (self.baseline, BASELINES),
            "--absorbance-kind": (self.absorbance_kind, ABSORBANCE_KINDS),
            "--side": (self.side, SIDES),
            "--r-baseline": (self.r_baseline, BASELINES),
            "--fit": (self.fit, FIT_KINDS),
            "--literature": (self.literature, LITERATURE),
        }
        for name, (value, known) in choices.items():
            if value is not None:
                check_choice(name, value, known)
        for name in self.polymers:
            check_choice("--polymer", name, POLYMERS)
        numbers = [
            ("--thickness-um", self.thickness_um),
            ("--bandwidth-nm", self.bandwidth_nm),
            ("--substrate-thickness-um", self.substrate_thickness_um),
            ("--u-substrate-n", self.u_substrate_n),
        ]
        for name, number in numbers:
            if number is not None and not 0.0 < number < np.inf:
                raise SpecError(name, value=number, limit="must be finite and above 0")
        for nm in self.at_nm:
            check_wavelength(nm, "--at-nm")
        for kind in self.u:
            self.u_of(kind)
        check_substrate(self)

    @property
    def thickness(self) -> Length:
        """Thickness of the layer; `SpecError` where it was not stated."""
        if self.thickness_um is None:
            remedy = "measure it with a micrometer and state it; the lossless mode alone needs none"
            raise SpecError("--thickness-um", limit="is missing", remedy=remedy)
        return Length(self.thickness_um, self.u_thickness_um)

    def u_of(self, kind: str) -> float | None:
        """Stated uncertainty of ``T``, ``R`` or ``A`` as a fraction."""
        text = self.u.get(kind)
        if text is None:
            return None
        digits, percent, rest = text.strip().partition("%")
        try:
            value = float(digits) * (0.01 if percent else 1.0)
        except ValueError:
            value = np.nan
        if rest or not 0.0 <= value <= _MOST_U:
            limit = f"must be a fraction or a percentage, 0 to {_MOST_U:.0%}"
            raise SpecError(f"--u-{kind}", value=text, limit=limit, remedy="write 0.003 or 0.3%")
        return value


def spectrum(spectra: Spectra, options: IndexOptions) -> IndexSpectrum:
    """Index by the route that was asked for, or else by the one that what was measured leads to.

    Raises
    ------
    SpecError, DataError
        Where something must be stated, or where what was measured gives no index by that route.
    """
    t = _transmittance(spectra, options)
    nm = spectra.wavelength_nm
    if options.substrate is not None:
        return _on_substrate(spectra, options, t)
    mode = options.mode or _mode(spectra, options, t)
    if mode == "lossless":
        return routes.lossless(nm, t)
    if mode == "as-published":
        _check_published(spectra, options, t)
        return routes.as_published(nm, t, options.thickness)
    if mode == "measured":
        if "R" not in spectra.rows:
            raise routes.no_reflectance("T alone,", nm, t)
        r = reading(spectra.rows["R"], options.u_of("R"), name="R")
        return routes.measured(nm, t, r, options.thickness)
    if "A" not in spectra.rows or options.absorbance_kind != "absorptance":
        remedy = "name its trace with --absorbance and state --absorbance-kind absorptance"
        raise SpecError("--mode absorptance", limit="needs the absorptance, measured", remedy=remedy)
    a = reading(spectra.rows["A"], options.u_of("A"), name="A")
    return routes.absorptance(nm, t, a, options.thickness)


def _on_substrate(spectra: Spectra, options: IndexOptions, t: Reading) -> IndexSpectrum:
    """Index of a layer that stays on its substrate: from T and R where both are measured, else from T alone."""
    nm, setup = spectra.wavelength_nm, setup_of(options, spectra.wavelength_nm)
    mode = options.mode or ("measured" if "R" in spectra.rows else "lossless")
    if mode == "lossless":
        return lossless_on_substrate(nm, t, setup)
    if "R" not in spectra.rows:
        limit, remedy = "needs R of layer and substrate together, measured", "name its trace; or take --mode lossless"
        raise SpecError("--mode measured", limit=limit, remedy=remedy)
    r = reading(spectra.rows["R"], options.u_of("R"), name="R")
    return measured_on_substrate(nm, t, r, options.thickness, setup)


def absorbance_warnings(spectra: Spectra, options: IndexOptions) -> list[str]:
    """What an absorbance beside a transmittance says: nothing, or that one of them is of another baseline."""
    base = BASES.get(options.absorbance_kind or "")
    if base is None or not {"A", "T"} <= spectra.rows.keys():
        return []
    if is_absorbance(spectra.rows["A"].mean(axis=0), spectra.rows["T"].mean(axis=0), base):
        return []
    name, other = spectra.names["A"][0], spectra.names["T"][0]
    return [f"{name} is not the absorbance of {other}: they have different baselines, or are of different samples"]


def _mode(spectra: Spectra, options: IndexOptions, t: Reading) -> str:
    """Route that what was measured leads to."""
    if "R" in spectra.rows:
        return "measured"
    if "A" not in spectra.rows or "T" not in spectra.rows:
        return "lossless"
    if options.absorbance_kind in BASES:
        raise routes.no_reflectance(f"an absorbance, −{options.absorbance_kind} T,", spectra.wavelength_nm, t)
    if options.absorbance_kind is None:
        raise _ask_kind(spectra)
    return "absorptance"


def _transmittance(spectra: Spectra, options: IndexOptions) -> Reading:
    """Reading of T, from an absorbance where that is all there is."""
    if "T" in spectra.rows:
        return reading(spectra.rows["T"], options.u_of("T"), name="T")
    if "A" not in spectra.rows:
        raise DataError("transmittance", limit="is missing", remedy="an index needs T; name its trace: --transmittance")
    if options.absorbance_kind is None:
        raise _ask_kind(spectra)
    if options.absorbance_kind == "absorptance":
        raise DataError("transmittance", limit="is missing", remedy="of an absorptance alone no index follows")
    base, u_a = BASES[options.absorbance_kind], options.u_of("A")
    rows = np.exp(-base * spectra.rows["A"])
    stated = options.u_of("T") if u_a is None else base * np.nan_to_num(rows.mean(axis=0)) * u_a
    return reading(rows, stated, name="T")


def _ask_kind(spectra: Spectra) -> SpecError:
    limit = f"must be stated for {spectra.names['A'][0]}: {', '.join(ABSORBANCE_KINDS)}"
    remedy = "a spectrophotometer exports log10, −log10 T; an absorptance is measured in an integrating sphere"
    return SpecError("--absorbance-kind", limit=limit, remedy=remedy)


def _check_published(spectra: Spectra, options: IndexOptions, t: Reading) -> None:
    """Raise where A was given and is not the absorbance that the published formula was fed with."""
    if options.absorbance_kind not in {None, "log10"}:
        limit = "is not what the as-published mode takes: there, A is log10"
        raise SpecError("--absorbance-kind", value=options.absorbance_kind, limit=limit)
    if "A" in spectra.rows and not is_absorbance(spectra.rows["A"].mean(axis=0), t.value):
        limit = "is not −log10 T, which the as-published mode takes for A"
        raise DataError(f"trace {spectra.names['A'][0]}", limit=limit, remedy="leave it out, or take another mode")
