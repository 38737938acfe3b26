"""A layer whose faces interfere: n(λ), k(λ) ≥ 0 and thickness from T, R or both, with fitted blurring of the fringes.

Unknowns other than the index are fitted with it, as nuisance parameters with priors
(`solen.material.index.film_model`). Fringes then determine n times thickness to one part in ten thousand, the level of
R determines n, the micrometer separates the two, and the covariance contains what the data do not determine. The
scatter is estimated from the residuals. n is free only if there are many fringes and Cauchy's three terms leave more
than noise.

Fringes have many nearly equivalent solutions, one order apart. Solutions with neighbouring orders are tried; an
alternative solution enters the covariance with its weight.

`fit_film` fits a `Film` to the readings in a `Measured`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.material.index.coherence import Blur
from solen.material.index.dispersion_form import MIN_FRINGES, Kind, free_knots
from solen.material.index.film_model import STEP, FilmModel, Measured
from solen.material.index.fringes import Phase
from solen.units import NM_PER_UM

_EVIDENCE = 10.0  # required increase of the log-likelihood for a free index
_ORDERS, _MAX_ORDERS = (-1.0, 1.0), 4  # shifts of the order to be tried, and number of rounds
_CLEAN = 1.5  # largest variance factor from correlated neighbours at which a free index is accepted
_FREE_ORDERS, _MAX_TRIED = tuple(np.arange(-6.0, 6.1)), 4  # shifts to be tried with a free index; number refined
_APART = 12.0  # difference of χ² above which another solution has no weight


@dataclass(frozen=True, eq=False)
class Film:
    """A fitted layer; arrays of shape (n,) along the wavelengths.

    Attributes
    ----------
    n, k
        Index and extinction coefficient.
    parts_n, parts_k
        Uncertainty as independent errors, each shared by all wavelengths, shape (parts, n): the covariance of two
        wavelengths is the sum of their products.
    thickness_um, u_thickness_um
        Mean thickness and its standard uncertainty.
    optical_um, u_optical_um
        n times thickness at the central wavelength, and its standard uncertainty.
    spread
        Relative standard deviation of the thickness within the beam.
    slit_nm
        Fitted slit width.
    visibility
        Contrast at the central wavelength, as a fraction of that of a perfect film.
    residual
        Root mean square of measured minus fitted values, for each reading.
    amplitude
        Root mean square of the fitted fringes, for each reading.
    fitted
        Fitted spectra, for each reading.
    form
        Functional form of n in the fit.
    """

    n: FloatArray
    k: FloatArray
    parts_n: FloatArray
    parts_k: FloatArray
    thickness_um: float
    u_thickness_um: float
    optical_um: float
    u_optical_um: float
    spread: float
    slit_nm: float
    visibility: float
    residual: dict[str, float]
    amplitude: dict[str, float]
    fitted: dict[str, FloatArray]
    form: Kind


def fit_film(measured: Measured, level: float, phases: Sequence[Phase], kind: Kind | None = None) -> Film:
    """Fit a layer to the fringes and levels of the readings.

    Parameters
    ----------
    level
        Initial value of the index.
    phases
        Possible interpretations of the fringes, the best first.
    kind
        Functional form of n; None for Cauchy's, or a free one if it explains much more.

    Raises
    ------
    DataError
        If the spectra do not determine a film, or a free index is requested with too few fringes.
    """
    begun = []
    for phase in phases:
        model = FilmModel(measured, level, phase.optical_um, "sellmeier" if kind == "sellmeier" else "cauchy")
        begun.append((model, *model.solve(model.start(phase), 6)))
    model, p, _ = min(begun, key=lambda one: one[2])
    p = _weighed(model, _best_order(model, p))
    if kind in {None, "free"}:
        others = [(one, begin) for one, begin, _ in begun if one is not model]
        model, p = _freed(model, p, others, asked=kind == "free")
    solutions = [model.solve(p), *(model.solve(model.shifted_order(p, by), 12) for by in (-1.0, -0.5, 0.5, 1.0))]
    p, cost = min(solutions, key=lambda one: one[1])
    place = model.names["ln_optical"]
    order = 0.5 / np.sqrt(model.middle) / model.optical_um
    rivals = [
        solution
        for solution in solutions
        if solution[1] < cost + _APART and abs(solution[0][place] - p[place]) > order / 4.0
    ]
    return _film(model, p, cost, rivals)


def _weighed(model: FilmModel, p: FloatArray) -> FloatArray:
    """Return the solution with weights from the scatter of its residuals."""
    for _ in range(2):
        p, _ = model.solve(p)
        model.weigh(p)
    return p


def _freed(
    model: FilmModel, p: FloatArray, others: Sequence[tuple[FilmModel, FloatArray]], *, asked: bool
) -> tuple[FilmModel, FloatArray]:
    """Return a free index if requested, or if three terms fit much worse; otherwise return the arguments unchanged."""
    if not free_knots(model.fringes):
        if not asked:
            return model, p
        remedy = "use cauchy or sellmeier, or measure a thicker layer or a wider range, which has more fringes"
        limit = f"has {model.fringes:.0f} fringes; a free index needs {MIN_FRINGES}"
        raise DataError("film", limit=limit, remedy=remedy)
    if not asked and not model.misfits(p):
        return model, p
    free, moved = min((_free_best(*one) for one in ((model, p), *others)), key=lambda one: one[0].cost(one[1]))
    moved = _weighed(free, _best_order(free, moved))
    clean = not free.misfits(moved, _CLEAN) and free.widening(moved) < _CLEAN
    if asked and not clean:
        limit = "leaves residuals beyond noise even with a free index"
        raise DataError(
            "film", limit=limit, remedy="omit the option: n is then computed from the levels, and is less certain"
        )
    gain = (free.likelihood(moved) - model.likelihood(p)) / free.widening(moved)
    points = model.um.size * len(model.blocks)
    better = gain - 0.5 * free.form.curves * float(np.log(points)) > _EVIDENCE  # Schwarz's criterion
    return (free, moved) if asked or (better and clean) else (model, p)


def _free_best(model: FilmModel, p: FloatArray) -> tuple[FilmModel, FloatArray]:
    """Return a free index, starting from a three-term solution, trying neighbouring orders and following the phases."""
    free, moved = model.freed(p)
    tried = [
        free.solve(_phase_matched(free, free.shifted_order(_phase_matched(free, moved), by)), 15) for by in _FREE_ORDERS
    ]
    best = []
    for q, cost in sorted(tried, key=lambda one: one[1])[:_MAX_TRIED]:
        again, less = free.solve(_phase_matched(free, q), 10)
        best.append(free.solve(again if less < cost else q))
    return free, min(best, key=lambda one: one[1])[0]


def _phase_matched(model: FilmModel, p: FloatArray) -> FloatArray:
    for _ in range(3):
        p = model.phase_matched(p)
    return p


def fit_levels(measured: Measured, level: float) -> Film:
    """Fit a layer to the levels alone, with the sum of powers; remaining fringes count as correlated scatter."""
    thickness_um = 25.0 if measured.thickness is None else measured.thickness.um
    model = FilmModel(measured, level, level * thickness_um, coherent=False)
    p = model.start(Phase(model.optical_um, 0.01, 0.0, 0.0, 0.0))
    for _ in range(3):
        p, _ = model.solve(p)
        model.weigh(p)
    return _film(model, *model.solve(p), ())


def _best_order(model: FilmModel, p: FloatArray) -> FloatArray:
    """Return the solution that no neighbouring order improves; adjacent orders differ very little in dispersion."""
    p, cost = model.solve(p, 6)
    for _ in range(_MAX_ORDERS):
        beside = [model.solve(model.shifted_order(p, by), 4) for by in _ORDERS]
        better, less = min(beside, key=lambda one: one[1])
        if less > 0.999 * cost:
            break
        p, cost = better, less
    return p


def _film(model: FilmModel, p: FloatArray, cost: float, rivals: Sequence[tuple[FloatArray, float]]) -> Film:
    parts = _parts(model, p)

    def changes(function: Callable[[Any], Any]) -> FloatArray:
        return np.stack([np.atleast_1d(function(p + 1j * STEP * row)).imag / STEP for row in parts])

    def k_of(q: Any) -> Any:
        return model.k_unit * (model.hats @ q[model.first_k : model.last_k])

    loose = _parts(model, p, k_is_free=True)

    def changes_of_k() -> FloatArray:
        return loose[:, model.first_k : model.last_k] @ (model.k_unit * model.hats.T)

    n, place = model.index(p)[0], model.names["ln_optical"]
    total = 1.0 + sum(np.exp((cost - misfit) / 2.0) for _, misfit in rivals)
    alternatives = [
        np.sqrt(np.exp((cost - misfit) / 2.0) / total) * (model.index(other)[0] - n) for other, misfit in rivals
    ]
    apart = sum(np.exp((cost - misfit) / 2.0) / total * float(other[place] - p[place]) ** 2 for other, misfit in rivals)
    thickness, optical = changes(model.thickness), changes(lambda q: np.exp(q[model.names["ln_optical"]]))
    spectra = model.spectra(p)
    clear = model.spectra(p, Blur(0.0, 10.0))
    slit, rough, wedge = (float(p[model.names[name]]) for name in ("slit", "rough", "wedge"))
    optical_um = model.optical_um * float(np.exp(p[model.names["ln_optical"]]))
    phase = 4.0 * np.pi * optical_um * np.sqrt(model.middle)
    per_nm = phase * np.sqrt(model.middle) / NM_PER_UM
    return Film(
        n=n,
        k=k_of(p),
        parts_n=np.vstack([changes(lambda q: model.index(q)[0]), *alternatives])
        if alternatives
        else changes(lambda q: model.index(q)[0]),
        parts_k=changes_of_k(),
        thickness_um=float(model.thickness(p)),
        u_thickness_um=float(np.sqrt((thickness**2).sum())),
        optical_um=optical_um,
        u_optical_um=model.optical_um * float(np.sqrt((optical**2).sum() + apart)),
        spread=float(np.hypot(rough, wedge)),
        slit_nm=slit,
        visibility=float(next(Blur(slit, rough, wedge).left(phase, per_nm))),
        residual={
            kind: float(np.sqrt(np.mean((reading.value - spectra[kind]) ** 2)))
            for kind, reading in model.measured.readings.items()
        },
        amplitude={kind: float(np.std(spectra[kind] - clear[kind])) for kind in spectra},
        fitted=spectra,
        form=model.form.kind,
    )


def _parts(model: FilmModel, p: FloatArray, *, k_is_free: bool = False) -> FloatArray:
    """Return rows whose products sum to the parameters' covariance; a parameter at its bound is fixed.

    For the bounds of k itself, its knots are free even at 0. Correlated residuals of neighbours, for example if the
    slit is wider than the step, widen the covariance.
    """
    low, high = model.bounds
    free: BoolArray = (p > low + 1e-9) & (p < high - 1e-9)
    if k_is_free:
        free[model.first_k :] = True
    slopes = model.slopes(p)[:, free]
    scale = np.sqrt((slopes**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    _, sizes, axes = np.linalg.svd(slopes / scale, full_matrices=False)
    if sizes[-1] < 1e-10 * sizes[0]:
        raise DataError(
            "film", limit="is not determined by these spectra", remedy="specify the thickness and the bandwidth"
        )
    rows = np.zeros((sizes.size, p.size))
    rows[:, free] = axes / sizes[:, None] / scale
    return np.asarray(rows * np.sqrt(model.widening(p)))
