"""What the transmittance alone says of a layer on its substrate: an index if it takes no light, or k if n is known.

The idea: one reading gives one number. A lossless layer's index follows from T, twice, as T(n) has a maximum near the
square root of the substrate's index; and as any loss lowers T, that index is an upper bound of the true one. The other
way round, a layer whose index is known from a refractometer has its k told by T, with the errors of n, thickness and
substrate in it.

The interface: `lossless`, `extinction`.
"""

import math
from dataclasses import dataclass

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
from solen.material.index.stack import Baseline, FloatArray, Substrate


@dataclass(frozen=True)
class Lossless:
    """The index that a lossless layer would need for the T that was read; NaN where masked.

    Attributes
    ----------
    wavelength_nm, n, u_n
        Shape (wavelengths,). Where the layer takes light after all, n is an upper bound and `other_n` a lower one.
    other_n
        The second index that fits; NaN where there is none above 1.
    shared
        Rows of what all wavelengths share, with k of NaN.
    n_by_t, n_by_substrate
        How n answers to T and to the substrate's index.
    reason
        Why n is masked; empty where it is not.
    """

    wavelength_nm: FloatArray
    n: FloatArray
    u_n: FloatArray
    other_n: FloatArray
    shared: Shared
    n_by_t: FloatArray
    n_by_substrate: FloatArray
    reason: Reasons


def lossless(
    transmittance: ArrayLike,
    wavelength_nm: ArrayLike,
    substrate: Substrate,
    errors: Errors | None = None,
    *,
    baseline: Baseline = "substrate",
    near: float = 1.5,
) -> Lossless:
    """Index of a layer on a substrate from T alone, taking the layer to be lossless; its thickness plays no part.

    Parameters and errors as of `solen.material.index.substrate.invert`.
    """
    errors = errors or Errors()
    t, wavelength = rows(transmittance, wavelength_nm)
    case = case_of(wavelength, 1.0, substrate, Way("layer", baseline, "air"))
    parts = [_both(case.some(block), t[block], near) for block in blocks(t.size)]
    n, other, most = (np.concatenate(part) for part in zip(*parts, strict=True))
    with np.errstate(all="ignore"):
        n_by_t = np.asarray(1 / by(case, n, 0.0, "n").T)
    by_sheet = -by(case, n, 0.0, "sheet_n").T * n_by_t
    nothing = np.full(t.shape, np.nan)
    shared = shared_of(
        [
            ("T, calibration", errors.transmittance_shared, n_by_t, nothing),
            ("index of the substrate", substrate.u_n, by_sheet, nothing),
            ("extinction of the substrate", substrate.u_k, -by(case, n, 0.0, "sheet_k").T * n_by_t, nothing),
            ("thickness of the substrate", substrate.u_thickness_um, -by(case, n, 0.0, "sheet_um").T * n_by_t, nothing),
        ]
    )
    u_n = total([n_by_t * np.asarray(errors.transmittance), *shared.n])
    reason = tuple(_reason(*row) for row in zip(t, n, u_n, other, most, strict=True))
    n, u_n = np.where(kept(reason), n, np.nan), np.where(kept(reason), u_n, np.nan)
    return Lossless(wavelength, n, u_n, other, shared, n_by_t, by_sheet, reason)


def _both(case: Case, transmittance: FloatArray, near: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The two indices that read T without loss, and the most that any reads."""
    read = case.read(GRID[:, None], 0.0).T
    first, second = starts(read - transmittance, near)
    return _polished(case, transmittance, first), _polished(case, transmittance, second), read.max(axis=0)


def _polished(case: Case, transmittance: FloatArray, n: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            n = n + (transmittance - case.read(n, 0.0).T) / by(case, n, 0.0, "n").T
        closed = (np.abs(case.read(n, 0.0).T - transmittance) < CLOSED) & (n >= N_LEAST)
    return np.where(closed, n, np.nan)


def _reason(t: float, n: float, u_n: float, other: float, most: float) -> str:
    if math.isnan(t):
        return "no reading"
    if t > most + CLOSED:
        return f"T = {t:.5g} is above {most:.5g}, the most that any lossless layer reads on this substrate"
    if math.isnan(n):
        return f"T = {t:.5g} needs loss, or an index above {N_MOST:g}"
    return two_fit(n, u_n, other)


@dataclass(frozen=True)
class Extinction:
    """k of a layer whose index is known, from T alone; NaN where masked.

    Attributes
    ----------
    wavelength_nm, k, u_k
        Shape (wavelengths,). Where k is below its own uncertainty it is masked and u_k stays.
    shared
        Rows of what all wavelengths share.
    reason
        Why k is masked; empty where it is not.
    """

    wavelength_nm: FloatArray
    k: FloatArray
    u_k: FloatArray
    shared: Shared
    reason: Reasons


def extinction(
    transmittance: ArrayLike,
    n: ArrayLike,
    wavelength_nm: ArrayLike,
    thickness_um: float,
    substrate: Substrate,
    errors: Errors | None = None,
    *,
    u_n: ArrayLike = 0.0,
    baseline: Baseline = "substrate",
) -> Extinction:
    """Extinction of a layer on a substrate from T and an index that is known otherwise, from a refractometer say.

    Parameters
    ----------
    n, u_n
        The layer's index and its standard uncertainty, one error common to all wavelengths.
    transmittance, wavelength_nm, thickness_um, substrate, errors, baseline
        As of `solen.material.index.substrate.invert`.
    """
    errors = errors or Errors()
    t, wavelength, n = rows(transmittance, wavelength_nm, n)
    case = case_of(wavelength, thickness_um, substrate, Way("layer", baseline, "air"))
    with np.errstate(all="ignore"):
        k = loss_of(case, n, t)
        for _ in range(ITERATIONS):
            k = k + (t - case.read(n, k).T) / by(case, n, k, "k").T
        k_by_t = np.asarray(1 / by(case, n, k, "k").T)
    none, one = np.zeros_like(n), np.ones_like(n)
    causes: list[tuple[str, ArrayLike, FloatArray, FloatArray]] = [
        ("T, calibration", errors.transmittance_shared, none, k_by_t)
    ]
    for name, what, u in (
        ("index of the layer", "n", u_n),
        ("index of the substrate", "sheet_n", substrate.u_n),
        ("extinction of the substrate", "sheet_k", substrate.u_k),
        ("thickness of the substrate", "sheet_um", substrate.u_thickness_um),
        ("thickness of the layer", "thickness_um", errors.thickness_um),
    ):
        causes.append((name, u, one if what == "n" else none, -by(case, n, k, what).T * k_by_t))
    shared = shared_of(causes)
    u_k = total([k_by_t * np.asarray(errors.transmittance), *shared.k])
    no_layer = tuple("" if one_t > 0 else "no reading of a layer" for one_t in t)
    reason = tuple(why or too_bright(*row) or unresolved(*row) for why, *row in zip(no_layer, k, u_k, strict=True))
    return Extinction(
        wavelength, np.where(kept(reason), k, np.nan), np.where(kept(no_layer), u_k, np.nan), shared, reason
    )
