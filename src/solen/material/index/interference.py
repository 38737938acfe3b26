"""Route for a layer with visible fringes, from T, R or both to an `IndexSpectrum`.

Fringes are detected automatically. The index then follows from a fit of a film with partial coherence
(`solen.material.index.film`). If the residuals still contain fringes, no film of this kind explains the data, and n is
computed from the levels of T and R with the incoherent model; the fringes then contribute to its uncertainty as
scatter.

`fringes_of` detects the fringes in readings; `index_from_fringes` returns the spectrum and an `Interference`.
"""

from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.dispersion_form import Kind
from solen.material.index.film import Film, fit_film, fit_levels
from solen.material.index.film_model import FilmReadings
from solen.material.index.fringes import Phase, find_fringes
from solen.material.index.inversion import invert
from solen.material.index.lossless_index import lossless_index
from solen.material.index.masks import THREE_SIGMAS, Reason, mask_warnings
from solen.material.index.reading import Combined, Length, Reading
from solen.material.index.spectrum import IndexSpectrum, all_masked, estimate
from solen.material.index.stack import Setup
from solen.ranks import Caution, note, warning
from solen.results import HIDDEN, Result

MODE = "fringes"
"""Name of the route."""
JOINT = "joint"
"""Name of the route for a layer and its bare substrate, without visible fringes."""
_INDEX_RANGE = (1.25, 1.9)  # range of indices in the search for fringes
_OPTICAL_UM = (8.0, 150.0)  # range of n times thickness if the thickness is not specified
_TYPICAL_INDEX = 1.5


class Interference(Result):
    """Results from the fringes of a layer, in addition to its index.

    Attributes
    ----------
    thickness_um, u_thickness_um
        Mean thickness, and its standard uncertainty.
    optical_thickness_um, u_optical_thickness_um
        n times thickness at the centre of the spectrum, and its standard uncertainty; None if n is computed from the
        levels of T and R alone.
    thickness_spread_percent
        Standard deviation of the thickness within the beam, estimated from the contrast.
    slit_nm
        Fitted slit width.
    visibility
        Contrast of the fringes at the centre of the spectrum, relative to that of a perfect film.
    by_levels
        Whether no film explains the fringes, so that n is computed from the levels of the spectra.
    residual
        RMS difference between measured and fitted values of T and of R.
    dispersion
        Functional form of n in the fit: cauchy (three terms), sellmeier (one pole), free (a smooth curve with knots).
    """

    thickness_um: float
    u_thickness_um: float
    optical_thickness_um: float | None
    u_optical_thickness_um: float | None
    thickness_spread_percent: float
    slit_nm: float
    visibility: float
    by_levels: bool
    residual: Mapping[str, float]
    dispersion: str
    fitted: Mapping[str, FloatArray] = field(metadata=HIDDEN)


def fringes_of(
    wavelength_nm: FloatArray, readings: Mapping[str, ArrayLike], thickness: Length | None = None
) -> list[Phase]:
    """Return the fringes in T, in R, or in their difference if both were measured; none if noise explains them."""
    spectra = {kind: np.asarray(values, dtype=float) for kind, values in readings.items()}
    mean = None
    if set(spectra) == {"T", "R"}:
        values, mean = (spectra["T"] - spectra["R"]) / 2.0, (spectra["T"] + spectra["R"]) / 2.0
    else:
        values = spectra["T"] if "T" in spectra else -spectra["R"]
    known = np.isfinite(values)
    low, high = _OPTICAL_UM
    if thickness is not None:
        margin = min(max(3.0 * (thickness.u_um or 0.0) / thickness.um, 0.15), 0.5)
        low = thickness.um * _INDEX_RANGE[0] * (1.0 - margin)
        high = thickness.um * _INDEX_RANGE[1] * (1.0 + margin)
    return find_fringes(wavelength_nm[known], values[known], (low, high), None if mean is None else mean[known])


def index_from_fringes(
    wavelength_nm: FloatArray,
    readings: Mapping[str, Reading],
    phases: list[Phase],
    thickness: Length | None,
    slit_nm: float | None,
    setup: Setup | None = None,
    bare: Mapping[str, Reading] | None = None,
    kind: Kind | None = None,
) -> tuple[IndexSpectrum, Interference | None]:
    """Return the index and extinction of a layer with fringes, or of a layer fitted jointly with its bare substrate.

    Raises
    ------
    DataError
        If a reading has missing values, or the spectra do not determine a film.
    """
    every_reading = [*readings.values(), *(bare or {}).values()]
    if not all(np.isfinite(reading.value).all() for reading in every_reading):
        limit = "must have a value at every wavelength if fringes are fitted"
        raise DataError("T and R", limit=limit, remedy="remove the rows without a value")
    measured = FilmReadings(wavelength_nm, dict(readings), thickness, slit_nm, setup, dict(bare or {}))
    start_n = _initial_index(readings) if setup is None else _TYPICAL_INDEX
    if not phases:
        return _spectrum(measured, fit_levels(measured, start_n), by_levels=False, mode=JOINT), None
    film = fit_film(measured, start_n, phases, kind)
    by_levels = _leaves_fringes(measured, film)
    if by_levels:
        _check_form(measured, film, fit_film(measured, start_n, phases) if kind in {"cauchy", "sellmeier"} else None)
        film = fit_levels(measured, start_n)
    return _spectrum(measured, film, by_levels=by_levels, kind=kind), _interference(film, by_levels=by_levels)


def _leaves_fringes(measured: FilmReadings, film: Film) -> bool:
    residuals = {kind: reading.value - film.fitted[kind] for kind, reading in measured.readings.items()}
    return bool(fringes_of(measured.wavelength_nm, residuals, measured.thickness))


def _check_form(measured: FilmReadings, film: Film, other: Film | None) -> None:
    """Raise `DataError` if the requested form of n leaves fringes but another form does not."""
    if other is None or other.form == film.form or _leaves_fringes(measured, other):
        return
    rms = [" and ".join(f"{value:.2g} in {kind}" for kind, value in fit.residual.items()) for fit in (film, other)]
    limit = (
        f"does not describe n: fringes remain in its residuals ({rms[0]} RMS), but not "
        f"in those of {other.form} ({rms[1]} RMS)"
    )
    raise DataError("--dispersion", value=film.form, limit=limit, remedy=f"omit it, or use {other.form}")


def _initial_index(readings: Mapping[str, Reading]) -> float:
    """Return an initial index from the medians of T and R."""
    medians = {kind: float(np.median(reading.value)) for kind, reading in readings.items()}
    if set(medians) == {"T", "R"}:
        n = float(invert(medians["R"], medians["T"], 25.0, 600.0).n)
    else:
        n = float(lossless_index(medians["T"] if "T" in medians else 1.0 - medians["R"]))
    return n if _INDEX_RANGE[0] < n < _INDEX_RANGE[1] else _TYPICAL_INDEX


def _interference(film: Film, *, by_levels: bool) -> Interference:
    return Interference(
        thickness_um=film.thickness_um,
        u_thickness_um=film.u_thickness_um,
        optical_thickness_um=None if by_levels else film.optical_um,
        u_optical_thickness_um=None if by_levels else film.u_optical_um,
        thickness_spread_percent=100.0 * film.thickness_sd,
        slit_nm=film.slit_nm,
        visibility=film.visibility,
        by_levels=by_levels,
        residual=film.residual,
        dispersion=film.form,
        fitted=film.fitted,
    )


def _spectrum(
    measured: FilmReadings, film: Film, *, by_levels: bool, mode: str = MODE, kind: Kind | None = None
) -> IndexSpectrum:
    nm, nan = measured.wavelength_nm, np.full(film.n.size, np.nan)
    n, k = (_common(errors) for errors in (film.errors_n, film.errors_k))
    unmasked = np.full(nm.size, int(Reason.NONE), dtype=np.int8)
    is_small = film.k <= k.bound(THREE_SIGMAS)
    no_k = np.where(is_small, Reason.SMALL, unmasked).astype(np.int8)
    values = {kind: reading.value for kind, reading in measured.readings.items()}
    return IndexSpectrum(
        mode=mode,
        measurement=True,
        wavelength_nm=nm,
        n=estimate(film.n, n, unmasked),
        k=estimate(film.k, k, no_k),
        k_low95=np.where(is_small, 0.0, np.maximum(film.k - k.bound(0.95), 0.0)),
        k_high95=film.k + k.bound(0.95),
        correlation=nan,
        lossless=all_masked(np.full(nm.size, int(Reason.ASSUMED), dtype=np.int8)),
        reflectance=values.get("R", nan),
        transmittance=values.get("T", nan),
        thickness=Length(film.thickness_um, film.u_thickness_um),
        warnings=(
            *_warnings(measured, mode, "" if kind == "free" else film.form, by_levels=by_levels),
            *mask_warnings("k", no_k),
        ),
    )


def _common(errors: FloatArray) -> Combined:
    size = errors.shape[1]
    return Combined(np.zeros(size), errors, np.full(size, np.inf))


def _warnings(measured: FilmReadings, mode: str, dispersion: str, *, by_levels: bool) -> list[Caution]:
    """Return notes on the choice of the model, and warnings about missing inputs."""
    warnings = [
        note(
            "fringes were detected: the reflections from the faces of the layer interfere, and their coherence was "
            "fitted together with the index"
        )
    ]
    if by_levels:
        warnings = [
            warning(
                "fringes were detected, but no film with a single slit width, a single thickness variation and a "
                "smooth n explains them: n is computed from the levels of the spectra, and the fringes contribute to "
                "its uncertainty as scatter; measure a spot with a more uniform thickness"
            )
        ]
    elif dispersion == "free":
        warnings.append(
            note(
                "the residuals of Cauchy's three terms exceed the noise: n is represented by "
                "a smooth curve with knots a few fringes apart"
            )
        )
    if mode == JOINT:
        warnings = [
            note(
                "layer and bare substrate are fitted jointly, with k of at least 0 in both and "
                "a common photometer error"
            )
        ]
    elif measured.slit_nm is None:
        warnings.append(
            warning(
                "the bandwidth is not specified and was fitted: specify --bandwidth-nm, because the "
                "contrast of the fringes depends on it"
            )
        )
    if mode == MODE and ((thickness := measured.thickness) is None or thickness.u_um is None):
        warnings.append(
            warning(
                "the uncertainty of the thickness is not specified and is assumed to be 10 %; the fringes determine "
                "the thickness"
            )
        )
    without_accuracy = [kind for kind, reading in measured.readings.items() if not reading.u_common.any()]
    if without_accuracy:
        options = " and ".join(f"--u-{kind}" for kind in without_accuracy)
        warnings.append(
            warning(
                f"the accuracy of {' and '.join(without_accuracy)} is not specified, so u(n) does not include it: "
                f"specify {options}"
            )
        )
    if "R" not in measured.readings:
        warnings.append(
            warning(
                "R was not measured, so n depends on the contrast of the fringes and on the thickness: measure R as "
                "well"
            )
        )
    return [*warnings, *(text for reading in measured.readings.values() for text in reading.warnings)]
