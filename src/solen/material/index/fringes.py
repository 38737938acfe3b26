"""Interference between the two faces of a layer, which the sum of powers ignores.

Fringes are λ²/(2nh) apart. A monochromator with a much larger bandwidth averages over them, and powers add; with a
smaller bandwidth, they are visible if the wavelengths are close enough. Points that are too far apart do not show the
fringes but are still affected by them.

Fringes are periodic in n/λ, and nothing else in a spectrum is: they are detected by the fraction of scatter that a
cosine of 4πnh/λ removes, over a range of n·h and dispersion. They are significant if noise would hardly ever remove as
much.

`find_fringes` returns a `Phase` for each interpretation (none without fringes), and `fringe_warnings` reports what a
bandwidth leaves undetermined.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.ranks import Caution, do_not_use, warning
from solen.units import NM_PER_UM

_MIN_POINTS = 24  # smallest number of points for the detection of fringes
_SMOOTH = 5  # degree of the smooth curve under the fringes
_MIN_FRINGES = 3.0  # smallest number of fringes in the range
_RISES = tuple(np.linspace(0.0, 0.03, 7))
_CHANCE = -4.0  # logarithm of the false-alarm probability
_SAME_UM, _MAX_PHASES, _ORDERS = 0.15, 3, 6.0
_MAX_RISE = 0.1
_WINDOWS, _MIN_WINDOWS = 12, 3  # parts of a spectrum, and number of them that must have fringes
_MIN_AMPLITUDE = 2e-5  # of T: below, rounding and the shape of the smooth curve look like fringes


def fringe_spacing_nm(n: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> FloatArray:
    """Return the distance in nm between two maxima of the interference of a layer's two faces, λ²/(2nh)."""
    wavelength = np.asarray(wavelength_nm, dtype=float)
    return np.asarray(wavelength**2 / (2.0 * np.asarray(n) * np.asarray(thickness_um) * NM_PER_UM))


@dataclass(frozen=True)
class Phase:
    """An interpretation of fringes: 4π · optical thickness/λ · (1 + rise·u + bend·u²), u from −1 to 1 along 1/λ².

    Attributes
    ----------
    optical_um
        n times thickness at u = 0.
    rise, bend
        Relative linear and quadratic changes of n towards short wavelengths.
    share
        Fraction of the scatter about a smooth curve that the fringes explain.
    amplitude
        Root mean square of the fringes.
    """

    optical_um: float
    rise: float
    bend: float
    share: float
    amplitude: float


def find_fringes(
    wavelength_nm: FloatArray,
    values: FloatArray,
    optical_um: tuple[float, float],
    beside: FloatArray | None = None,
) -> list[Phase]:
    """Return interpretations of a spectrum's fringes, the best first; none if noise or a band explains them.

    Parameters
    ----------
    wavelength_nm, values
        Ascending wavelengths, and T or (T − R)/2; shape (n,).
    optical_um
        Lower and upper bounds of n times thickness.
    beside
        (T + R)/2, which absorption affects and fringes do not.
    """
    count = wavelength_nm.size
    if count < _MIN_POINTS:
        return []
    um = wavelength_nm / NM_PER_UM
    ends = um[-1] ** -2, um[0] ** -2
    u = (um**-2 - sum(ends) / 2.0) / ((ends[1] - ends[0]) / 2.0)
    coarse: list[tuple[float, float, float]] = []
    for part in (slice(None), slice(count // 2, None)):  # a slit removes the fringes at short wavelengths
        coarse += _periodogram(um[part], u[part], _level(values[part]), optical_um)
    coarse.sort(reverse=True)
    if not coarse or coarse[0][0] > 1.0:
        return []
    seen: list[tuple[float, float, float]] = []
    for one in coarse:
        if all(abs(one[1] - other[1]) > _SAME_UM for other in seen):
            seen.append(one)
    off = _level(values)
    candidates = [_refined(um, u, off, optical, rise) for _, optical, rise in seen[:_MAX_PHASES]]
    candidates += [
        _shifted_order(um, u, off, candidates[0], by) for by in np.arange(-_ORDERS, _ORDERS + 0.1, 0.5) if by
    ]
    found: list[Phase] = []
    for candidate in sorted(candidates, key=lambda one: -one.share):
        inside = optical_um[0] <= candidate.optical_um <= optical_um[1] and abs(candidate.rise) < _MAX_RISE
        apart = all(abs(candidate.optical_um - other.optical_um) > 0.1 for other in found)
        if inside and apart and candidate.amplitude > _MIN_AMPLITUDE:
            found.append(candidate)
    if not found or not _are_fringes(um, u, off, None if beside is None else _level(beside), found[0]):
        return []
    return [one for one in found if one.share > 0.5 * found[0].share][:_MAX_PHASES]


def _are_fringes(um: FloatArray, u: FloatArray, off: FloatArray, beside: FloatArray | None, phase: Phase) -> bool:
    """Whether the oscillation extends through much of the spectrum or is absent from T + R; no absorption band does.

    A slit of several nm leaves the fringes of a thick layer only at long wavelengths.
    """
    waves = np.exp(4j * np.pi * phase.optical_um * (1.0 + phase.rise * u + phase.bend * u**2) / um)
    parts = np.array_split(np.arange(um.size), _WINDOWS)
    here = np.array([abs(np.mean(off[part] * waves[part])) for part in parts])
    if beside is None:
        return int((here > 0.3 * here.max()).sum()) >= _MIN_WINDOWS
    there = np.array([abs(np.mean(beside[part] * waves[part])) for part in parts])
    several = int((here > 0.15 * here.max()).sum()) >= _MIN_WINDOWS - 1
    return several and float(np.sum(there**2)) < 0.25 * float(np.sum(here**2))


def _level(values: FloatArray) -> FloatArray:
    """Return the values minus a smooth curve."""
    z = np.linspace(-1.0, 1.0, values.size)
    return np.asarray(values - np.polynomial.chebyshev.Chebyshev.fit(z, values, _SMOOTH, domain=(-1, 1))(z))


def _periodogram(
    um: FloatArray, u: FloatArray, off: FloatArray, optical_um: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Return the log probability, n·h and rise of the strongest periods that noise does not explain."""
    span = abs(2.0 / um[0] - 2.0 / um[-1])
    optical = np.arange(max(optical_um[0], _MIN_FRINGES / span), optical_um[1], 0.2 / span)
    total, freedom = float(off @ off), (um.size - _SMOOTH - 3) / 2.0
    if not (optical.size and total > 0.0):
        return []
    best = []
    for rise in _RISES:
        power = np.abs(np.exp(1j * np.outer(optical, 4.0 * np.pi * (1.0 + rise * u) / um)) @ off) ** 2
        share = np.minimum(2.0 * power / um.size / total, 1.0 - 1e-12)
        for place in np.argsort(share)[::-1][:2]:
            chance = np.log10(optical.size * len(_RISES)) + freedom * np.log10(1.0 - share[place])
            best.append((float(chance), float(optical[place]), float(rise)))
    return [(chance - _CHANCE, one, rise) for chance, one, rise in best if chance < _CHANCE]


def _refined(um: FloatArray, u: FloatArray, off: FloatArray, optical: float, rise: float) -> Phase:
    """Return the period close to a coarse one whose cosine, with a smoothly varying amplitude, explains most."""
    envelope = np.stack([np.ones_like(u), u, u**2])

    def explained(near: FloatArray, slope: float) -> tuple[FloatArray, FloatArray]:
        waves = np.cos(np.outer(near, 4.0 * np.pi * (1.0 + slope * u) / um))
        right = waves @ (envelope * off).T
        square = waves**2
        left = np.stack([[square @ (a * b) for b in envelope] for a in envelope]).transpose(2, 0, 1)
        answer = np.linalg.solve(left + 1e-9 * um.size * np.eye(3), right[..., None])[..., 0]
        return (right * answer).sum(axis=1) / float(off @ off), answer[:, 0] - 0.5 * answer[:, 1]

    tried = []
    for slope in rise + np.linspace(-0.008, 0.008, 17):
        near = np.arange(optical - 0.6, optical + 0.6, 0.02)
        share, sign = explained(near, slope)
        at = int(np.argmax(np.where(sign > 0.0, share, -1.0)))
        tried.append((float(share[at]), float(near[at]), float(slope)))
    _, best, slope = max(tried)
    return _polished(um, u, off, np.array([best, best * slope, 0.0]))


def _shifted_order(um: FloatArray, u: FloatArray, off: FloatArray, phase: Phase, by: float) -> Phase:
    """Return fringes with orders shifted by a number, and with phases as similar to the old ones as possible."""
    shape = np.stack([np.ones_like(u), u, u**2])
    shift = np.linalg.lstsq(shape.T, by * um / 2.0, rcond=None)[0]
    return _polished(um, u, off, phase.optical_um * np.array([1.0, phase.rise, phase.bend]) + shift)


def _polished(um: FloatArray, u: FloatArray, off: FloatArray, p: FloatArray) -> Phase:
    """Refine a phase, including a quadratic dispersion term, by Gauss-Newton steps."""
    per_um = 4.0 * np.pi / um
    shape: FloatArray = np.stack([np.ones_like(u), u, u**2])
    envelope: FloatArray = np.stack([np.ones_like(u), u, u**2, u**3])

    def misfit(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        phase = np.asarray(per_um * (p @ shape))
        waves = envelope * np.cos(phase)
        size = np.linalg.lstsq(waves.T, off, rcond=None)[0]
        slope = -(size @ envelope) * np.sin(phase) * per_um * shape
        return off - size @ waves, np.vstack([waves, slope])

    left, slopes = misfit(p)
    for _ in range(20):
        step = np.linalg.lstsq(slopes.T, left, rcond=None)[0][envelope.shape[0] :]
        for part in (1.0, 0.3, 0.1):
            other, turned = misfit(p + part * step)
            if float(other @ other) < float(left @ left):
                p, left, slopes = p + part * step, other, turned
                break
        else:
            break
    explained = math.sqrt(max(float(np.mean(off**2) - np.mean(left**2)), 0.0))
    share = 1.0 - float(left @ left) / float(off @ off)
    return Phase(float(p[0]), float(p[1] / p[0]), float(p[2] / p[0]), share, explained)


def fringe_warnings(
    wavelength_nm: FloatArray, n: FloatArray, thickness_um: float, bandwidth_nm: float | None
) -> tuple[Caution, ...]:
    """Return warnings about the fringes in a spectrum with ascending wavelengths.

    A NaN in ``n`` is replaced by the median of the other values. ``bandwidth_nm`` is None if it is not known.
    """
    if not np.isfinite(n).any():
        return ()
    index = np.where(np.isfinite(n), n, np.nanmedian(n))
    spacing = fringe_spacing_nm(index, thickness_um, wavelength_nm)
    ends = f"{spacing[0]:.2g} nm apart at {wavelength_nm[0]:g} nm"
    if spacing.size > 1:
        ends += f" and {spacing[-1]:.2g} nm at {wavelength_nm[-1]:g} nm"
    what = f"fringes of a layer of {thickness_um:g} µm are {ends}"
    if bandwidth_nm is None:
        return (warning(f"{what}: powers add if the bandwidth is larger; the instrument's bandwidth is not specified"),)
    wide = spacing > bandwidth_nm
    if not wide.any():
        return ()
    lost = (
        f"{what}, and from {wavelength_nm[np.argmax(wide)]:g} nm upwards wider than the bandwidth "
        f"of {bandwidth_nm:g} nm"
    )
    found = [do_not_use(f"{lost}: the spectrum contains interference, which the sum of powers ignores")]
    step = float(np.median(np.diff(wavelength_nm))) if wavelength_nm.size > 1 else np.inf
    if step > spacing[wide].min() / 2.0:
        apart = f"the wavelengths are {step:g} nm apart" if np.isfinite(step) else "there is only one wavelength"
        found.append(do_not_use(f"{apart}, which does not resolve the fringes; they act on n like scatter"))
    return tuple(found)
