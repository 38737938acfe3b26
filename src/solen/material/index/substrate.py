"""From what an instrument reads on a layer that stays on its substrate, back to the layer's n and k.

The idea: T fixes the loss of one pass for any assumed n, in closed form, so that R becomes a function of n alone. It
falls from its value on the bare substrate at n = 1 to a least value near the square root of the substrate's index, and
rises again: two indices fit one pair of readings. Both are found on a grid, made exact by Newton's method, and told;
the one nearer to an expected index is the answer. Uncertainties follow from exact derivatives of the forward model, and
errors that all wavelengths share (the substrate's index above all) are kept apart from those that average out.

What the route can tell: R and T of the layer move with n by some 0.1 per unit of n, so that 0.1 % costs about 0.01 in
n. The substrate's reflectance is part of both, so that an error of its index goes over into n nearly one to one.
The interface: `invert`; with T alone see `solen.material.index.transmittance`.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from solen.material.index.case import (
    CLOSED,
    GRID,
    ITERATIONS,
    N_LEAST,
    N_MOST,
    Case,
    Errors,
    Reasons,
    Shared,
    Way,
    blocks,
    by,
    case_of,
    changes,
    kept,
    loss_of,
    rows,
    shared_of,
    starts,
    too_bright,
    total,
    two_fit,
    unresolved,
)
from solen.material.index.stack import Baseline, FloatArray, Readings, Side, Substrate


@dataclass(frozen=True)
class OnSubstrate:
    """n and k of a layer on its substrate; NaN where masked, and why.

    Attributes
    ----------
    wavelength_nm, n, u_n, k, u_k
        Shape (wavelengths,); standard uncertainties with all shared errors in them. Where k is below its own
        uncertainty k is masked and u_k stays.
    other_n
        The second index that fits the same readings; NaN where there is none.
    shared
        The part of the uncertainties that does not average out over wavelengths.
    n_by_t, n_by_r, n_by_substrate
        How n answers to T, to R and to the substrate's index.
    reason_n, reason_k
        Why n or k is masked; empty where it is not.
    """

    wavelength_nm: FloatArray
    n: FloatArray
    u_n: FloatArray
    k: FloatArray
    u_k: FloatArray
    other_n: FloatArray
    shared: Shared
    n_by_t: FloatArray
    n_by_r: FloatArray
    n_by_substrate: FloatArray
    reason_n: Reasons
    reason_k: Reasons


class _Found(NamedTuple):
    """A solution as it stands, masked nowhere."""

    n: FloatArray
    k: FloatArray
    other: FloatArray


def invert(
    transmittance: ArrayLike,
    reflectance: ArrayLike,
    wavelength_nm: ArrayLike,
    thickness_um: float,
    substrate: Substrate,
    errors: Errors | None = None,
    *,
    side: Side = "layer",
    baseline: Baseline = "substrate",
    baseline_r: Baseline = "air",
    near: float = 1.5,
) -> OnSubstrate:
    """Index and extinction of a layer on a substrate from T and R as the instrument states them.

    Parameters
    ----------
    transmittance, reflectance
        Fractions, shape (wavelengths,). NaN is passed over.
    wavelength_nm, thickness_um, substrate
        Of the measurement; the layer's thickness; the sheet under it.
    errors
        Standard uncertainties; without them nothing is known of the result's.
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
    found = _Found(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    return _told(case, substrate, errors or Errors(), Readings(t, r), found)


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


def _told(case: Case, substrate: Substrate, errors: Errors, read: Readings, found: _Found) -> OnSubstrate:
    """Uncertainties and masks of a solution."""
    n, k, other = found
    by_n, by_k = by(case, n, k, "n"), by(case, n, k, "k")
    one, none = np.ones(n.shape), np.zeros(n.shape)
    by_t = changes(by_n, by_k, Readings(one, none))
    by_r = changes(by_n, by_k, Readings(none, one))
    by_sheet = _moved(case, found, "sheet_n")
    shared = shared_of(
        [
            ("T, calibration", errors.transmittance_shared, *by_t),
            ("R, calibration", errors.reflectance_shared, *by_r),
            ("index of the substrate", substrate.u_n, *by_sheet),
            ("extinction of the substrate", substrate.u_k, *_moved(case, found, "sheet_k")),
            ("thickness of the substrate", substrate.u_thickness_um, *_moved(case, found, "sheet_um")),
            ("thickness of the layer", errors.thickness_um, *_moved(case, found, "thickness_um")),
        ]
    )
    noise_t, noise_r = np.asarray(errors.transmittance), np.asarray(errors.reflectance)
    u_n = total([by_t[0] * noise_t, by_r[0] * noise_r, *shared.n])
    u_k = total([by_t[1] * noise_t, by_r[1] * noise_r, *shared.k])
    most_r = 1.0 if case.way.baseline_r == "air" else math.inf  # a layer may reflect more than its bare substrate
    reason_n = tuple(_reason_n(most_r, *row) for row in zip(*read, n, u_n, k, u_k, other, strict=True))
    reason_k = tuple(why or unresolved(*row) for why, *row in zip(reason_n, k, u_k, strict=True))
    keep_n, keep_k = kept(reason_n), kept(reason_k)
    return OnSubstrate(
        case.wavelength_nm,
        np.where(keep_n, n, np.nan),
        np.where(keep_n, u_n, np.nan),
        np.where(keep_k, k, np.nan),
        np.where(keep_n, u_k, np.nan),
        other,
        shared,
        by_t[0],
        by_r[0],
        by_sheet[0],
        reason_n,
        reason_k,
    )


def _moved(case: Case, found: _Found, what: str) -> tuple[FloatArray, FloatArray]:
    """How n and k answer to something that was taken as known."""
    n, k, _ = found
    read = by(case, n, k, what)
    return changes(by(case, n, k, "n"), by(case, n, k, "k"), Readings(-read.T, -read.R))


def _reason_n(most_r: float, t: float, r: float, n: float, u_n: float, k: float, u_k: float, other: float) -> str:
    if math.isnan(t) or math.isnan(r):
        return "no reading"
    if not (t > 0 and 0 < r < most_r):
        return f"T = {t:.4g} and R = {r:.4g} are not those of a layer"
    if math.isnan(n):
        return f"no index from {N_LEAST:g} to {N_MOST:g} reads T = {t:.5g} and R = {r:.5g} on this substrate"
    return two_fit(n, u_n, other) or too_bright(k, u_k)
