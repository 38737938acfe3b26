"""Simulated micrographs and height maps of prints, as predicted by the printer model.

The predicted outline is projected onto the pixels of a camera. Each pixel contains the fraction of its area inside the
outline; blur, non-uniform illumination, and noise from a fixed seed are then added. The model is that of `solen print
predict` with its default process, whose optics are assumed: an image shows how the evaluation behaves, not how a
printer behaves.

`lens_image`, `coupon_image` and `coupon_heights` return the bytes of a PNG or TIFF.
"""

import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from PIL import Image, PngImagePlugin
from scipy import ndimage

from solen.arrays import FloatArray, IntArray
from solen.fabricate.process import MeasuredFeature, print_design, printed_mm
from solen.fabricate.process.process_file import default_process
from solen.geometry.coupons import Coupon, Feature
from solen.lens.build import measured_lens
from solen.sensor import Sensor

MODEL = "print model with its default process, blurred camera with noise"
SEED = 1
LINES_PER_ROW = 4
"""Number of lines per pixel row along which the covered fraction is exact."""
BLUR_PX, NOISE, ILLUMINATION_CHANGE = 1.2, 0.02, 0.15
BACKGROUND, SLAB, PART = 0.15, 0.4, 0.75
"""Grey levels of the background, of a coupon's slab, and of a lens or the features on a slab."""
LENS_UM_PER_PX, COUPON_UM_PER_PX, HEIGHT_UM_PER_PX = 5.0, 8.0, 14.0
LENS_VIEW_MM, PART_ANGLE_DEG = (-2.4, 2.4, -0.4, 2.6), 3.0
ROUGHNESS_UM, SLOPE = 1.0, 0.003
MARGIN_MM = 0.4
_MARK = "simulated"


@dataclass(frozen=True)
class _View:
    """The field of view of a camera above the part, in mm, and its pixel size."""

    extent_mm: tuple[float, float, float, float]
    um_per_px: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        x0, x1, y0, y1 = self.extent_mm
        return round(1e3 * (y1 - y0) / self.um_per_px), round(1e3 * (x1 - x0) / self.um_per_px)

    def covered(self, area: shapely.Geometry) -> FloatArray:
        """Return the fraction of each pixel that an area covers, exact along `LINES_PER_ROW` lines per pixel row.

        Where an edge crosses a line, the line enters or leaves the area; the cumulative sum of these steps is 1 inside
        and 0 outside.
        """
        rows, columns = self.shape
        steps = np.zeros((LINES_PER_ROW * rows, columns + 2))
        for ring in _rings(area):
            np.add.at(steps, *self._crossings(ring))
        inside = np.cumsum(steps, axis=1)[:, :columns]
        return np.asarray(inside.reshape(rows, LINES_PER_ROW, columns).mean(axis=1))

    def _crossings(self, ring: FloatArray) -> tuple[tuple[IntArray, IntArray], FloatArray]:
        """Return positions and sizes of the steps where the edges of a ring (n, 2) cross the lines."""
        x = (ring[:, 0] - self.extent_mm[0]) * 1e3 / self.um_per_px
        y = (self.extent_mm[3] - ring[:, 1]) * 1e3 / self.um_per_px * LINES_PER_ROW - 0.5
        low, high = np.minimum(y[:-1], y[1:]), np.maximum(y[:-1], y[1:])
        first = np.ceil(low).astype(int)
        count = np.maximum(np.ceil(high).astype(int) - first, 0)
        edge = np.repeat(np.arange(count.size), count)
        line = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + first[edge]
        position = (line - y[:-1][edge]) / np.diff(y)[edge]
        at = np.clip(x[:-1][edge] + position * np.diff(x)[edge], 0.0, self.shape[1])
        visible = (line >= 0) & (line < LINES_PER_ROW * self.shape[0])
        line, at, sign = line[visible], at[visible], np.sign(np.diff(y))[edge][visible]
        column = np.floor(at).astype(int)
        fraction = at - column
        return (np.tile(line, 2), np.concatenate([column, column + 1])), np.concatenate(
            [sign * (1.0 - fraction), sign * fraction]
        )

    def exposed(self, levels: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return grey levels from 0 to 1 with blur, non-uniform illumination and noise."""
        grey = ndimage.gaussian_filter(levels, BLUR_PX)
        across = np.linspace(-0.5, 0.5, grey.shape[1])
        return np.clip(grey * (1.0 + ILLUMINATION_CHANGE * across) + NOISE * rng.standard_normal(grey.shape), 0.0, 1.0)


def _rings(area: shapely.Geometry) -> Iterator[FloatArray]:
    """Yield the closed rings of an area; holes have the opposite direction to outer rings."""
    for part in getattr(area, "geoms", [area]):
        if not part.is_empty:
            polygon = shapely.geometry.polygon.orient(part)
            yield from (np.asarray(ring.coords) for ring in (polygon.exterior, *polygon.interiors))


def lens_image(sensor: Sensor, number: int = 0) -> bytes:
    """Return a PNG of the lens of a design as the model prints it, with the part slightly rotated."""
    printed = print_design(sensor, response=False)
    body = Sensor(sensor.design, sensor.material, measured_lens(sensor.cut, printed.profile)).body().prism()
    part = shapely.affinity.rotate(shapely.Polygon(body.outline(1e-3)), PART_ANGLE_DEG, origin=(0.0, 0.0))
    view = _View(LENS_VIEW_MM, LENS_UM_PER_PX)
    levels = BACKGROUND + (PART - BACKGROUND) * view.covered(part)
    return _png(view.exposed(levels, np.random.default_rng([SEED, number])))


def coupon_image(coupon: Coupon) -> bytes:
    """Return a PNG of a coupon as the model prints it, seen from above."""
    view, printed = _view(coupon, COUPON_UM_PER_PX), _Printed.of(coupon)
    slab = view.covered(shapely.difference(printed.slab, shapely.union_all(printed.areas("hole"))))
    raised = view.covered(shapely.union_all([*printed.areas("pillar"), *printed.areas("mark"), *printed.bridges]))
    levels = BACKGROUND + (SLAB - BACKGROUND) * slab
    return _png(view.exposed(levels + (PART - levels) * raised, np.random.default_rng(SEED)))


def coupon_heights(coupon: Coupon) -> bytes:
    """Return a TIFF of the heights of a printed coupon in µm, with tilt and roughness."""
    import tifffile

    rng, view, printed = np.random.default_rng(SEED), _view(coupon, HEIGHT_UM_PER_PX), _Printed.of(coupon)
    um = 1e3 * printed.thickness_mm * view.covered(printed.slab)
    for feature in printed.standing("pillar", "mark"):
        um = um + 1e3 * printed.height_mm(feature) * view.covered(printed.area(feature))
    um = ndimage.gaussian_filter(um, 0.7) + ROUGHNESS_UM * rng.standard_normal(um.shape)
    um = um + SLOPE * HEIGHT_UM_PER_PX * np.arange(um.shape[1])
    file = io.BytesIO()
    tifffile.imwrite(file, um.astype(np.float32), description=f"{_MARK}: {MODEL}", software="solen", compression="zlib")
    return file.getvalue()


@dataclass(frozen=True)
class _Printed:
    """A coupon as the default process prints it: sizes keyed by name, 0 for a pillar or hole that is missing."""

    coupon: Coupon
    size_mm: dict[str, float]
    scale: float
    layer_mm: float
    scale_z: float

    @classmethod
    def of(cls, coupon: Coupon) -> "_Printed":
        settings = default_process().process
        drawn = [feature for feature in coupon.features if feature.round]
        nominal = [("hole" if feature.kind == "hole" else "pillar", feature.diameter_mm) for feature in drawn]
        sizes = _sizes(nominal)
        gaps = _sizes([("gap", gap.gap_mm) for gap in coupon.gaps])
        return cls(
            coupon,
            {feature.name: size for feature, size in zip(drawn, sizes, strict=True)}
            | {gap.name: size for gap, size in zip(coupon.gaps, gaps, strict=True)},
            1.0 - 0.01 * settings.shrinkage_percent,
            1e-3 * settings.layer_um,
            1.0 - 0.01 * settings.shrinkage_z_percent,
        )

    @property
    def thickness_mm(self) -> float:
        return 0.0 if self.coupon.slab is None else self.scale_z * self.coupon.slab.thickness_mm

    @property
    def slab(self) -> shapely.Polygon:
        """The slab with its chamfered corner."""
        slab = self.coupon.slab
        if slab is None:
            return shapely.Polygon()
        x, y, bevel = 0.5 * slab.width_mm, 0.5 * slab.depth_mm, slab.bevel_mm
        corners = np.array([(-x, -y), (x, -y), (x, y - bevel), (x - bevel, y), (-x, y)])
        return shapely.Polygon(self.scale * corners)

    @property
    def bridges(self) -> list[shapely.Geometry]:
        """The material that joins the pillars of closed gaps."""
        closed = [gap for gap in self.coupon.gaps if not self.size_mm[gap.name]]
        pairs = [[self.coupon.feature(name) for name in gap.between] for gap in closed]
        return [
            shapely.LineString([self.scale * np.array((feature.x_mm, feature.y_mm)) for feature in pair]).buffer(
                0.35 * self.size_mm[pair[0].name]
            )
            for pair in pairs
        ]

    def standing(self, *kinds: str) -> list[Feature]:
        return [
            feature
            for feature in self.coupon.features
            if feature.kind in kinds and self.size_mm.get(feature.name, 1.0) > 0.0
        ]

    def areas(self, kind: str) -> list[shapely.Geometry]:
        return [self.area(feature) for feature in self.standing(kind)]

    def area(self, feature: Feature) -> shapely.Polygon:
        x, y = self.scale * feature.x_mm, self.scale * feature.y_mm
        if feature.round:
            radius = 0.5 * self.size_mm[feature.name]
            return shapely.Polygon(shapely.Point(x, y).buffer(radius, quad_segs=64).exterior)
        half = 0.5 * self.scale * np.array((feature.width_mm, feature.depth_mm))
        return shapely.Polygon(shapely.box(x - half[0], y - half[1], x + half[0], y + half[1]).exterior)

    def height_mm(self, feature: Feature) -> float:
        """Return the height of a feature, rounded to complete layers."""
        return self.scale_z * self.layer_mm * round(feature.height_mm / self.layer_mm)


def _sizes(nominal: Iterable[tuple[str, float]]) -> list[float]:
    """Return the printed sizes in mm of features, given their kinds and nominal sizes; 0 if a feature is missing."""
    features: Sequence[MeasuredFeature] = [MeasuredFeature(kind, mm, None, None, resolved=True) for kind, mm in nominal]  # type: ignore[arg-type]
    return [float(size) for size in np.nan_to_num(printed_mm(default_process().process, features))]


def _view(coupon: Coupon, um_per_px: float) -> _View:
    width, depth, _ = coupon.size_mm
    x, y = 0.5 * width + MARGIN_MM, 0.5 * depth + MARGIN_MM
    return _View((-x, x, -y, y), um_per_px)


def _png(grey: FloatArray) -> bytes:
    """Return an 8-bit PNG whose text chunk states that it is simulated."""
    metadata, file = PngImagePlugin.PngInfo(), io.BytesIO()
    metadata.add_text("Description", f"{_MARK}: {MODEL}")
    Image.fromarray(np.rint(255.0 * grey).astype(np.uint8)).save(file, "PNG", pnginfo=metadata)
    return file.getvalue()
