"""The scale of an objective from an image of a stage micrometer: parallel lines at equal, known distances.

Such lines have a single period, regardless of their profiles. Their direction is found from the gradients of the grey
values. In strips across the lines, the position of each line is the centroid of its darkness (or brightness) relative
to its sides; a straight-line fit of all positions against the line numbers gives the period and the remaining tilt. The
positions on one line share the same optical errors, so the uncertainty is based on the number of lines, not of
readings. A period that changes across the image is a sign of distortion or a tilted micrometer, and contributes to the
uncertainty of any length measured in the image.

`measured_scale` returns a `MeasuredScale`; `scale_text` writes it as the file that ``--scale`` accepts
(`solen.metrology.scale.ScaleFile`).
"""

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field
from scipy import ndimage, signal, stats

from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.metrology.scale import ScaleFile
from solen.ranks import Caution, warning
from solen.recording import Measured, Provenance
from solen.spec.strict import Finite, Options

MIN_LINES = 5
STRIPS = 12
DIRECTION_ROUNDS = 3
"""Number of iterations that refine the direction across the lines by means of the line positions."""
MIN_FILLED = 0.6
"""Minimum fraction of a strip's pixels for a valid profile; strips near the image corners are only partly filled."""
REACH = 0.35
"""Half width, as a fraction of the period, of the window about a line in which its centroid is computed."""
MAX_SPACING_ERROR = 0.015
"""Largest RMS error of the line positions, as a fraction of the period, after a linear change of the spacing across the
image is removed.
"""
MAX_OFFSET = 0.15
"""Largest displacement of a line from its position in the sequence, as a fraction of the period."""
MIN_PROMINENCE = 0.4
"""Minimum contrast of a line, as a fraction of that of the strongest lines."""
MIN_PERIOD_PX = 4.0
STRETCH_SIGMAS = 3.0
"""Multiple of its standard uncertainty above which a change of the spacing is significant."""
NORMAL_95 = 1.96
"""95 % quantile of a normal distribution, two-sided."""
_CENTROID_ROUNDS = 3


class MicrometerOptions(Options):
    """Options for the measurement of a stage micrometer in an image."""

    spacing_mm: Finite = Field(gt=0.0, le=100.0)
    """Distance between the centres of neighbouring lines."""
    u_spacing_mm: Finite | None = Field(None, ge=0.0)
    """Standard uncertainty of the distance between lines, from the micrometer's certificate."""
    objective: str = ""
    """Name of the objective and camera, such as 10x, for the file."""


class MeasuredScale(Measured, kw_only=True):
    """Scale of an objective.

    Attributes
    ----------
    objective
        Name of the objective, as specified.
    um_per_px, u_um_per_px
        Side of a pixel in the object, and its standard uncertainty.
    spacing_mm, u_spacing_mm
        Spacing of the micrometer's lines, and its standard uncertainty; None if not specified.
    lines
        Number of lines.
    period_px, u_period_px
        Spacing of the lines in the image, and its standard uncertainty.
    angle_deg
        Angle between the direction across the lines and the image's rows.
    rms_um
        RMS residual of the line positions.
    stretch_percent
        Change of the scale from one side of the image to the other; None if it is not significant.
    columns, rows
        Size of the image.
    """

    objective: str
    um_per_px: float
    u_um_per_px: float
    spacing_mm: float
    u_spacing_mm: float | None
    lines: int
    period_px: float
    u_period_px: float
    angle_deg: float
    rms_um: float
    stretch_percent: float | None
    columns: int
    rows: int

    @property
    def file(self) -> ScaleFile:
        """Content of the scale file."""
        return ScaleFile(
            objective=self.objective,
            um_per_px=self.um_per_px,
            u_um_per_px=self.u_um_per_px,
            columns=self.columns,
            rows=self.rows,
            source=f"stage micrometer, {self.lines} lines {self.spacing_mm:g} mm apart: {self.sources[0].file}",
            simulated=self.simulated,
        )


@dataclass(frozen=True, eq=False)
class _Ruler:
    """Equally spaced lines: their numbers (n,), positions (n, strips), NaN if missing, and the strip centres."""

    number: IntArray
    positions: FloatArray
    strip_centres: FloatArray


def measured_scale(grey: FloatArray, source: Provenance, options: MicrometerOptions) -> MeasuredScale:
    """Measure the scale of an image (rows, columns) of a stage micrometer.

    Raises
    ------
    DataError
        If the image shows too few lines, or lines that are not equally spaced.
    """
    across = _direction(grey)
    for _ in range(DIRECTION_ROUNDS):
        ruler = _ruler(grey, across, source.file)
        number, line_at, tilt = _fit_lines(ruler)
        across = np.asarray((across - tilt * np.array([-across[1], across[0]])) / math.hypot(1.0, tilt))
    period_px, u_fit, quadratic, u_quadratic, residuals, rms_px = _fit_spacing(number, line_at)
    if rms_px > MAX_SPACING_ERROR * period_px:
        raise _no_lines(source.file, f"lines that deviate from equal spacing by {100.0 * rms_px / period_px:.2g} % RMS")
    secant = math.hypot(1.0, tilt)
    stretch = 2.0 * quadratic * float(np.ptp(number)) / period_px
    significant = abs(quadratic) > STRETCH_SIGMAS * u_quadratic
    u_period = math.hypot(u_fit, abs(stretch) * period_px / math.sqrt(12.0) if significant else 0.0) / secant
    period_px /= secant
    um_per_px = 1e3 * options.spacing_mm / period_px
    u_spacing = (options.u_spacing_mm or 0.0) / options.spacing_mm
    rows, columns = grey.shape
    angle = math.degrees(math.atan2(across[1], across[0]))
    return MeasuredScale(
        objective=options.objective,
        um_per_px=um_per_px,
        u_um_per_px=um_per_px * math.hypot(u_period / period_px, u_spacing),
        spacing_mm=options.spacing_mm,
        u_spacing_mm=options.u_spacing_mm,
        lines=len(number),
        period_px=period_px,
        u_period_px=u_period,
        angle_deg=(angle + 90.0) % 180.0 - 90.0,
        rms_um=float(np.sqrt(np.mean(residuals**2))) * um_per_px,
        stretch_percent=100.0 * stretch if significant else None,
        columns=columns,
        rows=rows,
        sources=(source,),
        warnings=tuple(_warnings(options, number, 100.0 * stretch if significant else None)),
    )


def _ruler(grey: FloatArray, across: FloatArray, file: str) -> _Ruler:
    """Return the equally spaced lines of an image, given the direction across them."""
    profile = _profiles(grey, across, 1)[0][0]
    sign, period = _period(profile, file)
    flat = sign * (profile - ndimage.uniform_filter1d(profile, round(2.0 * period), mode="nearest"))
    top = float(np.percentile(flat, 99.5))
    peaks, _ = signal.find_peaks(flat, prominence=MIN_PROMINENCE * top, distance=max(0.6 * period, 1.0))
    number = np.rint((peaks - peaks[len(peaks) // 2]) / period).astype(np.int64)
    for _ in range(2):
        slope, start = np.polyfit(number, peaks, 1)
        number = np.rint((peaks - start) / slope).astype(np.int64)
    accepted = np.abs(peaks - start - slope * number) < MAX_OFFSET * slope
    accepted &= np.append(True, np.diff(number) > 0)
    if accepted.sum() < MIN_LINES:
        raise _no_lines(file, f"{int(accepted.sum())} equally spaced lines")
    strips, strip_centres = _profiles(grey, across, STRIPS)
    positions = np.array(
        [
            [_centroid(sign * strip, float(peak), float(slope), MIN_PROMINENCE * top) for strip in strips]
            for peak in peaks[accepted]
        ]
    )
    kept = np.isfinite(positions).sum(axis=1) >= 2
    if kept.sum() < MIN_LINES:
        raise _no_lines(file, f"{int(kept.sum())} lines that cross the image")
    return _Ruler(number[accepted][kept], positions[kept], strip_centres)


def _no_lines(file: str, content: str) -> DataError:
    needed = f"at least {MIN_LINES} equally spaced parallel lines, at least {MIN_PERIOD_PX:g} pixels apart, are needed"
    remedy = "take a sharp image of the finest division that the objective resolves"
    return DataError(file, limit=f"shows {content}; {needed}", remedy=remedy)


def _direction(grey: FloatArray) -> FloatArray:
    """Return the unit vector (x, y) across the lines: that of the strongest gradients, from the structure tensor."""
    smooth = ndimage.gaussian_filter(grey, 1.0)
    y, x = np.gradient(smooth)
    tensor = np.array([[np.sum(x * x), np.sum(x * y)], [np.sum(x * y), np.sum(y * y)]])
    across = np.linalg.eigh(tensor)[1][:, -1]
    return np.asarray(across if across[np.argmax(np.abs(across))] > 0.0 else -across)


def _profiles(grey: FloatArray, across: FloatArray, strips: int) -> tuple[list[FloatArray], FloatArray]:
    """Return mean grey values against the distance across the lines, for strips along them, and the strip centres.

    A value is divided between the two nearest pixels of the profile, which broadens all lines equally and displaces
    none. Parts of a strip outside the image are NaN in its profile.
    """
    rows, columns = grey.shape
    y, x = np.indices(grey.shape)
    x0, y0 = 0.5 * (columns - 1), 0.5 * (rows - 1)
    s = (x - x0) * across[0] + (y - y0) * across[1]
    t = (y - y0) * across[0] - (x - x0) * across[1]
    length = math.ceil(np.ptp(s)) + 3
    first = float(s.min()) - 1.0
    low, high = np.percentile(t, [2.0, 98.0])
    strip_of_pixel = np.clip(((t - low) / (high - low) * strips).astype(np.int64), 0, strips - 1).ravel()
    at = (s - first).ravel()
    pixel = at.astype(np.int64)
    fraction, profiles = at - pixel, []
    for strip in range(strips):
        inside = strip_of_pixel == strip
        total, weight = np.zeros(length), np.zeros(length)
        for step, weight_of in ((0, 1.0 - fraction[inside]), (1, fraction[inside])):
            total += np.bincount(pixel[inside] + step, weight_of * grey.ravel()[inside], length)
            weight += np.bincount(pixel[inside] + step, weight_of, length)
        filled = weight > MIN_FILLED * weight.max()
        values = np.interp(np.arange(length), np.flatnonzero(filled), total[filled] / weight[filled])
        profiles.append(np.where(filled, values, np.nan) if strips > 1 else values)
    return profiles, low + (np.arange(strips) + 0.5) * (high - low) / strips


def _period(profile: FloatArray, file: str) -> tuple[float, float]:
    """Return 1 for bright or -1 for dark lines, and the spacing of the lines in pixels from the autocorrelation."""
    level = profile - ndimage.median_filter(profile, size=max(5, len(profile) // 8), mode="nearest")
    sign = 1.0 if np.mean(level**3) > 0.0 else -1.0
    line = np.maximum(sign * level, 0.0)
    line = line - line.mean()
    autocorrelation = signal.correlate(line, line, method="fft")[len(line) - 1 :]
    autocorrelation = autocorrelation / np.arange(len(line), 0, -1)
    peaks, _ = signal.find_peaks(autocorrelation[: len(line) // 2], prominence=0.2 * autocorrelation[0])
    peaks = peaks[peaks >= MIN_PERIOD_PX]
    if not len(peaks) or not autocorrelation[0] > 0.0:
        raise _no_lines(file, "no periodic lines")
    strong = peaks[autocorrelation[peaks] > 0.5 * autocorrelation[peaks].max()]
    return sign, float(strong[0])


def _centroid(line: FloatArray, peak: float, period: float, min_contrast: float) -> float:
    """Return the position of a bright line near a peak: the centroid above its sides; NaN below a minimum contrast."""
    at, reach = peak, REACH * period
    for _ in range(_CENTROID_ROUNDS):
        low, high = at - reach, at + reach
        if low < 0.0 or high > len(line) - 1:
            return math.nan
        positions = np.linspace(low, high, max(9, 2 * math.ceil(2.0 * reach) + 1))
        values = np.interp(positions, np.arange(len(line)), line)
        excess = np.maximum(values - np.linspace(values[0], values[-1], len(values)), 0.0)
        if not excess.sum() > 0.0:  # also NaN where the strip is outside the image
            return math.nan
        at = float(excess @ positions / excess.sum())
        if abs(at - peak) > REACH * period:
            return math.nan
    return at if float(excess.max()) > min_contrast else math.nan


def _fit_lines(ruler: _Ruler) -> tuple[IntArray, FloatArray, float]:
    """Return line numbers, positions (n,) at the mean strip centre, and the common slope along the lines."""
    t = ruler.strip_centres - ruler.strip_centres.mean()
    valid = np.isfinite(ruler.positions)
    t_all = np.where(valid, t, 0.0)
    middle_t = t_all.sum(axis=1) / valid.sum(axis=1)
    middle = np.where(valid, ruler.positions, 0.0).sum(axis=1) / valid.sum(axis=1)
    off_t = np.where(valid, t - middle_t[:, None], 0.0)
    offset_px = np.where(valid, ruler.positions - middle[:, None], 0.0)
    slope = float((off_t * offset_px).sum() / (off_t**2).sum())
    residuals = np.where(valid, offset_px - slope * off_t, np.nan)
    limit = 4.0 * 1.4826 * float(np.nanmedian(np.abs(residuals))) + 1e-9
    good = valid & (np.abs(np.nan_to_num(residuals)) <= limit)
    count = good.sum(axis=1)
    kept = count >= 2
    positions = np.where(good, ruler.positions - slope * t, 0.0).sum(axis=1)[kept] / count[kept]
    return ruler.number[kept], positions, slope


def _fit_spacing(number: IntArray, positions: FloatArray) -> tuple[float, float, float, float, FloatArray, float]:
    """Return the spacing of the lines and the quadratic term, each followed by its uncertainty, and the residuals.

    The last value is the RMS residual that remains with the quadratic term.
    """
    x = number - number.mean()
    powers = np.vander(x, 3, increasing=True)
    solution, *_ = np.linalg.lstsq(powers, positions, rcond=None)
    freedom = max(len(x) - 3, 1)
    remainder = positions - powers @ solution
    covariance = np.linalg.inv(powers.T @ powers) * float(remainder @ remainder) / freedom
    line = np.polyfit(x, positions, 1)
    residuals = positions - np.polyval(line, x)
    t_factor = float(stats.t.ppf(0.975, len(x) - 2)) / NORMAL_95  # the scatter of a few lines is uncertain
    u_uniform = math.sqrt(float(residuals @ residuals) / (len(x) - 2) / float(x @ x))
    u = t_factor * max(u_uniform, _u_of_slope(x, residuals))
    return (
        float(line[0]),
        u,
        float(solution[2]),
        math.sqrt(float(covariance[2, 2])),
        residuals,
        float(np.sqrt(np.mean(remainder**2))),
    )


def _u_of_slope(x: FloatArray, residuals: FloatArray) -> float:
    """Return the standard uncertainty of a slope for points (n,) with unequal scatter.

    It uses residuals over 1 − leverage: lines near the image corners are short, so their positions scatter more, and
    they have the largest influence on the slope (HC3: J. G. MacKinnon and H. White, J. Econometrics 29, 305, 1985).
    """
    leverage = 1.0 / len(x) + x**2 / float(x @ x)
    return float(np.sqrt(np.sum((x * residuals / (1.0 - leverage)) ** 2))) / float(x @ x)


def _warnings(options: MicrometerOptions, number: IntArray, stretch_percent: float | None) -> list[Caution]:
    warnings = []
    if options.u_spacing_mm is None:
        warnings.append(
            warning(
                "the uncertainty of the micrometer's spacing is not specified (--u-spacing-mm) and is not included in "
                "the uncertainty of the scale"
            )
        )
    if stretch_percent is not None:
        warnings.append(
            warning(
                f"the scale changes by {stretch_percent:+.2g} % across the image, because of distortion "
                "or a tilted micrometer; measure parts at the image's centre"
            )
        )
    missing = int(np.ptp(number)) + 1 - len(number)
    if missing:
        warnings.append(warning(f"{missing} lines between the first and the last were not detected"))
    return warnings
