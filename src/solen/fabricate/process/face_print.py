"""Flat print of a lens that varies with height: layer by layer, each with its own image.

A `FacePrint` combines the intended lens and the body that is drawn for it; they are the same unless the drawing is
compensated. The printed wall of each layer is computed along the normals of the intended wall at mid-height of the
layer, and converted to a profile z(|x|). A corner or the centre of a pixel is on the axis, so that the left half of the
image mirrors the right half.

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
"""Number of points along a section of the face, of which only the right half is used."""
PROFILE_POINTS = 257
"""Number of points of a profile from the axis to the half width."""
VERTEX = (0.0, 0.0)
MAX_ROUNDS, CONVERGED_UM, MIN_STEP = 12, 0.1, 0.2
"""Maximum number of rounds of compensation, change of the RMS error at convergence, and minimum fraction of a step."""
MIN_LIGHT = 1e-3
"""Minimum fraction of the light of a layer that must reach a wall if the layer is to be taken into account there."""
SMOOTHING_LAYERS = 1.0
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
        Mid-heights (L,) of the layers, from mid-height of the body.
    um
        Deviation (L, N) along the normals of the intended walls, at N points from the axis to the edge; positive for
        excess material.
    drawn, printed
        Profiles (L, M) of the layers as drawn and as printed.
    rounds_um
        For a compensation, RMS deviation after each round, without the edge of the aperture.
    """

    y_mm: FloatArray
    um: FloatArray = field(metadata=HIDDEN)
    drawn: FloatArray = field(metadata=HIDDEN)
    printed: FloatArray = field(metadata=HIDDEN)
    rounds_um: tuple[float, ...] = ()

    @property
    def rms_um(self) -> float:
        """RMS deviation of the entire face."""
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
        """Return the print of a body that is drawn as designed.

        Raises
        ------
        DataError
            If the pixels are too coarse for the lens.
        """
        if body.front is None:
            raise AssertionError("the lens does not vary with height")
        lens = body.front.lens
        if 2.0 * lens.half_width_mm < MIN_PIXELS * 1e-3 * settings.pixel_um:
            max_um = 2e3 * lens.half_width_mm / MIN_PIXELS
            limit = f"must be at most {max_um:.3g} µm: the lens must be at least {MIN_PIXELS} pixels wide"
            remedy = "use a printer with smaller pixels"
            raise DataError("process.pixel_um", value=settings.pixel_um, limit=limit, remedy=remedy)
        return cls(body, lens, settings, phase)

    @property
    def layers(self) -> int:
        """Number of layers."""
        return len(self.y_mm)

    @cached_property
    def edges_mm(self) -> FloatArray:
        """Heights (L + 1,) of the boundaries of the layers, in ascending order, from mid-height of the body."""
        return layer_edges_mm(self.lens.thickness_mm, 1e-3 * self.settings.layer_um)

    @cached_property
    def y_mm(self) -> FloatArray:
        """Mid-heights (L,) of the layers from mid-height of the body, starting at the build plate."""
        return np.asarray(0.5 * (self.edges_mm[:-1] + self.edges_mm[1:]))[::-1]

    @cached_property
    def x_mm(self) -> FloatArray:
        """Lateral positions (M,) of the points of profiles."""
        return np.linspace(0.0, self.lens.half_width_mm, PROFILE_POINTS)

    @cached_property
    def intended(self) -> FloatArray:
        """Intended profiles (L, M)."""
        return np.array([self.lens.z_at(self.x_mm, np.full(PROFILE_POINTS, y)) for y in self.y_mm.tolist()])

    def printed(self, progress: Progress | None = None) -> PrintedFace:
        """Return the face printed without compensation."""
        um, z = self._printed(self._layers(self.body), progress)
        return PrintedFace(self.y_mm, um, self.intended, z)

    def offsets_um(self, layer: int, settings: Settings) -> FloatArray:
        """Return the deviation (N,) of an uncompensated layer for other settings with the same pixels and layers."""
        stack = replace(self._uncompensated, settings=settings)
        return stack.offsets_um(layer, self._layers(self.body)[layer].target, VERTEX)

    def changes_um(self, face: PrintedFace, layers: Sequence[int], phase: tuple[float, float]) -> list[FloatArray]:
        """Return, for each of ``layers``, the change (N,) of its uncompensated deviation with another ``phase``."""
        stack, same = replace(self, phase=phase)._uncompensated, self._representative
        return [stack.offsets_um(same[layer], self._targets[same[layer]], VERTEX) - face.um[layer] for layer in layers]

    def compensated(self, start: PrintedFace, progress: Progress | None = None) -> PrintedFace:
        """Return the face printed from a drawing that is corrected, round by round, until the deviation converges."""
        best, step, rounds = start, 1.0, [self._inner_rms_um(start.printed)]
        for number in range(MAX_ROUNDS):
            drawn = (best.drawn - step * self._smooth(self._attributed(best)))[self._representative]
            um, z = self._printed(self._layers(self.drawn_body(drawn)), None)
            if progress is not None:
                progress((number + 1) / MAX_ROUNDS)
            gain = rounds[-1] - (rms := self._inner_rms_um(z))
            if gain > 0.0:
                best = PrintedFace(self.y_mm, um, drawn, z)
            else:
                step *= 0.5
            rounds.append(min(rms, rounds[-1]))
            if gain < CONVERGED_UM and (gain > 0.0 or step < MIN_STEP):
                break
        return replace(best, rounds_um=tuple(rounds))

    def profiles(self, z: FloatArray, name: str, warning: str) -> LayerProfiles:
        """Return `LayerProfiles`, from which a lens can be made, of profiles (L, M) in order from the build plate."""
        return LayerProfiles(name, self.lens.half_width_mm, self.edges_mm, z[::-1], simulated=True, warnings=(warning,))

    def lens_of(self, given: LayerProfiles) -> LayeredLensFromFile:
        """Return the lens with the given profiles."""
        lens = self.lens
        numbers = (lens.distance_mm, lens.focus_mm, lens.half_width_mm, lens.design_index, lens.outside_index)
        layer_mm = lens.thickness_mm / len(given.z_mm)
        return LayeredLensFromFile(*numbers, thickness_mm=lens.thickness_mm, layer_mm=layer_mm, file=given)

    @cached_property
    def _uncompensated(self) -> Stack:
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
        """Return the layers of a drawn body; layers with identical curves share one object."""
        if body.front is None:
            raise AssertionError("the lens does not vary with height")
        known: dict[bytes, Layer] = {}
        layers = []
        for y, intended, target in zip(self.y_mm.tolist(), self.intended, self._targets, strict=True):
            drawn = body.front.lens.z_at(self.x_mm, np.full(PROFILE_POINTS, y))
            key = np.round(np.concatenate([drawn, intended]), 9).tobytes()
            if key not in known:
                known[key] = Layer(rings_of(as_designed(section(body, y))), target)
            layers.append(known[key])
        return layers

    @cached_property
    def _targets(self) -> list[Target]:
        """Return the intended walls (L,); identical walls share one object."""
        known: dict[bytes, Target] = {}
        keys = [np.round(intended, 9).tobytes() for intended in self.intended]
        for y, key in zip(self.y_mm.tolist(), keys, strict=True):
            known[key] = known.get(key) or self._target(y)
        return [known[key] for key in keys]

    def _target(self, y_mm: float) -> Target:
        """Return the right half of the intended wall at a height."""
        wall = Target.of(lens_face(section(self.body, y_mm)).curve, POINTS)
        right = slice(POINTS // 2, None)
        return Target(wall.points_mm[right], wall.outward[right], wall.along_mm[right], VERTEX)

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
        rows = zip(self.y_mm.tolist(), layers, um, self.intended, strict=True)
        return np.array(um), np.array([self._profile(y, layer.target, offsets, z) for y, layer, offsets, z in rows])

    def _profile(self, y_mm: float, target: Target, um: FloatArray, intended: FloatArray) -> FloatArray:
        """Return a printed profile (M,): the intended profile plus the deviation along z, continued to the edge."""
        x, z = target.displaced(um).T
        ahead = x > np.concatenate([[-np.inf], np.maximum.accumulate(x[:-1])]) + 1e-9
        used = ahead & (x <= self.lens.half_width_mm)
        x, z = x[used], z[used]
        error = z - self.lens.z_at(x, np.full_like(x, y_mm))
        spline = CubicSpline(x, error, bc_type=((1, np.zeros(())), "not-a-knot"))
        return np.asarray(intended + spline(np.clip(self.x_mm, x[0], x[-1])))

    def drawn_body(self, z: FloatArray) -> Body:
        """Return the body with drawn profiles."""
        if self.body.front is None:
            raise AssertionError("the lens does not vary with height")
        lens = self.lens_of(self.profiles(z, "drawn", ""))
        return replace(self.body, front=replace(self.body.front, lens=lens))

    @cached_property
    def _representative(self) -> IntArray:
        """Index (L,) of the layer printed in place of each layer: the middle of its slab if all profiles are equal."""
        if np.ptp(self.intended, axis=0).max() > 0.0:
            return np.arange(self.layers)
        parts = slabs(self.settings, self.layers)
        return np.concatenate([np.full(part.last - part.first + 1, part.middle) for part in parts])

    @cached_property
    def _inner(self) -> int:
        """Number of points at a distance of more than two blur widths from the edge, whose corner cannot be printed."""
        end = self.lens.half_width_mm - 2e-3 * self.settings.edge_um
        return int(np.count_nonzero(self.x_mm < end))

    def _inner_rms_um(self, z: FloatArray) -> float:
        return 1e3 * float(np.sqrt(np.mean((z - self.intended)[:, : self._inner] ** 2)))

    def _attributed(self, face: PrintedFace) -> FloatArray:
        """Return deviations (L, M) along z, attributed to the layers whose light causes them.

        A wall moves with the edge of an image in proportion to the light of that edge at the wall. The wall below an
        overhang is determined by the light of the overhanging layer, so the edge of its own image has no effect.
        """
        error = face.printed - self.intended
        slant = np.hypot(1.0, np.gradient(self.intended, self.x_mm, axis=1))
        exposures, width = self.settings.exposures(self.layers), 1e-3 * self.settings.edge_um
        attributed, weights = np.zeros_like(error), np.full_like(error, MIN_LIGHT * exposures.max())
        for above in range(self.layers):
            transmitted = float(self.settings.transmitted(np.array([(above + 0.5) * self.settings.layer_um]))[0])
            if transmitted < MIN_LIGHT:
                break
            later, earlier = slice(above, None), slice(None, self.layers - above)
            distance = (face.drawn[later] - face.printed[earlier]) / (slant[earlier] * width)
            weight = transmitted * exposures[later, None] * np.exp(-0.5 * distance**2)
            attributed[later] += weight * error[earlier]
            weights[later] += weight
        return np.asarray(attributed / weights)

    def _smooth(self, error: FloatArray) -> FloatArray:
        """Return errors (L, M) smoothed to the width of the blur; the edge takes the error of the last inner point."""
        is_inner = np.arange(PROFILE_POINTS) < self._inner
        continued = np.where(is_inner, error, error[:, self._inner - 1 : self._inner])
        width = 1e-3 * self.settings.edge_um / float(self.x_mm[1])
        mirrored = np.concatenate([continued[:, :0:-1], continued], axis=1)
        smoothed = gaussian_filter(mirrored, (SMOOTHING_LAYERS, width), mode="nearest")
        return np.asarray(smoothed[:, PROFILE_POINTS - 1 :])
