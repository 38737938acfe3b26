"""The index of a printed layer, from a recording of its spectra to n and k against wavelength.

By default, the route follows from the spectra that were measured; the published formulas are used only on request.
Masked values are null, with the reason in `LayerIndex.reason`, and each unspecified property of the instrument or the
layer causes a warning.

`index_of_layer` evaluates a recording with `IndexOptions` and returns a `LayerIndex`.
"""

from collections.abc import Mapping
from dataclasses import field

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.material.index import routes
from solen.material.index.fit import Fit
from solen.material.index.formula import formula_through, smoothed_scatter
from solen.material.index.fringes import fringe_warnings
from solen.material.index.illuminant import EvaluatedIndex, formula_in, index_in, lines, named_light
from solen.material.index.interference import JOINT, MODE, Interference, fringes_of, index_from_fringes
from solen.material.index.inversion import invert
from solen.material.index.literature import Band, band, check_dispersion, check_index
from solen.material.index.lossless_index import lossless_index
from solen.material.index.options import IndexOptions
from solen.material.index.plausibility import check_plausibility
from solen.material.index.reading import Reading, reading
from solen.material.index.routes import BASES, is_absorbance
from solen.material.index.spectrum import IndexSpectrum
from solen.material.index.stack import Setup, Substrate
from solen.material.rows import chosen_rows, refuse_unused
from solen.material.warning_prefixes import THICKNESS_NOT_IN_K
from solen.ranks import Caution, note, warning
from solen.recording import Recording
from solen.recording.model import Measured
from solen.recording.optical import OPTIONS, OpticalSpectra, optical_spectra
from solen.results import HIDDEN

_MAX_ABOVE_1 = 0.02  # fraction of wavelengths with T > 1 above which a substrate baseline is suspected
_MAX_UNUSED = 3  # maximum number of unused traces that are named


class LayerIndex(Measured, kw_only=True):
    """Index and extinction of a layer against wavelength; arrays of shape (n,), NaN where masked or unknown.

    Attributes
    ----------
    file
        Name of the file with the spectra.
    mode
        Route from the spectra to the index.
    measurement
        Whether n follows from measured values.
    baseline
        Reference for 100 % transmittance, air or substrate.
    bandwidth_nm
        Spectral bandwidth of the instrument, in nm; None if unknown.
    options
        The options.
    wavelength_nm
        Wavelengths in nm, in ascending order.
    n, u_n
        Refractive index and its standard uncertainty.
    u_random_n, u_common_n
        Parts of u_n: scatter from wavelength to wavelength, and errors common to all wavelengths.
    interval95_n
        95 % interval of n, shape (n, 2).
    k, u_k
        Extinction coefficient and its standard uncertainty.
    interval95_k
        95 % bounds of k, given that k ≥ 0, shape (n, 2); also available where k is masked as not resolved.
    correlation_n_k
        Correlation of the errors of n and k.
    reason
        Why n or k is masked at a wavelength; null if neither is.
    masked_n, masked_k
        Number of wavelengths at which n is masked, and at which k is masked.
    lossless_n, u_lossless_n
        Index from T alone, assuming k = 0, and its standard uncertainty.
    T, R
        Transmittance and reflectance used, as fractions.
    fit
        Formula fitted to n.
    literature
        Lowest and highest index of comparable polymers in the literature.
    at
        n at the requested wavelengths.
    led
        n for the light of the requested emitter.
    fit_at, fit_led
        n at the requested wavelengths and for the light of the requested emitter, from the fitted formula.
    traces
        Names of the traces of T, R and A.
    repeats_nm, repeats_lossless_n
        Longest wavelength, in nm, at which every repeat measurement of T has a lossless index, and the index from each
        measurement at this wavelength.
    interference
        Results from the fringes; None if none were detected.
    """

    file: str
    mode: str
    measurement: bool
    baseline: str
    bandwidth_nm: float | None
    options: IndexOptions
    wavelength_nm: FloatArray
    n: FloatArray
    u_n: FloatArray
    u_random_n: FloatArray
    u_common_n: FloatArray
    interval95_n: FloatArray
    k: FloatArray
    u_k: FloatArray
    interval95_k: FloatArray
    correlation_n_k: FloatArray
    reason: tuple[str | None, ...]
    masked_n: int
    masked_k: int
    lossless_n: FloatArray
    u_lossless_n: FloatArray
    T: FloatArray
    R: FloatArray
    fit: Fit | None
    literature: Band | None
    at: tuple[EvaluatedIndex, ...]
    led: EvaluatedIndex | None
    fit_at: tuple[EvaluatedIndex, ...]
    fit_led: EvaluatedIndex | None
    traces: Mapping[str, tuple[str, ...]]
    repeats_nm: float | None
    repeats_lossless_n: FloatArray | None
    interference: Interference | None
    spectrum: IndexSpectrum = field(metadata=HIDDEN)


def index_of_layer(recording: Recording, options: IndexOptions = IndexOptions()) -> LayerIndex:
    """Return the index of a layer from a recording of its spectra.

    Raises
    ------
    DataError, SpecError
        If traces must be selected, required information is missing, or no index follows from the measurement.
    """
    traces = {"T": options.transmittance, "R": options.reflectance, "A": options.absorbance}
    recording = chosen_rows(recording, options)
    column_notes = refuse_unused(recording, options, (), labels_only=True)
    spectra = optical_spectra(recording, traces)
    check_plausibility(spectra.rows, spectra.names)
    bandwidth_nm = options.bandwidth_nm or _bandwidth_nm(recording)
    spectrum, interference = _from_fringes(recording, spectra, options, bandwidth_nm)
    if spectrum is None:
        spectrum = _by_route(spectra, options)
    fit, fit_warnings = formula_through(spectrum, options.fit, options.terms)
    literature, literature_warnings = _literature(spectrum, options)
    at = [lines([nm], [1.0]) for nm in options.at_nm]
    led = None if options.led is None else named_light(options.led)
    repeats_nm, repeats_n = _repeats(spectra) if spectrum.mode not in {MODE, JOINT} else (None, None)
    repeats_notes = (
        []
        if repeats_n is None
        else [
            note(
                f"lossless n({repeats_nm:g} nm) of the {repeats_n.size} repeat measurements, in chronological order: "
                f"{repeats_n[0]:.3f} … {repeats_n[-1]:.3f}"
            )
        ]
    )
    n, k = spectrum.n, spectrum.k
    return LayerIndex(
        file=recording.provenance.file,
        mode=spectrum.mode,
        measurement=spectrum.measurement,
        baseline=options.baseline or "air",
        bandwidth_nm=bandwidth_nm,
        options=options,
        wavelength_nm=spectrum.wavelength_nm,
        n=n.value,
        u_n=n.u,
        u_random_n=n.u_random,
        u_common_n=n.u_common,
        interval95_n=np.stack([n.value - n.u95, n.value + n.u95], axis=1),
        k=k.value,
        u_k=k.u,
        interval95_k=np.stack([spectrum.k_low95, spectrum.k_high95], axis=1),
        correlation_n_k=spectrum.correlation,
        reason=spectrum.reason,
        masked_n=int((~n.known).sum()),
        masked_k=int((~k.known).sum()),
        lossless_n=spectrum.lossless.value,
        u_lossless_n=spectrum.lossless.u,
        T=spectrum.transmittance,
        R=spectrum.reflectance,
        fit=fit,
        literature=literature,
        at=tuple(index_in(spectrum, light) for light in at),
        led=index_in(spectrum, led) if led else None,
        fit_at=tuple(formula_in(fit.model, light) for light in at) if fit else (),
        fit_led=formula_in(fit.model, led) if fit and led else None,
        traces=spectra.names,
        repeats_nm=repeats_nm,
        repeats_lossless_n=repeats_n,
        interference=interference,
        sources=(recording.provenance,),
        warnings=(
            *spectrum.warnings,
            *spectra.warnings,
            *column_notes,
            *_baseline_warnings(spectra, options),
            *repeats_notes,
            *_instrument_warnings(spectrum, spectra, options, bandwidth_nm),
            *literature_warnings,
            *fit_warnings,
        ),
        spectrum=spectrum,
    )


def _from_fringes(
    recording: Recording, spectra: OpticalSpectra, options: IndexOptions, bandwidth_nm: float | None
) -> tuple[IndexSpectrum | None, Interference | None]:
    """Return the index and results from fringes, or from a joint fit with the bare substrate; None for both otherwise.

    Raises
    ------
    DataError, SpecError
        If fringes are requested but absent, or present although another route is requested.
    """
    ignores_fringes = options.mode in {"as-published", "absorptance"}
    if ignores_fringes and options.dispersion is not None:
        raise SpecError("--dispersion", limit=f"has no effect with --mode {options.mode}", remedy="omit --dispersion")
    if ignores_fringes or not {"T", "R"} & spectra.rows.keys():
        return None, None
    thickness = None if options.thickness_um is None else options.thickness
    kinds = [kind for kind in ("T", "R") if kind in spectra.rows and not (kind == "R" and options.mode == "lossless")]
    nm, readings = spectra.wavelength_nm, {kind: _reading(spectra, options, kind) for kind in kinds}
    phases = fringes_of(nm, {kind: reading.value for kind, reading in readings.items()}, thickness)
    if options.dispersion is not None and not phases:
        limit = "requires fringes, but none were detected"
        raise SpecError("--dispersion", value=options.dispersion, limit=limit, remedy="omit --dispersion")
    if options.bare_transmittance:
        bare, setup = _bare(recording, spectra, options)
        return index_from_fringes(
            nm, readings, phases, options.thickness, bandwidth_nm, setup, bare, options.dispersion
        )
    if not phases:
        if options.mode == MODE:
            limit = "requires fringes, but none were detected"
            raise SpecError("--mode", value=MODE, limit=limit, remedy="omit --mode")
        return None, None
    if options.mode in {"measured", "lossless"}:
        amplitude = np.sqrt(2.0) * phases[0].amplitude
        limit = f"neglects interference, but fringes of ± {amplitude:.2g} were detected"
        raise DataError("--mode", value=options.mode, limit=limit, remedy="omit --mode to use the route for fringes")
    return index_from_fringes(nm, readings, phases, thickness, bandwidth_nm, options.setup(nm), kind=options.dispersion)


def _bare(recording: Recording, spectra: OpticalSpectra, options: IndexOptions) -> tuple[dict[str, Reading], Setup]:
    """Return T and R of the bare substrate, and a setup with the median of the index computed from this T and R."""
    traces = {"T": options.bare_transmittance, "R": options.bare_reflectance, "A": ()}
    sheet, nm = optical_spectra(recording, traces), spectra.wavelength_nm
    if sheet.wavelength_nm.shape != nm.shape or not np.allclose(sheet.wavelength_nm, nm):
        limit = "must have the same wavelengths as the traces of the layer"
        remedy = "measure the layer and the bare substrate with the same settings"
        raise DataError("traces of the bare substrate", limit=limit, remedy=remedy)
    bare = {kind: _reading(sheet, options, kind) for kind in ("T", "R")}
    thickness_um = options.substrate_thickness_um or 0.0
    n = invert(bare["R"].value, bare["T"].value, thickness_um, nm).n
    if not np.isfinite(n).any():
        limit = "have values of T and R that no index produces"
        raise DataError("traces of the bare substrate", limit=limit, remedy="check the traces")
    start = Substrate(np.full(nm.shape, float(np.nanmedian(n))), 0.0, thickness_um)
    return bare, Setup(start, options.side or "layer", options.baseline or "air", options.r_baseline or "air")


def _by_route(spectra: OpticalSpectra, options: IndexOptions) -> IndexSpectrum:
    """Return the index by the requested route or, by default, by the route that the measured spectra allow."""
    t, nm = _transmittance(spectra, options), spectra.wavelength_nm
    setup = options.setup(nm)
    mode = options.mode or _default_mode(spectra, options, t)
    if mode == "lossless":
        return routes.lossless(nm, t, setup)
    if mode == "as-published":
        _check_published(spectra, options, t)
        return routes.as_published(nm, t, options.thickness)
    if mode == "measured":
        if "R" in spectra.rows:
            return routes.measured(nm, t, _reading(spectra, options, "R"), options.thickness, setup)
        if setup is None:
            raise routes.no_reflectance("T alone,", nm, t)
        limit = "requires a measured R of the layer on its substrate"
        raise SpecError("--mode", value=mode, limit=limit, remedy="name the trace of R, or use --mode lossless")
    if "A" not in spectra.rows or options.absorbance_kind != "absorptance":
        remedy = "name its trace with --absorbance, and add --absorbance-kind absorptance"
        raise SpecError("--mode", value=mode, limit="requires a measured absorptance", remedy=remedy)
    return routes.absorptance(nm, t, _reading(spectra, options, "A"), options.thickness)


def _default_mode(spectra: OpticalSpectra, options: IndexOptions, t: Reading) -> str:
    """Return the route that the measured spectra allow."""
    if "R" in spectra.rows:
        return "measured"
    if options.substrate is not None or "A" not in spectra.rows or "T" not in spectra.rows:
        return "lossless"
    if options.absorbance_kind in BASES:
        raise routes.no_reflectance(f"an absorbance, −{options.absorbance_kind} T,", spectra.wavelength_nm, t)
    if options.absorbance_kind is None:
        raise _kind_missing(spectra)
    return "absorptance"


def _reading(spectra: OpticalSpectra, options: IndexOptions, kind: str) -> Reading:
    return reading(spectra.rows[kind], getattr(options, f"u_{kind}"), name=kind)


def _transmittance(spectra: OpticalSpectra, options: IndexOptions) -> Reading:
    """Return the reading of T, computed from an absorbance if T was not measured."""
    if "T" in spectra.rows:
        return _reading(spectra, options, "T")
    if "A" not in spectra.rows:
        remedy = f"an index requires T; name the trace of T: {OPTIONS['T']}"
        raise DataError("transmittance", limit="is missing", remedy=remedy)
    if options.absorbance_kind is None:
        raise _kind_missing(spectra)
    if options.absorbance_kind == "absorptance":
        remedy = "measure T, too: an absorptance alone determines no index"
        raise DataError("transmittance", limit="is missing", remedy=remedy)
    base = BASES[options.absorbance_kind]
    rows = np.exp(-base * spectra.rows["A"])
    u_t = options.u_T if options.u_A is None else base * np.nan_to_num(rows.mean(axis=0)) * options.u_A
    return reading(rows, u_t, name="T")


def _kind_missing(spectra: OpticalSpectra) -> SpecError:
    limit = f"is required for {spectra.names['A'][0]}"
    remedy = "specify log10 for −log10 T, ln for −ln T, or absorptance for the fraction of the light that is absorbed"
    return SpecError("--absorbance-kind", limit=limit, remedy=remedy)


def _check_published(spectra: OpticalSpectra, options: IndexOptions, t: Reading) -> None:
    """Raise if A is specified as, or measured to be, anything but −log10 T, the absorbance of the published formula."""
    if options.absorbance_kind not in {None, "log10"}:
        limit = "must be log10 with --mode as-published"
        raise SpecError("--absorbance-kind", value=options.absorbance_kind, limit=limit)
    if "A" in spectra.rows and not is_absorbance(spectra.mean("A"), t.value):
        limit = "is not −log10 T, which --mode as-published uses as A"
        raise DataError(f"trace {spectra.names['A'][0]}", limit=limit, remedy="omit this trace, or use another mode")


def _bandwidth_nm(recording: Recording) -> float | None:
    """Return the spectral bandwidth from the metadata of a file; None if there is none."""
    for name, text in recording.provenance.metadata.items():
        if "sbw" in name.lower():
            try:
                value = float(text)
            except ValueError:
                continue
            if 0.0 < value < np.inf:
                return value
    return None


def _literature(spectrum: IndexSpectrum, options: IndexOptions) -> tuple[Band | None, list[Caution]]:
    """Return the index range of the literature, and warnings if n is outside it or falls too steeply."""
    if options.literature == "none":
        return None, []
    nm, n, package = spectrum.wavelength_nm, spectrum.n, options.literature == "package"
    return band(nm, options.polymers, package=package), [
        *check_index(nm, n.value, n.u, options.polymers, package=package),
        *check_dispersion(nm, n.value, smoothed_scatter(n), package=package),
    ]


def _repeats(spectra: OpticalSpectra) -> tuple[float | None, FloatArray | None]:
    """Return the longest wavelength at which every repeat measurement of T has a lossless index, and these indices."""
    n = lossless_index(spectra.rows.get("T", np.empty((0, 0))))
    (known,) = np.nonzero(np.isfinite(n).all(axis=0))
    if len(n) < 2 or not known.size:
        return None, None
    return float(spectra.wavelength_nm[known[-1]]), n[:, known[-1]]


def _baseline_warnings(spectra: OpticalSpectra, options: IndexOptions) -> list[Caution]:
    """Return a warning if an absorbance and a transmittance in the same file have different baselines."""
    base = BASES.get(options.absorbance_kind or "")
    if base is None or not {"A", "T"} <= spectra.rows.keys():
        return []
    if is_absorbance(spectra.mean("A"), spectra.mean("T"), base):
        return []
    name, other = spectra.names["A"][0], spectra.names["T"][0]
    return [
        warning(
            f"{name} is not the absorbance of {other}: they have different baselines, or belong to different samples"
        )
    ]


def _instrument_warnings(
    spectrum: IndexSpectrum, spectra: OpticalSpectra, options: IndexOptions, bandwidth_nm: float | None
) -> list[Caution]:
    """Return warnings about properties that are unspecified, or contradicted by T or the fringe spacing."""
    warnings = []
    if options.baseline is None:
        warnings.append(
            warning("the baseline is not specified and is assumed to be air (a free-standing layer): add --baseline")
        )
    if options.substrate is None and "T" in spectra.rows:
        t = spectra.mean("T")
        if (above_1 := float(np.mean(t > 1.0))) >= _MAX_ABOVE_1:
            warnings.append(
                warning(
                    f"T exceeds 1 at {above_1:.0%} of the wavelengths, up to {np.nanmax(t):.4f}: this is impossible "
                    "for a free-standing layer, but possible for a layer measured against its bare substrate; if so, "
                    "specify --baseline substrate"
                )
            )
    if options.thickness_um is not None and spectrum.mode not in {MODE, JOINT}:
        n = spectrum.lossless.value
        warnings += fringe_warnings(spectrum.wavelength_nm, n, options.thickness_um, bandwidth_nm)
        if options.u_thickness_um is None and spectrum.k.known.any():
            warnings.append(warning(f"{THICKNESS_NOT_IN_K} and not included in u_k: k is proportional to 1/thickness"))
    known = {*options.ignore, *options.bare_transmittance, *options.bare_reflectance}
    if others := [name for name in spectra.unused if name not in known]:
        more = len(others) - _MAX_UNUSED
        warnings.append(note(f"not used: {', '.join(others[:_MAX_UNUSED])}{f' and {more} more' if more > 0 else ''}"))
    return warnings
