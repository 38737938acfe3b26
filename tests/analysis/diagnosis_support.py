"""A response in closed form that a diagnosis can be held against, and recordings of it.

A point emitter's light goes to the right by half of 1 − tanh u and to the left by half of 1 + tanh u, u its place from
an edge that wanders with the angle; its integral over the places is a logarithm of cosh. The edge is wider at larger
angles, so that an angle's zero is not the same as a decentre; another index widens it, too. Loss takes the same share
of everything: nothing tells it from the gains.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.analysis import AnalysisOptions, SensorResponse, sensor_response
from solen.analysis.diagnosis import Change, Cycles, Model, Response, Table
from solen.analysis.diagnosis.design_response import INDEX, LOSS_STEP
from solen.arrays import FloatArray
from tests.analysis.made_support import Protocol, Truth, made

MOVES_MM_PER_DEG, EDGE_MM, WIDER, PART = 0.03, 0.04, 0.15, 0.5
INDEX_STEP, WAY_MM = 0.0045, 40.0
ANGLES = np.round(np.arange(-29, 30) * 0.1, 9)
KNOWN = {"angle.zero_deg": 0.1, INDEX: 0.003}


def edge_mm(angle_deg: FloatArray, index: float = 0.0) -> FloatArray:
    """Width of the edge at angles, for an index that is so much larger."""
    return np.asarray(EDGE_MM * (1.0 + WIDER * (angle_deg / 3.0) ** 2 + 0.02 * angle_deg) * (1.0 + 20.0 * index))


def integral(angle_deg: FloatArray, position_mm: FloatArray, index: float = 0.0) -> FloatArray:
    """Integral (2, …) of what a point gives right and left, up to a place."""
    width = edge_mm(angle_deg, index)
    u = (position_mm + MOVES_MM_PER_DEG * angle_deg) / width
    log_cosh = width * (np.abs(u) + np.log1p(np.exp(-2.0 * np.abs(u))) - math.log(2.0))
    return np.stack([0.5 * PART * (position_mm - log_cosh), 0.5 * PART * (position_mm + log_cosh)])


def exact(angle_deg: FloatArray, offset_mm: float, width_mm: float) -> FloatArray:
    """Shares (n, 2) of a chip."""
    ends = (integral(angle_deg, np.full(angle_deg.shape, offset_mm + sign * 0.5 * width_mm)) for sign in (1.0, -1.0))
    high, low = ends
    return np.asarray((high - low).T / width_mm)


def table(low_deg: float = -3.6, high_deg: float = 3.6, index: float = 0.0, every: int = 1) -> Table:
    """The response as a table."""
    angles = np.linspace(low_deg, high_deg, 65)[::every]
    places = np.linspace(-0.5, 0.5, 501)
    edge = np.array([-MOVES_MM_PER_DEG, 0.0])
    at = places[None, :] + np.polyval(edge, angles)[:, None]
    return Table(angles, places, edge, integral(angles[:, None], at, index))


def response(width_mm: float = 0.2, *, with_index: bool = True) -> Response:
    """The response with what may differ."""
    base = table()
    up, down = (table(index=step, every=2).minus(base) for step in (INDEX_STEP, -INDEX_STEP))
    changes = {INDEX: Change(INDEX_STEP, up, down)} if with_index else {}
    lossy = replace(base, total_mm=base.total_mm * (math.exp(-LOSS_STEP * WAY_MM) - 1.0))
    return Response(base, changes, lossy, width_mm, 0.0, 1e-6)  # straight from the formula


def model(of: Response, sides: tuple[str, ...] = ("right", "left")) -> Model:
    """Its model at usual angles."""
    return Model.of(of, ANGLES, sides, np.full(len(sides), 4.0), KNOWN)


def truth(of: Model, **values: float) -> FloatArray:
    """Values of a model with some set; names with _ for a blank."""
    found = np.array([one.start for one in of.parameters])
    for name, value in values.items():
        found[of.indices[name]] = value
    return found


@dataclass(frozen=True)
class Rough:
    """What a rig does to cycles, in V: white noise, a level of its own, a slow wave and a drift over each cycle.

    ``gain`` is the share by which a cycle's swing differs.
    """

    white: float = 2e-3
    level: float = 5e-3
    wave: float = 3e-3
    drift: float = 4e-3
    gain: float = 1e-3

    def cycles(self, curves: FloatArray, count: int, draw: np.random.Generator) -> Cycles:
        """Cycles of curves (n, r)."""
        n, r = curves.shape
        phase = draw.uniform(0.0, 2.0 * np.pi, (count, 1, r))
        along = np.linspace(-1.0, 1.0, n)[None, :, None]
        made = curves * (1.0 + self.gain * draw.standard_normal((count, 1, r)))
        made = made + self.white * draw.standard_normal((count, n, r))
        made += (
            self.level * draw.standard_normal((count, 1, r)) + self.drift * draw.standard_normal((count, 1, r)) * along
        )
        made += self.wave * draw.standard_normal((count, 1, r)) * np.sin(4.0 * along + phase)
        return Cycles(ANGLES, made)


@dataclass(frozen=True)
class Lit(Truth):
    """A made recording of the response in closed form."""

    offset_mm: float = 0.02
    width_mm: float = 0.2
    zero_deg: float = 0.0
    gains_V: tuple[float, float] = (8.0, 7.0)
    offsets_V: tuple[float, float] = (5.0, 4.8)

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        right, left = exact(angle_deg + self.zero_deg, self.offset_mm, self.width_mm).T
        by_side = (self.offsets_V[0] - self.gains_V[0] * right, self.offsets_V[1] - self.gains_V[1] * left)
        return np.column_stack(by_side[::-1])


def sensor(lit: Truth | None = None) -> SensorResponse:
    """A made recording, analysed."""
    return sensor_response([made(lit or Lit(noise_V=2e-3))], AnalysisOptions())


__all__ = ["ANGLES", "Lit", "Protocol", "Rough", "exact", "model", "response", "sensor", "table", "truth"]
