"""A lens printed upright or on edge: its profile is along the printing direction and made of layers.

Seen from the side, a layer is a row of pixels, lit where the drawn body is at mid-height of the layer, with grey pixels
at the ends. Across the printing direction, light blurs in both directions. Along it, light only travels from the window
towards the platform. Behind an overhang it sets unintended resin (print-through), while no resin is left to set on the
window side. A face towards the platform therefore grows and its steps are filled in, and a face towards the window
keeps its steps. The body is assumed thick along y; shrinkage is specified separately along and across the printing
direction.

`SidePrint.profile_um` returns the offsets along the normals of a target, and `SidePrint.steps` splits them into a
smooth part and the ripple of the steps.
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
from solen.fabricate.process.field import DARK
from solen.fabricate.process.flat import MIN_PIXELS
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Target, exits_um
from solen.fabricate.process.terms import FAINT

Side = Literal["upright", "upright-lens-first", "on-edge"]
STEP_UM = 1.0
MAX_WORK = 2e10
"""Maximum number of products for a side view: about a minute of computing time."""
SUBLAYERS = 5
"""Number of heights within a layer at which the dose is computed; its logarithm is interpolated linearly in between."""
_DEPTHS = -math.log(FAINT)
_MARGIN_UM = 1500.0
_LAYERS_PER_KNOT = 10.0


@dataclass(frozen=True, eq=False)
class SidePrint:
    """Rows of light near a lens that is printed along its own plane.

    Attributes
    ----------
    settings
        The process.
    side
        Orientation: the lens printed last and away from the platform, first and on the platform, or to one side.
    rows
        Fraction of the full light (layers, columns) of the layers from ``first`` on.
    first
        Layer number of the first row, counted from 0 at the first layer of the part.
    corner_um
        Position at which the first column begins.
    platform_um
        Position of the platform along the printing direction.
    target
        The designed lens.
    """

    settings: Settings
    side: Side
    rows: FloatArray
    first: int
    corner_um: float
    platform_um: float
    target: Target

    @classmethod
    def of(cls, rings: Sequence[FloatArray], target: Target, settings: Settings, side: Side) -> "SidePrint":
        """Return the print of closed polylines (N, 2) in mm.

        Raises
        ------
        DataError
            If pixels or layers are too coarse for the lens.
        """
        turned = [_turned(1e3 * np.asarray(ring), side) for ring in rings]
        wanted = _turned(1e3 * target.points_mm, side)
        platform = min(float(ring[:, 1].min()) for ring in turned)
        highest = max(float(ring[:, 1].max()) for ring in turned)
        h, pitch = settings.layer_um, _pixel_um(settings, side)
        _check_fine(wanted, settings, pitch)
        layers = round((highest - platform) / h)
        low, high = wanted.min(axis=0), wanted.max(axis=0)
        first = max(0, math.floor((low[1] - platform - _MARGIN_UM) / h))
        last = min(layers, math.ceil((high[1] - platform + settings.deep_Dp_um * _DEPTHS) / h) + 1)
        start = pitch * math.floor((low[0] - _MARGIN_UM) / pitch)
        _check_work(last - first, (high[0] - start + _MARGIN_UM) / pitch, settings)
        columns = fft.next_fast_len(math.ceil((high[0] + _MARGIN_UM - start) / pitch), real=True)
        heights = platform + (np.arange(first, last) + 0.5) * h
        rows = np.array([_row(turned, float(v), start, pitch, columns) for v in heights])
        light = settings.greys.light[np.rint(FULL * rows).astype(np.uint8)]
        return cls(settings, side, light, first, start, platform, target)

    @cached_property
    def _log_excess(self) -> FloatArray:
        """Logarithm of dose over critical dose, (layers, sublayers, fine columns), from the far side of each layer."""
        s, (layers, columns) = self.settings, self.rows.shape
        fine, pitch = s.pixel_light.fine, _pixel_um(s, self.side)
        k = math.tau * fft.rfftfreq(columns * fine, pitch / fine)
        spectra = np.tile(fft.fft(self.rows, axis=1), (1, fine))[:, : len(k)]
        exposures = s.exposures(self.first + layers)[self.first :, None]
        lit = spectra * exposures * s.pixel_light.row(columns * fine, pitch / fine, int(self.side == "on-edge"))
        excess = np.empty((layers, SUBLAYERS, columns * fine))
        for m in range(SUBLAYERS):
            depth = s.layer_um * (1.0 - m / (SUBLAYERS - 1))
            dose = fft.irfft(self._gathered(lit, k, depth), columns * fine, axis=1) * fine
            excess[:, m] = np.log(np.maximum(dose, DARK * s.inside_mJ_per_cm2()) / s.Ec_mJ_per_cm2)
        return excess

    def _gathered(self, lit: NDArray[np.complex128], k: FloatArray, depth_um: float) -> NDArray[np.complex128]:
        """Return dose spectra of each layer at a depth from its window side, including later layers."""
        s = self.settings
        spectra, blur_um = np.zeros_like(lit), s.blur_um
        for later in range(min(len(lit), math.ceil(s.deep_Dp_um * _DEPTHS / s.layer_um) + 1)):
            depth = depth_um + later * s.layer_um
            beyond_um2 = s.halo_um**2 + (s.halo_per_depth * depth) ** 2 - blur_um**2
            blur = 1.0 - s.halo_fraction + s.halo_fraction * np.exp(-0.5 * beyond_um2 * k**2)
            spectra[: len(lit) - later] += lit[later:] * (float(s.left(depth)) * blur)
        return spectra

    def log_excess(self, places_mm: FloatArray) -> FloatArray:
        """Logarithm of dose over critical dose at points (..., 2) in the plane of the body, before shrinkage."""
        s, fine = self.settings, self.settings.pixel_light.fine
        at = _turned(1e3 * np.asarray(places_mm, float), self.side)
        height = (at[..., 1] - self.platform_um) / s.layer_um
        number = np.floor(height)
        within = (height - number) * (SUBLAYERS - 1)
        own = number - self.first
        layers = len(self.rows)
        pitch = _pixel_um(s, self.side)
        column = (at[..., 0] - self.corner_um - pitch / 2) / (pitch / fine)
        # layers are separate blocks, so interpolation never mixes two of them
        rows = self._log_excess.reshape(layers * SUBLAYERS, -1)
        index = np.clip(own, 0, layers - 1) * SUBLAYERS + within
        excess = ndimage.map_coordinates(rows, [index, column], order=1, mode="nearest")
        outside = (own < 0) | (own >= layers) | (height < 0.0)
        return np.asarray(np.where(outside, -1.0, excess))

    def profile_um(self) -> FloatArray:
        """Return the deviation of the printed lens from the designed lens, (N,) along its normals, including steps."""
        s = self.settings
        across, along = s.shrinkage_percent, s.shrinkage_z_percent
        shrunk = np.array([along, across] if self.side == "on-edge" else [across, along])
        grown = 1.0 / (1.0 - 0.01 * shrunk)
        centre = np.asarray(self.target.centre)

        def excess(places_mm: FloatArray) -> FloatArray:
            return self.log_excess(centre + grown * (places_mm - centre))

        return exits_um(excess, self.target, STEP_UM) + s.wash_um

    def steps(self, offset_um: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets without the ripple of the steps (smooth, one knot per ten layers), and the ripple, (N,) each."""
        along = self.target.along_mm
        knots = np.arange(1, int(1e3 * along[-1] / (_LAYERS_PER_KNOT * self.settings.layer_um)))
        inner = along[-1] * knots / (len(knots) + 1)
        smooth = np.asarray(LSQUnivariateSpline(along, offset_um, inner, k=3)(along))
        return smooth, offset_um - smooth


def _pixel_um(settings: Settings, side: Side) -> float:
    """Return the side of a pixel along the lens: the part's x is along the printer's X, its z along Y."""
    return settings.pixels_um[side == "on-edge"]


def _check_fine(wanted: FloatArray, settings: Settings, pixel_um: float) -> None:
    size = np.ptp(wanted, axis=0)
    if size[0] < MIN_PIXELS * pixel_um:
        limit = f"the lens, {1e-3 * size[0]:.3g} mm along the pixels, must be at least {MIN_PIXELS} pixels wide"
        raise DataError("process.pixel_um", value=pixel_um, limit=limit, remedy="use a printer with smaller pixels")
    if size[1] < 2.0 * settings.layer_um:
        limit = f"the lens, {1e-3 * size[1]:.3g} mm along the layers, must be at least two layers high"
        raise DataError("process.layer_um", value=settings.layer_um, limit=limit, remedy="use thinner layers")


def _check_work(layers: int, columns: float, settings: Settings) -> None:
    """Raise `DataError` if the sums over later layers would take minutes."""
    later = min(layers, settings.deep_Dp_um * _DEPTHS / settings.layer_um)
    work = layers * later * columns * settings.pixel_light.fine * SUBLAYERS
    if work > MAX_WORK:
        limit = (
            f"{layers:,} layers near the lens, each exposed through {later:,.0f} others, would take minutes to compute"
        )
        raise DataError("process.layer_um", value=settings.layer_um, limit=limit, remedy="use thicker layers")


def _turned(places: FloatArray, side: Side) -> FloatArray:
    """Return coordinates across and along the printing direction for points (..., 2) in the plane of the body."""
    x, z = places[..., 0], places[..., 1]
    across, along = {"upright": (x, -z), "upright-lens-first": (x, z), "on-edge": (z, x)}[side]
    return np.stack([across, along], axis=-1)


def _row(rings: Sequence[FloatArray], height: float, start: float, pitch: float, columns: int) -> FloatArray:
    """Return the fraction of each pixel of a row that closed polylines cover at a height."""
    crossings = []
    for ring in rings:
        a, b = ring, np.roll(ring, -1, axis=0)
        over = (a[:, 1] > height) != (b[:, 1] > height)
        share = (height - a[over, 1]) / (b[over, 1] - a[over, 1])
        crossings.append(a[over, 0] + share * (b[over, 0] - a[over, 0]))
    ends = np.sort(np.concatenate(crossings))
    edges = start + pitch * np.arange(columns + 1)
    covered = np.zeros(columns)
    for low, high in zip(ends[::2], ends[1::2], strict=True):
        covered += np.diff(np.clip(edges, low, high)) / pitch
    return covered
