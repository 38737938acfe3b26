"""Light of one pixel at the window: a rectangle blurred by a Gaussian, or a measured response.

The light of an image is the sum of the light of its pixels. Often, only the width of the blur of the projector is
known; the rectangle of the pixel is then convolved with a Gaussian. If the light of a single lit pixel was measured,
that image replaces both, with its flat top, tails and asymmetry. Its samples are interpolated by a cubic spline, and
the light outside the table is zero; the sum of the samples is the light of one pixel.

`PixelResponse` is the table in a process file, and `light_of_file` reads its samples from a file. `GaussianPixel` and
`MeasuredPixel` return the spectrum on a grid, in the plane or summed along an axis, and the mean over directions as a
sum of Gaussians, with which straight walls and round features are modelled.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy import fft, ndimage

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.recording import grid
from solen.recording.numbers import parse
from solen.recording.source import load
from solen.spec.strict import Number, Positive, Strict, refused

Spectrum = NDArray[np.complex128]
Mixture = tuple[FloatArray, FloatArray]
"""Weights, some of them negative, and standard deviations in µm of Gaussians whose sum is a response."""

IMAGE_SUFFIXES = (".png", ".tif", ".tiff", ".bmp")
MAX_SAMPLES = 65_536
MAX_GAUSSIAN_AMPLITUDE = 1e-6
"""Maximum relative spectral amplitude of a Gaussian blur at the highest frequency of the fine grid."""
MAX_MEASURED_AMPLITUDE = 5e-5
"""Maximum relative spectral amplitude of a measured response at the highest frequency of the fine grid."""
MIN_SUBSAMPLES, MAX_SUBSAMPLES = 3, 16
"""Minimum and maximum number of points of the fine grid per pixel."""
MAX_RIM = 0.01
"""Maximum mean of each side of the rim of a table, as a fraction of the brightest sample."""
MAX_NEGATIVE = 0.05
"""Maximum magnitude of negative samples, as a fraction of the brightest sample."""
MAX_NEIGHBOUR_RATIO = 8.0
"""Maximum ratio of a sample to its brightest neighbour; a brighter one is probably a hot pixel of the camera."""
MIN_SAMPLES_PER_PIXEL = 4.0
"""Minimum number of samples along the side of a pixel."""
_GREY_MODES = ("L", "F", "I", "I;16", "I;16B", "I;16L", "I;16N")  # image modes whose values are proportional to light
_FULL_SCALES = (255, 1023, 4095, 16383, 65535)
_WIDTHS = np.geomspace(0.35, 2.5, 8)  # widths of the Gaussians in a mixture, divided by the width of the response
_WAVES, _DIRECTIONS, _RIDGE = 120, 16, 1e-4
_PAD = 12  # dark samples around a table, over which its spline decays
_BLUR_WIDTHS = 6.0  # standard deviations at which a Gaussian is cut off
_WIDTH_RATIOS = 0.1, 20.0  # minimum and maximum width of a response, divided by the size of a pixel


class PixelResponse(Strict):
    """Measured light of one pixel over x and y at the window."""

    table: ClassVar[str] = "process.response"
    error: ClassVar[type[SolenError]] = DataError

    light: tuple[tuple[Number, ...], ...] = Field(
        description="samples in any unit, with columns along x and rows along y, both ascending; instead of light, "
        "the key file may name a table (.csv, .txt) of samples or an image with y upwards (.png, .tif)."
    )
    pitch_um: Annotated[Positive, Field(le=1e3)] = Field(description="Sample spacing in µm.")
    centre_um: tuple[Number, Number] | None = Field(
        None, description="Position of the pixel's centre from the first sample, along x and y; default: the centroid."
    )

    @model_validator(mode="after")
    def _check_light(self) -> Self:
        rows, columns = len(self.light), len(self.light[0]) if self.light else 0
        if min(rows, columns) < 5 or any(len(row) != columns for row in self.light):
            raise refused("light", "must have at least 5 rows of at least 5 numbers, all of the same length")
        if rows * columns > MAX_SAMPLES:
            limit = f"has {rows} x {columns} samples, more than {MAX_SAMPLES:,}"
            raise refused("light", limit, remedy="crop the table to the light, or average samples")
        light = np.array(self.light)
        peak, lowest = float(light.max()), float(light.min())
        if not peak > 0.0:
            raise refused("light", f"has no sample above 0: the brightest is {peak:g}")
        if lowest < -MAX_NEGATIVE * peak:
            limit = f"has samples down to {lowest:.3g}, below -{100 * MAX_NEGATIVE:g} % of the brightest, {peak:.3g}"
            raise refused("light", limit, remedy="check the dark image that was subtracted")
        rim = max(float(np.mean(side)) for side in (light[0], light[-1], light[:, 0], light[:, -1]))
        if rim > MAX_RIM * peak:
            limit = (
                f"must be dark at its rim, but the mean of a side is {100 * rim / peak:.2g} % of the brightest sample"
            )
            remedy = f"subtract the background, or use a larger table (limit: {100 * MAX_RIM:g} %)"
            raise refused("light", limit, remedy=remedy)
        sides = (columns - 1) * self.pitch_um, (rows - 1) * self.pitch_um
        if self.centre_um and not all(0.0 <= at <= side for at, side in zip(self.centre_um, sides, strict=True)):
            limit = f"must be within the table, 0 to {sides[0]:g} and 0 to {sides[1]:g} µm"
            raise refused("centre_um", limit, value=list(self.centre_um), remedy="specify it along x and y, in µm")
        return self

    @property
    def hot_pixel(self) -> tuple[int, int, float] | None:
        """Row and column (from 1) of a probable hot pixel, and its ratio to its brightest neighbour; otherwise None."""
        light = np.array(self.light)
        neighbours = np.ones((3, 3), bool)
        neighbours[1, 1] = False
        brightest = ndimage.maximum_filter(light, footprint=neighbours, mode="constant")
        row, column = np.unravel_index(int(np.argmax(light)), light.shape)
        ratio = float(light[row, column] / max(brightest[row, column], 1e-3 * light.max()))
        return (int(row) + 1, int(column) + 1, ratio) if ratio > MAX_NEIGHBOUR_RATIO else None


@dataclass(frozen=True)
class GaussianPixel:
    """A uniformly lit rectangle, ``pixels_um`` in x and y, blurred by a Gaussian of standard deviation ``blur_um``."""

    blur_um: float
    pixels_um: tuple[float, float]

    @property
    def mixture(self) -> Mixture:
        """Mean of the response over directions: a single Gaussian."""
        return np.ones(1), np.array([math.sqrt(self.blur_um**2 + _variance_um2(self.pixels_um))])

    @property
    def reach_um(self) -> float:
        """Distance to which the light extends beyond the rectangle of the pixel."""
        return _BLUR_WIDTHS * self.blur_um

    @property
    def fine(self) -> int:
        """Grid points per pixel for an error as small as rounding; raises `DataError` if the blur is too small."""
        width, pixel_um = math.sqrt(-2.0 * math.log(MAX_GAUSSIAN_AMPLITUDE)), max(self.pixels_um)
        required = math.ceil(width * pixel_um / (math.pi * self.blur_um))
        if required > MAX_SUBSAMPLES:
            min_um = width * pixel_um / (math.pi * MAX_SUBSAMPLES)
            limit = f"must be at least {min_um:.2g} µm for pixels of {pixel_um:g} µm"
            remedy = "increase sigma_um: projectors have larger blurs"
            raise DataError("process.sigma_um", value=self.blur_um, limit=limit, remedy=remedy)
        return max(required, MIN_SUBSAMPLES)

    def plane(self, shape: tuple[int, int], step_um: tuple[float, float]) -> FloatArray:
        """Return the spectrum of a real transform on a periodic grid of rows and columns with steps along x and y."""
        along_x, along_y = self.row(shape[1], step_um[0], 0), self.row(shape[0], step_um[1], 1)
        return np.outer(along_y[_mirrored(shape[0])], along_x)

    def row(self, count: int, step_um: float, axis: int) -> FloatArray:
        """Return the spectrum of the response on a periodic row along x (0) or y (1), summed along the other axis."""
        k = math.tau * fft.rfftfreq(count, step_um)
        blur = np.exp(-0.5 * (self.blur_um * k) ** 2)
        return np.asarray(blur * np.sinc(k * self.pixels_um[axis] / math.tau))


@dataclass(frozen=True, eq=False)
class MeasuredPixel:
    """A measured response as spline coefficients.

    Attributes
    ----------
    response
        Table of samples.
    splines
        Coefficients (rows, columns) of cubic B-splines, whose sum is 1.
    first_um
        Position of the first spline relative to the centre of the pixel, along x and y.
    pitch_um
        Spacing of the splines.
    pixels_um
        Sizes of the pixel along x and y.
    """

    response: PixelResponse
    splines: FloatArray
    first_um: tuple[float, float]
    pitch_um: float
    pixels_um: tuple[float, float]

    @cached_property
    def centroid_um(self) -> FloatArray:
        """Position of the centroid of the light relative to the centre of the pixel, along x and y."""
        return np.array([float(self._summed(axis) @ self._positions(axis)) for axis in (0, 1)])

    @cached_property
    def blur_um(self) -> float:
        """Standard deviation of the Gaussian that blurs the rectangle of a pixel to the width of the measured light."""
        return math.sqrt(max(self.width_um**2 - _variance_um2(self.pixels_um), 0.0))

    @cached_property
    def width_um(self) -> float:
        """Standard deviation of the light along an axis, RMS of both axes."""
        centroid = self.centroid_um
        squares = (float(self._summed(axis) @ (self._positions(axis) - centroid[axis]) ** 2) for axis in (0, 1))
        return math.sqrt(0.5 * sum(squares) + self.pitch_um**2 / 3.0)  # plus the variance of a cubic B-spline

    @property
    def reach_um(self) -> float:
        """Distance to which the table extends."""
        return max(float(np.abs(self._positions(axis)).max()) for axis in (0, 1))

    @property
    def mixture(self) -> Mixture:
        """Mean over directions about the centroid, as Gaussians fitted to the spectrum by least squares."""
        return _weights(self.response), self.width_um * _WIDTHS

    @cached_property
    def fine(self) -> int:
        """Number of grid points per pixel that represent the response; at most that of its samples."""
        pixel_um, axes = max(self.pixels_um), ((1.0, 0.0), (0.0, 1.0))
        densest = min(MAX_SUBSAMPLES, math.ceil(pixel_um / self.pitch_um))
        k = math.pi / pixel_um * np.linspace(1.0, 2.0, 32)
        for fine in range(MIN_SUBSAMPLES, densest):
            amplitude = max(float(np.abs(self.along(fine * k, *axis)).max()) for axis in axes)
            if amplitude < MAX_MEASURED_AMPLITUDE:
                return fine
        return densest

    def plane(self, shape: tuple[int, int], step_um: tuple[float, float]) -> Spectrum:
        """Return the spectrum of a real transform on a periodic grid of rows and columns with steps along x and y."""
        (rows, i), (columns, j) = (self._basis(shape[1 - axis], step_um[axis], axis) for axis in (1, 0))
        kernel = np.zeros(shape)
        np.add.at(kernel, (i[:, None], j), rows @ self.splines @ columns.T)
        return np.asarray(fft.rfft2(kernel))

    def row(self, count: int, step_um: float, axis: int) -> Spectrum:
        """Return the spectrum of the response on a periodic row along x (0) or y (1), summed along the other axis."""
        basis, indices = self._basis(count, step_um, axis)
        kernel = np.zeros(count)
        np.add.at(kernel, indices, basis @ self._summed(axis))
        return np.asarray(fft.rfft(kernel))

    def towards(self, axis: int, sign: float) -> tuple[FloatArray, FloatArray, float]:
        """Return weights and positions (N,) of the light along an axis (or its negative), and the width of a sample."""
        return self._summed(axis), sign * self._positions(axis), self.pitch_um / math.sqrt(3.0)

    def _summed(self, axis: int) -> FloatArray:
        return np.asarray(self.splines.sum(axis=axis))

    def _positions(self, axis: int) -> FloatArray:
        count = self.splines.shape[1 - axis]
        return self.first_um[axis] + self.pitch_um * np.arange(count, dtype=float)

    def _basis(self, count: int, step_um: float, axis: int) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return N splines (M, N) at points of a grid, times its step, and the periodic indices (M,) of the points."""
        positions = self._positions(axis)
        low, high = positions[0] - 2.0 * self.pitch_um, positions[-1] + 2.0 * self.pitch_um
        points = np.arange(math.ceil(low / step_um), math.floor(high / step_um) + 1)
        basis = _spline((points[:, None] * step_um - positions) / self.pitch_um) * (step_um / self.pitch_um)
        return basis, np.asarray(points % count, np.intp)

    def along(self, k: FloatArray, x: float, y: float) -> FloatArray:
        """Return the spectrum (K,) about the centroid at wave numbers in the direction (x, y) and its opposite."""
        positions = (self._positions(axis) - self.centroid_um[axis] for axis in (0, 1))
        waves = [np.exp(-1j * np.outer(k * part, position)) for part, position in zip((x, y), positions, strict=True)]
        splines = [np.sinc(k * part * self.pitch_um / math.tau) ** 4 for part in (x, y)]
        spectrum = np.einsum("ky,yx,kx->k", waves[1], self.splines, waves[0], optimize=True)
        return np.asarray(spectrum.real * splines[0] * splines[1])


@lru_cache(maxsize=8)
def measured_pixel(response: PixelResponse, scale: float, pixels_um: tuple[float, float]) -> MeasuredPixel:
    """Return a response as spline coefficients, with its lengths multiplied by ``scale``.

    Raises
    ------
    DataError
        If the samples are too coarse for the pixels, or the light is not about as wide as a pixel.
    """
    if MIN_SAMPLES_PER_PIXEL * response.pitch_um > min(pixels_um):
        max_um = min(pixels_um) / MIN_SAMPLES_PER_PIXEL
        limit = f"must be at most {max_um:.3g} µm: {MIN_SAMPLES_PER_PIXEL:g} samples per pixel of {min(pixels_um):g} µm"
        remedy = "measure the response with a higher magnification"
        raise DataError("process.response.pitch_um", value=response.pitch_um, limit=limit, remedy=remedy)
    pixel = _scaled(response, scale, pixels_um)
    low, high = (ratio * max(pixels_um) for ratio in _WIDTH_RATIOS)
    if not low <= pixel.width_um <= high:
        limit = f"has a standard deviation of {pixel.width_um:.3g} µm, outside {low:.3g} to {high:.3g} µm"
        remedy = f"check pitch_um, and pixel_um = {max(pixels_um):g}: both are in µm"
        raise DataError("process.response", limit=limit, remedy=remedy)
    return pixel


def _scaled(response: PixelResponse, scale: float, pixels_um: tuple[float, float]) -> MeasuredPixel:
    (splines, (x, y)), pitch = _splines(response), scale * response.pitch_um
    return MeasuredPixel(response, splines, (-x * pitch, -y * pitch), pitch, pixels_um)


@lru_cache(maxsize=8)
def _splines(response: PixelResponse) -> tuple[FloatArray, tuple[float, float]]:
    """Return the spline coefficients of a response, and the centre of the pixel from the first spline, in samples."""
    light = np.pad(np.array(response.light), _PAD)
    splines = ndimage.spline_filter(light, order=3, mode="mirror")
    splines = splines / splines.sum()
    if response.centre_um is not None:
        x, y = (_PAD + position / response.pitch_um for position in response.centre_um)
    else:
        rows, columns = (np.arange(count) for count in light.shape)
        x, y = float(splines.sum(axis=0) @ columns), float(splines.sum(axis=1) @ rows)
    return splines, (x, y)


@lru_cache(maxsize=8)
def _weights(response: PixelResponse) -> FloatArray:
    """Return the weights of Gaussians whose sum best fits the mean of a response over directions."""
    pixel = _scaled(response, 1.0, (1.0, 1.0))
    k, widths = np.linspace(0.0, 6.0 / pixel.width_um, _WAVES), pixel.width_um * _WIDTHS
    angles = math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    mean = np.mean([pixel.along(k, math.cos(angle), math.sin(angle)) for angle in angles], axis=0)
    total, ridge = 1e3 * np.ones((1, len(widths))), _RIDGE * math.sqrt(_WAVES) * np.eye(len(widths))
    matrix = np.vstack([np.exp(-0.5 * np.outer(k, widths) ** 2), total, ridge])
    weights = np.linalg.lstsq(matrix, np.concatenate([mean, [1e3], np.zeros(len(widths))]))[0]
    return np.asarray(weights / weights.sum())


def light_of_file(path: Path) -> list[list[float]]:
    """Return the samples in a table of numbers, or in a single-channel image with y upwards; the smallest y is first.

    Raises
    ------
    DataError
        If the file cannot be read, if an image is in colour, overexposed or has several pages, or if a table has gaps.
    """
    return _image_light(path) if path.suffix.lower() in IMAGE_SUFFIXES else _table_light(path)


def _table_light(path: Path) -> list[list[float]]:
    """Return the rows of numbers of a table with one separator and one decimal mark."""
    cells = grid.of_text(load(path))
    rows = [row for row in range(len(cells.rows)) if not cells.is_blank(row)]
    widths = [cells.width(row) for row in rows]
    mark = cells.mark(rows, {column: cells.cells(column, rows) for column in range(max(widths, default=0))})

    def number(row: int, column: int) -> float:
        try:
            value = parse(cells.rows[row][column], mark)
        except ValueError as error:
            raise cells.error(row, column, str(error), "use one separator, and # before comments") from None
        if math.isnan(value):
            raise cells.error(row, column, "must be a finite number", "use a table without gaps")
        return value

    return [[number(row, column) for column in range(width)] for row, width in zip(rows, widths, strict=True)]


def _image_light(path: Path) -> list[list[float]]:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            mode, pages, light = image.mode, getattr(image, "n_frames", 1), np.array(image)
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise DataError(
            str(path), limit=f"cannot be read as an image: {error}", remedy="save it again as PNG or TIFF"
        ) from None
    if mode not in _GREY_MODES:  # the values of a palette are not light
        limit = f"must be a single-channel grey image, without colours or a palette, but has the mode {mode}"
        raise DataError(str(path), limit=limit, remedy="save it as grey levels with 8, 16 or 32 bits")
    if pages > 1:
        limit = f"must contain a single image, but has {pages} pages"
        raise DataError(str(path), limit=limit, remedy="save only the page with the pixel")
    if int(light.max()) in _FULL_SCALES and np.count_nonzero(light == light.max()) > 1:
        limit = f"is overexposed: {np.count_nonzero(light == light.max()):,} samples are at full scale, {light.max():g}"
        raise DataError(str(path), limit=limit, remedy="use a shorter camera exposure time")
    rows: list[list[float]] = light[::-1].astype(float).tolist()
    return rows


def _spline(t: FloatArray) -> FloatArray:
    """Return a cubic B-spline as a function of the distance from its centre, in steps."""
    t = np.abs(t)
    return np.where(t < 1.0, 2.0 / 3.0 - t**2 + 0.5 * t**3, np.maximum(2.0 - t, 0.0) ** 3 / 6.0)


def _variance_um2(pixels_um: tuple[float, float]) -> float:
    """Return the variance of the rectangle of a pixel along an axis, mean of both axes."""
    return sum(side**2 for side in pixels_um) / 24.0


def _mirrored(count: int) -> NDArray[np.intp]:
    """Return, for each frequency of a full transform, its index in a real transform."""
    return np.abs(np.rint(fft.fftfreq(count) * count)).astype(np.intp)
