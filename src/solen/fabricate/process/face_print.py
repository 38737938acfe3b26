"""Flat print of a lens that varies with height, layer by layer, each with its own image.

A `FacePrint` combines the intended lens and the body that is drawn for it; they are the same unless the drawing is
compensated. The printed wall of every layer is computed along the normals of the intended wall at mid-height of the
layer, and becomes a profile z over |x|. The image has a corner or the centre of a pixel on the axis, so its left half
mirrors its right half.

`FacePrint.printed` and `FacePrint.compensated` return a `PrintedFace`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter

from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.fabricate.process.drawing import as_designed, lens_face, rings_of
from solen.fabricate.process.flat import MIN_PIXELS
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.solid import slabs
from solen.fabricate.process.stack import Rings, Stack
from solen.fabricate.process.target import Target
from solen.geometry import Body, section
from solen.lens import LayeredLensFromFile, LayerProfiles, LensInSpace, layer_edges_mm
from solen.progress import Progress
from solen.results import HIDDEN

POINTS = 401
"""Number of points along a section of the face; only the right half is used."""
PLACES = 257
"""Number of points of a profile from the axis to the half width."""
VERTEX = (0.0, 0.0)
MAX_ROUNDS, SETTLED_UM, MIN_SHARE = 12, 0.1, 0.2
"""Maximum number of compensation rounds; change of the root mean square at convergence; minimum step fraction."""
FAINT = 1e-3
"""Fraction of a layer's light below which the layer does not affect a wall."""
ACROSS_LAYERS = 1.0
"""Number of layers over which a correction is smoothed."""


class Layer(NamedTuple):
    """The drawn image of a layer, and the right half of its intended wall."""

    rings: Rings
    target: Target


@dataclass(frozen=True, eq=False)
class PrintedFace:
    """A printed face, layer by layer from the build plate.

    Attributes
    ----------
    y_mm
        Mid-heights (L,) of the layers, measured from mid-height of the body.
    um
        Deviation (L, N) along the normals of the intended walls, at N points from the axis to the edge; positive for
        more material.
    drawn, printed
        Profiles as drawn and as printed.
    rounds_um
        For a compensation, root mean square of the deviation for each round, excluding the edge of the aperture.
    """

    y_mm: FloatArray
    um: FloatArray = field(metadata=HIDDEN)
    drawn: FloatArray = field(metadata=HIDDEN)
    printed: FloatArray = field(metadata=HIDDEN)
    rounds_um: tuple[float, ...] = ()

    @property
    def rms_um(self) -> float:
        """Root mean square over the entire face."""
        return float(np.sqrt(np.mean(self.um**2)))


@dataclass(frozen=True, eq=False)
class FacePrint:
    """A body whose lens varies with height, as designed and as drawn, and the process that prints it."""

    body: Body
    lens: LensInSpace
    settings: Settings
    phase: tuple[float, float]

    @classmethod
    def of(cls, body: Body, settings: Settings, phase: tuple[float, float] = (0.0, 0.0)) -> "FacePrint":
        """Return the print of a body as drawn.

        Raises
        ------
        DataError
            If the pixels are too coarse for the lens.
        """
        if body.front is None:
            raise AssertionError("a prism has one outline")
        lens = body.front.lens
        if 2.0 * lens.half_width_mm < MIN_PIXELS * 1e-3 * settings.pixel_um:
            limit = f"the lens must be at least {MIN_PIXELS} pixels wide"
            raise DataError("process.pixel_um", value=settings.pixel_um, limit=limit, remedy="use smaller pixels")
        return cls(body, lens, settings, phase)

    @property
    def layers(self) -> int:
        """Number of layers."""
        return len(self.y_mm)

    @cached_property
    def edges_mm(self) -> FloatArray:
        """Boundary heights (L + 1,) of the process layers, ascending, as for a layered lens."""
        return layer_edges_mm(self.lens.thickness_mm, 1e-3 * self.settings.layer_um)

    @cached_property
    def y_mm(self) -> FloatArray:
        """Mid-heights (L,) of the layers, measured from mid-height of the body, starting at the build plate."""
        return np.asarray(0.5 * (self.edges_mm[:-1] + self.edges_mm[1:]))[::-1]

    @cached_property
    def places_mm(self) -> FloatArray:
        """Lateral positions (M,) of profile points."""
        return np.linspace(0.0, self.lens.half_width_mm, PLACES)

    @cached_property
    def wanted(self) -> FloatArray:
        """Intended profiles (L, M)."""
        return np.array([self.lens.z_at(self.places_mm, np.full(PLACES, y)) for y in self.y_mm.tolist()])

    def printed(self, progress: Progress | None = None) -> PrintedFace:
        """Face printed without compensation."""
        um, z = self._printed(self._layers(self.body), progress)
        return PrintedFace(self.y_mm, um, self.wanted, z)

    def offsets_um(self, layer: int, settings: Settings) -> FloatArray:
        """Return the deviation of one uncompensated layer (N,) for other settings with the same pixels and layers."""
        stack = replace(self._plain, settings=settings)
        return stack.offsets_um(layer, self._layers(self.body)[layer].target, VERTEX)

    def moved_um(self, face: PrintedFace, layers: Sequence[int], phase: tuple[float, float]) -> list[FloatArray]:
        """Change in deviation (N,) of the given layers of an uncompensated face at another position in the pixel."""
        stack, alike = replace(self, phase=phase)._plain, self._representative
        return [
            stack.offsets_um(alike[layer], self._targets[alike[layer]], VERTEX) - face.um[layer] for layer in layers
        ]

    def compensated(self, start: PrintedFace, progress: Progress | None = None) -> PrintedFace:
        """Return the face printed from a drawing that is corrected by the print deviation until this stops changing."""
        best, share, rounds = start, 1.0, [self._inner_rms_um(start.printed)]
        for number in range(MAX_ROUNDS):
            drawn = (best.drawn - share * self._smooth(self._attributed(best)))[self._representative]
            um, z = self._printed(self._layers(self.drawn_body(drawn)), None)
            if progress is not None:
                progress((number + 1) / MAX_ROUNDS)
            gained = rounds[-1] - (rms := self._inner_rms_um(z))
            if gained > 0.0:
                best = PrintedFace(self.y_mm, um, drawn, z)
            else:
                share *= 0.5
            rounds.append(min(rms, rounds[-1]))
            if gained < SETTLED_UM and (gained > 0.0 or share < MIN_SHARE):
                break
        return replace(best, rounds_um=tuple(rounds))

    def profiles(self, z: FloatArray, name: str, warning: str) -> LayerProfiles:
        """Return profiles (L, M) of the layers from the build plate, in the form that a lens requires."""
        cut = (self.lens.half_width_mm, self.edges_mm, z[::-1])
        return LayerProfiles(name, *cut, simulated=True, warnings=(warning,))

    def lens_of(self, given: LayerProfiles) -> LayeredLensFromFile:
        """Return a lens with the given profiles in place of the intended ones."""
        own = self.lens
        cut = (own.distance_mm, own.focus_mm, own.half_width_mm, own.design_index, own.outside_index)
        layer_mm = own.thickness_mm / len(given.z_mm)
        return LayeredLensFromFile(*cut, thickness_mm=own.thickness_mm, layer_mm=layer_mm, file=given)

    @cached_property
    def _plain(self) -> Stack:
        return self._stack(self._layers(self.body))

    def _stack(self, layers: list[Layer]) -> Stack:
        extent = layers[0].target.points_mm * [[-1.0, 1.0]]
        return Stack.of(
            [layer.rings for layer in layers],
            np.vstack([extent, layers[len(layers) // 2].target.points_mm]),
            self.settings,
            self.phase,
        )

    def _layers(self, body: Body) -> list[Layer]:
        """Return the layers as a body draws them; layers with the same curve share one object."""
        if body.front is None:
            raise AssertionError("a prism has one outline")
        known: dict[bytes, Layer] = {}
        layers = []
        for y, wanted, target in zip(self.y_mm.tolist(), self.wanted, self._targets, strict=True):
            drawn = body.front.lens.z_at(self.places_mm, np.full(PLACES, y))
            key = np.round(np.concatenate([drawn, wanted]), 9).tobytes()
            if key not in known:
                known[key] = Layer(rings_of(as_designed(section(body, y))), target)
            layers.append(known[key])
        return layers

    @cached_property
    def _targets(self) -> list[Target]:
        """Return the intended walls (L,); walls with the same curve share one object."""
        known: dict[bytes, Target] = {}
        for y, wanted in zip(self.y_mm.tolist(), self.wanted, strict=True):
            key = np.round(wanted, 9).tobytes()
            known[key] = known.get(key) or self._target(y)
        return [known[np.round(wanted, 9).tobytes()] for wanted in self.wanted]

    def _target(self, y_mm: float) -> Target:
        """Return the right half of the intended wall at a height."""
        whole = Target.of(lens_face(section(self.body, y_mm)).curve, POINTS)
        right = slice(POINTS // 2, None)
        return Target(whole.points_mm[right], whole.outward[right], whole.along_mm[right], VERTEX)

    def _printed(self, layers: list[Layer], progress: Progress | None) -> tuple[FloatArray, FloatArray]:
        """Return deviations (L, N) and printed profiles (L, M)."""
        stack = self._stack(layers)
        known: dict[int, FloatArray] = {}
        for number in self._representative.tolist():
            if number not in known:
                known[number] = stack.offsets_um(number, layers[number].target, VERTEX)
            if progress is not None:
                progress((number + 1) / len(layers))
        um = [known[number] for number in self._representative.tolist()]
        rows = zip(self.y_mm.tolist(), layers, um, self.wanted, strict=True)
        return np.array(um), np.array([self._profile(y, layer.target, off, z) for y, layer, off, z in rows])

    def _profile(self, y_mm: float, target: Target, um: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return a printed profile (M,): intended profile plus deviation along z, continued beyond the last point."""
        x, z = target.moved_um(um).T
        forward = (x > np.concatenate([[-np.inf], np.maximum.accumulate(x[:-1])]) + 1e-9) & (
            x <= self.lens.half_width_mm
        )
        x, z = x[forward], z[forward]
        off = CubicSpline(x, z - self.lens.z_at(x, np.full_like(x, y_mm)), bc_type=((1, np.zeros(())), "not-a-knot"))
        return np.asarray(wanted + off(np.clip(self.places_mm, x[0], x[-1])))

    def drawn_body(self, z: FloatArray) -> Body:
        """Return the body with drawn profiles."""
        if self.body.front is None:
            raise AssertionError("a prism has one outline")
        lens = self.lens_of(self.profiles(z, "drawn", ""))
        return replace(self.body, front=replace(self.body.front, lens=lens))

    @cached_property
    def _representative(self) -> IntArray:
        """Number of a layer that prints like each layer (L,); for an upright lens, the middle of its slab."""
        if np.ptp(self.wanted, axis=0).max() > 0.0:
            return np.arange(self.layers)
        parts = slabs(self.settings, self.layers)
        return np.concatenate([np.full(part.last - part.first + 1, part.middle) for part in parts])

    @cached_property
    def _inner(self) -> int:
        """Number of points farther from the edge than the blur, because a sharper corner cannot be printed."""
        reach = self.lens.half_width_mm - 2e-3 * self.settings.edge_um
        return int(np.count_nonzero(self.places_mm < reach))

    def _inner_rms_um(self, z: FloatArray) -> float:
        return 1e3 * float(np.sqrt(np.mean((z - self.wanted)[:, : self._inner] ** 2)))

    def _attributed(self, face: PrintedFace) -> FloatArray:
        """Return deviations (L, M) along z, assigned to the layers whose light causes them.

        A wall moves with the edge of an image in proportion to the light from that edge at the wall. The wall below an
        overhang is determined by light from the overhanging layer, so moving the edge of its own image has no effect.
        """
        off = face.printed - self.wanted
        lean = np.hypot(1.0, np.gradient(self.wanted, self.places_mm, axis=1))
        exposures, width = self.settings.exposures(self.layers), 1e-3 * self.settings.edge_um
        moved, weights = np.zeros_like(off), np.full_like(off, FAINT * exposures.max())
        for above in range(self.layers):
            left = float(self.settings.left(np.array([(above + 0.5) * self.settings.layer_um]))[0])
            if left < FAINT:
                break
            later, here = slice(above, None), slice(None, self.layers - above)
            apart = (face.drawn[later] - face.printed[here]) / (lean[here] * width)
            weight = left * exposures[later, None] * np.exp(-0.5 * apart**2)
            moved[later] += weight * off[here]
            weights[later] += weight
        return np.asarray(moved / weights)

    def _smooth(self, off: FloatArray) -> FloatArray:
        """Return deviations (L, M) along z, smoothed to the blur width; at the edge, the adjacent face is continued."""
        steady = np.where(np.arange(PLACES) < self._inner, off, off[:, self._inner - 1 : self._inner])
        width = 1e-3 * self.settings.edge_um / float(self.places_mm[1])
        mirrored = np.concatenate([steady[:, :0:-1], steady], axis=1)
        return np.asarray(gaussian_filter(mirrored, (ACROSS_LAYERS, width), mode="nearest")[:, PLACES - 1 :])
