"""Measured rays from a vendor's ray file as a source."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import check_numbers, check_points
from solen.plane import Point, heading
from solen.scene.sources.base import Launch, Placed, PlacedInSpace, Source, weighted_indices
from solen.scene.sources.ray_formats import RaySet, read_rays

MIN_PROJECTED_LENGTH = 1e-9
"""Projected length below which a direction is treated as parallel to y."""


@dataclass(frozen=True)
class RayFile(Source):
    """Rays from a vendor's file, with its origin at ``point`` and its z-axis along ``axis_deg``.

    With as many rays as the file contains, each is launched once with its own fraction of the power; otherwise rays are
    chosen with probability proportional to their power. The x-axis of the file points to the right of the emitter axis,
    and its y-axis along y; the rays are raised by ``y_mm``. In the plane, points and directions are projected: each ray
    keeps its power, and a ray along y is directed along the axis.

    Create the source with `RayFile.of`, which reads the number of rays and the spectrum from the file.
    """

    path: str
    point: Point
    axis_deg: float
    rays: int
    y_mm: float = 0.0

    @classmethod
    def of(cls, path: str, point: Point, axis_deg: float, rays: int | None = None, power: float = 1.0) -> Self:
        """Return all rays of a file, or ``rays`` of them, with its spectrum; raise `DataError` if it cannot be read."""
        ray_set = read_rays(path)
        return cls(path, point, axis_deg, rays or len(ray_set), power=power, spectrum=ray_set.spectrum)

    @property
    def file(self) -> RaySet:
        """Content of the file."""
        return read_rays(self.path)

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinate: a number that selects one of the rays."""
        return 1

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        x, _, z, dx, _, dz = self._placed(self._indices(u))
        length = np.hypot(dx, dz)
        axis_x, axis_z = heading(self.axis_deg)
        along_y = length < MIN_PROJECTED_LENGTH
        safe = np.where(along_y, 1.0, length)
        return x, z, np.where(along_y, axis_x, dx / safe), np.where(along_y, axis_z, dz / safe)

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """See :meth:`~solen.scene.sources.base.Source.place_in_space`."""
        return self._placed(self._indices(u))

    def dimensions(self, in_space: bool = False) -> int:  # noqa: ARG002  the same in both
        """See :meth:`~solen.scene.sources.base.Source.dimensions`; wavelengths from the file require no coordinate."""
        return 1 + (len(self.spectrum) > 1 and not self._uses_file_lines)

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """See :meth:`~solen.scene.sources.base.Source.launch_at`."""
        launch = super().launch_at(u, rays, in_space)
        if self.rays != len(self.file):
            return launch
        ray_power = self.power * (len(self.file) / rays) * self.file.power[self._indices(u)]
        return replace(launch, power_s=ray_power * self.s_share, power_p=ray_power * (1.0 - self.s_share))

    def lines(self, u: FloatArray) -> IntArray:
        """See :meth:`~solen.scene.sources.base.Source.lines`."""
        line = self.file.line
        return line[self._indices(u)] if line is not None and self._uses_file_lines else super().lines(u)

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("ray file", self.point)
        check_numbers("ray file", self.axis_deg, self.y_mm)
        _ = self.file  # raises if the file cannot be read

    @property
    def _uses_file_lines(self) -> bool:
        file = self.file
        return file.line is not None and file.spectrum == self.spectrum

    def _indices(self, u: FloatArray) -> IntArray:
        """Return ray indices: in order if all rays are launched, otherwise chosen in proportion to their power."""
        power = self.file.power
        if self.rays == len(power):
            return np.minimum((u[:, 0] * len(power)).astype(np.int64), len(power) - 1)
        return weighted_indices(power, u[:, 0])

    def _placed(self, indices: IntArray) -> PlacedInSpace:
        file = self.file
        (x, y, z), (dx, dy, dz) = file.point_mm[indices].T, file.direction[indices].T
        axis_x, axis_z = heading(self.axis_deg)
        right_x, right_z = axis_z, -axis_x
        return (
            self.point[0] + x * right_x + z * axis_x,
            self.y_mm + y,
            self.point[1] + x * right_z + z * axis_z,
            dx * right_x + dz * axis_x,
            dy.copy(),
            dx * right_z + dz * axis_z,
        )
