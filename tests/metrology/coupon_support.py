"""Simulated micrographs and height maps of coupons, rendered from areas and independently of the measurement."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import shapely

from solen.arrays import FloatArray
from solen.geometry.coupons import Coupon, Feature
from tests.metrology.render.coverage import coverage
from tests.metrology.render.optics import gaussian

CORNERS = 360


def circle(x: float, y: float, radius: float) -> shapely.Polygon:
    """Return a polygon with the area of the circle."""
    turn = 2 * np.pi / CORNERS
    grown = radius * np.sqrt(turn / np.sin(turn))
    angle = turn * np.arange(CORNERS)
    return shapely.Polygon(np.column_stack([x + grown * np.cos(angle), y + grown * np.sin(angle)]))


@dataclass(frozen=True)
class Print:
    """A printed coupon: its sizes, and which features are missing or merged."""

    coupon: Coupon
    size_mm: Callable[[Feature], float] = lambda feature: feature.diameter_mm
    height_mm: Callable[[Feature], float] = lambda feature: feature.height_mm
    missing: frozenset[str] = frozenset()
    merged: frozenset[str] = frozenset()
    stretch: float = 1.0

    def shape(self, feature: Feature) -> shapely.Polygon:
        """Return a feature as printed, mm."""
        x, y = self.stretch * feature.x_mm, self.stretch * feature.y_mm
        if feature.round:
            return circle(x, y, 0.5 * self.size_mm(feature))
        return shapely.box(
            x - 0.5 * feature.width_mm,
            y - 0.5 * feature.depth_mm,
            x + 0.5 * feature.width_mm,
            y + 0.5 * feature.depth_mm,
        )

    @property
    def slab(self) -> shapely.Polygon:
        """The slab with its bevel."""
        slab = self.coupon.slab
        assert slab is not None
        x, y, bevel = 0.5 * slab.width_mm, 0.5 * slab.depth_mm, slab.bevel_mm
        return shapely.Polygon([(-x, -y), (x, -y), (x, y - bevel), (x - bevel, y), (-x, y)])

    def raised(self) -> shapely.Geometry:
        """Return everything that stands on the slab, with merged pairs joined by a bridge."""
        features = [feature for feature in self.coupon.features if feature.kind != "hole"]
        parts = [self.shape(feature) for feature in features if feature.name not in self.missing]
        for gap in self.coupon.gaps:
            if gap.name in self.merged:
                left, right = (self.coupon.feature(name) for name in gap.between)
                bridge = shapely.LineString([(left.x_mm, left.y_mm), (right.x_mm, right.y_mm)])
                parts.append(bridge.buffer(0.35 * left.diameter_mm))
        return shapely.union_all(parts)

    def holes(self) -> list[shapely.Polygon]:
        """Return the open holes."""
        return [self.shape(hole) for hole in self.coupon.of_kind("hole") if hole.name not in self.missing]


@dataclass(frozen=True)
class Camera:
    """Pose of the print under a microscope, and the properties of the microscope's images."""

    um_per_px: float = 5.0
    angle_deg: float = 0.0
    mirrored: bool = False
    shape: tuple[int, int] | None = None
    at_px: tuple[float, float] | None = None
    blur_px: float = 2.0
    noise: float = 0.03
    gradient: float = 0.2
    levels: Mapping[str, float] = field(default_factory=lambda: {"outside": 0.12, "slab": 0.35, "raised": 0.75})

    def frame(self, coupon: Coupon) -> tuple[tuple[int, int], tuple[float, float]]:
        """Return the shape of the image, and the position of the coupon's centre in it."""
        width, depth, _ = coupon.size_mm
        angle = np.radians(self.angle_deg)
        wide = abs(width * np.cos(angle)) + abs(depth * np.sin(angle)) + 1.0
        high = abs(width * np.sin(angle)) + abs(depth * np.cos(angle)) + 1.0
        shape = self.shape or (int(1e3 * high / self.um_per_px), int(1e3 * wide / self.um_per_px))
        return shape, self.at_px or (0.5 * shape[1] + 0.3, 0.5 * shape[0] - 0.4)

    def cover(self, area: shapely.Geometry, coupon: Coupon) -> FloatArray:
        """Return the fraction of each pixel that an area covers."""
        shape, (u, v) = self.frame(coupon)
        turn = np.exp(1j * np.radians(self.angle_deg))

        def px(ring: shapely.LinearRing) -> FloatArray:
            x, y = np.asarray(ring.coords).T
            position = 1e3 / self.um_per_px * turn * ((-x if self.mirrored else x) + 1j * y)
            return np.column_stack([u + position.real, v - position.imag])

        parts = [part for part in getattr(area, "geoms", [area]) if not part.is_empty]
        polygons = [shapely.geometry.polygon.orient(part) for part in parts]
        rings = [px(ring) for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
        return coverage(rings, shape)

    def image(self, printed: Print, seed: int = 0) -> FloatArray:
        """Return the grey values (rows, columns)."""
        rng = np.random.default_rng(seed)
        coupon, levels = printed.coupon, self.levels
        slab = self.cover(shapely.difference(printed.slab, shapely.union_all(printed.holes())), coupon)
        image = levels["outside"] + (levels["slab"] - levels["outside"]) * slab
        image = image + (levels["raised"] - levels["slab"]) * self.cover(printed.raised(), coupon)
        image = gaussian(self.blur_px)(image, 1)
        rows, columns = np.meshgrid(*(np.linspace(-0.5, 0.5, n) for n in image.shape), indexing="ij")
        image = image * (1.0 + self.gradient * (0.8 * columns + 0.6 * rows))
        image = image + self.noise * rng.standard_normal(image.shape)
        return np.asarray(np.rint(255.0 * np.clip(image, 0.0, 1.0)) / 255.0)

    def height_map(
        self, printed: Print, *, roughness_um: float = 1.0, tilt_um_per_mm: float = 3.0, seed: int = 0
    ) -> FloatArray:
        """Return heights in mm (rows, columns) above the plate, tilted and rough on small and larger scales."""
        rng = np.random.default_rng(seed)
        coupon = printed.coupon
        assert coupon.slab is not None
        z = coupon.slab.thickness_mm * self.cover(printed.slab, coupon)
        for feature in coupon.features:
            if feature.kind in {"pillar", "mark"} and feature.name not in printed.missing:
                z = z + printed.height_mm(feature) * self.cover(printed.shape(feature), coupon)
        z = gaussian(0.7)(z, 1)
        patches = gaussian(4.0)(rng.standard_normal(z.shape), 1)
        texture = 0.5 * patches / patches.std() + rng.standard_normal(z.shape)
        columns = np.arange(z.shape[1]) * self.um_per_px * 1e-3
        return np.asarray(z + 1e-3 * roughness_um * texture + 1e-3 * tilt_um_per_mm * columns)
