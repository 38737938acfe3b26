"""The routes to the index of a layer that stays on its substrate; each states what it assumes.

- **measured on a substrate**: R and T of layer and sheet together. Near n = 1.5 on PET an error of 0.001 in R moves n
  by 0.009, and an error of the substrate's index goes over into n one to one: it is the bare sheet's reflectance that
  the layer's is seen against.
- **lossless on a substrate**: T alone, k = 0 assumed. Any loss makes this n an upper bound; 0.1 % of T is 0.009 in n.

An index that cannot be told from the second one that fits the same readings, within three standard uncertainties, is
masked; so is one that takes more light out than went in.

The interface: `measured_on_substrate`, `lossless_on_substrate`, each giving an `IndexSpectrum` as the routes of
`solen.material.index.routes` do; `extinction_on_substrate` for a layer whose index is known.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solen.arrays import FloatArray
from solen.material.index.inversion import Inverted, Slopes
from solen.material.index.masks import THREE_SIGMAS, Codes, Why, first
from solen.material.index.reading import Combined, Length, Reading, Share, combined
from solen.material.index.routes import k_bounds, masked_at
from solen.material.index.spectrum import Estimate, IndexSpectrum, estimate, nothing
from solen.material.index.stack import Baseline, Side, Substrate
from solen.material.index.substrate import Inverse, extinction, invert, invert_lossless, most_transmitted

_ROUNDING = 1e-12  # of k


@dataclass(frozen=True)
class Setup:
    """How a layer on its substrate was measured.

    Attributes
    ----------
    substrate
        The sheet, with its uncertainties.
    side
        Which of the two the light met first.
    baseline, baseline_r
        What the 100 % of T, and of R, was: the bare substrate or air.
    near
        Of two indices that fit, the one nearer to this is given.
    """

    substrate: Substrate
    side: Side = "layer"
    baseline: Baseline = "substrate"
    baseline_r: Baseline = "air"
    near: float = 1.5

    @property
    def u(self) -> dict[str, ArrayLike]:
        """Standard uncertainties of the sheet, by the names of `Inverse`."""
        sheet = self.substrate
        return {"sheet_n": sheet.u_n, "sheet_k": sheet.u_k, "sheet_um": sheet.u_thickness_um}


def measured_on_substrate(
    wavelength_nm: ArrayLike, transmittance: Reading, reflectance: Reading, thickness: Length, setup: Setup
) -> IndexSpectrum:
    """Index and extinction from T and R of a layer on its substrate, each measured.

    The spectrum's `lossless` is the index that T alone gives on this substrate when k = 0 is assumed.
    """
    nm = np.asarray(wavelength_nm, dtype=float)
    t, r = transmittance.value, reflectance.value
    found = invert(
        t,
        r,
        nm,
        thickness.um,
        setup.substrate,
        side=setup.side,
        baseline=setup.baseline,
        baseline_r=setup.baseline_r,
        near=setup.near,
    )
    read = {"T": transmittance, "R": reflectance}
    u = setup.u | {"thickness_um": thickness.u_um or 0.0}
    n_parts, k_parts = _parts(found.n_by, read, u), _parts(found.k_by, read, u)
    n, k = combined(n_parts, nm.size), combined(k_parts, nm.size)
    no_n = _why_no_n(t, r, found, n, k, setup)
    no_k = _why_no_k(no_n, found.k, k)
    estimates = estimate(found.n, n, no_n), estimate(found.k, k, no_k)
    clear = _lossless(nm, transmittance, setup)
    told = [
        *_sensitivity(found.n, found.n_by, no_n),
        *_unstated(read, setup),
        *_by_sheet(found.n_by, estimates[0], setup),
        *transmittance.remarks,
        *reflectance.remarks,
        *masked_at(estimates[0], "n"),
        *masked_at(estimates[1], "k", no_n),
    ]
    return IndexSpectrum(
        "measured",
        True,
        nm,
        *estimates,
        *_bounds(found, k, no_k, transmittance, nm.size),
        _correlation(n_parts, k_parts),
        clear,
        r,
        t,
        thickness,
        tuple(told),
    )


def lossless_on_substrate(wavelength_nm: ArrayLike, transmittance: Reading, setup: Setup) -> IndexSpectrum:
    """Index of a layer on its substrate from T alone, k = 0 assumed: an upper bound where the layer takes light."""
    nm, t = np.asarray(wavelength_nm, dtype=float), transmittance.value
    found = _lossless(nm, transmittance, setup)
    none = np.full(t.shape, np.nan)
    inverse = invert_lossless(t, nm, setup.substrate, baseline=setup.baseline, near=setup.near)
    told = [
        "lossless: k = 0 is assumed, so that n is an upper bound: whatever the layer absorbs or scatters raises it",
        *_sensitivity(inverse.n, inverse.n_by, found.why),
        *_unstated({"T": transmittance}, setup),
        *_by_sheet(inverse.n_by, found, setup),
        *transmittance.remarks,
        *masked_at(found, "n"),
    ]
    return IndexSpectrum(
        "lossless",
        True,
        nm,
        found,
        nothing(np.where(found.known, Why.ASSUMED, found.why).astype(np.int8)),
        none,
        none,
        none,
        found,
        none,
        t,
        None,
        tuple(told),
    )


def extinction_on_substrate(
    wavelength_nm: ArrayLike,
    transmittance: Reading,
    n: ArrayLike,
    thickness: Length,
    setup: Setup,
    *,
    u_n: ArrayLike = 0.0,
) -> Estimate:
    """Extinction of a layer on its substrate from T, with its index known otherwise.

    Parameters
    ----------
    n, u_n
        The layer's index and its standard uncertainty, one error common to all wavelengths.
    """
    nm, t = np.asarray(wavelength_nm, dtype=float), transmittance.value
    found = extinction(t, n, nm, thickness.um, setup.substrate, baseline=setup.baseline)
    u = setup.u | {"thickness_um": thickness.u_um or 0.0, "n": u_n}
    k = combined(_parts(found.k_by, {"T": transmittance}, u), nm.size)
    lost = first({Why.MISSING: ~np.isfinite(t), Why.TRANSMITTANCE: ~(t > 0.0), Why.BRIGHT: _bright(found.k, k)})
    return estimate(found.k, k, _why_no_k(lost, found.k, k))


def _parts(by: Mapping[str, FloatArray], read: Mapping[str, Reading], u: Mapping[str, ArrayLike]) -> list[Share]:
    """Parts of an uncertainty: of each reading, and of what is known of the stack."""
    parts = [share for name, reading in read.items() for share in reading.shares(by[name])]
    known = [Share(np.asarray(by[name] * np.asarray(u[name])), np.inf, True) for name in u if name in by]
    return parts + known


def _correlation(n: list[Share], k: list[Share]) -> FloatArray:
    """Between the errors of n and of k."""
    together = np.array([one.u * other.u for one, other in zip(n, k, strict=True)]).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(together / np.sqrt(sum(one.u**2 for one in n) * sum(one.u**2 for one in k)))


def _why_no_n(t: FloatArray, r: FloatArray, found: Inverse, n: Combined, k: Combined, setup: Setup) -> Codes:
    most_r = 1.0 if setup.baseline_r == "air" else np.inf  # a layer may reflect more than its bare substrate
    return first(
        {
            Why.MISSING: ~(np.isfinite(t) & np.isfinite(r)),
            Why.REFLECTANCE: ~((r > 0.0) & (r < most_r)),
            Why.TRANSMITTANCE: ~(t > 0.0),
            Why.NO_FIT: np.isnan(found.n),
            Why.INDISTINCT: _indistinct(found, n),
            Why.BRIGHT: _bright(found.k, k),
        }
    )


def _indistinct(found: Inverse, n: Combined) -> NDArray[np.bool_]:
    """Where the least of R, or the most of T, between the two indices is within three uncertainties."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(found.n - found.other_n) < 2.0 * n.bound(THREE_SIGMAS))


def _bright(found: FloatArray, k: Combined) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray(found < -k.bound(THREE_SIGMAS) - _ROUNDING)


def _why_no_k(no_n: Codes, found: FloatArray, k: Combined) -> Codes:
    with np.errstate(invalid="ignore"):
        tests = {Why.BELOW: found < 0.0, Why.SMALL: found <= k.u}
    return np.where(no_n != Why.FINE, no_n, first(tests)).astype(np.int8)


def _bounds(
    found: Inverse, k: Combined, no_k: Codes, transmittance: Reading, points: int
) -> tuple[FloatArray, FloatArray]:
    """95 % bounds of k, as those of a free-standing layer."""
    none = np.full(points, np.nan)
    as_slab = Inverted(found.n, found.k, found.other_n, none, none)
    slopes = Slopes(none, none, none, none, found.k_by["T"], none)
    u_t = combined(transmittance.shares(1.0 + np.zeros(points)), points)
    return k_bounds(as_slab, k, no_k, transmittance.value, u_t, slopes)


def _lossless(nm: FloatArray, transmittance: Reading, setup: Setup) -> Estimate:
    """Index that T alone gives when k = 0 is assumed."""
    t = transmittance.value
    found = invert_lossless(t, nm, setup.substrate, baseline=setup.baseline, near=setup.near)
    n = combined(_parts(found.n_by, {"T": transmittance}, setup.u), nm.size)
    most = most_transmitted(nm, setup.substrate, baseline=setup.baseline)
    with np.errstate(invalid="ignore"):
        tests = {
            Why.MISSING: ~np.isfinite(t),
            Why.TRANSMITTANCE: ~(t > 0.0),
            Why.TOO_CLEAR: t > most + _ROUNDING,
            Why.TOO_DARK: np.isnan(found.n),
            Why.INDISTINCT: _indistinct(found, n),
        }
    return estimate(found.n, n, first(tests))


def _sensitivity(n: FloatArray, by: Mapping[str, FloatArray], why: Codes) -> list[str]:
    """What an error of the readings and of the substrate does to n, in the middle of what is known."""
    at = np.flatnonzero(why == Why.FINE)
    if not at.size:
        return []
    i = at[at.size // 2]
    moves = [f"{abs(by[name][i]) * 1e-3:.4f} by 0.001 in {name}" for name in ("R", "T") if name in by]
    sheet = f"{abs(by['sheet_n'][i]) * 0.01:.4f} by 0.01 in the substrate's index"
    return [f"on this substrate n = {n[i]:.4f} moves {', '.join(moves)}, and {sheet}"]


def _by_sheet(by: Mapping[str, FloatArray], n: Estimate, setup: Setup) -> list[str]:
    """Where the substrate makes most of the uncertainty, and what to do about it."""
    at = np.flatnonzero(n.known)
    if not at.size:
        return []
    i = at[at.size // 2]
    part = abs(float(by["sheet_n"][i] * np.broadcast_to(np.asarray(setup.substrate.u_n), by["sheet_n"].shape)[i]))
    if not part**2 > float(n.u[i]) ** 2 / 2:
        return []
    return [
        f"most of u(n) = {n.u[i]:.2g}, {part:.2g}, is the doubt about the substrate's index: measure T and R of the "
        "bare sheet in air, find its index by solen resin index, and state it: --substrate and --u-substrate-n"
    ]


def _unstated(read: Mapping[str, Reading], setup: Setup) -> list[str]:
    """What is missing for an uncertainty."""
    told = []
    names = [name for name, reading in read.items() if not reading.known]
    if names:
        options = " and ".join(f"--u-{name}" for name in names)
        told.append(
            f"no uncertainty of {' and '.join(names)} is known, so none of n: state it with {options}, or give repeats"
        )
    if not np.any(np.asarray(setup.substrate.u_n) > 0):
        told.append("the substrate's index is taken as exact: an error of it goes over into n nearly one to one")
    return told
