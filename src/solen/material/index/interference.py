"""Route for a layer with visible fringes: from T, R or both to an `IndexSpectrum`, or back to the sum of powers.

Fringes in the data are detected automatically. The index is then that of a film whose coherence is fitted too
(`solen.material.index.film`). If the residuals still contain fringes, no film of this kind explains the data, and n is
computed from the levels of T and R, with the fringes as scatter in its uncertainty.

`fringes_of` detects the fringes in readings; `fringed` returns the spectrum and an `Interference`.
"""

from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.dispersion_form import Kind
from solen.material.index.film import Film, fit_film, fit_levels
from solen.material.index.film_model import Measured
from solen.material.index.fringes import Phase, find_fringes
from solen.material.index.inversion import invert
from solen.material.index.lossless_index import lossless_index
from solen.material.index.masks import THREE_SIGMAS, Why, counted
from solen.material.index.reading import Combined, Length, Reading
from solen.material.index.spectrum import IndexSpectrum, estimate, nothing
from solen.material.index.stack import Setup
from solen.ranks import Caution, note, warning
from solen.results import HIDDEN, Result

MODE = "fringes"
"""Name of the route."""
JOINT = "joint"
"""Name of the route for a layer and its bare sheet without visible fringes."""
_INDICES = (1.25, 1.9)  # range of indices in the search for fringes
_THICK_UM = (8.0, 150.0)  # n times thickness if the thickness is not specified
_TYPICAL_INDEX = 1.5


class Interference(Result):
    """Results from a layer's fringes, in addition to its index.

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
        Contrast at the centre of the spectrum, as a fraction of that of a perfect film.
    by_levels
        Whether no film explains the fringes, so that n is computed from the levels of the spectra.
    residual
        Root mean square of measured minus fitted values, for each reading.
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
    beside = None
    if set(spectra) == {"T", "R"}:
        values, beside = (spectra["T"] - spectra["R"]) / 2.0, (spectra["T"] + spectra["R"]) / 2.0
    else:
        values = spectra["T"] if "T" in spectra else -spectra["R"]
    known = np.isfinite(values)
    least, most = _THICK_UM
    if thickness is not None:
        margin = min(max(3.0 * (thickness.u_um or 0.0) / thickness.um, 0.15), 0.5)
        least, most = (thickness.um * end for end in (_INDICES[0] * (1.0 - margin), _INDICES[1] * (1.0 + margin)))
    return find_fringes(wavelength_nm[known], values[known], (least, most), None if beside is None else beside[known])


def fringed(
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
        If a reading is missing between others, or the spectra do not determine a film.
    """
    every = [*readings.values(), *(bare or {}).values()]
    if not all(np.isfinite(one.value).all() for one in every):
        limit = "must have a value at every wavelength where fringes are fitted"
        raise DataError("T and R", limit=limit, remedy="remove the rows without a value")
    measured = Measured(wavelength_nm, dict(readings), thickness, slit_nm, setup, dict(bare or {}))
    level = _level(readings) if setup is None else _TYPICAL_INDEX
    if not phases:
        return _spectrum(measured, fit_levels(measured, level), by_levels=False, mode=JOINT), None
    film = fit_film(measured, level, phases, kind)
    left = {kind: reading.value - film.fitted[kind] for kind, reading in readings.items()}
    by_levels = bool(fringes_of(wavelength_nm, left, thickness))
    if by_levels:
        _refuse_form(measured, film, fit_film(measured, level, phases) if kind in {"cauchy", "sellmeier"} else None)
        film = fit_levels(measured, level)
    return _spectrum(measured, film, by_levels=by_levels, kind=kind), _facts(film, by_levels=by_levels)


def _refuse_form(measured: Measured, film: Film, other: Film | None) -> None:
    """Raise `DataError` if the requested form of n leaves fringes and another form leaves none."""
    if other is None or other.form == film.form:
        return
    left = {kind: reading.value - other.fitted[kind] for kind, reading in measured.readings.items()}
    if fringes_of(measured.wavelength_nm, left, measured.thickness):
        return
    rms = [" and ".join(f"{value:.2g} in {kind}" for kind, value in one.residual.items()) for one in (film, other)]
    limit = (
        f"does not describe n here: fringes remain in its residuals ({rms[0]} rms), but not "
        f"in those of {other.form} ({rms[1]})"
    )
    raise DataError("--dispersion", value=film.form, limit=limit, remedy=f"omit it, or use {other.form}")


def _level(readings: Mapping[str, Reading]) -> float:
    """Return an initial index from the median levels of T and R."""
    middle = {kind: float(np.median(reading.value)) for kind, reading in readings.items()}
    if set(middle) == {"T", "R"}:
        n = float(invert(middle["R"], middle["T"], 25.0, 600.0).n)
    else:
        n = float(lossless_index(middle["T"] if "T" in middle else 1.0 - middle["R"]))
    return n if _INDICES[0] < n < _INDICES[1] else _TYPICAL_INDEX


def _facts(film: Film, *, by_levels: bool) -> Interference:
    return Interference(
        thickness_um=film.thickness_um,
        u_thickness_um=film.u_thickness_um,
        optical_thickness_um=None if by_levels else film.optical_um,
        u_optical_thickness_um=None if by_levels else film.u_optical_um,
        thickness_spread_percent=100.0 * film.spread,
        slit_nm=film.slit_nm,
        visibility=film.visibility,
        by_levels=by_levels,
        residual=film.residual,
        dispersion=film.form,
        fitted=film.fitted,
    )


def _spectrum(
    measured: Measured, film: Film, *, by_levels: bool, mode: str = MODE, kind: Kind | None = None
) -> IndexSpectrum:
    nm, nothing_known = measured.wavelength_nm, np.full(film.n.size, np.nan)
    n, k = (_common(parts) for parts in (film.parts_n, film.parts_k))
    fine = np.full(nm.size, int(Why.FINE), dtype=np.int8)
    small = film.k <= k.bound(THREE_SIGMAS)
    no_k = np.where(small, Why.SMALL, fine).astype(np.int8)
    values = {kind: reading.value for kind, reading in measured.readings.items()}
    return IndexSpectrum(
        mode=mode,
        measurement=True,
        wavelength_nm=nm,
        n=estimate(film.n, n, fine),
        k=estimate(film.k, k, no_k),
        k_low95=np.where(small, 0.0, np.maximum(film.k - k.bound(0.95), 0.0)),
        k_high95=film.k + k.bound(0.95),
        correlation=nothing_known,
        lossless=nothing(np.full(nm.size, int(Why.ASSUMED), dtype=np.int8)),
        reflectance=values.get("R", nothing_known),
        transmittance=values.get("T", nothing_known),
        thickness=Length(film.thickness_um, film.u_thickness_um),
        warnings=(
            *_remarks(measured, mode, "" if kind == "free" else film.form, by_levels=by_levels),
            *counted("k", no_k),
        ),
    )


def _common(parts: FloatArray) -> Combined:
    size = parts.shape[1]
    return Combined(np.zeros(size), parts, np.full(size, np.inf))


def _remarks(measured: Measured, mode: str, dispersion: str, *, by_levels: bool) -> list[Caution]:
    """Return notes on the choice of model, and on missing inputs."""
    found = [
        note(
            "fringes were detected: the faces of the layer interfere, and the coherence was fitted "
            "together with the index"
        )
    ]
    if by_levels:
        found = [
            warning(
                "fringes were detected, but no film with a single slit width, a single thickness "
                "variation and a smooth n explains them: n is computed from the levels of the "
                "spectra, and the fringes count as scatter in its uncertainty; measure a flatter "
                "spot"
            )
        ]
    elif dispersion == "free":
        found.append(
            note(
                "the residuals of Cauchy's three terms exceed the noise: n is represented by "
                "a smooth curve with knots a few fringes apart"
            )
        )
    if mode == JOINT:
        found = [
            note(
                "layer and bare substrate are fitted jointly, with k of at least 0 in both and "
                "a common photometer error"
            )
        ]
    elif measured.slit_nm is None:
        found.append(
            warning(
                "the bandwidth is not specified and was fitted: specify --bandwidth-nm, because the "
                "contrast of fringes depends on it"
            )
        )
    if mode == MODE and ((thickness := measured.thickness) is None or thickness.u_um is None):
        found.append(
            warning(
                "the uncertainty of the thickness is not specified: 10 % is assumed, and the fringes "
                "determine the thickness"
            )
        )
    unknown = [kind for kind, reading in measured.readings.items() if not reading.u_common.any()]
    if unknown:
        options = " and ".join(f"--u-{kind}" for kind in unknown)
        found.append(
            warning(
                f"the accuracy of {' and '.join(unknown)} is neither specified nor included in u(n): specify {options}"
            )
        )
    if "R" not in measured.readings:
        found.append(
            warning(
                "R was not measured: n depends on the contrast of the fringes and on the thickness; measure R as well"
            )
        )
    return [*found, *(remark for reading in measured.readings.values() for remark in reading.remarks)]
