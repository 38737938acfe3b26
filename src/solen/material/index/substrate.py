"""Inversion of the instrument readings for a layer on its substrate to n and k of the layer.

T determines the loss of one pass for any assumed n, in closed form, so R becomes a function of n alone. It falls from
that of the bare substrate at n = 1 to a minimum near the square root of the substrate's index, and rises again, so two
indices fit each pair of readings. Both are found on a grid and refined by Newton's method; the result is the one nearer
to an expected index, and the other is reported as well.

T alone determines one quantity: the index if the layer is lossless (an upper bound if it is not), or k if the index was
measured by other means.

`invert_on_substrate`, `invert_lossless` and `extinction` return a `SubstrateInversion`, with exact derivatives with
respect to all inputs; values that do not exist are NaN, and `solen.material.index.routes` masks others.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.inversion import Slopes
from solen.material.index.stack import Numbers, Readings, Setup, optical_depth, readings

MIN_N, MAX_N = 1.0, 3.0
"""Range of the indices that are searched."""

_GRID = np.linspace(MIN_N, MAX_N, 201)[:, None]
_TOLERANCE = 1e-12  # largest error with which a solution may reproduce the readings
_MAX_ITERATIONS = 20
_SHEET = ("sheet_n", "sheet_k", "sheet_um")
_KNOWN = (*_SHEET, "thickness_um")  # known inputs with an uncertainty
_BLOCK = 2048  # number of wavelengths that are inverted at once
_STEP = 1e-30  # complex step, which causes no cancellation


@dataclass(frozen=True, eq=False)
class SubstrateInversion:
    """n and k with their derivatives; arrays of shape (wavelengths,), NaN if there is no value.

    Attributes
    ----------
    n, k
        Index and extinction coefficient; k is negative if more light is measured than a lossless layer reflects and
        transmits.
    other_n
        The second index that fits the same readings.
    n_by, k_by
        Derivatives with respect to ``T``, ``R``, ``thickness_um`` of the layer, ``n`` (if the index of the layer was
        specified), and the properties of the substrate: ``sheet_n``, ``sheet_k``, ``sheet_um``.
    """

    n: FloatArray
    k: FloatArray
    other_n: FloatArray
    n_by: Slopes
    k_by: Slopes


@dataclass(frozen=True, eq=False)
class _Model:
    """All inputs of the forward model except n and k of the layer; arrays of the same shape, or numbers."""

    wavelength_nm: FloatArray
    sheet_n: Numbers
    sheet_k: Numbers
    sheet_um: Numbers
    thickness_um: Numbers
    setup: Setup

    def read(self, n: ArrayLike, k: ArrayLike) -> Readings:
        """Return the readings of the instrument for a layer with n and k."""
        sheet = (self.sheet_n, self.sheet_k, self.sheet_um)
        return readings((n, k, self.thickness_um), sheet, self.wavelength_nm, self.setup)

    def derivative(self, n: ArrayLike, k: ArrayLike, name: str) -> Readings:
        """Return the complex-step derivative of the readings with respect to n, k or another input."""
        step = 1j * _STEP
        with np.errstate(all="ignore"):  # NaN stays NaN
            if name == "n":
                shifted = self.read(np.asarray(n) + step, k)
            elif name == "k":
                shifted = self.read(n, np.asarray(k) + step)
            else:
                changed: dict[str, Any] = {name: getattr(self, name) + step}
                shifted = dataclasses.replace(self, **changed).read(n, k)
        return Readings(shifted.T.imag / _STEP, shifted.R.imag / _STEP)

    def k_of(self, n: ArrayLike, transmittance: FloatArray) -> FloatArray:
        """Return the extinction of a layer with index n and this T, neglecting the effect of k on the interfaces.

        As a function of the transmittance τ of one pass, the transmittance of the stack is a τ/(1 − b τ²), a quadratic
        equation for τ. a and b are computed from the forward model at τ = 1 and τ = 1/2.
        """
        depth = optical_depth(self.thickness_um, self.wavelength_nm)
        full, half = self.read(n, 0.0).T, self.read(n, np.log(2) / depth).T  # a/(1 − b), (a/2)/(1 − b/4)
        ratio = 2 * half / full  # (1 − b)/(1 − b/4)
        b = (1 - ratio) / (1 - ratio / 4)
        a = full * (1 - b)
        with np.errstate(all="ignore"):
            tau = 2 * transmittance / (a + np.sqrt(a**2 + 4 * b * transmittance**2))
            return np.asarray(-np.log(tau) / depth)


def invert_on_substrate(
    transmittance: ArrayLike, reflectance: ArrayLike, wavelength_nm: ArrayLike, thickness_um: float, setup: Setup
) -> SubstrateInversion:
    """Return the index and extinction coefficient of a layer on a substrate from measured T and R.

    Parameters
    ----------
    transmittance, reflectance
        Fractions, shape (wavelengths,). The result is NaN where one of them is.
    wavelength_nm, thickness_um, setup
        Wavelengths of the measurement, thickness of the layer, and conditions of the measurement.

    Raises
    ------
    DataError
        If a thickness or a wavelength is not positive, or there is more than one row of readings.
    """
    t, r, wavelength = _rows(transmittance, reflectance, wavelength_nm)

    def solve(model: _Model, t: FloatArray, r: FloatArray) -> tuple[FloatArray, ...]:
        read = Readings(t, r)
        nearest, second = _starts(model.read(_GRID, model.k_of(_GRID, t)).R - r, setup.near)
        return *_refined(model, read, nearest), _refined(model, read, second)[0]

    model = _model(wavelength, thickness_um, setup)
    n, k, other = _in_blocks(solve, model, t, r)
    by_n, by_k = model.derivative(n, k, "n"), model.derivative(n, k, "k")
    ones, zeros = np.ones(n.shape), np.zeros(n.shape)
    changes = {"T": Readings(ones, zeros), "R": Readings(zeros, ones)}
    for name in _KNOWN:
        by_input = model.derivative(n, k, name)
        changes[name] = Readings(-by_input.T, -by_input.R)
    solutions = {name: _solved(by_n, by_k, change) for name, change in changes.items()}
    n_by, k_by = ({name: solution[i] for name, solution in solutions.items()} for i in (0, 1))
    return SubstrateInversion(n, k, other, n_by, k_by)


def invert_lossless(transmittance: ArrayLike, wavelength_nm: ArrayLike, setup: Setup) -> SubstrateInversion:
    """Return the index of a lossless layer on a substrate from T alone; its thickness has no effect.

    The parameters are those of `invert_on_substrate`. If the layer absorbs, n is an upper bound and other_n a lower
    one.
    """
    t, wavelength = _rows(transmittance, wavelength_nm)

    def solve(model: _Model, t: FloatArray) -> tuple[FloatArray, ...]:
        starts = _starts(model.read(_GRID, 0.0).T - t, setup.near)
        return tuple(_refined_lossless(model, t, start) for start in starts)

    model = _model(wavelength, 1.0, setup)
    n, other = _in_blocks(solve, model, t)
    with np.errstate(all="ignore"):
        n_by = {"T": np.asarray(1 / model.derivative(n, 0.0, "n").T)}
        n_by |= {name: np.asarray(-model.derivative(n, 0.0, name).T * n_by["T"]) for name in _SHEET}
    return SubstrateInversion(n, np.zeros(n.shape), other, n_by, {})


def max_transmittance(wavelength_nm: ArrayLike, setup: Setup) -> FloatArray:
    """Return the largest reading of T that a lossless layer of any index on a substrate has."""
    (wavelength,) = _rows(wavelength_nm)
    (t,) = _in_blocks(lambda model: (model.read(_GRID, 0.0).T.max(axis=0),), _model(wavelength, 1.0, setup))
    return t


def extinction(
    transmittance: ArrayLike, n: ArrayLike, wavelength_nm: ArrayLike, thickness_um: float, setup: Setup
) -> SubstrateInversion:
    """Return the extinction of a layer on a substrate from T and an index measured, for example, with a refractometer.

    Parameters
    ----------
    transmittance, wavelength_nm, thickness_um, setup
        As for `invert_on_substrate`.
    n
        Index of the layer, a single number or one for each wavelength.
    """
    t, wavelength, n = _rows(transmittance, wavelength_nm, n)
    model = _model(wavelength, thickness_um, setup)
    with np.errstate(all="ignore"):
        k = model.k_of(n, np.where(t > 0, t, np.nan))
        for _ in range(_MAX_ITERATIONS):
            k = k + (t - model.read(n, k).T) / model.derivative(n, k, "k").T
        k_by = {"T": np.asarray(1 / model.derivative(n, k, "k").T)}
        k_by |= {name: np.asarray(-model.derivative(n, k, name).T * k_by["T"]) for name in ("n", *_KNOWN)}
    return SubstrateInversion(n, k, np.full(n.shape, np.nan), {}, k_by)


def _rows(*values: ArrayLike) -> tuple[FloatArray, ...]:
    """Return arrays of one shape (wavelengths,); raise `DataError` if a value has several rows."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=float)) for value in values))
    if arrays[0].ndim != 1:
        limit = "must be one-dimensional"
        raise DataError("shape of the spectra", value=arrays[0].shape, limit=limit, remedy="invert each row separately")
    return tuple(np.array(array) for array in arrays)


def _model(wavelength: FloatArray, thickness_um: float, setup: Setup) -> _Model:
    """Return the forward model; raise `DataError` if a wavelength or the thickness is not positive."""
    if not (np.isfinite(wavelength) & (wavelength > 0)).all():
        raise DataError("wavelength", value=float(wavelength.min()), limit="must be above 0 nm")
    if not (np.isfinite(thickness_um) and thickness_um > 0):
        raise DataError("thickness", value=thickness_um, limit="must be above 0 µm")
    sheet = setup.substrate
    n, k = (np.broadcast_to(np.asarray(value, dtype=float), wavelength.shape) for value in (sheet.n, sheet.k))
    return _Model(wavelength, n, k, np.asarray(sheet.thickness_um), np.asarray(thickness_um), setup)


def _in_blocks(
    solve: Callable[..., tuple[FloatArray, ...]], model: _Model, *read: FloatArray
) -> tuple[FloatArray, ...]:
    """Return the results of a function of a model and its readings, in blocks of wavelengths to limit memory."""
    parts = []
    for start in range(0, max(model.wavelength_nm.size, 1), _BLOCK):
        block = slice(start, start + _BLOCK)
        arrays = {name: getattr(model, name)[block] for name in ("wavelength_nm", "sheet_n", "sheet_k")}
        parts.append(solve(dataclasses.replace(model, **arrays), *(values[block] for values in read)))
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _starts(difference: FloatArray, near: float) -> tuple[FloatArray, FloatArray]:
    """Return the zeros of a function (grid, wavelengths) nearest and second nearest to an index; NaN if none."""
    with np.errstate(all="ignore"):
        crosses = np.signbit(difference[:-1]) != np.signbit(difference[1:])
        step = _GRID[1:] - _GRID[:-1]
        roots = _GRID[:-1] + step * difference[:-1] / (difference[:-1] - difference[1:])
    roots = np.where(crosses & np.isfinite(roots), roots, np.nan)
    distance = np.where(np.isnan(roots), np.inf, np.abs(roots - near))
    nearest, second = np.take_along_axis(roots, np.argsort(distance, axis=0)[:2], axis=0)
    return nearest, second


def _solved(by_n: Readings, by_k: Readings, change: Readings) -> tuple[FloatArray, FloatArray]:
    """Return the changes of n and k that produce a given change of the readings."""
    det = by_n.T * by_k.R - by_k.T * by_n.R
    with np.errstate(all="ignore"):
        return (
            (change.T * by_k.R - by_k.T * change.R) / det,
            (by_n.T * change.R - change.T * by_n.R) / det,
        )


def _refined(model: _Model, read: Readings, n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the solution of the full model by Newton's method from a start; NaN if it does not converge."""
    with np.errstate(all="ignore"):
        k = model.k_of(n, read.T)
        for _ in range(_MAX_ITERATIONS):
            now = model.read(n, k)
            by_n, by_k = model.derivative(n, k, "n"), model.derivative(n, k, "k")
            dn, dk = _solved(by_n, by_k, Readings(read.T - now.T, read.R - now.R))
            n, k = n + dn, k + dk
            if not (np.abs(dn) > _TOLERANCE).any():
                break
        now = model.read(n, k)
        converged = (np.abs(now.T - read.T) < _TOLERANCE) & (np.abs(now.R - read.R) < _TOLERANCE) & (n >= MIN_N)
    return np.where(converged, n, np.nan), np.where(converged, k, np.nan)


def _refined_lossless(model: _Model, transmittance: FloatArray, n: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        for _ in range(_MAX_ITERATIONS):
            n = n + (transmittance - model.read(n, 0.0).T) / model.derivative(n, 0.0, "n").T
        converged = (np.abs(model.read(n, 0.0).T - transmittance) < _TOLERANCE) & (n >= MIN_N)
    return np.where(converged, n, np.nan)
