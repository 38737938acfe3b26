"""Optical properties of layers against their exposure: transmittance and, if R was measured, index at some wavelengths.

Layers exposed for 2, 4 and 6 s give three points, which determine a linear trend with an interval, but no curve. Each
sample is one point. A trend of the transmittance is a property of the layers, not necessarily of the resin: a layer
that was exposed longer may also be thicker, rougher or yellower, and the trend alone does not distinguish these causes.

`exposure_trends` evaluates recordings; `samples_of` returns the layers of a recording, and `trend` fits a straight line
to values against exposure.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index import Length, measured, reading
from solen.material.index.interference import fringes_of
from solen.material.regression import fitted, t_tail
from solen.material.rows import RowOptions, chosen_rows, refuse_unused
from solen.ranks import Caution, note, warning
from solen.recording import Channel, Recording, Spectrum, spectra
from solen.recording.model import Measured
from solen.recording.optical import kind_of
from solen.results import HIDDEN
from solen.spec.strict import Above0, Wavelength
from solen.units import factor

WAVELENGTHS_NM = (450.0, 500.0, 860.0)
"""Wavelengths of the paper's three designs."""
TIMES = ("exposure", "exposure time", "time", "t")
"""Accepted names of the exposure column."""
_SAMPLES = ("sample", "specimen", "name", "replicate")
_TIME_IN_NAME = re.compile(r"(?<![a-zA-Z0-9.,])(\d+(?:[.,]\d+)?)\s*(ms|s|sec|sek|seconds|min)(?![a-zA-Z])")
_SECONDS = {"ms": 1e-3, "min": 60.0}
_MIN_SAMPLES = 4  # smallest number of samples that causes no warning
_REMEDY = "name the columns exposure_s, wavelength_nm and T, or write the exposure in the name of each %T trace (2 s)"
_MAX_DISTANCE_NM = 10.0  # largest distance of a wavelength from the nearest measured one
_SIGNIFICANCE = 0.05


class ExposureOptions(RowOptions):
    """Options for comparing layers with different exposures."""

    wavelength_nm: tuple[Wavelength, ...] = ()
    """A wavelength to evaluate; repeatable; default: those of 450, 500 and 860 nm that all spectra include."""
    irradiance_mW_per_cm2: Above0 | None = None
    """Irradiance at the window; converts exposures to doses."""
    thickness_um: Above0 | None = None
    """Thickness of the layers, required for the index."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A layer: its name, its exposure in s, and its spectra as fractions, shape (n,).

    The wavelengths are in ascending order; ``reflectance`` is None if it was not measured.
    """

    name: str
    exposure_s: float
    wavelength_nm: FloatArray
    transmittance: FloatArray
    reflectance: FloatArray | None = None

    def interferes(self, thickness_um: float) -> bool:
        """Whether the spectra show fringes, so that R and T at one wavelength determine no index."""
        spectra = {"T": self.transmittance} | ({} if self.reflectance is None else {"R": self.reflectance})
        return bool(fringes_of(self.wavelength_nm, spectra, Length(thickness_um)))


@dataclass(frozen=True)
class Trend:
    """Linear trend of a value with exposure.

    Attributes
    ----------
    slope_per_s, u_slope_per_s, interval95_slope_per_s
        Change per second of exposure, its standard uncertainty and 95 % interval; the last two are None with two
        samples.
    p
        Probability that a slope this steep occurs by chance; None with two samples.
    middle, middle_s
        Value of the line at the mean exposure, and the mean exposure.
    samples, exposures
        Number of samples, and number of different exposures.
    """

    slope_per_s: float
    u_slope_per_s: float | None
    interval95_slope_per_s: tuple[float, float] | None
    p: float | None
    middle: float = field(metadata=HIDDEN)
    middle_s: float = field(metadata=HIDDEN)
    samples: int
    exposures: int

    def value(self, exposure_s: ArrayLike) -> FloatArray:
        """Return the value of the line at a given exposure."""
        return self.middle + self.slope_per_s * (np.asarray(exposure_s, float) - self.middle_s)


@dataclass(frozen=True, eq=False)
class AtWavelength:
    """Optical properties of all layers at one wavelength, and their trends; arrays of shape (samples,), NaN if unknown.

    Attributes
    ----------
    wavelength_nm
        The wavelength.
    T, R, n
        Transmittance, reflectance and index of each layer.
    trend_T, trend_n
        Trends of T and n with exposure; None if the value is known for fewer than two exposures.
    """

    wavelength_nm: float
    T: FloatArray
    R: FloatArray
    n: FloatArray
    trend_T: Trend | None
    trend_n: Trend | None


class ExposureTrends(Measured, kw_only=True):
    """Optical properties of layers against their exposure.

    Attributes
    ----------
    samples
        Names of the layers, in ascending order of exposure.
    exposure_s, dose_mJ_per_cm2
        Exposure and dose of each layer; the dose is None without an irradiance.
    wavelengths
        Values and trends at each wavelength.
    """

    samples: tuple[str, ...]
    exposure_s: FloatArray
    dose_mJ_per_cm2: FloatArray | None
    wavelengths: tuple[AtWavelength, ...]
    layers: tuple[Sample, ...] = field(metadata=HIDDEN)


def exposure_trends(recordings: Sequence[Recording], options: ExposureOptions = ExposureOptions()) -> ExposureTrends:
    """Return the transmittance of layers against exposure at the given wavelengths, and their index if R was measured.

    Parameters
    ----------
    recordings
        Spectra with the exposure (``2 s``) in the name of each trace or of the file, or tables with columns exposure_s,
        wavelength_nm and T, and optionally R.
    options
        Wavelengths, irradiance, thickness.

    Raises
    ------
    DataError, SpecError
        If an exposure is missing, or there are fewer than two exposures.
    """
    recordings = [chosen_rows(recording, options) for recording in recordings]
    notes = [note for recording in recordings for note in _check_unused(recording, options)]
    layers = sorted(
        (sample for recording in recordings for sample in samples_of(recording)), key=lambda layer: layer.exposure_s
    )
    seconds = np.array([layer.exposure_s for layer in layers])
    if (exposures := len(set(seconds.tolist()))) < 2:
        raise DataError("number of exposures", value=exposures, limit="must be at least 2 for a trend")
    wavelengths = [
        _at_wavelength(nm, layers, seconds, options.thickness_um) for nm in _wavelengths(layers, options.wavelength_nm)
    ]
    irradiance = options.irradiance_mW_per_cm2
    file_warnings = [text for recording in recordings if _time(recording) is None for text in recording.warnings]
    return ExposureTrends(
        samples=tuple(layer.name for layer in layers),
        exposure_s=seconds,
        dose_mJ_per_cm2=None if irradiance is None else seconds * irradiance,
        wavelengths=tuple(wavelengths),
        sources=tuple(recording.provenance for recording in recordings),
        warnings=(*file_warnings, *notes, *_warnings(layers, exposures, wavelengths, options.thickness_um)),
        layers=tuple(layers),
    )


def trend(exposure_s: ArrayLike, values: ArrayLike) -> Trend | None:
    """Return the trend of values with exposure, shape (n,), ignoring NaN; None with fewer than two exposures."""
    x, y = np.asarray(exposure_s, float), np.asarray(values, float)
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    exposures = len(np.unique(x))
    if exposures < 2:
        return None
    middle_s = float(x.mean())
    if len(x) == 2:
        return Trend(float((y[1] - y[0]) / (x[1] - x[0])), None, None, None, float(y.mean()), middle_s, 2, 2)
    fit = fitted(np.column_stack([np.ones(len(x)), x - middle_s]), y)
    slope, u = float(fit.parameters[1]), fit.u((0.0, 1.0))
    p = t_tail(slope / u, fit.error_df) if u > 0.0 else float(slope == 0.0)
    return Trend(slope, u, fit.interval((0.0, 1.0)), p, float(fit.parameters[0]), middle_s, len(x), exposures)


def samples_of(recording: Recording) -> list[Sample]:
    """Return the layers of a recording, each with its exposure."""
    time = _time(recording)
    traces = [(kind_of(spectrum.channel), spectrum) for spectrum in spectra(recording)]
    traces = [(kind, spectrum) for kind, spectrum in traces if kind in {"T", "R"}]
    if time is not None:
        return _samples_of_rows(recording, dict(traces), time.to("s"))
    by_exposure: dict[float, dict[str | None, list[Spectrum]]] = {}
    for kind, spectrum in traces:
        seconds = _exposure_in_name(recording, spectrum.channel.name)
        by_exposure.setdefault(seconds, {"T": [], "R": []})[kind].append(spectrum)
    samples = [sample for seconds, kinds in by_exposure.items() for sample in _paired(seconds, kinds["T"], kinds["R"])]
    if not samples:
        raise DataError(recording.provenance.file, limit="contains no transmittance", remedy=_REMEDY)
    return samples


def _time(recording: Recording) -> Channel | None:
    """Return the exposure column of a table with one row per exposure and wavelength; None for any other file."""
    times = [recording.find(name) for name in TIMES]
    return next((channel for channel in times if channel and factor(channel.unit or "1", "s")), None)


def _check_unused(recording: Recording, options: ExposureOptions) -> list[Caution]:
    """Return notes on unused columns, as `refuse_unused` does; in a file of traces, only labels are checked."""
    time, traces = _time(recording), spectra(recording)
    if time is None:
        return refuse_unused(recording, options, (), labels_only=True)
    names: dict[str | None, str] = {}
    for spectrum in traces:
        names.setdefault(kind_of(spectrum.channel), spectrum.channel.name)
    axes = {spectrum.channel.axis for spectrum in traces}
    used = [time.name, *axes, *_SAMPLES, *(name for kind, name in names.items() if kind in {"T", "R"})]
    return refuse_unused(recording, options, used)


def _exposure_in_name(recording: Recording, name: str) -> float:
    """Return the exposure in the name of a trace or, if it contains none, in the name of the file."""
    for text in (name, Path(recording.provenance.file).stem.replace("_", " ")):
        if match := _TIME_IN_NAME.search(text):
            return float(match[1].replace(",", ".")) * _SECONDS.get(match[2], 1.0)
    limit = "the name contains no exposure"
    remedy = "add the exposure to the name, for example 2 s"
    raise DataError(f"{recording.provenance.file}: trace {name}", limit=limit, remedy=remedy)


def _paired(seconds: float, transmittances: list[Spectrum], reflectances: list[Spectrum]) -> list[Sample]:
    """Return one sample per trace of T at one exposure, with a trace of R if T and R have equally many traces."""
    has_pairs = len(reflectances) == len(transmittances)
    samples = []
    for number, transmittance in enumerate(transmittances):
        nm, t = _ascending(transmittance.wavelength_nm, transmittance.ratio())
        r = None
        if has_pairs:
            r = np.interp(nm, *_ascending(reflectances[number].wavelength_nm, reflectances[number].ratio()))
        samples.append(Sample(transmittance.channel.name, seconds, nm, t, r))
    return samples


def _samples_of_rows(recording: Recording, by_kind: dict[str | None, Spectrum], seconds: FloatArray) -> list[Sample]:
    """Return the samples from a table with one row per exposure and wavelength."""
    if "T" not in by_kind:
        raise DataError(recording.provenance.file, limit="contains no transmittance", remedy="name its column T")
    labels = [cells for name in _SAMPLES if (cells := recording.label(name)) is not None]
    names = [" ".join(row).strip() for row in zip(*labels, strict=True)] or [""] * len(seconds)
    keys = list(zip(names, seconds.tolist(), strict=True))
    samples = []
    for name, value in dict.fromkeys(keys):
        rows = np.array([key == (name, value) for key in keys])
        (nm, t), *reflectance = (
            _ascending(by_kind[kind].wavelength_nm[rows], by_kind[kind].ratio()[rows])
            for kind in ("T", "R")
            if kind in by_kind
        )
        r = np.interp(nm, *reflectance[0]) if reflectance and reflectance[0][0].size else None
        samples.append(Sample(f"{name} {value:g} s".strip(), value, nm, t, r))
    return samples


def _ascending(nm: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = np.isfinite(nm) & np.isfinite(values)
    order = np.argsort(nm[known])
    return nm[known][order], values[known][order]


def _wavelengths(layers: Sequence[Sample], wanted: Sequence[float]) -> list[float]:
    """Return the requested wavelengths or, by default, those of `WAVELENGTHS_NM` at which all samples were measured.

    Raises
    ------
    DataError
        If a sample was not measured at a requested wavelength, or there is no common wavelength.
    """
    for nm in wanted:
        missing = [layer.name for layer in layers if not _includes(layer, nm)]
        if missing:
            limit = f"{missing[0]} was not measured within {_MAX_DISTANCE_NM:g} nm of this wavelength"
            raise DataError("--wavelength-nm", value=nm, limit=limit, remedy="choose another wavelength")
    chosen = list(wanted) or [nm for nm in WAVELENGTHS_NM if all(_includes(layer, nm) for layer in layers)]
    if not chosen:
        default = " or ".join(f"{nm:g}" for nm in WAVELENGTHS_NM)
        limit = f"not all samples were measured at {default} nm"
        raise DataError("exposures", limit=limit, remedy="specify a common wavelength with --wavelength-nm")
    return chosen


def _includes(sample: Sample, nm: float) -> bool:
    """Whether a wavelength is within the range of a sample and close to one of its points."""
    points = sample.wavelength_nm
    return points.size > 0 and points[0] <= nm <= points[-1] and float(np.min(np.abs(points - nm))) <= _MAX_DISTANCE_NM


def _at_wavelength(
    nm: float, layers: Sequence[Sample], seconds: FloatArray, thickness_um: float | None
) -> AtWavelength:
    """Return the values of all samples at a wavelength, and their trends."""
    t = np.array([np.interp(nm, layer.wavelength_nm, layer.transmittance) for layer in layers])
    r = np.array(
        [
            math.nan if layer.reflectance is None else np.interp(nm, layer.wavelength_nm, layer.reflectance)
            for layer in layers
        ]
    )
    n = np.full(len(layers), np.nan)
    if thickness_um is not None:
        for number in np.flatnonzero(np.isfinite(r)).tolist():
            if layers[number].interferes(thickness_um):
                continue
            t_and_r = reading([t[number]], name="T"), reading([r[number]], name="R")
            n[number] = measured([nm], *t_and_r, Length(thickness_um)).n.value[0]
    return AtWavelength(nm, t, r, n, trend(seconds, t), trend(seconds, n))


def _warnings(
    layers: Sequence[Sample], exposures: int, wavelengths: Sequence[AtWavelength], thickness_um: float | None
) -> list[Caution]:
    warnings = []
    if len(layers) < _MIN_SAMPLES:
        warnings.append(
            warning(
                f"{len(layers)} samples are few for a trend (degrees of freedom: "
                f"{max(len(layers) - 2, 0)}), so its interval is wide; "
                "measure several layers at each exposure"
            )
        )
    if exposures == 2:
        warnings.append(note("two exposures do not show whether the change is linear"))
    unresolved = [f"{row.wavelength_nm:g} nm" for row in wavelengths if not _is_resolved(row.trend_T)]
    if unresolved:
        warnings.append(warning(f"no trend of T with exposure is resolved at {', '.join(unresolved)}"))
    warnings.append(
        note(
            "a layer that was exposed longer may also be thicker, unless a gap fixed its thickness: measure the "
            "thickness of each layer before attributing the trend to the resin"
        )
    )
    if all(layer.reflectance is None for layer in layers):
        warnings.append(note("R was not measured: transmittance alone does not determine the change of the index"))
    elif thickness_um is None:
        warnings.append(note("no index is computed: it requires the thickness; specify --thickness-um"))
    elif with_fringes := [
        layer.name for layer in layers if layer.reflectance is not None and layer.interferes(thickness_um)
    ]:
        warnings.append(
            warning(
                f"no index is computed for {', '.join(with_fringes)}, because fringes were detected; "
                "use solen resin index, which fits the fringes"
            )
        )
    return warnings


def _is_resolved(line: Trend | None) -> bool:
    return line is not None and line.p is not None and line.p <= _SIGNIFICANCE
