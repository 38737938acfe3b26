"""A print job: copies of a solid on the plate of a printer, layer by layer.

The origin of the part is at the common corner of four pixels, or at a specified position in a pixel, and the distances
between copies are integer numbers of pixels. A sensor, whose origin is the lens vertex, therefore stays symmetric about
its axis, drawings on a pixel grid stay on the grid, and all copies have identical pixels. The copies are centred on the
plate.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.fabricate.grey import FULL, Greys
from solen.fabricate.layers.options import Slicing
from solen.fabricate.layers.solid import Exposures, Rings, Solid
from solen.fabricate.process import Process
from solen.fabricate.raster import coverage_bytes
from solen.lens import layer_count
from solen.parts.printer import Axis, Printer, library_printer, printers

Bytes = NDArray[np.uint8]

PAPER_MW_PER_CM2 = 13.0
"""Irradiance at which the working curve of the paper was measured."""
MAX_SUGGESTED = 3
"""Maximum number of larger printers that an error message suggests, the smallest first."""
GREY_STEPS = "all steps together"
ROUNDING = 1e-6
"""Rounding tolerance as a fraction of a layer or a pixel."""


@dataclass(frozen=True, eq=False)
class Layer:
    """A layer: index from 0, heights above the plate, exposure time, dose at the window, and image.

    ``image`` (rows, columns) has the largest Y in its first row; identical layers share one array. ``feature`` names
    the part if it is exposed separately, and is empty for a layer of a stack. ``area_mm2`` is the covered area of all
    copies. ``islands`` is the number of regions of a copy with nothing of the previous layer below them.
    """

    index: int
    from_mm: float
    to_mm: float
    exposure_s: float
    dose_mJ_per_cm2: float
    image: Bytes
    area_mm2: float
    islands: int
    feature: str = ""


@dataclass(frozen=True, eq=False)
class Job:
    """Copies of a solid on a printer, checked when created; ``greys`` maps covered fractions to grey levels.

    Raises
    ------
    SpecError
        If the printer cannot make layers of the specified thickness, or options contradict one another.
    DesignError
        If the solid is too low for a single layer, or the copies do not fit on the plate.
    """

    solid: Solid
    printer: Printer
    slicing: Slicing = Slicing()  # noqa: RUF009  frozen
    greys: Greys = Greys()  # noqa: RUF009  frozen
    process: Process | None = None

    def __post_init__(self) -> None:
        if self.greys.response and isinstance(self.solid, Exposures) and self.solid.greys:
            limit = "does not apply to the grey-steps coupon, whose grey levels are to be measured"
            raise SpecError("--process", limit=limit, remedy="omit --process")
        self._check_image_options()
        low, high = self.printer.layers_um
        if not low <= self.slicing.layer_um <= high:
            limit = f"must be {low:g} to {high:g} µm for {self.printer.name}"
            raise SpecError("--layer-um", value=self.slicing.layer_um, limit=limit, remedy="choose another printer")
        if self.count < 1:
            height = f"{self.solid.size_mm[2] * 1e3:.4g} µm high"
            limit = f"is {height}, less than half a layer of {self.slicing.layer_um:g} µm"
            remedy = "make the part thicker, or its layers thinner"
            raise DesignError("part", limit=limit, remedy=remedy)
        self._check_size()

    @property
    def layer_mm(self) -> float:
        """Thickness of a layer."""
        return self.slicing.layer_um / 1000.0

    @property
    def count(self) -> int:
        """Number of layers with their mid-height in the solid, or number of separate exposures."""
        if self.solid.exposures_s:
            return len(self.solid.exposures_s)
        return layer_count(self.solid.size_mm[2], self.layer_mm)

    @property
    def height_mm(self) -> float:
        """Height of the stack."""
        return self.layer_mm if self.solid.exposures_s else self.count * self.layer_mm

    def seconds_of(self, index: int) -> float:
        """Return the exposure time of a layer; the index of the first layer is 0."""
        return (self.solid.exposures_s or (self.slicing.seconds(index),) * self.count)[index]

    @property
    def doses_mJ_per_cm2(self) -> FloatArray:
        """Dose of each layer at the window, (count,)."""
        return np.array([self.irradiance_mW_per_cm2 * self.seconds_of(index) for index in range(self.count)])

    @property
    def burn_in_layers(self) -> int:
        """Number of burn-in layers."""
        return 0 if self.solid.exposures_s else min(self.count, self.slicing.burn_in_layers)

    @property
    def exposures_s(self) -> float:
        """Total exposure time."""
        return sum(self.solid.exposures_s) or self.slicing.total_s(self.count)

    @property
    def volume_mm3(self) -> float:
        """Total volume of all copies."""
        return self.slicing.copies * self.solid.volume_mm3

    @property
    def pause_s(self) -> float | None:
        """Mean time between exposures; None if the printer file contains neither the time nor the lift."""
        if self.printer.pause_s is not None:
            return self.printer.pause_s.nominal
        if (lift := self.printer.lift) is None:
            return None
        bottom = self.burn_in_layers / self.count
        return bottom * lift.pause_s(bottom=True) + (1.0 - bottom) * lift.pause_s(bottom=False)

    @property
    def seconds(self) -> float | None:
        """Total time of exposures and pauses; None if the pause is unknown."""
        return None if self.pause_s is None else self.exposures_s + self.count * self.pause_s

    @property
    def irradiance_mW_per_cm2(self) -> float:
        """Irradiance at the window: from the options, otherwise from the printer file, otherwise from the paper."""
        printer = self.printer.irradiance_mw_per_cm2
        default = PAPER_MW_PER_CM2 if printer is None else printer.nominal
        return self.slicing.irradiance_mW_per_cm2 or default

    @property
    def tile(self) -> tuple[int, int]:
        """Numbers of rows and columns of the image of one copy, its tile."""
        ends = zip(self.solid.size_mm, self.tile_from_mm, self.printer.pitches_mm, strict=False)
        columns, rows = (max(math.ceil((end - start) / pitch - ROUNDING), 1) for end, start, pitch in ends)
        return rows, columns

    @property
    def tile_from_mm(self) -> tuple[float, float]:
        """X and Y of the lower left corner of the tile, in coordinates of the solid."""
        axes = zip(self.solid.origin_mm, self.printer.pitches_mm, self.slicing.phase_px, strict=True)
        shifts = [(origin / pitch - phase, pitch) for origin, pitch, phase in axes]
        left, low = ((shift - math.ceil(shift - ROUNDING)) * pitch for shift, pitch in shifts)
        return left, low

    @cached_property
    def corners(self) -> tuple[tuple[int, int], ...]:
        """Row and column of the lower left pixel of the tile of each copy, counted from the lower left of the plate."""
        rows, columns = self._grid
        steps = tuple(size + gap for size, gap in zip(self.tile, self._gaps, strict=True))
        used = (rows * steps[0] - self._gaps[0], columns * steps[1] - self._gaps[1])
        starts = tuple((total - size) // 2 for total, size in zip(self.printer.shape, used, strict=True))
        cells = [divmod(number, columns) for number in range(self.slicing.copies)]
        return tuple((starts[0] + row * steps[0], starts[1] + column * steps[1]) for row, column in cells)

    @property
    def positions_mm(self) -> tuple[tuple[float, float], ...]:
        """X and Y of the centre of each copy relative to the centre of the plate, before mirroring."""
        (x_pitch, y_pitch), (rows, columns) = self.printer.pitches_mm, self.printer.shape
        (left, low), (x, y, _) = self.tile_from_mm, self.solid.size_mm
        return tuple(
            ((column - 0.5 * columns) * x_pitch - left + 0.5 * x, (row - 0.5 * rows) * y_pitch - low + 0.5 * y)
            for row, column in self.corners
        )

    def layers(self) -> Iterator[Layer]:
        """Yield the layers from the plate upwards, each computed on demand."""
        if isinstance(self.solid, Exposures):
            yield from self._separate_exposures(self.solid)
            return
        last_section: int | None = None
        tile: Bytes | None = None
        image = np.zeros(self.printer.shape, np.uint8)
        for index in range(self.count):
            section, rings = self.solid.section((index + 0.5) * self.layer_mm)
            islands = 0
            if tile is None or section is None or section != last_section:
                covered = self._coverage(rings)
                islands = 0 if tile is None else islands_over(covered, tile)
                if tile is None or not np.array_equal(covered, tile):
                    tile, image = covered, self._plate_image(self.greys.levels[covered])
            last_section = section
            yield self._layer(index, image, self._area_mm2(tile), islands)

    def _separate_exposures(self, parts: Exposures) -> Iterator[Layer]:
        """Yield an image for each separately exposed part, all at one height."""
        names = (GREY_STEPS,) if parts.greys else parts.names
        for index, (name, seconds) in enumerate(zip(names, parts.exposures_s, strict=True)):
            covered = self._coverage(parts.section(0.0)[1] if parts.greys else parts.rings[index])
            image = self._plate_image(self.copy_of_layer(index))
            dose = self.irradiance_mW_per_cm2 * seconds
            yield Layer(index, 0.0, self.layer_mm, seconds, dose, image, self._area_mm2(covered), 0, name)

    def _area_mm2(self, tile: Bytes) -> float:
        """Return the covered area of all copies of a tile."""
        return self.slicing.copies * (float(tile.sum(dtype=np.int64)) / FULL) * self.printer.pixel_mm2

    def copy_of_layer(self, index: int) -> Bytes:
        """Return the image of one copy in a layer, rows upwards, before mirroring."""
        if not isinstance(self.solid, Exposures):
            return self.greys.levels[self._coverage(self.solid.section((index + 0.5) * self.layer_mm)[1])]
        if not self.solid.greys:
            return self.greys.levels[self._coverage(self.solid.rings[index])]
        steps = zip(self.solid.rings, self.solid.greys, strict=True)
        return np.asarray(sum(np.rint(grey * self._coverage(rings)) for rings, grey in steps), np.uint8)

    def _layer(self, index: int, image: Bytes, area_mm2: float, islands: int) -> Layer:
        seconds = self.slicing.seconds(index)
        dose = self.irradiance_mW_per_cm2 * seconds
        low, high = index * self.layer_mm, (index + 1) * self.layer_mm
        return Layer(index, low, high, seconds, dose, image, area_mm2, islands)

    def _coverage(self, rings: Rings) -> Bytes:
        """Return the covered fractions of the pixels of a tile in 255ths, rows upwards."""
        covered = coverage_bytes(rings, self.printer.pitches_mm, self.tile_from_mm, self.tile)
        return np.where(covered > FULL // 2, FULL, 0).astype(np.uint8) if self.slicing.no_anti_aliasing else covered

    def _plate_image(self, tile: Bytes) -> Bytes:
        """Return the image of the plate with a tile for each copy, the largest Y first."""
        plate = np.zeros(self.printer.shape, np.uint8)
        rows, columns = tile.shape
        for row, column in self.corners:
            plate[row : row + rows, column : column + columns] = tile
        image = plate[::-1]
        image = {"none": image, "x": image[:, ::-1], "y": image[::-1]}[self.mirror]
        image.flags.writeable = False
        return image

    @property
    def mirror(self) -> Axis:
        """Axis along which the images are mirrored."""
        default: Axis = "none" if self.printer.mirror is None else self.printer.mirror.axis
        return self.slicing.mirror or default

    @property
    def _gaps(self) -> tuple[int, int]:
        """Numbers of rows and columns of pixels between copies."""
        x, y = (math.ceil(self.slicing.gap_mm / pitch - ROUNDING) for pitch in self.printer.pitches_mm)
        return y, x

    @property
    def _max_grid(self) -> tuple[int, int]:
        """Maximum numbers of rows and columns of copies on the plate."""
        axes = zip(self.printer.shape, self.tile, self._gaps, strict=True)
        rows, columns = ((total + gap) // (size + gap) for total, size, gap in axes)
        return rows, columns

    @cached_property
    def _grid(self) -> tuple[int, int]:
        """Numbers of rows and columns of copies, in a grid that is as square as possible."""
        (max_rows, max_columns), (x_pitch, y_pitch) = self._max_grid, self.printer.pitches_mm
        height, width = (size + gap for size, gap in zip(self.tile, self._gaps, strict=True))
        square = math.ceil(math.sqrt(self.slicing.copies * height * y_pitch / (width * x_pitch)))
        columns = min(max(square, math.ceil(self.slicing.copies / max_rows)), max_columns, self.slicing.copies)
        return math.ceil(self.slicing.copies / columns), columns

    def _check_image_options(self) -> None:
        """Reject options of images if no images are written."""
        slicing = self.slicing
        for key in ("format", "phase_px", "no_anti_aliasing"):
            if slicing.sheet_only and getattr(slicing, key) != type(slicing).model_fields[key].default:
                limit = "does not apply with --sheet-only, which writes no images"
                raise SpecError(f"--{key.replace('_', '-')}", limit=limit, remedy="omit one of them")

    def _check_size(self) -> None:
        size, build = self.solid.size_mm, self.printer.size_mm
        rows, columns = self._max_grid
        if self.height_mm <= build[2] * (1.0 + ROUNDING) and rows * columns >= self.slicing.copies:
            return
        volume = f"the build volume of {self.printer.name}, {_times(build)} mm"
        if self.slicing.copies > 1 and rows * columns and self.height_mm <= build[2]:
            limit = f"must be at most {rows * columns} with gaps of {self.slicing.gap_mm:g} mm in {volume}"
            remedy = "print fewer copies, or reduce --gap-mm"
            raise DesignError("--copies", value=self.slicing.copies, limit=limit, remedy=remedy)
        limit = f"is {_times(size)} mm, too large for {volume}"
        raise DesignError("part", limit=limit, remedy=_remedy(size, build))


def islands_over(tile: Bytes, below: Bytes) -> int:
    """Return the number of connected regions of an image with no lit pixel of the image below them."""
    lit, supported = tile > 0, below > 0
    if not np.any(lit & ~supported):
        return 0
    from scipy.ndimage import label

    regions, count = label(lit, np.ones((3, 3)))
    return int(count - len(np.unique(regions[supported & lit])))


def _times(size: tuple[float, float, float]) -> str:
    return " x ".join(f"{length:.4g}" for length in size)


def _fits(size: tuple[float, float, float], build: tuple[float, float, float]) -> bool:
    return all(length <= limit * (1.0 + ROUNDING) for length, limit in zip(size, build, strict=True))


def _remedy(size: tuple[float, float, float], build: tuple[float, float, float]) -> str:
    """Return the remedy for a part that is too large."""
    x, y, z = size
    if _fits((y, x, z), build):
        return "rotate the part with --rotate-deg 0 0 90"
    if _fits(tuple(sorted(size)), tuple(sorted(build))):  # type: ignore[arg-type]  # three each
        return "print the part in another --orientation"
    larger = [name for name in printers() if _fits(size, library_printer(name).size_mm)]
    larger.sort(key=lambda name: math.prod(library_printer(name).size_mm))
    if larger:
        return f"choose a larger printer, such as {', '.join(larger[:MAX_SUGGESTED])}"
    return "make the part smaller, or divide it"
