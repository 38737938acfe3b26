"""Simulated micrographs and height maps of coupons, made from areas: not the inverse of what measures them."""

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
    """Polygon of the same area as the circle."""
    turn = 2 * np.pi / CORNERS
    grown = radius * np.sqrt(turn / np.sin(turn))
    angle = turn * np.arange(CORNERS)
    return shapely.Polygon(np.column_stack([x + grown * np.cos(angle), y + grown * np.sin(angle)]))


@dataclass(frozen=True)
class Print:
    """What came out of the printer: sizes, what is missing, what has merged."""

    coupon: Coupon
    size_mm: Callable[[Feature], float] = lambda one: one.diameter_mm
    height_mm: Callable[[Feature], float] = lambda one: one.height_mm
    missing: frozenset[str] = frozenset()
    merged: frozenset[str] = frozenset()
    stretch: float = 1.0

    def shape(self, one: Feature) -> shapely.Polygon:
        """A feature as it was printed, mm."""
        x, y = self.stretch * one.x_mm, self.stretch * one.y_mm
        if one.round:
            return circle(x, y, 0.5 * self.size_mm(one))
        return shapely.box(
            x - 0.5 * one.width_mm, y - 0.5 * one.depth_mm, x + 0.5 * one.width_mm, y + 0.5 * one.depth_mm
        )

    @property
    def slab(self) -> shapely.Polygon:
        """The slab with its bevel."""
        slab = self.coupon.slab
        assert slab is not None
        x, y, bevel = 0.5 * slab.width_mm, 0.5 * slab.depth_mm, slab.bevel_mm
        return shapely.Polygon([(-x, -y), (x, -y), (x, y - bevel), (x - bevel, y), (-x, y)])

    def raised(self) -> shapely.Geometry:
        """All that stands on the slab, merged pairs joined by a bridge."""
        parts = [self.shape(one) for one in self.coupon.features if one.kind != "hole" and one.name not in self.missing]
        for gap in self.coupon.gaps:
            if gap.name in self.merged:
                one, other = (self.coupon.feature(name) for name in gap.between)
                way = shapely.LineString([(one.x_mm, one.y_mm), (other.x_mm, other.y_mm)])
                parts.append(way.buffer(0.35 * one.diameter_mm))
        return shapely.union_all(parts)

    def holes(self) -> list[shapely.Polygon]:
        """Holes that are open."""
        return [self.shape(one) for one in self.coupon.of_kind("hole") if one.name not in self.missing]


@dataclass(frozen=True)
class Camera:
    """How the print lies under the microscope, and what the microscope makes of it."""

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
        """Rows and columns of the image, and where the coupon's middle lies in it."""
        width, depth, _ = coupon.size_mm
        angle = np.radians(self.angle_deg)
        wide = abs(width * np.cos(angle)) + abs(depth * np.sin(angle)) + 1.0
        high = abs(width * np.sin(angle)) + abs(depth * np.cos(angle)) + 1.0
        shape = self.shape or (int(1e3 * high / self.um_per_px), int(1e3 * wide / self.um_per_px))
        return shape, self.at_px or (0.5 * shape[1] + 0.3, 0.5 * shape[0] - 0.4)

    def cover(self, area: shapely.Geometry, coupon: Coupon) -> FloatArray:
        """Share of each pixel that an area covers."""
        shape, (u, v) = self.frame(coupon)
        turn = np.exp(1j * np.radians(self.angle_deg))

        def px(ring: shapely.LinearRing) -> FloatArray:
            x, y = np.asarray(ring.coords).T
            place = 1e3 / self.um_per_px * turn * ((-x if self.mirrored else x) + 1j * y)
            return np.column_stack([u + place.real, v - place.imag])

        polygons = [shapely.geometry.polygon.orient(one) for one in getattr(area, "geoms", [area]) if not one.is_empty]
        rings = [px(ring) for one in polygons for ring in (one.exterior, *one.interiors)]
        return coverage(rings, shape)

    def image(self, printed: Print, seed: int = 0) -> FloatArray:
        """Grey values (rows, columns)."""
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
        self, printed: Print, *, rough_um: float = 1.0, tilt_um_per_mm: float = 3.0, seed: int = 0
    ) -> FloatArray:
        """Heights in mm (rows, columns) over the plate, tilted, with the roughness of pixels and of larger patches."""
        rng = np.random.default_rng(seed)
        coupon = printed.coupon
        assert coupon.slab is not None
        z = coupon.slab.thickness_mm * self.cover(printed.slab, coupon)
        for one in coupon.features:
            if one.kind in {"pillar", "mark"} and one.name not in printed.missing:
                z = z + printed.height_mm(one) * self.cover(printed.shape(one), coupon)
        z = gaussian(0.7)(z, 1)
        patches = gaussian(4.0)(rng.standard_normal(z.shape), 1)
        texture = 0.5 * patches / patches.std() + rng.standard_normal(z.shape)
        columns = np.arange(z.shape[1]) * self.um_per_px * 1e-3
        return np.asarray(z + 1e-3 * rough_um * texture + 1e-3 * tilt_um_per_mm * columns)
