"""From R and T of a free-standing layer back to n and k: exact, stable, with exact derivatives.

The idea: the formulas as printed subtract nearly equal numbers, R_F = (B − S)/(2(2 − R)) at small R and R − R_F where
little light comes through. Both have forms without a difference. With c = R(2 − R),

    S² = (1 − R)⁴ + T² (2 + 2c + T²),   R_F = 2R / (1 + c + T² + S),
    τ = 2T / ((1 − R_F)² + √((1 − R_F)⁴ + 4 R_F² T²)),   k = −λ ln τ / (4πh),
    n = (1 + R_F)/(1 − R_F) + √(4R_F/(1 − R_F)² − k²),

where every sum is one of positive terms. R + T > 1 is the same as τ > 1 and gives a k below 0: it is returned as it is,
to be judged by its uncertainty. n depends on k² alone and keeps its meaning there.

The square root has two signs. The other index that has the same R_F and k is (1 + k²)/n: below 1 and of no concern
where k is small, a real alternative inside strong absorption bands.

The interface: `invert` gives `Inverted`; `invert_many` the same n and k for more numbers than fit in memory at once;
`slopes` the derivatives by R, T and h.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.material.index.stack import optical_depth

_IN_BLOCKS: dict[str, Any] = {
    "flags": ["external_loop", "buffered", "zerosize_ok"],
    "op_flags": [["readonly"]] * 3 + [["writeonly"]] * 2,
    "order": "C",
    "buffersize": 1 << 13,  # numbers at a time: what is in between stays in the cache of a core
}
MUCH = 1 << 20  # numbers above which a call is shared among cores


@dataclass(frozen=True, eq=False)
class Inverted:
    """Index by R and T of a layer in air, with only missing values masked: arrays of one shape.

    Attributes
    ----------
    n, k
        Refractive index and extinction coefficient. NaN where none has these R and T; k below 0 where R + T > 1.
    other_n
        The second index that fits as well, (1 + k²)/n.
    face
        Reflectance of one face, the R_F of the formulas.
    tau
        Transmittance of one pass; above 1 where R + T > 1.
    """

    n: FloatArray
    k: FloatArray
    other_n: FloatArray
    face: FloatArray
    tau: FloatArray


Slopes = Mapping[str, FloatArray]
"""Derivatives by input: ``T``, ``R``, ``thickness_um``, and on a substrate its properties."""


@dataclass(frozen=True, eq=False)
class Inverse:
    """n and k with their derivatives; arrays of shape (wavelengths,), NaN where there is no value.

    Attributes
    ----------
    n, k
        Index and extinction; k below 0 where more light came out than went in.
    other_n
        The second index that fits the same readings.
    n_by, k_by
        Derivatives by ``T``, ``R``, ``thickness_um`` of the layer, ``n`` (where the layer's index was given) and what
        was known of a substrate: ``sheet_n``, ``sheet_k``, ``sheet_um``.
    """

    n: FloatArray
    k: FloatArray
    other_n: FloatArray
    n_by: Slopes
    k_by: Slopes


def invert(
    reflectance: ArrayLike, transmittance: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike
) -> Inverted:
    """Index and extinction of a layer in air of which R and T are known, at normal incidence.

    Parameters
    ----------
    reflectance, transmittance
        Fractions; outside 0 < R < 1 and T > 0 there is no index.
    thickness_um, wavelength_nm
        Thickness in µm and wavelength in air in nm; all four broadcast.
    """
    r, t, depth = _broadcast(reflectance, transmittance, optical_depth(thickness_um, wavelength_nm))
    with np.errstate(all="ignore"):  # what has no value becomes NaN
        face, tau, k, n = _inverted(r, t, 1.0 / depth)
        return Inverted(n, k, (1.0 + k**2) / n, face, tau)


def invert_many(
    reflectance: ArrayLike,
    transmittance: ArrayLike,
    thickness_um: ArrayLike,
    wavelength_nm: ArrayLike,
    out: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Index and extinction as `invert` gives them, block by block on all cores: little memory beside the results.

    Parameters
    ----------
    reflectance, transmittance, thickness_um, wavelength_nm
        As in `invert`.
    out
        Arrays of the common shape that n and k are written into, to reuse memory.
    """
    arguments = _broadcast(reflectance, transmittance, 1.0 / optical_depth(thickness_um, wavelength_nm))
    n, k = out or (np.empty(arguments[0].shape), np.empty(arguments[0].shape))
    parts = _parts(n.shape)
    with ThreadPoolExecutor(len(parts)) as pool:  # numpy releases Python's lock while it computes
        for done in [pool.submit(_invert_into, *(one[part] for one in (*arguments, n, k))) for part in parts]:
            done.result()
    return n, k


def slopes(
    reflectance: ArrayLike, transmittance: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike
) -> tuple[Slopes, Slopes]:
    """Derivatives of n and of k of `invert`, exact; arguments as there.

    They follow from the quadratic equations that R_F and τ solve, (2 − R) R_F² − (2 + T² − (1 − R)²) R_F + R = 0 and
    R_F² T τ² + (1 − R_F)² τ − T = 0.
    """
    r, t, h, depth = _broadcast(reflectance, transmittance, thickness_um, optical_depth(thickness_um, wavelength_nm))
    with np.errstate(all="ignore"):
        face, tau, k, n = _inverted(r, t, 1.0 / depth)
        once, root = 1.0 - face, n - (1.0 + face) / (1.0 - face)
        face_by_r = (1.0 - face**2 - 2.0 * (1.0 - r) * face) / _s(r, t)
        face_by_t = -2.0 * t * face / _s(r, t)
        d = np.hypot(once**2, 2.0 * face * t)
        log_by_face = 2.0 * (once - face * t * tau) / d
        log_by_t = (1.0 - (face * tau) ** 2) / (d * tau) + log_by_face * face_by_t
        k_by_r, k_by_t, k_by_h = -log_by_face * face_by_r / depth, -log_by_t / depth, -k / h
        n_by_face = 2.0 / once**2 + 2.0 * (1.0 + face) / (once**3 * root)
        n_by_k = -k / root
    n_by = {"R": n_by_face * face_by_r + n_by_k * k_by_r, "T": n_by_face * face_by_t + n_by_k * k_by_t}
    return n_by | {"thickness_um": n_by_k * k_by_h}, {"R": k_by_r, "T": k_by_t, "thickness_um": k_by_h}


def _parts(shape: tuple[int, ...]) -> list[tuple[slice | EllipsisType, ...]]:
    """The first axis in as many pieces as there are cores; all at once where there is little to do."""
    rows = shape[0] if shape else 0
    pieces = min(rows, os.cpu_count() or 1) if np.prod(shape) > MUCH else 1
    if pieces < 2:
        return [(...,)]
    edges = [rows * piece // pieces for piece in range(pieces + 1)]
    return [(slice(low, high),) for low, high in pairwise(edges)]


def _invert_into(
    reflectance: FloatArray, transmittance: FloatArray, per_depth: FloatArray, n: FloatArray, k: FloatArray
) -> None:
    operands = [reflectance, transmittance, per_depth, n, k]
    with np.errstate(all="ignore"), np.nditer(operands, **_IN_BLOCKS) as blocks:
        for r, t, per, out_n, out_k in blocks:
            _, _, out_k[...], out_n[...] = _inverted(r, t, per)


def _inverted(
    r: FloatArray, t: FloatArray, per_depth: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """R_F, τ, k and n; NaN where there are none."""
    possible = (r > 0.0) & (r < 1.0) & (t > 0.0)
    if not possible.all():
        r = np.where(possible, r, np.nan)
    face = 2.0 * r / (1.0 + r * (2.0 - r) + t * t + _s(r, t))
    once = 1.0 - face
    once2, twice = once * once, 2.0 * face * t
    tau = 2.0 * t / (once2 + np.sqrt(once2 * once2 + twice * twice))
    k = -np.log(tau) * per_depth
    lost = k * once
    return face, tau, k, (1.0 + face + np.sqrt(4.0 * face - lost * lost)) / once


def _s(r: FloatArray, t: FloatArray) -> FloatArray:
    """The square root in R_F."""
    t2, past = t * t, 1.0 - r
    past2 = past * past
    return np.asarray(np.sqrt(past2 * past2 + t2 * (2.0 + 2.0 * r * (2.0 - r) + t2)))


def _broadcast(*values: ArrayLike) -> list[FloatArray]:
    return list(np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in values)))
