"""Inversion of R and T of a free-standing layer to n and k: numerically stable, with exact derivatives.

The published formulas subtract nearly equal numbers: in R_F = (B − S)/(2(2 − R)) at small R, and in R − R_F if little
light is transmitted. Both have forms without a difference. With c = R(2 − R),

    S² = (1 − R)⁴ + T² (2 + 2c + T²),   R_F = 2R / (1 + c + T² + S), τ = 2T / ((1 − R_F)² + √((1 − R_F)⁴ + 4 R_F² T²)),
    k = −λ ln τ / (4πh), n = (1 + R_F)/(1 − R_F) + √(4R_F/(1 − R_F)² − k²),

where all sums have positive terms. R + T > 1 is equivalent to τ > 1 and gives a negative k, which is returned
unchanged, for comparison with its uncertainty. n depends only on k² and remains meaningful in this case.

The square root has two signs. The other index with the same R_F and k is (1 + k²)/n: below 1 and irrelevant if k is
small, but possible inside strong absorption bands.

`invert` returns an `AirInversion`; `invert_many` returns the same n and k for large arrays; and `slopes` returns the
derivatives with respect to R, T and h.
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

_BLOCKS: dict[str, Any] = {
    "flags": ["external_loop", "buffered", "zerosize_ok"],
    "op_flags": [["readonly"]] * 3 + [["writeonly"]] * 2,
    "order": "C",
    "buffersize": 1 << 13,  # numbers per block: intermediate arrays fit in the cache of a core
}
MIN_PARALLEL_SIZE = 1 << 20  # number of values above which a call uses several cores


@dataclass(frozen=True, eq=False)
class AirInversion:
    """Index of a layer in air from R and T, without masks; all arrays have the same shape.

    Attributes
    ----------
    n, k
        Refractive index and extinction coefficient; NaN if no layer has these R and T; k is negative if R + T > 1.
    other_n
        The second index that fits equally well, (1 + k²)/n.
    face
        Reflectance of a single face, the R_F of the formulas.
    tau
        Transmittance of a single pass; above 1 if R + T > 1.
    """

    n: FloatArray
    k: FloatArray
    other_n: FloatArray
    face: FloatArray
    tau: FloatArray


Slopes = Mapping[str, FloatArray]
"""Derivatives keyed by input: ``T``, ``R``, ``thickness_um`` and, on a substrate, the properties of the sheet."""


def invert(
    reflectance: ArrayLike, transmittance: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike
) -> AirInversion:
    """Return the index and extinction coefficient of a layer in air from R and T at normal incidence.

    Parameters
    ----------
    reflectance, transmittance
        Fractions; there is no index unless 0 < R < 1 and T > 0.
    thickness_um, wavelength_nm
        Thickness in µm and wavelength in air in nm; all four broadcast.
    """
    r, t, depth = _broadcast(reflectance, transmittance, optical_depth(thickness_um, wavelength_nm))
    with np.errstate(all="ignore"):  # undefined values become NaN
        face, tau, k, n = _inverted(r, t, 1.0 / depth)
        return AirInversion(n, k, (1.0 + k**2) / n, face, tau)


def invert_many(
    reflectance: ArrayLike,
    transmittance: ArrayLike,
    thickness_um: ArrayLike,
    wavelength_nm: ArrayLike,
    out: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the n and k of `invert`, computed in blocks on all cores, with little memory in addition to the results.

    Parameters
    ----------
    reflectance, transmittance, thickness_um, wavelength_nm
        As for `invert`.
    out
        Arrays with the broadcast shape of the inputs, into which n and k are written to reuse memory.
    """
    inputs = _broadcast(reflectance, transmittance, 1.0 / optical_depth(thickness_um, wavelength_nm))
    n, k = out or (np.empty(inputs[0].shape), np.empty(inputs[0].shape))
    parts = _parts(n.shape)
    with ThreadPoolExecutor(len(parts)) as pool:  # numpy releases the interpreter lock while it computes
        for task in [pool.submit(_invert_into, *(array[part] for array in (*inputs, n, k))) for part in parts]:
            task.result()
    return n, k


def slopes(
    reflectance: ArrayLike, transmittance: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike
) -> tuple[Slopes, Slopes]:
    """Return the exact derivatives of the n and k of `invert` for the same arguments.

    They follow from the quadratic equations that R_F and τ solve, (2 − R) R_F² − (2 + T² − (1 − R)²) R_F + R = 0 and
    R_F² T τ² + (1 − R_F)² τ − T = 0.
    """
    r, t, h, depth = _broadcast(reflectance, transmittance, thickness_um, optical_depth(thickness_um, wavelength_nm))
    with np.errstate(all="ignore"):
        face, tau, k, n = _inverted(r, t, 1.0 / depth)
        through, root = 1.0 - face, n - (1.0 + face) / (1.0 - face)
        face_by_r = (1.0 - face**2 - 2.0 * (1.0 - r) * face) / _s(r, t)
        face_by_t = -2.0 * t * face / _s(r, t)
        d = np.hypot(through**2, 2.0 * face * t)
        log_by_face = 2.0 * (through - face * t * tau) / d
        log_by_t = (1.0 - (face * tau) ** 2) / (d * tau) + log_by_face * face_by_t
        k_by_r, k_by_t, k_by_h = -log_by_face * face_by_r / depth, -log_by_t / depth, -k / h
        n_by_face = 2.0 / through**2 + 2.0 * (1.0 + face) / (through**3 * root)
        n_by_k = -k / root
    n_by = {"R": n_by_face * face_by_r + n_by_k * k_by_r, "T": n_by_face * face_by_t + n_by_k * k_by_t}
    return n_by | {"thickness_um": n_by_k * k_by_h}, {"R": k_by_r, "T": k_by_t, "thickness_um": k_by_h}


def _parts(shape: tuple[int, ...]) -> list[tuple[slice | EllipsisType, ...]]:
    """Return slices of the first axis, one per core, or a single one for a small array."""
    rows = shape[0] if shape else 0
    count = min(rows, os.cpu_count() or 1) if np.prod(shape) > MIN_PARALLEL_SIZE else 1
    if count < 2:
        return [(...,)]
    edges = [rows * number // count for number in range(count + 1)]
    return [(slice(low, high),) for low, high in pairwise(edges)]


def _invert_into(
    reflectance: FloatArray, transmittance: FloatArray, per_depth: FloatArray, n: FloatArray, k: FloatArray
) -> None:
    operands = [reflectance, transmittance, per_depth, n, k]
    with np.errstate(all="ignore"), np.nditer(operands, **_BLOCKS) as blocks:
        for r, t, depth, out_n, out_k in blocks:
            _, _, out_k[...], out_n[...] = _inverted(r, t, depth)


def _inverted(
    r: FloatArray, t: FloatArray, per_depth: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return R_F, τ, k and n; NaN if they do not exist."""
    possible = (r > 0.0) & (r < 1.0) & (t > 0.0)
    if not possible.all():
        r = np.where(possible, r, np.nan)
    face = 2.0 * r / (1.0 + r * (2.0 - r) + t * t + _s(r, t))
    through = 1.0 - face
    square, product = through * through, 2.0 * face * t
    tau = 2.0 * t / (square + np.sqrt(square * square + product * product))
    k = -np.log(tau) * per_depth
    scaled_k = k * through
    return face, tau, k, (1.0 + face + np.sqrt(4.0 * face - scaled_k * scaled_k)) / through


def _s(r: FloatArray, t: FloatArray) -> FloatArray:
    """Return the square root S in the formula for R_F."""
    t2, remaining = t * t, 1.0 - r
    remaining2 = remaining * remaining
    return np.asarray(np.sqrt(remaining2 * remaining2 + t2 * (2.0 + 2.0 * r * (2.0 - r) + t2)))


def _broadcast(*values: ArrayLike) -> list[FloatArray]:
    return list(np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in values)))
