"""A response in closed form, and recordings of it, with which a diagnosis can be compared.

The fractions (1 − tanh u)/2 and (1 + tanh u)/2 of a point emitter's detected light reach the right and the left
receiver, where u is its scaled distance from an edge that moves with the angle; their integral over the position
contains ln cosh u. The edge is wider at larger angles, so that a zero angle differs from a decentre; a change of the
index widens it, too. Loss attenuates all light equally and therefore cannot be distinguished from the gains.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.analysis import AnalysisOptions, SensorResponse, sensor_response
from solen.analysis.diagnosis import Change, Cycles, Model, Response, Table
from solen.analysis.diagnosis.design_response import INDEX, LOSS_STEP
from solen.arrays import FloatArray
from tests.analysis.simulated_support import Truth, simulated

EDGE_MM_PER_DEG, EDGE_MM, WIDENING, FRACTION = 0.03, 0.04, 0.15, 0.5
INDEX_STEP, PATH_MM = 0.0045, 40.0
ANGLES = np.round(np.arange(-29, 30) * 0.1, 9)
PRIORS = {"angle.zero_deg": 0.1, INDEX: 0.003}


def edge_mm(angle_deg: FloatArray, index: float = 0.0) -> FloatArray:
    """Return the width of the edge at angles, for a given increase of the index."""
    return np.asarray(EDGE_MM * (1.0 + WIDENING * (angle_deg / 3.0) ** 2 + 0.02 * angle_deg) * (1.0 + 20.0 * index))


def integral(angle_deg: FloatArray, position_mm: FloatArray, index: float = 0.0) -> FloatArray:
    """Return the integral (2, …) of the fractions of a point, right and left, up to a position."""
    width = edge_mm(angle_deg, index)
    u = (position_mm + EDGE_MM_PER_DEG * angle_deg) / width
    log_cosh = width * (np.abs(u) + np.log1p(np.exp(-2.0 * np.abs(u))) - math.log(2.0))
    return np.stack([0.5 * FRACTION * (position_mm - log_cosh), 0.5 * FRACTION * (position_mm + log_cosh)])


def exact_fractions(angle_deg: FloatArray, offset_mm: float, width_mm: float) -> FloatArray:
    """Return the fractions (n, 2) of a chip's light, right and left."""
    high, low = (
        integral(angle_deg, np.full(angle_deg.shape, offset_mm + sign * 0.5 * width_mm)) for sign in (1.0, -1.0)
    )
    return np.asarray((high - low).T / width_mm)


def table(low_deg: float = -3.6, high_deg: float = 3.6, index: float = 0.0, every: int = 1) -> Table:
    """Return the response as a table with every n-th of 65 angles."""
    angles = np.linspace(low_deg, high_deg, 65)[::every]
    positions = np.linspace(-0.5, 0.5, 501)
    edge = np.array([-EDGE_MM_PER_DEG, 0.0])
    shifted = positions[None, :] + np.polyval(edge, angles)[:, None]
    return Table(angles, positions, edge, integral(angles[:, None], shifted, index))


def response(width_mm: float = 0.2, *, with_index: bool = True) -> Response:
    """Return the response with its changes due to the index and the loss."""
    base = table()
    up, down = (table(index=step, every=2).minus(base) for step in (INDEX_STEP, -INDEX_STEP))
    changes = {INDEX: Change(INDEX_STEP, up, down)} if with_index else {}
    lossy = replace(base, total_mm=base.total_mm * (math.exp(-LOSS_STEP * PATH_MM) - 1.0))
    return Response(base, changes, lossy, width_mm, 0.0, 1e-6)  # the table is exact


def model(of: Response, sides: tuple[str, ...] = ("right", "left")) -> Model:
    """Return the model of a response at `ANGLES`."""
    return Model.of(of, ANGLES, sides, np.full(len(sides), 4.0), PRIORS)


def parameter_vector(of: Model, **values: float) -> FloatArray:
    """Return the start values of a model, with some of them replaced."""
    vector = np.array([parameter.start for parameter in of.parameters])
    for name, value in values.items():
        vector[of.indices[name]] = value
    return vector


@dataclass(frozen=True)
class Disturbances:
    """Disturbances in V: white noise, and a level, a slow wave and a drift that are drawn for each cycle.

    ``gain`` is the relative standard deviation of the cycles' swings.
    """

    white: float = 2e-3
    level: float = 5e-3
    wave: float = 3e-3
    drift: float = 4e-3
    gain: float = 1e-3

    def cycles(self, curves: FloatArray, count: int, rng: np.random.Generator) -> Cycles:
        """Return disturbed cycles with given true curves (n, r)."""
        n, r = curves.shape
        phase = rng.uniform(0.0, 2.0 * np.pi, (count, 1, r))
        u = np.linspace(-1.0, 1.0, n)[None, :, None]
        volts = curves * (1.0 + self.gain * rng.standard_normal((count, 1, r)))
        volts = volts + self.white * rng.standard_normal((count, n, r))
        volts += self.level * rng.standard_normal((count, 1, r)) + self.drift * rng.standard_normal((count, 1, r)) * u
        volts += self.wave * rng.standard_normal((count, 1, r)) * np.sin(4.0 * u + phase)
        return Cycles(ANGLES, volts)


@dataclass(frozen=True)
class LitSensor(Truth):
    """True values of a recording with the response in closed form."""

    offset_mm: float = 0.02
    width_mm: float = 0.2
    zero_deg: float = 0.0
    gains_V: tuple[float, float] = (8.0, 7.0)
    offsets_V: tuple[float, float] = (5.0, 4.8)

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        right, left = exact_fractions(angle_deg + self.zero_deg, self.offset_mm, self.width_mm).T
        by_side = (self.offsets_V[0] - self.gains_V[0] * right, self.offsets_V[1] - self.gains_V[1] * left)
        return np.column_stack(by_side[::-1])


def recorded_response(truth: Truth | None = None) -> SensorResponse:
    """Return the response of a simulated recording."""
    return sensor_response([simulated(truth or LitSensor(noise_V=2e-3))], AnalysisOptions())
