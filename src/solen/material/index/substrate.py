"""Inversion of the instrument readings for a layer on its substrate to the layer's n and k.

T determines the loss of one pass for any assumed n, in closed form, so R becomes a function of n alone. It falls from
its value on the bare substrate at n = 1 to a minimum near the square root of the substrate's index, and rises again, so
two indices fit each pair of readings. Both are found on a grid and refined by Newton's method; the result is the one
nearer to an expected index, and the other is reported too.

T alone gives a single result: an index if the layer is lossless, which is an upper bound if it is not; or k if the
index was measured by other means.

`invert_on_substrate`, `invert_lossless` and `extinction` return an `Inverse`, with exact derivatives with respect to
all inputs, and mask only values that do not exist; `solen.material.index.routes` applies further masks.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.inversion import Inverse
from solen.material.index.stack import Numbers, Readings, Setup, optical_depth, readings

N_LEAST, N_MOST = 1.0, 3.0
"""Range of indices searched."""

_GRID = np.linspace(N_LEAST, N_MOST, 201)[:, None]
_CLOSED = 1e-12  # how closely a solution must reproduce the readings
_ITERATIONS = 20
_SHEET = ("sheet_n", "sheet_k", "sheet_um")
_KNOWN = (*_SHEET, "thickness_um")  # known inputs with uncertainty
_BLOCK = 2048  # number of wavelengths on the grid at once
_STEP = 1e-30  # a complex step without cancellation


@dataclass(frozen=True, eq=False)
class _Case:
    """All inputs of the forward model except n and k of the layer; arrays of the same shape, or numbers."""

    wavelength_nm: FloatArray
    sheet_n: Numbers
    sheet_k: Numbers
    sheet_um: Numbers
    thickness_um: Numbers
    setup: Setup

    def read(self, n: ArrayLike, k: ArrayLike) -> Readings:
        """Return the instrument's readings for a layer with n and k."""
        sheet = (self.sheet_n, self.sheet_k, self.sheet_um)
        return readings((n, k, self.thickness_um), sheet, self.wavelength_nm, self.setup)

    def by(self, n: ArrayLike, k: ArrayLike, what: str) -> Readings:
        """Return the complex-step derivative of the readings with respect to one argument of the model."""
        step = 1j * _STEP
        with np.errstate(all="ignore"):  # NaN stays NaN
            if what == "n":
                moved = self.read(np.asarray(n) + step, k)
            elif what == "k":
                moved = self.read(n, np.asarray(k) + step)
            else:
                changed: dict[str, Any] = {what: getattr(self, what) + step}
                moved = dataclasses.replace(self, **changed).read(n, k)
        return Readings(moved.T.imag / _STEP, moved.R.imag / _STEP)

    def k_of(self, n: ArrayLike, transmittance: FloatArray) -> FloatArray:
        """Return the extinction with which a layer of index n has that T, neglecting the effect of k on the interfaces.

        The transmittance of the stack as a function of that of one pass, τ, is a τ/(1 − b τ²): a quadratic equation. a
        and b are computed from the forward model at τ = 1 and τ = 1/2.
        """
        depth = optical_depth(self.thickness_um, self.wavelength_nm)
        whole, less = self.read(n, 0.0).T, self.read(n, np.log(2) / depth).T  # a/(1 − b), (a/2)/(1 − b/4)
        ratio = 2 * less / whole  # (1 − b)/(1 − b/4)
        b = (1 - ratio) / (1 - ratio / 4)
        a = whole * (1 - b)
        with np.errstate(all="ignore"):
            tau = 2 * transmittance / (a + np.sqrt(a**2 + 4 * b * transmittance**2))
            return np.asarray(-np.log(tau) / depth)


def invert_on_substrate(
    transmittance: ArrayLike, reflectance: ArrayLike, wavelength_nm: ArrayLike, thickness_um: float, setup: Setup
) -> Inverse:
    """Return the index and extinction of a layer on a substrate from the instrument's T and R.

    Parameters
    ----------
    transmittance, reflectance
        Fractions, shape (wavelengths,). NaN is skipped.
    wavelength_nm, thickness_um, setup
        Wavelengths of the measurement; the layer's thickness; sheet, side and baselines.

    Raises
    ------
    DataError
        If a thickness or a wavelength is not positive, or there is more than one row of readings.
    """
    t, r, wavelength = _rows(transmittance, reflectance, wavelength_nm)

    def solved(case: _Case, t: FloatArray, r: FloatArray) -> tuple[FloatArray, ...]:
        read = Readings(t, r)
        first, second = _starts(case.read(_GRID, case.k_of(_GRID, t)).R - r, setup.near)
        return *_polished(case, read, first), _polished(case, read, second)[0]

    case = _case(wavelength, thickness_um, setup)
    n, k, other = _in_blocks(solved, case, t, r)
    by_n, by_k = case.by(n, k, "n"), case.by(n, k, "k")
    one, none = np.ones(n.shape), np.zeros(n.shape)
    moved = {"T": Readings(one, none), "R": Readings(none, one)}
    for what in _KNOWN:
        by_what = case.by(n, k, what)
        moved[what] = Readings(-by_what.T, -by_what.R)
    answers = {what: _changes(by_n, by_k, readings) for what, readings in moved.items()}
    n_by, k_by = ({what: answer[i] for what, answer in answers.items()} for i in (0, 1))
    return Inverse(n, k, other, n_by, k_by)


def invert_lossless(transmittance: ArrayLike, wavelength_nm: ArrayLike, setup: Setup) -> Inverse:
    """Return the index of a layer on a substrate from T alone, assuming a lossless layer; its thickness has no effect.

    The parameters are those of `invert_on_substrate`. If the layer does absorb, n is an upper bound and other_n a lower
    one.
    """
    t, wavelength = _rows(transmittance, wavelength_nm)

    def solved(case: _Case, t: FloatArray) -> tuple[FloatArray, ...]:
        starts = _starts(case.read(_GRID, 0.0).T - t, setup.near)
        return tuple(_polished_lossless(case, t, start) for start in starts)

    case = _case(wavelength, 1.0, setup)
    n, other = _in_blocks(solved, case, t)
    with np.errstate(all="ignore"):
        n_by = {"T": np.asarray(1 / case.by(n, 0.0, "n").T)}
        n_by |= {what: np.asarray(-case.by(n, 0.0, what).T * n_by["T"]) for what in _SHEET}
    return Inverse(n, np.zeros(n.shape), other, n_by, {})


def most_transmitted(wavelength_nm: ArrayLike, setup: Setup) -> FloatArray:
    """Return the largest reading of T of a lossless layer of any index on a substrate."""
    (wavelength,) = _rows(wavelength_nm)
    (most,) = _in_blocks(lambda case: (case.read(_GRID, 0.0).T.max(axis=0),), _case(wavelength, 1.0, setup))
    return most


def extinction(
    transmittance: ArrayLike, n: ArrayLike, wavelength_nm: ArrayLike, thickness_um: float, setup: Setup
) -> Inverse:
    """Return the extinction of a layer on a substrate from T and an index measured, for example, with a refractometer.

    Parameters
    ----------
    n
        The layer's index, a single number or one for each wavelength.
    transmittance, wavelength_nm, thickness_um, setup
        As for `invert_on_substrate`.
    """
    t, wavelength, n = _rows(transmittance, wavelength_nm, n)
    case = _case(wavelength, thickness_um, setup)
    with np.errstate(all="ignore"):
        k = case.k_of(n, np.where(t > 0, t, np.nan))
        for _ in range(_ITERATIONS):
            k = k + (t - case.read(n, k).T) / case.by(n, k, "k").T
        k_by = {"T": np.asarray(1 / case.by(n, k, "k").T)}
        k_by |= {what: np.asarray(-case.by(n, k, what).T * k_by["T"]) for what in ("n", *_KNOWN)}
    return Inverse(n, k, np.full(n.shape, np.nan), {}, k_by)


def _rows(*values: ArrayLike) -> tuple[FloatArray, ...]:
    """Return arrays of one shape (wavelengths,)."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=float)) for value in values))
    if arrays[0].ndim != 1:
        raise DataError(
            "spectra", value=arrays[0].shape, limit="must each be a single row", remedy="invert each row separately"
        )
    return tuple(np.array(array) for array in arrays)


def _case(wavelength: FloatArray, thickness_um: float, setup: Setup) -> _Case:
    """Return the inputs of the forward model; `DataError` if a wavelength or the thickness is not positive."""
    if not (np.isfinite(wavelength) & (wavelength > 0)).all():
        raise DataError("wavelength", value=float(wavelength.min()), limit="must be above 0 nm")
    if not (np.isfinite(thickness_um) and thickness_um > 0):
        raise DataError("thickness", value=thickness_um, limit="must be above 0 µm")
    sheet = setup.substrate
    n, k = (np.broadcast_to(np.asarray(value, dtype=float), wavelength.shape) for value in (sheet.n, sheet.k))
    return _Case(wavelength, n, k, np.asarray(sheet.thickness_um), np.asarray(thickness_um), setup)


def _in_blocks(solve: Callable[..., tuple[FloatArray, ...]], case: _Case, *read: FloatArray) -> tuple[FloatArray, ...]:
    """Return the results of a function of a case and its readings, in blocks of wavelengths to limit memory."""
    parts = []
    for start in range(0, max(case.wavelength_nm.size, 1), _BLOCK):
        block = slice(start, start + _BLOCK)
        some = {name: getattr(case, name)[block] for name in ("wavelength_nm", "sheet_n", "sheet_k")}
        parts.append(solve(dataclasses.replace(case, **some), *(values[block] for values in read)))
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _starts(off: FloatArray, near: float) -> tuple[FloatArray, FloatArray]:
    """Return the zeros of a function (grid, wavelengths) nearest and second nearest to an index; NaN if none."""
    with np.errstate(all="ignore"):
        crossed = np.signbit(off[:-1]) != np.signbit(off[1:])
        roots = _GRID[:-1] + (_GRID[1:] - _GRID[:-1]) * off[:-1] / (off[:-1] - off[1:])
    roots = np.where(crossed & np.isfinite(roots), roots, np.nan)
    far = np.where(np.isnan(roots), np.inf, np.abs(roots - near))
    first, second = np.take_along_axis(roots, np.argsort(far, axis=0)[:2], axis=0)
    return first, second


def _changes(by_n: Readings, by_k: Readings, wanted: Readings) -> tuple[FloatArray, FloatArray]:
    """Return the changes of n and k that produce given changes of the readings."""
    det = by_n.T * by_k.R - by_k.T * by_n.R
    with np.errstate(all="ignore"):
        return (
            (wanted.T * by_k.R - by_k.T * wanted.R) / det,
            (by_n.T * wanted.R - wanted.T * by_n.R) / det,
        )


def _polished(case: _Case, read: Readings, n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the solution of the full model by Newton's method from a start; NaN if it does not converge."""
    with np.errstate(all="ignore"):
        k = case.k_of(n, read.T)
        for _ in range(_ITERATIONS):
            now = case.read(n, k)
            dn, dk = _changes(case.by(n, k, "n"), case.by(n, k, "k"), Readings(read.T - now.T, read.R - now.R))
            n, k = n + dn, k + dk
            if not (np.abs(dn) > _CLOSED).any():
                break
        now = case.read(n, k)
        closed = (np.abs(now.T - read.T) < _CLOSED) & (np.abs(now.R - read.R) < _CLOSED) & (n >= N_LEAST)
    return np.where(closed, n, np.nan), np.where(closed, k, np.nan)


def _polished_lossless(case: _Case, transmittance: FloatArray, n: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            n = n + (transmittance - case.read(n, 0.0).T) / case.by(n, 0.0, "n").T
        closed = (np.abs(case.read(n, 0.0).T - transmittance) < _CLOSED) & (n >= N_LEAST)
    return np.where(closed, n, np.nan)
