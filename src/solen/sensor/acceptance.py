"""Effect of the receivers' directionality on traced power.

A trace gives the power through a receiver's face. A part with a lens collects less of the light from the side, so its
current is not proportional to that power. `Acceptance` applies the part's directionality to the light of a scene. All
code that converts traced power to currents uses it: `solen.sensor.readings`, the simulated bench and the diagnosis.

A trace gives the angle of incidence in projection. In space, light also arrives from above and below: vertical walls
conserve the product of the index and the y-component of a ray's direction, so this product is already known at the
emitter. Light is traced in bands of this component, which gives the angle of incidence for each band. Scattering or
textured walls do not conserve it; for them, the factor for smooth walls is used.
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
from solen.trace.entry import through_face

SIDES = ("right", "left")
ANGLE_BINS, BANDS = 90, 8
"""Number of bins of the angle of incidence in projection, and number of bands of the y-component."""
FLAT = 1e-6
"""Maximum deviation from 1 of an exponent that is treated as that of a flat window."""


@dataclass(frozen=True)
class Acceptance:
    """Directional response of receivers to a beam: cos^m of the angle of incidence.

    Attributes
    ----------
    exponent
        m; 1 for a flat window, whose current depends only on the power through it.
    index
        Index of the material at the window; behind a matched face, Snell's law converts angles to those in air.
    """

    exponent: float = 1.0
    index: float = 1.0

    @classmethod
    def of(cls, sensor: Sensor) -> "Acceptance":
        """Return the acceptance of the part that a design names; raise `DataError` if there is no such receiver."""
        matched = sensor.design.receivers.coupling == "matched"
        exponent = exponent_of(named_part(sensor.design, "part", ReceiverPart))
        return cls(exponent, sensor.material.index if matched else 1.0)

    @property
    def is_flat(self) -> bool:
        """Whether all light through the face counts equally."""
        return abs(self.exponent - 1.0) < FLAT

    def factors(self, scene: Scene, receivers: Sequence[str] = SIDES) -> FloatArray:
        """Return the fractions (R,) of the first source's power that receivers detect, by default right and left.

        The fraction is 1 if no light arrives.
        """
        if self.is_flat:
            return np.ones(len(receivers))
        scene = through_face(scene, "power")
        edges = np.linspace(-90.0, 90.0, ANGLE_BINS + 1)
        sine = self.index * np.sin(np.radians(0.5 * (edges[1:] + edges[:-1])))
        window_deg, powers = [], []
        for light, ups in _bands(scene):
            detectors = trace(replace(scene, sources=(light,)), "power", angle_bins=ANGLE_BINS).detectors
            window_deg += [np.degrees(np.arcsin(np.minimum(np.hypot(sine, up), 1.0))) for up in ups]
            powers += [np.array([detectors[name].power_by_angle for name in receivers])] * len(ups)
        return angular_factor(self.exponent, np.concatenate(window_deg), np.concatenate(powers, axis=1))


def _bands(scene: Scene) -> Iterator[tuple[Source, tuple[float, ...]]]:
    """Yield bands of a scene's first source by the y-component of direction in air, each represented by two values.

    The two values match the mean and the standard deviation of the band's emitted light.
    """
    source = scene.sources[0]
    if scene.extrusion is None:
        yield source, (0.0,)
        return
    launch = source.launch(in_space=True)
    ups = _ups(launch)
    for least, most in pairwise(np.linspace(0.0, 1.0, BANDS + 1).tolist()):
        power = (launch.power_s + launch.power_p) * ((ups >= least) & (ups <= most))
        if not power.any():
            continue
        middle = float(np.average(ups, weights=power))
        half = math.sqrt(float(np.average((ups - middle) ** 2, weights=power)))
        band = Band(whole=source, least=least, most=most, power=source.power, spectrum=source.spectrum)
        yield band, (middle - half, middle + half)


@dataclass(frozen=True, kw_only=True)
class Band(Source):
    """A source limited to directions whose y-component has a magnitude between two limits; other rays have no power."""

    whole: Source
    least: float
    most: float

    @property
    def rays(self) -> int:
        """Number of rays of the entire source."""
        return self.whole.rays

    @property
    def shape_dimensions(self) -> int:
        """See `Source.shape_dimensions`; same as the entire source."""
        return self.whole.shape_dimensions

    def dimensions(self, in_space: bool = False) -> int:
        """See `Source.dimensions`; same as the entire source."""
        return self.whole.dimensions(in_space)

    def place(self, u: FloatArray) -> Placed:
        """Return rays of the entire source by their numbers."""
        return self.whole.place(u)

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """Return rays of the entire source in space by their numbers."""
        return self.whole.place_in_space(u)

    def lines(self, u: FloatArray) -> IntArray:
        """Return the spectral lines to which the rays belong."""
        return self.whole.lines(u)

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """See :meth:`~solen.scene.sources.base.Source.launch_at`."""
        launch = self.whole.launch_at(u, rays, in_space)
        up = _ups(launch)
        inside = (up >= self.least) & (up <= self.most)
        return replace(launch, power_s=launch.power_s * inside, power_p=launch.power_p * inside)


def _ups(launch: Launch) -> FloatArray:
    """Return the magnitudes (N,) of the y-components of direction in air, at most 1."""
    up = np.zeros_like(launch.dx) if launch.dy is None else np.abs(launch.dy)
    return up if launch.behind is None else np.minimum(launch.behind.inside * up, 1.0)
