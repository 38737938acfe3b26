"""A lens printed upright or on edge: its profile is along the printing direction and consists of layers.

Seen from the side, a layer is a row of pixels, which are lit where the drawn body is at mid-height of the layer, with
grey pixels at the ends. Across the printing direction, light is blurred to both sides. Along it, light travels only
from the window towards the plate. Behind an overhang, it cures resin that should stay liquid (print-through), but not
on the window side. Faces towards the plate therefore grow, and their steps are filled in; faces towards the window keep
their steps. The body is assumed to be thick along y; shrinkage is given separately along and across the printing
direction.

`SidePrint.profile_um` returns offsets along the normals of a target, and `SidePrint.steps` divides them into a smooth
part and the ripple of the steps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage
from scipy.interpolate import LSQUnivariateSpline

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.grey import FULL
from solen.fabricate.process.field import MIN_DOSE
from solen.fabricate.process.flat import MIN_PIXELS
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Target, exits_um
from solen.fabricate.process.terms import MIN_FRACTION

Side = Literal["upright", "upright-lens-first", "on-edge"]
STEP_UM = 1.0
MAX_WORK = 2e10
"""Maximum number of products in the computation, which take about a minute."""
SUBLAYERS = 5
"""Number of heights in a layer at which the dose is computed; between them, its logarithm is interpolated linearly."""
_DEPTHS = -math.log(MIN_FRACTION)
_MARGIN_UM = 1500.0
_LAYERS_PER_KNOT = 10.0


@dataclass(frozen=True, eq=False)
class SidePrint:
    """Rows of light near a lens whose plane contains the printing direction.

    Attributes
    ----------
    settings
        The process.
    side
        Orientation: with the lens printed last, away from the plate; first, on the plate; or at a side.
    rows
        Fraction of the full light (layers, columns) of the layers from ``first`` on.
    first
        Index of the layer of the first row.
    corner_um
        Position at which the first column begins.
    plate_um
        Position of the plate along the printing direction.
    target
        The designed lens.
    """

    settings: Settings
    side: Side
    rows: FloatArray
    first: int
    corner_um: float
    plate_um: float
    target: Target

    @classmethod
    def of(cls, rings: Sequence[FloatArray], target: Target, settings: Settings, side: Side) -> "SidePrint":
        """Return the print of closed polylines (N, 2) in mm.

        Raises
        ------
        DataError
            If pixels or layers are too coarse for the lens.
        """
        rings_um = [_rotated(1e3 * np.asarray(ring), side) for ring in rings]
        target_um = _rotated(1e3 * target.points_mm, side)
        plate = min(float(ring[:, 1].min()) for ring in rings_um)
        highest = max(float(ring[:, 1].max()) for ring in rings_um)
        h, pitch = settings.layer_um, _pixel_um(settings, side)
        _check_resolution(target_um, settings, pitch)
        layers = round((highest - plate) / h)
        low, high = target_um.min(axis=0), target_um.max(axis=0)
        first = max(0, math.floor((low[1] - plate - _MARGIN_UM) / h))
        last = min(layers, math.ceil((high[1] - plate + settings.deep_Dp_um * _DEPTHS) / h) + 1)
        start = pitch * math.floor((low[0] - _MARGIN_UM) / pitch)
        _check_work(last - first, (high[0] - start + _MARGIN_UM) / pitch, settings)
        columns = fft.next_fast_len(math.ceil((high[0] + _MARGIN_UM - start) / pitch), real=True)
        heights = plate + (np.arange(first, last) + 0.5) * h
        rows = np.array([_row(rings_um, float(height), start, pitch, columns) for height in heights])
        light = settings.greys.light[np.rint(FULL * rows).astype(np.uint8)]
        return cls(settings, side, light, first, start, plate, target)

    @cached_property
    def _log_excess(self) -> FloatArray:
        """Logarithm of dose over critical dose, (layers, heights, fine columns), from the far side of each layer."""
        s, (layers, columns) = self.settings, self.rows.shape
        fine, pitch = s.pixel_light.fine, _pixel_um(s, self.side)
        k = math.tau * fft.rfftfreq(columns * fine, pitch / fine)
        spectra = np.tile(fft.fft(self.rows, axis=1), (1, fine))[:, : len(k)]
        exposures = s.exposures(self.first + layers)[self.first :, None]
        light = spectra * exposures * s.pixel_light.row(columns * fine, pitch / fine, int(self.side == "on-edge"))
        excess = np.empty((layers, SUBLAYERS, columns * fine))
        for m in range(SUBLAYERS):
            depth = s.layer_um * (1.0 - m / (SUBLAYERS - 1))
            dose = fft.irfft(self._accumulated(light, k, depth), columns * fine, axis=1) * fine
            excess[:, m] = np.log(np.maximum(dose, MIN_DOSE * s.inside_mJ_per_cm2()) / s.Ec_mJ_per_cm2)
        return excess

    def _accumulated(self, light: NDArray[np.complex128], k: FloatArray, depth_um: float) -> NDArray[np.complex128]:
        """Return the spectra of the dose of each layer at a depth from its window side, including later layers."""
        s = self.settings
        spectra, blur_um = np.zeros_like(light), s.blur_um
        for later in range(min(len(light), math.ceil(s.deep_Dp_um * _DEPTHS / s.layer_um) + 1)):
            depth = depth_um + later * s.layer_um
            additional_um2 = s.halo_um**2 + (s.halo_per_depth * depth) ** 2 - blur_um**2
            blur = 1.0 - s.halo_fraction + s.halo_fraction * np.exp(-0.5 * additional_um2 * k**2)
            spectra[: len(light) - later] += light[later:] * (float(s.transmitted(depth)) * blur)
        return spectra

    def log_excess(self, points_mm: FloatArray) -> FloatArray:
        """Return the logarithm of dose over critical dose at points (..., 2) in the plane of the body."""
        s, fine = self.settings, self.settings.pixel_light.fine
        points = _rotated(1e3 * np.asarray(points_mm, float), self.side)
        height = (points[..., 1] - self.plate_um) / s.layer_um
        layer = np.floor(height)
        sublayer = (height - layer) * (SUBLAYERS - 1)
        row, layers = layer - self.first, len(self.rows)
        pitch = _pixel_um(s, self.side)
        column = (points[..., 0] - self.corner_um - pitch / 2) / (pitch / fine)
        # each layer has rows of its own, so interpolation never mixes two layers
        rows = self._log_excess.reshape(layers * SUBLAYERS, -1)
        index = np.clip(row, 0, layers - 1) * SUBLAYERS + sublayer
        excess = ndimage.map_coordinates(rows, [index, column], order=1, mode="nearest")
        outside = (row < 0) | (row >= layers) | (height < 0.0)
        return np.asarray(np.where(outside, -1.0, excess))

    def profile_um(self) -> FloatArray:
        """Return the deviation (N,) of the printed lens with its steps, along the normals of the designed lens."""
        s = self.settings
        across, along = s.shrinkage_percent, s.shrinkage_z_percent
        shrinkage = np.array([along, across] if self.side == "on-edge" else [across, along])
        enlargement = 1.0 / (1.0 - 0.01 * shrinkage)
        centre = np.asarray(self.target.centre)

        def excess(points_mm: FloatArray) -> FloatArray:
            return self.log_excess(centre + enlargement * (points_mm - centre))

        return exits_um(excess, self.target, STEP_UM) + s.wash_um

    def steps(self, offset_um: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return smooth offsets (a spline with one knot per ten layers) and the ripple of the steps, (N,) each."""
        along = self.target.along_mm
        knots = np.arange(1, int(1e3 * along[-1] / (_LAYERS_PER_KNOT * self.settings.layer_um)))
        inner = along[-1] * knots / (len(knots) + 1)
        smooth = np.asarray(LSQUnivariateSpline(along, offset_um, inner, k=3)(along))
        return smooth, offset_um - smooth


def _pixel_um(settings: Settings, side: Side) -> float:
    """Return the size of a pixel along the lens: x of the part is along X of the printer, and z along Y."""
    return settings.pixels_um[side == "on-edge"]


def _check_resolution(target_um: FloatArray, settings: Settings, pixel_um: float) -> None:
    width, height = np.ptp(target_um, axis=0).tolist()
    if width < MIN_PIXELS * pixel_um:
        condition = f"the lens, {1e-3 * width:.3g} mm wide across the layers, must be at least {MIN_PIXELS} pixels wide"
        limit = f"must be at most {width / MIN_PIXELS:.3g} µm: {condition}"
        raise DataError("process.pixel_um", value=pixel_um, limit=limit, remedy="use a printer with smaller pixels")
    if height < 2.0 * settings.layer_um:
        condition = f"the lens, {1e-3 * height:.3g} mm high, must have at least two layers"
        limit = f"must be at most {height / 2.0:.3g} µm: {condition}"
        raise DataError("process.layer_um", value=settings.layer_um, limit=limit, remedy="use thinner layers")


def _check_work(layers: int, columns: float, settings: Settings) -> None:
    """Raise `DataError` if the sums over later layers would take minutes."""
    later = min(layers, settings.deep_Dp_um * _DEPTHS / settings.layer_um)
    work = layers * later * columns * settings.pixel_light.fine * SUBLAYERS
    if work > MAX_WORK:
        limit = f"would take minutes: {layers:,} layers near the lens are each exposed through {later:,.0f} others"
        raise DataError("process.layer_um", value=settings.layer_um, limit=limit, remedy="use thicker layers")


def _rotated(points: FloatArray, side: Side) -> FloatArray:
    """Return coordinates across and along the printing direction of points (..., 2) in the plane of the body."""
    x, z = points[..., 0], points[..., 1]
    across, along = {"upright": (x, -z), "upright-lens-first": (x, z), "on-edge": (z, x)}[side]
    return np.stack([across, along], axis=-1)


def _row(rings: Sequence[FloatArray], height: float, start: float, pitch: float, columns: int) -> FloatArray:
    """Return the covered fractions of a row of pixels at a height of closed polylines."""
    crossings = []
    for ring in rings:
        a, b = ring, np.roll(ring, -1, axis=0)
        crosses = (a[:, 1] > height) != (b[:, 1] > height)
        a, b = a[crosses], b[crosses]
        fraction = (height - a[:, 1]) / (b[:, 1] - a[:, 1])
        crossings.append(a[:, 0] + fraction * (b[:, 0] - a[:, 0]))
    ends = np.sort(np.concatenate(crossings))
    edges = start + pitch * np.arange(columns + 1)
    covered = np.zeros(columns)
    for low, high in zip(ends[::2], ends[1::2], strict=True):
        covered += np.diff(np.clip(edges, low, high)) / pitch
    return covered
