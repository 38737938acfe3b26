"""Light of one pixel at the window: a rectangle blurred by a Gaussian, or a measured response.

The light of an image is the sum of the light of its pixels. Often only the width of the projector blur is known; the
rectangle of the pixel is then convolved with a Gaussian. If the light of a single lit pixel was measured, that image
replaces both, with its flat top, tails and asymmetry. Samples are interpolated by a cubic spline, and the light outside
the table is zero; the sum of the samples is the light of one pixel.

`PixelResponse` is the table in a process file, and `light_of_file` reads the samples from a file. `GaussianPixel` and
`MeasuredPixel` return the spectrum on a grid, in the plane and summed along one axis, and the mean over directions as a
sum of Gaussians, which is used for straight walls and round features.
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

IMAGES = (".png", ".tif", ".tiff", ".bmp")
MAX_SAMPLES = 65_536
FAINTEST = 1e-6
"""Relative spectral amplitude of the narrowest blur at the highest frequency of the fine grid."""
FAINT = 5e-5
"""Relative spectral amplitude of a measured response at the highest frequency of the fine grid."""
MIN_SUBSAMPLES, MAX_SUBSAMPLES = 3, 16
RIM = 0.01
"""Maximum mean of each side of a table's rim, as a fraction of the brightest sample."""
NOISE = 0.05
"""Maximum depth of negative samples, as a fraction of the brightest sample."""
HOT = 8.0
"""Ratio of a sample to its brightest neighbour above which it is probably a camera defect."""
MIN_SAMPLES_PER_PIXEL = 4.0
"""Minimum number of samples along the side of a pixel."""
_GREY = ("L", "F", "I", "I;16", "I;16B", "I;16L", "I;16N")  # image modes whose values are proportional to light
_FULL_SCALES = (255, 1023, 4095, 16383, 65535)
_WIDTHS = np.geomspace(0.35, 2.5, 8)  # widths of the Gaussians in a mixture, divided by the width of the response
_WAVES, _DIRECTIONS, _RIDGE = 120, 16, 1e-4
_PAD = 12  # dark samples around a table, over which its spline decays
_FAR = 6.0  # widths of a Gaussian
_APART = 0.1, 20.0  # response width divided by pixel width


class PixelResponse(Strict):
    """Measured light of one pixel over x and y at the window."""

    table: ClassVar[str] = "process.response"
    error: ClassVar[type[SolenError]] = DataError

    light: tuple[tuple[Number, ...], ...] = Field(
        description="samples, in any unit: columns along x, rows along y, the smallest first; or file names a table "
        "(.csv, .txt) of samples or an image with y up (.png, .tif)."
    )
    pitch_um: Annotated[Positive, Field(le=1e3)] = Field(description="Sample spacing in µm.")
    centre_um: tuple[Number, Number] | None = Field(
        None, description="Position of the pixel's centre from the first sample, along x and y; default: the centroid."
    )

    @model_validator(mode="after")
    def _is_one_pixel(self) -> Self:
        rows, columns = len(self.light), len(self.light[0]) if self.light else 0
        if min(rows, columns) < 5 or any(len(row) != columns for row in self.light):
            raise refused(
                "light", "must be at least 5 rows of at least 5 numbers, all of the same length", value=f"{rows} rows"
            )
        if rows * columns > MAX_SAMPLES:
            limit = f"at most {MAX_SAMPLES:,} samples"
            raise refused(
                "light", limit, value=f"{rows} x {columns}", remedy="crop the table to the light, or average samples"
            )
        light = np.array(self.light)
        peak = float(light.max())
        if not peak > 0.0 or light.min() < -NOISE * peak:
            limit = f"must be light: above 0, and nowhere below -{100 * NOISE:g} % of the brightest sample"
            raise refused("light", limit, value=float(light.min()), remedy="check the dark image that was subtracted")
        rim = max(float(np.mean(side)) for side in (light[0], light[-1], light[:, 0], light[:, -1]))
        if rim > RIM * peak:
            limit = f"the mean of each side of its rim must be dark: within {100 * RIM:g} % of the brightest sample"
            remedy = "subtract the background, or use a wider table"
            raise refused("light", limit, value=f"{100 * rim / peak:.2g} %", remedy=remedy)
        sides = (columns - 1) * self.pitch_um, (rows - 1) * self.pitch_um
        if self.centre_um and not all(0.0 <= at <= side for at, side in zip(self.centre_um, sides, strict=True)):
            limit = f"must be within the table, 0 to {sides[0]:g} and 0 to {sides[1]:g} µm"
            raise refused("centre_um", limit, value=list(self.centre_um), remedy="specify it along x and y, in µm")
        return self

    @property
    def hot(self) -> tuple[int, int, float] | None:
        """Row and column (from 1) of a sample far brighter than its neighbours, and the ratio; otherwise None."""
        from scipy.ndimage import maximum_filter

        light = np.array(self.light)
        around = np.ones((3, 3), bool)
        around[1, 1] = False
        nearby = maximum_filter(light, footprint=around, mode="constant")
        row, column = np.unravel_index(int(np.argmax(light)), light.shape)
        ratio = float(light[row, column] / max(nearby[row, column], 1e-3 * light.max()))
        return (int(row) + 1, int(column) + 1, ratio) if ratio > HOT else None


@dataclass(frozen=True)
class GaussianPixel:
    """Uniformly lit rectangle with sides ``pixels_um`` along x and y, blurred by a Gaussian of ``blur_um``."""

    blur_um: float
    pixels_um: tuple[float, float]

    @property
    def mixture(self) -> Mixture:
        """Return the mean of the response over directions, as one Gaussian."""
        return np.ones(1), np.array([math.sqrt(self.blur_um**2 + _own_um2(self.pixels_um))])

    @property
    def reach_um(self) -> float:
        """Extent of the light beyond the rectangle of the pixel."""
        return _FAR * self.blur_um

    @property
    def fine(self) -> int:
        """Grid points per pixel that represent the response exactly to rounding; `DataError` if it is too sharp."""
        width, pixel_um = math.sqrt(-2.0 * math.log(FAINTEST)), max(self.pixels_um)
        needed = math.ceil(width * pixel_um / (math.pi * self.blur_um))
        if needed > MAX_SUBSAMPLES:
            least = width * pixel_um / (math.pi * MAX_SUBSAMPLES)
            limit = f"must be at least {least:.2g} µm for pixels of {pixel_um:g} µm"
            raise DataError(
                "process.sigma_um", value=self.blur_um, limit=limit, remedy="no projector produces sharper pixels"
            )
        return max(needed, MIN_SUBSAMPLES)

    def plane(self, shape: tuple[int, int], step_um: tuple[float, float]) -> FloatArray:
        """Spectrum on a periodic grid of rows and columns with steps along x and y, as for a real transform."""
        across = self.row(shape[1], step_um[0], 0)
        along = self.row(shape[0], step_um[1], 1)
        return np.outer(along[_mirrored(shape[0])], across)

    def row(self, count: int, step_um: float, axis: int) -> FloatArray:
        """Return the spectrum of the response summed along the other axis, on a periodic row along x (0) or y (1)."""
        k = math.tau * fft.rfftfreq(count, step_um)
        blur = np.exp(-0.5 * (self.blur_um * k) ** 2)
        return np.asarray(blur * np.sinc(k * self.pixels_um[axis] / math.tau))


@dataclass(frozen=True, eq=False)
class MeasuredPixel:
    """A measured response as spline coefficients.

    Attributes
    ----------
    response
        The sample table.
    splines
        Coefficients (rows, columns) of the cubic B-splines; their sum is 1.
    first_um
        Position of the first spline from the pixel centre, along x and y.
    pitch_um
        Spacing of the splines.
    pixels_um
        Sides of the pixel.
    """

    response: PixelResponse
    splines: FloatArray
    first_um: tuple[float, float]
    pitch_um: float
    pixels_um: tuple[float, float]

    @cached_property
    def centroid_um(self) -> FloatArray:
        """Position of the light centroid relative to the pixel centre, along x and y."""
        return np.array([float(self._line(axis) @ self._places(axis)) for axis in (0, 1)])

    @cached_property
    def blur_um(self) -> float:
        """Standard deviation of the Gaussian blur that gives the pixel rectangle the same width, mean of both axes."""
        return math.sqrt(max(self.width_um**2 - _own_um2(self.pixels_um), 0.0))

    @cached_property
    def width_um(self) -> float:
        """Standard deviation of the light along an axis, root mean square of both axes."""
        centroid = self.centroid_um
        squares = (float(self._line(axis) @ (self._places(axis) - centroid[axis]) ** 2) for axis in (0, 1))
        return math.sqrt(0.5 * sum(squares) + self.pitch_um**2 / 3.0)  # a cubic B-spline's own variance

    @property
    def reach_um(self) -> float:
        """Extent of the table."""
        return max(float(np.abs(self._places(axis)).max()) for axis in (0, 1))

    @property
    def mixture(self) -> Mixture:
        """Return the mean over directions about the centroid, as Gaussians fitted to the spectrum by least squares."""
        return _weights(self.response), self.width_um * _WIDTHS

    @cached_property
    def fine(self) -> int:
        """Grid points per pixel at which a spline represents the response: at most as fine as its samples."""
        pixel_um = max(self.pixels_um)
        most = min(MAX_SUBSAMPLES, math.ceil(pixel_um / self.pitch_um))
        k = math.pi / pixel_um * np.linspace(1.0, 2.0, 32)
        for fine in range(MIN_SUBSAMPLES, most):
            if max(float(np.abs(self.along(fine * k, *way)).max()) for way in ((1.0, 0.0), (0.0, 1.0))) < FAINT:
                return fine
        return most

    def plane(self, shape: tuple[int, int], step_um: tuple[float, float]) -> Spectrum:
        """Spectrum on a periodic grid of rows and columns with steps along x and y, as for a real transform."""
        (rows, i), (columns, j) = (self._on(shape[1 - axis], step_um[axis], axis) for axis in (1, 0))
        kernel = np.zeros(shape)
        np.add.at(kernel, (i[:, None], j), rows @ self.splines @ columns.T)
        return np.asarray(fft.rfft2(kernel))

    def row(self, count: int, step_um: float, axis: int) -> Spectrum:
        """Return the spectrum of the response summed along the other axis, on a periodic row along x (0) or y (1)."""
        basis, places = self._on(count, step_um, axis)
        kernel = np.zeros(count)
        np.add.at(kernel, places, basis @ self._line(axis))
        return np.asarray(fft.rfft(kernel))

    def towards(self, axis: int, sign: float) -> tuple[FloatArray, FloatArray, float]:
        """Weights and positions (N,) of the light along an axis in one direction, and the width of each sample."""
        return self._line(axis), sign * self._places(axis), self.pitch_um / math.sqrt(3.0)

    def _line(self, axis: int) -> FloatArray:
        return np.asarray(self.splines.sum(axis=axis))

    def _places(self, axis: int) -> FloatArray:
        count = self.splines.shape[1 - axis]
        return self.first_um[axis] + self.pitch_um * np.arange(count, dtype=float)

    def _on(self, count: int, step_um: float, axis: int) -> tuple[FloatArray, NDArray[np.intp]]:
        """Splines (M, N) at the points of a periodic grid in their support, times the grid step; the points (M,)."""
        places = self._places(axis)
        low, high = places[0] - 2.0 * self.pitch_um, places[-1] + 2.0 * self.pitch_um
        points = np.arange(math.ceil(low / step_um), math.floor(high / step_um) + 1)
        basis = _spline((points[:, None] * step_um - places) / self.pitch_um) * (step_um / self.pitch_um)
        return basis, np.asarray(points % count, np.intp)

    def along(self, k: FloatArray, across: float, along: float) -> FloatArray:
        """Return the spectrum (K,) about the centroid at wave numbers along a direction, averaged over both signs."""
        (x, y), (cx, cy) = (self._places(0), self._places(1)), self.centroid_um
        turn = [np.exp(-1j * np.outer(k * way, place)) for way, place in ((across, x - cx), (along, y - cy))]
        smooth = [np.sinc(k * way * self.pitch_um / math.tau) ** 4 for way in (across, along)]
        lit = np.einsum("ky,yx,kx->k", turn[1], self.splines, turn[0], optimize=True)
        return np.asarray(lit.real * smooth[0] * smooth[1])


@lru_cache(maxsize=8)
def measured_pixel(response: PixelResponse, scale: float, pixels_um: tuple[float, float]) -> MeasuredPixel:
    """Return a response as spline coefficients, with its lengths multiplied by ``scale``.

    Raises
    ------
    DataError
        If the samples are too coarse for the pixels, or the light is not about as wide as a pixel.
    """
    if MIN_SAMPLES_PER_PIXEL * response.pitch_um > min(pixels_um):
        limit = f"a pixel of {min(pixels_um):g} µm requires at least {MIN_SAMPLES_PER_PIXEL:g} samples"
        raise DataError(
            "process.response.pitch_um",
            value=response.pitch_um,
            limit=limit,
            remedy="measure the response with smaller samples",
        )
    made = _scaled(response, scale, pixels_um)
    least, most = (share * max(pixels_um) for share in _APART)
    if not least <= made.width_um <= most:
        limit = (
            f"the light of a pixel of {max(pixels_um):g} µm has a standard deviation of {least:.3g} to {most:.3g} µm"
        )
        value = f"{made.width_um:.3g} µm"
        raise DataError("process.response", value=value, limit=limit, remedy="check pitch_um, which is in µm")
    return made


def _scaled(response: PixelResponse, scale: float, pixels_um: tuple[float, float]) -> MeasuredPixel:
    splines, centre, pitch = *_splines(response), scale * response.pitch_um
    return MeasuredPixel(response, splines, (-centre[0] * pitch, -centre[1] * pitch), pitch, pixels_um)


@lru_cache(maxsize=8)
def _splines(response: PixelResponse) -> tuple[FloatArray, tuple[float, float]]:
    """Spline coefficients of a response, and the position of the pixel centre from the first spline, in samples."""
    light = np.pad(np.array(response.light), _PAD)
    splines = ndimage.spline_filter(light, order=3, mode="mirror")
    splines = splines / splines.sum()
    if response.centre_um is not None:
        x, y = (_PAD + place / response.pitch_um for place in response.centre_um)
    else:
        rows, columns = (np.arange(count) for count in light.shape)
        x, y = float(splines.sum(axis=0) @ columns), float(splines.sum(axis=1) @ rows)
    return splines, (x, y)


@lru_cache(maxsize=8)
def _weights(response: PixelResponse) -> FloatArray:
    """Return the weights of Gaussians whose sum best fits the mean of a response over directions."""
    one = _scaled(response, 1.0, (1.0, 1.0))
    k, widths = np.linspace(0.0, 6.0 / one.width_um, _WAVES), one.width_um * _WIDTHS
    angles = math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    mean = np.mean([one.along(k, math.cos(angle), math.sin(angle)) for angle in angles], axis=0)
    whole, ridge = 1e3 * np.ones((1, len(widths))), _RIDGE * math.sqrt(_WAVES) * np.eye(len(widths))
    left = np.vstack([np.exp(-0.5 * np.outer(k, widths) ** 2), whole, ridge])
    weights = np.linalg.lstsq(left, np.concatenate([mean, [1e3], np.zeros(len(widths))]))[0]
    return np.asarray(weights / weights.sum())


def light_of_file(path: Path) -> list[list[float]]:
    """Return samples from a table of numbers, or from a single-channel image with y up; the smallest y comes first.

    Raises
    ------
    DataError
        If the file cannot be read, is in colour, overexposed or of several pages, or contains no rectangle of numbers.
    """
    return _of_image(path) if path.suffix.lower() in IMAGES else _of_table(path)


def _of_table(path: Path) -> list[list[float]]:
    """Return rows of numbers; the entire file uses one separator and one decimal mark."""
    cells = grid.of_text(load(path))
    rows = [row for row in range(len(cells.rows)) if not cells.is_blank(row)]
    widths = [cells.width(row) for row in rows]
    mark = cells.mark(rows, {column: cells.cells(column, rows) for column in range(max(widths, default=0))})

    def number(row: int, column: int) -> float:
        try:
            value = parse(cells.rows[row][column], mark)
        except ValueError as bad:
            limit = f"must contain rows of numbers; this cell {bad}"
            raise cells.error(row, column, limit, "use one separator; begin other lines with #") from None
        if math.isnan(value):
            raise cells.error(row, column, "must be a finite number", "use a rectangle without gaps")
        return value

    return [[number(row, column) for column in range(width)] for row, width in zip(rows, widths, strict=True)]


def _of_image(path: Path) -> list[list[float]]:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            kind, pages, light = image.mode, getattr(image, "n_frames", 1), np.array(image)
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError) as bad:
        raise DataError(str(path), limit=f"cannot be read as an image: {bad}", remedy="check the file") from None
    if kind not in _GREY:  # the values of a palette are not light
        limit = "must be a single-channel grey image, without colours or a palette"
        raise DataError(str(path), value=kind, limit=limit, remedy="save it as grey levels, in 8, 16 or 32 bits")
    if pages > 1:
        raise DataError(
            str(path),
            value=f"{pages} pages",
            limit="must contain a single image",
            remedy="save only the page with the pixel",
        )
    if int(light.max()) in _FULL_SCALES and np.count_nonzero(light == light.max()) > 1:
        limit = f"is overexposed: {np.count_nonzero(light == light.max()):,} samples are {light.max():g}"
        raise DataError(str(path), limit=limit, remedy="expose less: values must be proportional to the light")
    rows: list[list[float]] = light[::-1].astype(float).tolist()
    return rows


def _spline(t: FloatArray) -> FloatArray:
    """Return a cubic B-spline as a function of the distance in steps."""
    t = np.abs(t)
    return np.where(t < 1.0, 2.0 / 3.0 - t**2 + 0.5 * t**3, np.maximum(2.0 - t, 0.0) ** 3 / 6.0)


def _own_um2(pixels_um: tuple[float, float]) -> float:
    """Return the variance of a pixel rectangle along an axis, mean of both axes."""
    return sum(side**2 for side in pixels_um) / 24.0


def _mirrored(count: int) -> NDArray[np.intp]:
    """Return the index in a real transform for each frequency of a full transform."""
    return np.abs(np.rint(fft.fftfreq(count) * count)).astype(np.intp)
