"""What every way back from readings on a substrate shares: the case, its derivatives, the search.

The idea: a `Case` is the forward model with everything fixed but n and k of the layer. `by` differentiates it by
anything, exactly. `starts` finds all indices that a grid brackets, so that no second solution stays unnoticed.

The interface: for `solen.material.index.substrate` and `solen.material.index.transmittance`.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.stack import Baseline, Numbers, Readings, Side, Substrate, readings
from solen.units import NM_PER_UM

N_LEAST, N_MOST = 1.0, 3.0
"""Indices that are looked for."""

GRID = np.linspace(N_LEAST, N_MOST, 201)
CLOSED = 1e-12
"""How closely a solution must reproduce the readings."""

ITERATIONS = 20
INPUTS = ("sheet_n", "sheet_k", "sheet_um", "thickness_um")
"""What is taken as known beside the readings, and may be in error."""

_BLOCK = 2048  # wavelengths on the grid at once
_STEP = 1e-30  # a complex step has no cancellation


class Way(NamedTuple):
    """How the light went and what 100 % is."""

    side: Side
    baseline: Baseline
    baseline_r: Baseline


@dataclass(frozen=True)
class Case:
    """Everything that the forward model takes beside n and k of the layer; arrays of one shape, or numbers."""

    wavelength_nm: FloatArray
    sheet_n: Numbers
    sheet_k: Numbers
    sheet_um: Numbers
    thickness_um: Numbers
    way: Way

    def read(self, n: ArrayLike, k: ArrayLike) -> Readings:
        """What the instrument states where the layer has n and k."""
        sheet = (self.sheet_n, self.sheet_k, self.sheet_um)
        return readings((n, k, self.thickness_um), sheet, self.wavelength_nm, *self.way)

    def some(self, where: slice) -> "Case":
        """The same at some of the wavelengths."""
        return dataclasses.replace(
            self,
            wavelength_nm=self.wavelength_nm[where],
            sheet_n=self.sheet_n[where],
            sheet_k=self.sheet_k[where],
        )


def rows(*values: ArrayLike) -> tuple[FloatArray, ...]:
    """Arrays of one shape (wavelengths,)."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=float)) for value in values))
    if arrays[0].ndim != 1:
        raise DataError("spectra", value=arrays[0].shape, limit="must be one row each", remedy="invert one by one")
    return tuple(np.array(array) for array in arrays)


def case_of(wavelength: FloatArray, thickness_um: float, substrate: Substrate, way: Way) -> Case:
    """Case of a measurement; `DataError` where a wavelength or the thickness is not positive."""
    if not (np.isfinite(wavelength) & (wavelength > 0)).all():
        raise DataError("wavelength", value=float(wavelength.min()), limit="must be above 0 nm")
    if not (np.isfinite(thickness_um) and thickness_um > 0):
        raise DataError("thickness", value=thickness_um, limit="must be above 0 µm")
    n, k = (np.broadcast_to(np.asarray(value, dtype=float), wavelength.shape) for value in (substrate.n, substrate.k))
    return Case(wavelength, n, k, np.asarray(substrate.thickness_um), np.asarray(thickness_um), way)


def per_um(case: Case) -> FloatArray:
    """What k is multiplied with to be the absorption in 1/µm."""
    return np.asarray(4 * np.pi * NM_PER_UM / case.wavelength_nm)


def loss_of(case: Case, n: ArrayLike, transmittance: FloatArray) -> FloatArray:
    """Extinction that makes the layer of index n read that T, with the interfaces' own share of k left out.

    The transmittance of the stack as a function of that of one pass, τ, is a τ/(1 − b τ²): a quadratic equation. a and
    b are found by asking the forward model at τ = 1 and τ = 1/2.
    """
    half = np.log(2) / (per_um(case) * case.thickness_um)
    whole, less = case.read(n, 0.0).T, case.read(n, half).T  # a/(1 − b), (a/2)/(1 − b/4)
    ratio = 2 * less / whole  # (1 − b)/(1 − b/4)
    b = (1 - ratio) / (1 - ratio / 4)
    a = whole * (1 - b)
    with np.errstate(all="ignore"):
        tau = 2 * transmittance / (a + np.sqrt(a**2 + 4 * b * transmittance**2))
        return np.asarray(-np.log(tau) / (per_um(case) * case.thickness_um))


def starts(off: FloatArray, near: float) -> tuple[FloatArray, FloatArray]:
    """Where on the grid a function crosses zero, shape (grid, wavelengths): nearest to an index and next; else NaN."""
    grid = GRID[:, None]
    with np.errstate(all="ignore"):
        crossed = np.signbit(off[:-1]) != np.signbit(off[1:])
        roots = grid[:-1] + (grid[1:] - grid[:-1]) * off[:-1] / (off[:-1] - off[1:])
    roots = np.where(crossed & np.isfinite(roots), roots, np.nan)
    far = np.where(np.isnan(roots), np.inf, np.abs(roots - near))
    order = np.argsort(far, axis=0)[:2]
    first, second = np.take_along_axis(roots, order, axis=0)
    return first, second


def by(case: Case, n: ArrayLike, k: ArrayLike, what: str) -> Readings:
    """Derivative of the readings by one argument of the model, by a complex step."""
    step = 1j * _STEP
    with np.errstate(all="ignore"):  # NaN stays NaN
        if what == "n":
            found = case.read(np.asarray(n) + step, k)
        elif what == "k":
            found = case.read(n, np.asarray(k) + step)
        else:
            moved: dict[str, Any] = {what: getattr(case, what) + step}
            found = dataclasses.replace(case, **moved).read(n, k)
    return Readings(found.T.imag / _STEP, found.R.imag / _STEP)


def changes(by_n: Readings, by_k: Readings, wanted: Readings) -> tuple[FloatArray, FloatArray]:
    """Changes of n and k that change the readings by what is wanted."""
    det = by_n.T * by_k.R - by_k.T * by_n.R
    with np.errstate(all="ignore"):
        return (
            (wanted.T * by_k.R - by_k.T * wanted.R) / det,
            (by_n.T * wanted.R - wanted.T * by_n.R) / det,
        )


def blocks(size: int) -> list[slice]:
    """Slices of a row of wavelengths, each small enough for the grid to fit in memory."""
    return [slice(start, start + _BLOCK) for start in range(0, max(size, 1), _BLOCK)]
