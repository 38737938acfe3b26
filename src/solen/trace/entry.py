"""Entry of light into a body through a face whose walls are not vertical: a step in space before the extruded engine.

`through_face` replaces the sources of a scene by the rays that continue behind the face, with the power that remains
after Fresnel's equations, their polarisation, and their optical path length up to the face. The power reflected by the
face is reported as ``reflected``. Reflected light that turns back escapes; reflected light that continues forwards or
meets a ledge is followed, and so is light that passes beside the lens. Behind the face the body is a prism and is
traced like any other.

Light that returns to the face from within meets a cylinder with the face's middle section instead; see
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
"""Index of the power reflected by a face in space; the compiled loops never write to it."""


def through_face(scene: Scene, mode: Mode) -> Scene:
    """Replace the sources with the light behind the face in space; return a scene without such a face unchanged."""
    front, slab = scene.front, scene.extrusion
    if front is None or slab is None:
        return scene
    wall = next(interface for interface in scene.interfaces if interface.name == front.interface)
    regions = {region.name: region for region in scene.regions}
    body, air = regions[wall.left], regions[wall.right]
    sources = tuple(Entered.of(source, front, body, air, mode, scene) for source in scene.sources)
    return replace(scene, sources=sources, front=None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Entered(Source):
    """Light from a source behind a face in space."""

    source: Source
    faced: entry.Faced
    motion: Rigid
    indices: tuple[float, ...]
    """of the body, at each spectral line"""

    @classmethod
    def of(cls, source: Source, front: Front, body: "Region", air: "Region", mode: Mode, scene: Scene) -> "Entered":
        """Return the light that a source sends through the face of a scene."""
        slab = scene.extrusion
        if slab is None:
            raise AssertionError("a face in space requires a slab")
        if source.emission() is None:
            limit = (
                "must be an emitter with a pattern: other sources are not supported with a lens that is not cylindrical"
            )
            raise DesignError("source", value=type(source).__name__, limit=limit, remedy="use the cartesian-oval")
        face = front.lens.face
        outside = air.index_at(source.spectrum[0][0] if source.spectrum else None)
        counts = mode == "count"
        loss = 0.0 if counts else body.absorption_per_mm
        return cls(
            power=source.power,
            s_share=source.s_share,
            spectrum=source.spectrum,
            source=source,
            faced=entry.Faced(face, outside, slab.index_above, slab.index_below, loss, counts),
            motion=front.motion,
            indices=tuple(body.index_at(nm) for nm, _ in source.spectrum) or (body.index_at(None),),
        )

    @property
    def rays(self) -> int:
        """Number of rays that the original source emits."""
        return self.source.rays

    @property
    def shape_dimensions(self) -> int:
        """As for the original source in the plane."""
        return self.source.shape_dimensions

    @property
    def _ledges(self) -> bool:
        return len(self.faced.face.edges) > 2

    def dimensions(self, in_space: bool = False) -> int:
        """As for the original source, plus one if there are ledges."""
        return self.source.dimensions(in_space) + self._ledges

    def place(self, u: FloatArray) -> Placed:  # noqa: ARG002  it has no rays in the plane
        """Never called, because rays at a face in space are not in the plane."""
        raise AssertionError("a face in space requires rays in space")

    def check(self) -> None:
        """Do nothing, because the scene has checked the original source."""

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """See :meth:`~solen.scene.sources.base.Source.launch_at`; rays that miss the body have a y outside it."""
        own = self.source.dimensions(in_space)
        launch = self.source.launch_at(u[:, :own], rays, in_space)
        if launch.y_mm is None or launch.dy is None:
            raise AssertionError("a face in space requires rays in space")
        count = len(launch)
        back = _inverse(self.motion)
        x, z = _moved(back, launch.x_mm, launch.z_mm)
        dx, dz = _moved(replace(back, shift=(0.0, 0.0)), launch.dx, launch.dz)
        chance = u[:, own] if self._ledges else np.zeros(count)
        columns = (x, launch.y_mm, z, dx, launch.dy, dz, launch.power_s, launch.power_p)
        x, y, z, dx, dy, dz, s, p, chance = (_with_room(column) for column in (*columns, chance))
        (cr, ci, optical), line, free = np.zeros((3, 2 * count)), _with_room(launch.line), np.array([count])
        inside = np.array(self.indices)[line]
        lost = np.zeros(entry.LOST)
        through = entry.Passage(x, y, z, dx, dy, dz, s, p, cr, ci, optical, inside, chance, line, lost)
        entry.pass_face(self.faced, through, free)
        rows, more = slice(0, int(free[0])), int(free[0]) - count
        x, z = _moved(self.motion, x[rows], z[rows])
        dx, dz = _moved(replace(self.motion, shift=(0.0, 0.0)), dx[rows], dz[rows])
        leaked, reflected, turned_back, absorbed = lost.tolist()
        began = (cr[rows], ci[rows], optical[rows], inside[rows])
        behind = Behind(*began, leaked, reflected, turned_back, absorbed, more)
        return Launch(x, z, dx, dz, s[rows], p[rows], line[rows], y[rows], dy[rows], behind)


def note_entry(sums: tally.Sums, launch: Launch) -> None:
    """Add the power that was lost before the rays start behind the face."""
    behind = launch.behind
    if behind is None:
        return
    sums.fate[ESCAPED] += behind.leaked + behind.turned_back
    sums.fate[tally.LEAKED] += behind.leaked
    sums.fate[REFLECTED] += behind.reflected
    sums.fate[ABSORBED] += behind.absorbed


def _with_room(column: NDArray[T]) -> NDArray[T]:
    """Return an array (..., N) extended to 2N entries."""
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
