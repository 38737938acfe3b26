"""Effect of the receivers' directionality on traced power.

A trace gives the power through a receiver's face. A part with a lens collects less of the oblique light, so its current
is not proportional to that power. `Acceptance` applies the part's directionality to the light of a scene. All code that
converts traced power to currents uses it: `solen.sensor.readings`, the simulated bench and the diagnosis.

A trace gives the angle of incidence projected onto the plane. In space, rays also have a y-component: upright walls
conserve the product of the index and the y-component of a ray's direction, so this product is known at the emitter.
Light is traced in bands of this product, which gives the angle of incidence for each band. Scattering and textured
walls do not conserve it; for them, the factor for smooth walls is used.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.parts import ReceiverPart
from solen.readout.circuit import named_part
from solen.readout.transistor import angular_factor, exponent_of
from solen.scene import Scene, Source
from solen.scene.sources.base import Launch, Placed, PlacedInSpace
from solen.sensor.sensor import Sensor
from solen.trace import trace
from solen.trace.entry import scene_behind_face

SIDES = ("right", "left")
ANGLE_BINS, BANDS = 90, 8
"""Number of bins of the projected angle of incidence, and number of bands of the y-component."""
FLAT_TOLERANCE = 1e-6
"""Maximum deviation from 1 of an exponent that is treated as that of a flat window."""


@dataclass(frozen=True)
class Acceptance:
    """Directional response of receivers to a beam: cos^m of the angle of incidence.

    Attributes
    ----------
    exponent
        Exponent m; 1 for a flat window, behind which the current depends only on the power through the window.
    index
        Index of the material at the window; behind a matched face, Snell's law converts angles to those in air.
    """

    exponent: float = 1.0
    index: float = 1.0

    @classmethod
    def of(cls, sensor: Sensor) -> "Acceptance":
        """Return the acceptance of the design's receiver; raise `DataError` if there is no such part."""
        matched = sensor.design.receivers.coupling == "matched"
        exponent = exponent_of(named_part(sensor.design, "part", ReceiverPart))
        return cls(exponent, sensor.material.index if matched else 1.0)

    @property
    def is_flat(self) -> bool:
        """Whether the current depends only on the power through the face."""
        return abs(self.exponent - 1.0) < FLAT_TOLERANCE

    def factors(self, scene: Scene, receivers: Sequence[str] = SIDES) -> FloatArray:
        """Return the detected fractions (R,) of the first source's light at receivers, by default right and left.

        A fraction is 1 if no light arrives.
        """
        if self.is_flat:
            return np.ones(len(receivers))
        scene = scene_behind_face(scene, "power")
        edges = np.linspace(-90.0, 90.0, ANGLE_BINS + 1)
        sine = self.index * np.sin(np.radians(0.5 * (edges[1:] + edges[:-1])))
        window_deg, powers = [], []
        for light, y_components in _bands(scene):
            detectors = trace(replace(scene, sources=(light,)), "power", angle_bins=ANGLE_BINS).detectors
            window_deg += [np.degrees(np.arcsin(np.minimum(np.hypot(sine, y), 1.0))) for y in y_components]
            powers += [np.array([detectors[name].power_by_angle for name in receivers])] * len(y_components)
        return angular_factor(self.exponent, np.concatenate(window_deg), np.concatenate(powers, axis=1))


def _bands(scene: Scene) -> Iterator[tuple[Source, tuple[float, ...]]]:
    """Yield bands of a scene's first source by the y-component of direction in air, each with two such y-components.

    The two y-components match the mean and the standard deviation of the band's emitted light.
    """
    source = scene.sources[0]
    if scene.extrusion is None:
        yield source, (0.0,)
        return
    launch = source.launch(in_space=True)
    y_components = _y_components(launch)
    for low, high in pairwise(np.linspace(0.0, 1.0, BANDS + 1).tolist()):
        power = (launch.power_s + launch.power_p) * ((y_components >= low) & (y_components <= high))
        if not power.any():
            continue
        mean = float(np.average(y_components, weights=power))
        sd = math.sqrt(float(np.average((y_components - mean) ** 2, weights=power)))
        band = Band(source=source, low=low, high=high, power=source.power, spectrum=source.spectrum)
        yield band, (mean - sd, mean + sd)


@dataclass(frozen=True, kw_only=True)
class Band(Source):
    """A source limited to directions whose y-component has a magnitude between two limits; other rays have no power."""

    source: Source
    low: float
    high: float

    @property
    def rays(self) -> int:
        """Number of rays of the entire source."""
        return self.source.rays

    @property
    def shape_dimensions(self) -> int:
        """See `Source.shape_dimensions`; as for the entire source."""
        return self.source.shape_dimensions

    def dimensions(self, in_space: bool = False) -> int:
        """See `Source.dimensions`; as for the entire source."""
        return self.source.dimensions(in_space)

    def place(self, u: FloatArray) -> Placed:
        """See `Source.place`; as for the entire source."""
        return self.source.place(u)

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """See `Source.place_in_space`; as for the entire source."""
        return self.source.place_in_space(u)

    def lines(self, u: FloatArray) -> IntArray:
        """See `Source.lines`; as for the entire source."""
        return self.source.lines(u)

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """See `Source.launch_at`; rays outside the band have no power."""
        launch = self.source.launch_at(u, rays, in_space)
        y_component = _y_components(launch)
        inside = (y_component >= self.low) & (y_component <= self.high)
        return replace(launch, power_s=launch.power_s * inside, power_p=launch.power_p * inside)


def _y_components(launch: Launch) -> FloatArray:
    """Return the magnitudes (N,) of the y-components of direction in air, at most 1."""
    y_component = np.zeros_like(launch.dx) if launch.dy is None else np.abs(launch.dy)
    return y_component if launch.behind is None else np.minimum(launch.behind.inside * y_component, 1.0)
