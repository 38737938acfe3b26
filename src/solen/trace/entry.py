"""Entry of light into a body through a lens face that varies with height: a step before the trace of extruded walls.

`scene_behind_face` replaces the sources of a scene by the rays that continue behind the face, with the power that
remains after Fresnel reflection, their polarisation, and their optical path length up to that point. The power that the
face reflects is reported as ``reflected``. Reflected light that turns back escapes; reflected light that continues
forwards or meets a ledge is followed, and so is light that passes beside the lens. Behind the face the body has
vertical walls and is traced like any other body.

Light that returns to the face from inside meets a cylinder with the face's section at mid-height instead; see
`solen.trace.kernel.entry`.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.geometry import Front
from solen.plane import Rigid
from solen.scene import Launch, Scene, Source
from solen.scene.sources.base import Behind, Placed
from solen.trace.kernel import entry, tally
from solen.trace.result import ABSORBED, ESCAPED, Mode

if TYPE_CHECKING:
    from solen.scene.model import Region

T = TypeVar("T", bound=np.generic)

REFLECTED = tally.LEAKED + 1
"""Index of the power reflected by a face in space, which the compiled loops leave at 0."""


def scene_behind_face(scene: Scene, mode: Mode) -> Scene:
    """Return the scene with sources behind its face in space; a scene without such a face is returned unchanged."""
    front, slab = scene.front, scene.extrusion
    if front is None or slab is None:
        return scene
    wall = next(interface for interface in scene.interfaces if interface.name == front.interface)
    regions = {region.name: region for region in scene.regions}
    body, air = regions[wall.left], regions[wall.right]
    sources = tuple(LightBehindFace.of(source, front, body, air, mode, scene) for source in scene.sources)
    return replace(scene, sources=sources, front=None)


@dataclass(frozen=True, kw_only=True, eq=False)
class LightBehindFace(Source):
    """Light from a source behind a face in space."""

    source: Source
    face: entry.FaceInMedia
    motion: Rigid
    indices: tuple[float, ...]
    """refractive index of the body at each spectral line"""

    @classmethod
    def of(
        cls, source: Source, front: Front, body: "Region", air: "Region", mode: Mode, scene: Scene
    ) -> "LightBehindFace":
        """Return the light that a source sends through the face of a scene."""
        slab = scene.extrusion
        if slab is None:
            raise AssertionError("a face in space requires a slab")
        if source.emission() is None:
            limit = "must be an emitter with a pattern if the lens varies with height"
            raise DesignError("source", value=type(source).__name__, limit=limit, remedy="use a cartesian-oval lens")
        face = front.lens.face
        outside = air.index_at(source.spectrum[0][0] if source.spectrum else None)
        counting = mode == "count"
        loss = 0.0 if counting else body.absorption_per_mm
        return cls(
            power=source.power,
            s_share=source.s_share,
            spectrum=source.spectrum,
            source=source,
            face=entry.FaceInMedia(face, outside, slab.index_above, slab.index_below, loss, counting),
            motion=front.motion,
            indices=tuple(body.index_at(nm) for nm, _ in source.spectrum) or (body.index_at(None),),
        )

    @property
    def rays(self) -> int:
        """Number of rays that the original source emits."""
        return self.source.rays

    @property
    def shape_dimensions(self) -> int:
        """See `Source`: as for the original source."""
        return self.source.shape_dimensions

    @property
    def _has_ledges(self) -> bool:
        return len(self.face.face.edges) > 2

    def dimensions(self, in_space: bool = False) -> int:
        """See `Source`: as for the original source, plus one if there are ledges."""
        return self.source.dimensions(in_space) + self._has_ledges

    def place(self, u: FloatArray) -> Placed:  # noqa: ARG002  there are no rays in the plane
        """Raise an error: rays at a face in space are not in the plane."""
        raise AssertionError("a face in space requires rays in space")

    def check(self) -> None:
        """Do nothing, because the scene has checked the original source."""

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """See :meth:`~solen.scene.sources.base.Source.launch_at`; rays that miss the body have a y outside it."""
        source_dimensions = self.source.dimensions(in_space)
        launch = self.source.launch_at(u[:, :source_dimensions], rays, in_space)
        if launch.y_mm is None or launch.dy is None:
            raise AssertionError("a face in space requires rays in space")
        count = len(launch)
        to_lens = _inverse(self.motion)
        x, z = _moved(to_lens, launch.x_mm, launch.z_mm)
        dx, dz = _moved(replace(to_lens, shift=(0.0, 0.0)), launch.dx, launch.dz)
        random = u[:, source_dimensions] if self._has_ledges else np.zeros(count)
        columns = (x, launch.y_mm, z, dx, launch.dy, dz, launch.power_s, launch.power_p)
        x, y, z, dx, dy, dz, s, p, random = (_with_spare_rows(column) for column in (*columns, random))
        (cr, ci, optical), line, used_rows = np.zeros((3, 2 * count)), _with_spare_rows(launch.line), np.array([count])
        inside = np.array(self.indices)[line]
        lost = np.zeros(entry.LOSSES)
        face_rays = entry.FaceRays(x, y, z, dx, dy, dz, s, p, cr, ci, optical, inside, random, line, lost)
        entry.pass_face(self.face, face_rays, used_rows)
        rows, extra_rays = slice(0, int(used_rows[0])), int(used_rows[0]) - count
        x, z = _moved(self.motion, x[rows], z[rows])
        dx, dz = _moved(replace(self.motion, shift=(0.0, 0.0)), dx[rows], dz[rows])
        leaked, reflected, turned_back, absorbed = lost.tolist()
        state_behind = (cr[rows], ci[rows], optical[rows], inside[rows])
        behind = Behind(*state_behind, leaked, reflected, turned_back, absorbed, extra_rays)
        return Launch(x, z, dx, dz, s[rows], p[rows], line[rows], y[rows], dy[rows], behind)


def add_entry_losses(sums: tally.Sums, launch: Launch) -> None:
    """Add the power that was lost before the rays start behind the face."""
    behind = launch.behind
    if behind is None:
        return
    sums.fate[ESCAPED] += behind.leaked + behind.turned_back
    sums.fate[tally.LEAKED] += behind.leaked
    sums.fate[REFLECTED] += behind.reflected
    sums.fate[ABSORBED] += behind.absorbed


def _with_spare_rows(column: NDArray[T]) -> NDArray[T]:
    """Return an array (..., N) extended by N zeros."""
    return np.ascontiguousarray(np.concatenate([column, np.zeros_like(column)], axis=-1))


def _inverse(motion: Rigid) -> Rigid:
    """Return the inverse of a rigid motion."""
    x, z = motion.shift
    c, s = motion.cos, motion.sin
    return Rigid(c, -s, (-(c * x + s * z), s * x - c * z))


def _moved(motion: Rigid, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points after a rigid motion."""
    c, s, (x0, z0) = motion.cos, motion.sin, motion.shift
    return c * x - s * z + x0, s * x + c * z + z0
