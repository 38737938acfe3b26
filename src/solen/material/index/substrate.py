"""From what an instrument reads on a layer that stays on its substrate, back to the layer's n and k.

The idea: T fixes the loss of one pass for any assumed n, in closed form, so that R becomes a function of n alone. It
falls from its value on the bare substrate at n = 1 to a least value near the square root of the substrate's index, and
rises again: two indices fit one pair of readings. Both are found on a grid, made exact by Newton's method, and told;
the one nearer to an expected index is the answer.

T alone is one number, and gives one: an index if the layer takes no light, which is an upper bound if it does; or k if
the index is known from elsewhere.

The interface: `invert`, `invert_lossless`, `extinction`; all give `Inverse`, with exact derivatives by everything that
went in, and mask nothing but what has no value. `solen.material.index.layered` judges it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.material.index.case import (
    CLOSED,
    GRID,
    INPUTS,
    ITERATIONS,
    N_LEAST,
    Case,
    Way,
    blocks,
    by,
    case_of,
    changes,
    loss_of,
    rows,
    starts,
)
from solen.material.index.stack import Baseline, Readings, Side, Substrate


@dataclass(frozen=True)
class Inverse:
    """What readings on a substrate say; arrays of shape (wavelengths,), NaN where there is no value.

    Attributes
    ----------
    n, k
        Index and extinction; k below 0 where more light came out than went in.
    other_n
        The second index that fits the same readings.
    n_by, k_by
        Derivatives by ``T``, ``R``, ``n`` (where the layer's index was given) and what was known of the stack:
        ``sheet_n``, ``sheet_k``, ``sheet_um`` of the substrate and ``thickness_um`` of the layer.
    """

    n: FloatArray
    k: FloatArray
    other_n: FloatArray
    n_by: Mapping[str, FloatArray]
    k_by: Mapping[str, FloatArray]


def invert(
    transmittance: ArrayLike,
    reflectance: ArrayLike,
    wavelength_nm: ArrayLike,
    thickness_um: float,
    substrate: Substrate,
    *,
    side: Side = "layer",
    baseline: Baseline = "substrate",
    baseline_r: Baseline = "air",
    near: float = 1.5,
) -> Inverse:
    """Index and extinction of a layer on a substrate from T and R as the instrument states them.

    Parameters
    ----------
    transmittance, reflectance
        Fractions, shape (wavelengths,). NaN is passed over.
    wavelength_nm, thickness_um, substrate
        Of the measurement; the layer's thickness; the sheet under it.
    side, baseline, baseline_r
        As in `solen.material.index.stack.on_substrate`.
    near
        Of two indices that fit, the one nearer to this is given.

    Raises
    ------
    DataError
        Where a thickness or a wavelength is not positive, or there is more than one row of readings.
    """
    t, r, wavelength = rows(transmittance, reflectance, wavelength_nm)
    case = case_of(wavelength, thickness_um, substrate, Way(side, baseline, baseline_r))
    parts = [_solved(case.some(block), Readings(t[block], r[block]), near) for block in blocks(t.size)]
    n, k, other = (np.concatenate(part) for part in zip(*parts, strict=True))
    by_n, by_k = by(case, n, k, "n"), by(case, n, k, "k")
    one, none = np.ones(n.shape), np.zeros(n.shape)
    answers = {"T": changes(by_n, by_k, Readings(one, none)), "R": changes(by_n, by_k, Readings(none, one))}
    for what in INPUTS:
        moved = by(case, n, k, what)
        answers[what] = changes(by_n, by_k, Readings(-moved.T, -moved.R))
    n_by, k_by = ({what: answer[i] for what, answer in answers.items()} for i in (0, 1))
    return Inverse(n, k, other, n_by, k_by)


class _Found(NamedTuple):
    """A solution: n, k and the other n."""

    n: FloatArray
    k: FloatArray
    other: FloatArray


def _solved(case: Case, read: Readings, near: float) -> _Found:
    """The index nearest to an expected one with its k, and the other index that fits; NaN where there is none."""
    grid = GRID[:, None]
    first, second = starts(case.read(grid, loss_of(case, grid, read.T)).R - read.R, near)
    n, k = _polished(case, read, first)
    return _Found(n, k, _polished(case, read, second)[0])


def _polished(case: Case, read: Readings, n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solution of the whole model by Newton's method from a start; NaN where it does not close."""
    with np.errstate(all="ignore"):
        k = loss_of(case, n, read.T)
        for _ in range(ITERATIONS):
            now = case.read(n, k)
            dn, dk = changes(by(case, n, k, "n"), by(case, n, k, "k"), Readings(read.T - now.T, read.R - now.R))
            n, k = n + dn, k + dk
            if not (np.abs(dn) > CLOSED).any():
                break
        now = case.read(n, k)
        closed = (np.abs(now.T - read.T) < CLOSED) & (np.abs(now.R - read.R) < CLOSED) & (n >= N_LEAST)
    return np.where(closed, n, np.nan), np.where(closed, k, np.nan)


def invert_lossless(
    transmittance: ArrayLike,
    wavelength_nm: ArrayLike,
    substrate: Substrate,
    *,
    baseline: Baseline = "substrate",
    near: float = 1.5,
) -> Inverse:
    """Index of a layer on a substrate from T alone, taking it to be lossless; its thickness plays no part.

    Parameters as of `invert`. Of a layer that takes light after all, n is an upper bound and other_n a lower one.
    """
    t, wavelength = rows(transmittance, wavelength_nm)
    case = case_of(wavelength, 1.0, substrate, Way("layer", baseline, "air"))
    parts = [_clear(case.some(block), t[block], near) for block in blocks(t.size)]
    n, other = (np.concatenate(part) for part in zip(*parts, strict=True))
    with np.errstate(all="ignore"):
        n_by = {"T": np.asarray(1 / by(case, n, 0.0, "n").T)}
        n_by |= {what: np.asarray(-by(case, n, 0.0, what).T * n_by["T"]) for what in INPUTS[:3]}
    return Inverse(n, np.zeros(n.shape), other, n_by, {})


def most_transmitted(wavelength_nm: ArrayLike, substrate: Substrate, *, baseline: Baseline = "substrate") -> FloatArray:
    """The most that a lossless layer of any index reads on a substrate."""
    (wavelength,) = rows(wavelength_nm)
    case = case_of(wavelength, 1.0, substrate, Way("layer", baseline, "air"))
    return np.concatenate(
        [case.some(block).read(GRID[:, None], 0.0).T.max(axis=0) for block in blocks(wavelength.size)]
    )


def _clear(case: Case, transmittance: FloatArray, near: float) -> tuple[FloatArray, FloatArray]:
    """The two indices that read T without loss."""
    first, second = starts(case.read(GRID[:, None], 0.0).T - transmittance, near)
    return _polished_clear(case, transmittance, first), _polished_clear(case, transmittance, second)


def _polished_clear(case: Case, transmittance: FloatArray, n: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            n = n + (transmittance - case.read(n, 0.0).T) / by(case, n, 0.0, "n").T
        closed = (np.abs(case.read(n, 0.0).T - transmittance) < CLOSED) & (n >= N_LEAST)
    return np.where(closed, n, np.nan)


def extinction(
    transmittance: ArrayLike,
    n: ArrayLike,
    wavelength_nm: ArrayLike,
    thickness_um: float,
    substrate: Substrate,
    *,
    baseline: Baseline = "substrate",
) -> Inverse:
    """Extinction of a layer on a substrate from T and an index that is known otherwise, from a refractometer say.

    Parameters
    ----------
    n
        The layer's index, one or one for each wavelength.
    transmittance, wavelength_nm, thickness_um, substrate, baseline
        As of `invert`.
    """
    t, wavelength, n = rows(transmittance, wavelength_nm, n)
    case = case_of(wavelength, thickness_um, substrate, Way("layer", baseline, "air"))
    with np.errstate(all="ignore"):
        k = loss_of(case, n, np.where(t > 0, t, np.nan))
        for _ in range(ITERATIONS):
            k = k + (t - case.read(n, k).T) / by(case, n, k, "k").T
        k_by = {"T": np.asarray(1 / by(case, n, k, "k").T)}
        k_by |= {what: np.asarray(-by(case, n, k, what).T * k_by["T"]) for what in ("n", *INPUTS)}
    return Inverse(n, k, np.full(n.shape, np.nan), {}, k_by)
