"""A layer with fringes: n(λ), k(λ) ≥ 0 and thickness fitted to T, R or both, together with the contrast of the fringes.

Unknowns other than the index are fitted with it, as nuisance parameters with priors
(`solen.material.index.film_model`). Fringes determine n times thickness to one part in ten thousand, and the levels of
R and T, or a micrometer, separate n from the thickness; the covariance contains what the data do not determine. The
scatter is estimated from the residuals. The form of n is free only if there are many fringes and the residuals of
Cauchy's three terms exceed the noise.

Fringes have many nearly equivalent solutions, whose interference orders differ by one. Solutions with neighbouring
orders are tried; an alternative solution contributes to the covariance in proportion to its probability.

`fit_film` fits a `Film` to `FilmReadings`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.material.index.coherence import Blur
from solen.material.index.dispersion_form import MIN_FRINGES, Kind, free_knots
from solen.material.index.film_model import STEP, FilmModel, FilmReadings
from solen.material.index.fringes import Phase
from solen.units import NM_PER_UM

_MIN_GAIN = 10.0  # required increase of the log-likelihood for a free index
_ORDERS, _MAX_ROUNDS = (-1.0, 1.0), 4  # shifts of the order to be tried, and number of rounds
_MAX_VARIANCE_FACTOR = 1.5  # largest factor with which a free index is accepted
_FREE_ORDERS, _MAX_REFINED = tuple(np.arange(-6.0, 6.1)), 4  # shifts to be tried with a free index; number refined
_MAX_CHI2_DIFFERENCE = 12.0  # difference above which another solution is negligible


@dataclass(frozen=True, eq=False)
class Film:
    """A fitted layer; arrays of shape (n,) contain a value for each wavelength.

    Attributes
    ----------
    n, k
        Index and extinction coefficient.
    errors_n, errors_k
        Uncertainty as independent errors, each common to all wavelengths, shape (errors, n): the covariance of two
        wavelengths is the sum of the products of their errors.
    thickness_um, u_thickness_um
        Mean thickness and its standard uncertainty.
    optical_um, u_optical_um
        n times thickness at the central wavelength, and its standard uncertainty.
    thickness_sd
        Relative standard deviation of the thickness within the beam.
    slit_nm
        Fitted slit width.
    visibility
        Contrast at the central wavelength, relative to that of a perfect film.
    residual
        RMS difference between measured and fitted values, for each reading.
    amplitude
        RMS value of the fitted fringes, for each reading.
    fitted
        Fitted spectra, for each reading.
    form
        Functional form of n in the fit.
    """

    n: FloatArray
    k: FloatArray
    errors_n: FloatArray
    errors_k: FloatArray
    thickness_um: float
    u_thickness_um: float
    optical_um: float
    u_optical_um: float
    thickness_sd: float
    slit_nm: float
    visibility: float
    residual: dict[str, float]
    amplitude: dict[str, float]
    fitted: dict[str, FloatArray]
    form: Kind


def fit_film(measured: FilmReadings, start_n: float, phases: Sequence[Phase], kind: Kind | None = None) -> Film:
    """Fit a layer to the fringes and levels of the readings.

    Parameters
    ----------
    measured
        The readings.
    start_n
        Initial value of the index.
    phases
        Possible interpretations of the fringes, the best first.
    kind
        Functional form of n; by default Cauchy's, or a free one if it fits much better.

    Raises
    ------
    DataError
        If the spectra do not determine a film, or a free index is requested with too few fringes.
    """
    starts = []
    for phase in phases:
        model = FilmModel(measured, start_n, phase.optical_um, "sellmeier" if kind == "sellmeier" else "cauchy")
        starts.append((model, *model.solve(model.initial(phase), 6)))
    model, p, _ = min(starts, key=lambda start: start[2])
    p = _reweighted(model, _best_order(model, p))
    if kind in {None, "free"}:
        others = [(other, start) for other, start, _ in starts if other is not model]
        model, p = _with_free_index(model, p, others, is_requested=kind == "free")
    solutions = [model.solve(p), *(model.solve(model.shifted_order(p, by), 12) for by in (-1.0, -0.5, 0.5, 1.0))]
    p, cost = min(solutions, key=lambda solution: solution[1])
    optical = model.names["ln_optical"]
    order = 0.5 / np.sqrt(model.centre) / model.optical_um
    alternatives = [
        solution
        for solution in solutions
        if solution[1] < cost + _MAX_CHI2_DIFFERENCE and abs(solution[0][optical] - p[optical]) > order / 4.0
    ]
    return _film(model, p, cost, alternatives)


def _reweighted(model: FilmModel, p: FloatArray) -> FloatArray:
    """Return the solution with weights from the scatter of its residuals."""
    for _ in range(2):
        p, _ = model.solve(p)
        model.set_scatter(p)
    return p


def _with_free_index(
    model: FilmModel, p: FloatArray, others: Sequence[tuple[FilmModel, FloatArray]], *, is_requested: bool
) -> tuple[FilmModel, FloatArray]:
    """Return a free index if it is requested or fits much better; otherwise return the arguments unchanged."""
    if not free_knots(model.fringes):
        if not is_requested:
            return model, p
        remedy = "use cauchy or sellmeier, or measure a thicker layer or a wider range to obtain more fringes"
        limit = f"requires at least {MIN_FRINGES} fringes, but the spectra have {model.fringes:.0f}"
        raise DataError("--dispersion free", limit=limit, remedy=remedy)
    if not is_requested and not model.has_misfit(p):
        return model, p
    candidates = [_best_free_index(*start) for start in ((model, p), *others)]
    free, free_p = min(candidates, key=lambda candidate: candidate[0].cost(candidate[1]))
    free_p = _reweighted(free, _best_order(free, free_p))
    factor = free.variance_factor(free_p)
    is_clean = not free.has_misfit(free_p, _MAX_VARIANCE_FACTOR) and factor < _MAX_VARIANCE_FACTOR
    if is_requested and not is_clean:
        limit = "leaves residuals that exceed the noise"
        remedy = "omit --dispersion: n is then computed from the levels of T and R, and is less certain"
        raise DataError("--dispersion free", limit=limit, remedy=remedy)
    gain = (free.log_likelihood(free_p) - model.log_likelihood(p)) / factor
    points = model.um.size * len(model.blocks)
    is_better = gain - 0.5 * free.form.count * float(np.log(points)) > _MIN_GAIN  # Schwarz's criterion
    return (free, free_p) if is_requested or (is_better and is_clean) else (model, p)


def _best_free_index(model: FilmModel, p: FloatArray) -> tuple[FilmModel, FloatArray]:
    """Return the best free index near a three-term solution, from several orders, by matching the measured phases."""
    free, free_p = model.with_free_index(p)
    matched = _phase_matched(free, free_p)
    solutions = [free.solve(_phase_matched(free, free.shifted_order(matched, by)), 15) for by in _FREE_ORDERS]
    refined = []
    for q, cost in sorted(solutions, key=lambda solution: solution[1])[:_MAX_REFINED]:
        new_q, new_cost = free.solve(_phase_matched(free, q), 10)
        refined.append(free.solve(new_q if new_cost < cost else q))
    return free, min(refined, key=lambda solution: solution[1])[0]


def _phase_matched(model: FilmModel, p: FloatArray) -> FloatArray:
    for _ in range(3):
        p = model.phase_matched(p)
    return p


def fit_levels(measured: FilmReadings, start_n: float) -> Film:
    """Fit a layer to the levels alone, with the incoherent model; fringes contribute as correlated scatter."""
    thickness_um = 25.0 if measured.thickness is None else measured.thickness.um
    model = FilmModel(measured, start_n, start_n * thickness_um, coherent=False)
    p = model.initial(Phase(model.optical_um, 0.01, 0.0, 0.0, 0.0))
    for _ in range(3):
        p, _ = model.solve(p)
        model.set_scatter(p)
    return _film(model, *model.solve(p), ())


def _best_order(model: FilmModel, p: FloatArray) -> FloatArray:
    """Change the interference order until no neighbouring order fits better, and return the solution."""
    p, cost = model.solve(p, 6)
    for _ in range(_MAX_ROUNDS):
        neighbours = [model.solve(model.shifted_order(p, by), 4) for by in _ORDERS]
        new_p, new_cost = min(neighbours, key=lambda solution: solution[1])
        if new_cost > 0.999 * cost:
            break
        p, cost = new_p, new_cost
    return p


def _film(model: FilmModel, p: FloatArray, cost: float, alternatives: Sequence[tuple[FloatArray, float]]) -> Film:
    errors = _errors(model, p)

    def propagated(function: Callable[[Any], Any]) -> FloatArray:
        return np.stack([np.atleast_1d(function(p + 1j * STEP * row)).imag / STEP for row in errors])

    knots = slice(model.first_k, model.last_k)
    n, optical = model.index(p)[0], model.names["ln_optical"]
    likelihoods = [np.exp((cost - other_cost) / 2.0) for _, other_cost in alternatives]
    total = 1.0 + sum(likelihoods)
    weights = [likelihood / total for likelihood in likelihoods]
    other_n = [
        np.sqrt(weight) * (model.index(other)[0] - n) for weight, (other, _) in zip(weights, alternatives, strict=True)
    ]
    other_optical = sum(
        weight * float(other[optical] - p[optical]) ** 2
        for weight, (other, _) in zip(weights, alternatives, strict=True)
    )
    u_optical = propagated(lambda q: np.exp(q[optical]))
    spectra = model.spectra(p)
    without_fringes = model.spectra(p, Blur(0.0, 10.0))
    slit, rough, wedge = (float(p[model.names[name]]) for name in ("slit", "rough", "wedge"))
    optical_um = model.optical_um * float(np.exp(p[optical]))
    phase = 4.0 * np.pi * optical_um * np.sqrt(model.centre)
    per_nm = phase * np.sqrt(model.centre) / NM_PER_UM
    return Film(
        n=n,
        k=model.k_unit * (model.hats @ p[knots]),
        errors_n=np.vstack([propagated(lambda q: model.index(q)[0]), *other_n]),
        errors_k=_errors(model, p, k_is_free=True)[:, knots] @ (model.k_unit * model.hats.T),
        thickness_um=float(model.thickness(p)),
        u_thickness_um=float(np.sqrt((propagated(model.thickness) ** 2).sum())),
        optical_um=optical_um,
        u_optical_um=model.optical_um * float(np.sqrt((u_optical**2).sum() + other_optical)),
        thickness_sd=float(np.hypot(rough, wedge)),
        slit_nm=slit,
        visibility=float(next(Blur(slit, rough, wedge).factors(phase, per_nm))),
        residual={
            kind: float(np.sqrt(np.mean((reading.value - spectra[kind]) ** 2)))
            for kind, reading in model.measured.readings.items()
        },
        amplitude={kind: float(np.std(spectra[kind] - without_fringes[kind])) for kind in spectra},
        fitted=spectra,
        form=model.form.kind,
    )


def _errors(model: FilmModel, p: FloatArray, *, k_is_free: bool = False) -> FloatArray:
    """Return rows of independent errors of the parameters; a parameter at its bound is fixed.

    The covariance of the parameters is the sum of the outer products of the rows. For the uncertainty of k, its knots
    are free even at 0. The covariance is widened if neighbouring residuals are correlated, for example if the slit is
    wider than the step.
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
        limit = "is not determined by these spectra"
        raise DataError("film", limit=limit, remedy="specify the thickness and the bandwidth")
    rows = np.zeros((sizes.size, p.size))
    rows[:, free] = axes / sizes[:, None] / scale
    return np.asarray(rows * np.sqrt(model.variance_factor(p)))
