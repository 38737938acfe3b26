"""Interference fringes from the two faces of a layer, which the incoherent model neglects.

The spacing of fringes is λ²/(2nh). A monochromator with a much larger bandwidth averages over them, and the incoherent
model is valid; with a smaller bandwidth, they are visible if the wavelengths are measured in sufficiently small steps.
Points that are too far apart do not show the fringes but are still affected by them.

Fringes are periodic in n/λ, and no other feature of a spectrum is: they are detected by the fraction of the variance
that a cosine of 4πnh/λ explains, over a range of n·h and dispersion. They are significant if noise would explain as
much only very rarely.

`find_fringes` returns a `Phase` for each interpretation (none without fringes), and `fringe_warnings` returns warnings
if the bandwidth does not average over the fringes.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.ranks import Caution, do_not_use, warning
from solen.units import NM_PER_UM

_MIN_POINTS = 24  # smallest number of points for the detection of fringes
_DEGREE = 5  # degree of the polynomial that is subtracted from a spectrum
_MIN_FRINGES = 3.0  # smallest number of fringes in the range
_RISES = tuple(np.linspace(0.0, 0.03, 7))  # linear dispersions to be tried
_LOG_FALSE_ALARM = -4.0  # decadic logarithm of the false-alarm probability
_MIN_DISTANCE_UM = 0.15  # smallest difference of n·h between two interpretations
_MAX_PHASES, _MAX_ORDERS = 3, 6.0  # number of interpretations, and largest shift of the order
_MAX_RISE = 0.1
_WINDOWS, _MIN_WINDOWS = 12, 3  # parts of a spectrum, and number of them that must have fringes
_MIN_AMPLITUDE = 2e-5  # smallest amplitude of T that is not due to rounding or the subtracted polynomial


def fringe_spacing_nm(n: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> FloatArray:
    """Return the spacing of the interference fringes of a layer in nm, λ²/(2nh)."""
    wavelength = np.asarray(wavelength_nm, dtype=float)
    return np.asarray(wavelength**2 / (2.0 * np.asarray(n) * np.asarray(thickness_um) * NM_PER_UM))


@dataclass(frozen=True)
class Phase:
    """An interpretation of fringes: their phase is 4π · optical thickness/λ · (1 + rise·u + bend·u²).

    Attributes
    ----------
    optical_um
        n times thickness at u = 0, where u is 1/λ² scaled to the range from −1 to 1.
    rise, bend
        Relative linear and quadratic changes of n with u.
    explained
        Fraction of the variance about a smooth curve that the fringes explain.
    amplitude
        RMS value of the fringes.
    """

    optical_um: float
    rise: float
    bend: float
    explained: float
    amplitude: float


def find_fringes(
    wavelength_nm: FloatArray,
    values: FloatArray,
    optical_um: tuple[float, float],
    mean: FloatArray | None = None,
) -> list[Phase]:
    """Return interpretations of the fringes in a spectrum, the best first; none if noise or absorption explains them.

    Parameters
    ----------
    wavelength_nm, values
        Wavelengths in ascending order, and T, −R or (T − R)/2; shape (n,).
    optical_um
        Lower and upper bounds of n times thickness.
    mean
        (T + R)/2, which is affected by absorption but not by fringes; None if only T or R is known.
    """
    count = wavelength_nm.size
    if count < _MIN_POINTS:
        return []
    um = wavelength_nm / NM_PER_UM
    ends = um[-1] ** -2, um[0] ** -2
    u = (um**-2 - sum(ends) / 2.0) / ((ends[1] - ends[0]) / 2.0)
    coarse: list[tuple[float, float, float]] = []
    for part in (slice(None), slice(count // 2, None)):  # a slit removes the fringes at short wavelengths
        coarse += _periodogram(um[part], u[part], _detrended(values[part]), optical_um)
    coarse.sort(reverse=True)
    if not coarse or coarse[0][0] > 1.0:
        return []
    distinct: list[tuple[float, float, float]] = []
    for period in coarse:
        if all(abs(period[1] - other[1]) > _MIN_DISTANCE_UM for other in distinct):
            distinct.append(period)
    signal = _detrended(values)
    candidates = [_refined(um, u, signal, optical, rise) for _, optical, rise in distinct[:_MAX_PHASES]]
    shifts = np.arange(-_MAX_ORDERS, _MAX_ORDERS + 0.1, 0.5)
    candidates += [_shifted_order(um, u, signal, candidates[0], shift) for shift in shifts if shift]
    phases: list[Phase] = []
    for candidate in sorted(candidates, key=lambda phase: -phase.explained):
        is_inside = optical_um[0] <= candidate.optical_um <= optical_um[1] and abs(candidate.rise) < _MAX_RISE
        is_distinct = all(abs(candidate.optical_um - other.optical_um) > 0.1 for other in phases)
        if is_inside and is_distinct and candidate.amplitude > _MIN_AMPLITUDE:
            phases.append(candidate)
    if not phases or not _are_fringes(um, u, signal, None if mean is None else _detrended(mean), phases[0]):
        return []
    return [phase for phase in phases if phase.explained > 0.5 * phases[0].explained][:_MAX_PHASES]


def _are_fringes(um: FloatArray, u: FloatArray, signal: FloatArray, mean: FloatArray | None, phase: Phase) -> bool:
    """Whether the oscillation is present in several parts of the spectrum and, if it is known, absent from T + R.

    Neither is the case for an absorption band. A slit of several nm leaves the fringes of a thick layer only at long
    wavelengths.
    """
    waves = np.exp(4j * np.pi * phase.optical_um * (1.0 + phase.rise * u + phase.bend * u**2) / um)
    parts = np.array_split(np.arange(um.size), _WINDOWS)
    amplitudes = np.array([abs(np.mean(signal[part] * waves[part])) for part in parts])
    if mean is None:
        return int((amplitudes > 0.3 * amplitudes.max()).sum()) >= _MIN_WINDOWS
    mean_amplitudes = np.array([abs(np.mean(mean[part] * waves[part])) for part in parts])
    is_wide = int((amplitudes > 0.15 * amplitudes.max()).sum()) >= _MIN_WINDOWS - 1
    return is_wide and float(np.sum(mean_amplitudes**2)) < 0.25 * float(np.sum(amplitudes**2))


def _detrended(values: FloatArray) -> FloatArray:
    """Return the values minus a smooth curve."""
    z = np.linspace(-1.0, 1.0, values.size)
    return np.asarray(values - np.polynomial.chebyshev.Chebyshev.fit(z, values, _DEGREE, domain=(-1, 1))(z))


def _periodogram(
    um: FloatArray, u: FloatArray, signal: FloatArray, optical_um: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Return the strongest periods that noise does not explain: log10 of probability over its limit, n·h, and rise."""
    span = abs(2.0 / um[0] - 2.0 / um[-1])
    optical = np.arange(max(optical_um[0], _MIN_FRINGES / span), optical_um[1], 0.2 / span)
    total, df = float(signal @ signal), (um.size - _DEGREE - 3) / 2.0
    if not (optical.size and total > 0.0):
        return []
    periods = []
    for rise in _RISES:
        power = np.abs(np.exp(1j * np.outer(optical, 4.0 * np.pi * (1.0 + rise * u) / um)) @ signal) ** 2
        explained = np.minimum(2.0 * power / um.size / total, 1.0 - 1e-12)
        for i in np.argsort(explained)[::-1][:2]:
            log_p = np.log10(optical.size * len(_RISES)) + df * np.log10(1.0 - explained[i])
            periods.append((float(log_p), float(optical[i]), float(rise)))
    return [(log_p - _LOG_FALSE_ALARM, nh, rise) for log_p, nh, rise in periods if log_p < _LOG_FALSE_ALARM]


def _refined(um: FloatArray, u: FloatArray, signal: FloatArray, optical: float, rise: float) -> Phase:
    """Return the phase, close to coarse values, of the best-fitting cosine with smoothly varying amplitude."""
    envelope = np.stack([np.ones_like(u), u, u**2])

    def explained_and_sign(nh: FloatArray, slope: float) -> tuple[FloatArray, FloatArray]:
        waves = np.cos(np.outer(nh, 4.0 * np.pi * (1.0 + slope * u) / um))
        right = waves @ (envelope * signal).T
        square = waves**2
        normal = np.stack([[square @ (a * b) for b in envelope] for a in envelope]).transpose(2, 0, 1)
        amplitudes = np.linalg.solve(normal + 1e-9 * um.size * np.eye(3), right[..., None])[..., 0]
        return (right * amplitudes).sum(axis=1) / float(signal @ signal), amplitudes[:, 0] - 0.5 * amplitudes[:, 1]

    nh = np.arange(optical - 0.6, optical + 0.6, 0.02)
    periods = []
    for slope in rise + np.linspace(-0.008, 0.008, 17):
        explained, sign = explained_and_sign(nh, slope)
        i = int(np.argmax(np.where(sign > 0.0, explained, -1.0)))
        periods.append((float(explained[i]), float(nh[i]), float(slope)))
    _, best, slope = max(periods)
    return _polished(um, u, signal, np.array([best, best * slope, 0.0]))


def _shifted_order(um: FloatArray, u: FloatArray, signal: FloatArray, phase: Phase, shift: float) -> Phase:
    """Return fringes with orders shifted by a number, and with phases as similar to the original phases as possible."""
    terms = np.stack([np.ones_like(u), u, u**2])
    change = np.linalg.lstsq(terms.T, shift * um / 2.0, rcond=None)[0]
    return _polished(um, u, signal, phase.optical_um * np.array([1.0, phase.rise, phase.bend]) + change)


def _polished(um: FloatArray, u: FloatArray, signal: FloatArray, p: FloatArray) -> Phase:
    """Return a phase refined by Gauss-Newton steps, with a quadratic dispersion term."""
    per_um = 4.0 * np.pi / um
    terms: FloatArray = np.stack([np.ones_like(u), u, u**2])
    envelope: FloatArray = np.stack([np.ones_like(u), u, u**2, u**3])

    def residuals_and_slopes(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        phase = np.asarray(per_um * (p @ terms))
        waves = envelope * np.cos(phase)
        amplitudes = np.linalg.lstsq(waves.T, signal, rcond=None)[0]
        slopes = -(amplitudes @ envelope) * np.sin(phase) * per_um * terms
        return signal - amplitudes @ waves, np.vstack([waves, slopes])

    residuals, slopes = residuals_and_slopes(p)
    for _ in range(20):
        step = np.linalg.lstsq(slopes.T, residuals, rcond=None)[0][envelope.shape[0] :]
        for fraction in (1.0, 0.3, 0.1):
            new_residuals, new_slopes = residuals_and_slopes(p + fraction * step)
            if float(new_residuals @ new_residuals) < float(residuals @ residuals):
                p, residuals, slopes = p + fraction * step, new_residuals, new_slopes
                break
        else:
            break
    amplitude = math.sqrt(max(float(np.mean(signal**2) - np.mean(residuals**2)), 0.0))
    explained = 1.0 - float(residuals @ residuals) / float(signal @ signal)
    return Phase(float(p[0]), float(p[1] / p[0]), float(p[2] / p[0]), explained, amplitude)


def fringe_warnings(
    wavelength_nm: FloatArray, n: FloatArray, thickness_um: float, bandwidth_nm: float | None
) -> tuple[Caution, ...]:
    """Return warnings if the bandwidth does not average over the fringes of a spectrum.

    The wavelengths are in ascending order. A NaN in ``n`` is replaced by the median of the other values.
    ``bandwidth_nm`` is None if it is unknown.
    """
    if not np.isfinite(n).any():
        return ()
    index = np.where(np.isfinite(n), n, np.nanmedian(n))
    spacing = fringe_spacing_nm(index, thickness_um, wavelength_nm)
    spacing_text = f"{spacing[0]:.2g} nm at {wavelength_nm[0]:g} nm"
    if spacing.size > 1:
        spacing_text += f" and {spacing[-1]:.2g} nm at {wavelength_nm[-1]:g} nm"
    text = f"the spacing of the fringes of a layer of {thickness_um:g} µm is {spacing_text}"
    if bandwidth_nm is None:
        return (
            warning(
                f"{text}: interference is negligible only if the bandwidth is larger, and the instrument's bandwidth "
                "is not specified"
            ),
        )
    resolved = spacing > bandwidth_nm
    if not resolved.any():
        return ()
    text += f", from {wavelength_nm[np.argmax(resolved)]:g} nm upwards more than the bandwidth, {bandwidth_nm:g} nm"
    warnings = [do_not_use(f"{text}: the spectrum contains interference, which this route neglects")]
    step = float(np.median(np.diff(wavelength_nm))) if wavelength_nm.size > 1 else np.inf
    if step > spacing[resolved].min() / 2.0:
        sampling = f"the wavelengths are {step:g} nm apart" if np.isfinite(step) else "there is only one wavelength"
        warnings.append(do_not_use(f"{sampling}, which does not resolve the fringes; they act on n like scatter"))
    return tuple(warnings)
