"""Model of a recording's mean curves: its parameters with their priors, and the receiver voltages.

Light I lowers the voltage of a receiver by gain times I, until the transistor is saturated. Saturation follows
`solen.readout.load_line`, and is modelled only if the circuit is known. Voltages begin at 0 if the voltage without the
emitter was subtracted, otherwise at the supply voltage; an offset for each receiver accounts for both cases.

Public name: `Model`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solen.analysis.diagnosis.design_response import INDEX, Response
from solen.arrays import FloatArray
from solen.readout import Circuit
from solen.readout.transistor import load_line
from solen.sensor.acceptance import SIDES

OFFSET, SPREAD, ZERO, LOSS = "emitter.offset_mm", "chip spread_mm2", "angle.zero_deg", "loss_per_mm"
_OHM = 1e3  # converts mA to V
LOSS_WORTH = 0.05
"""Loss along the path, as a fraction of the light, above which a warning is given."""
_NODES = math.sqrt(3.0) * np.array([-0.794654472, -0.187592474, 0.187592474, 0.794654472])
"""Positions in a cell, in standard deviations, at which the mean equals the mean over the cell (Chebyshev
quadrature).
"""


@dataclass(frozen=True)
class Bend:
    """Load line of every receiver.

    Attributes
    ----------
    supply_V, saturation_V, knee_V
        As in `solen.readout.load_line`.
    room_V
        Voltage drop of each receiver due to ambient light, (r,).
    """

    supply_V: float
    saturation_V: float
    knee_V: float
    room_V: tuple[float, ...]

    @classmethod
    def of(cls, circuit: Circuit, room_V: tuple[float, ...]) -> "Bend":
        """Load lines of a circuit in the specified ambient light."""
        part = circuit.transistor
        return cls(circuit.supply_V, part.saturation_V, part.knee_V, room_V)

    def __call__(self, pulled_V: FloatArray) -> FloatArray:
        """Return the voltage drops (n, r) for which a linear circuit would have the drops ``pulled_V``."""
        room = np.maximum(np.array(self.room_V), 0.0)
        pulled = np.maximum(pulled_V + room, 0.0)
        line = (self.supply_V, self.saturation_V, self.knee_V)
        down = load_line(np.vstack([room, pulled]), _OHM, *line).volts
        return np.asarray(down[0] - down[1:] + np.minimum(pulled_V + room, 0.0))


def _receiver_V(shares: FloatArray, gain_V: FloatArray, offset_V: FloatArray, bend: Bend | None) -> FloatArray:
    """Return the voltages (n, r) from fractions of the light (n, r), for gains and offsets (r,)."""
    pulled = shares * gain_V
    return np.asarray(offset_V - (pulled if bend is None else bend(pulled)))


@dataclass(frozen=True)
class Parameter:
    """A parameter of the model.

    Attributes
    ----------
    name
        A design key, ``angle.zero_deg``, ``loss_per_mm``, ``gain right`` or ``offset left``, and so on.
    start
        Value in the design.
    scale
        Largest useful uncertainty: if the uncertainty is larger, the recording does not determine the parameter.
    known
        Standard uncertainty of ``start`` as a prior; inf without a prior.
    """

    name: str
    start: float
    scale: float
    known: float = math.inf


@dataclass(frozen=True, eq=False)
class Model:
    """Model of the curves (n, r) of one or both receivers over angles (n,), as a function of its parameters (p,)."""

    response: Response
    angle_deg: FloatArray
    sides: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    bend: Bend | None = None
    spacing_deg: float = 0.0

    @classmethod
    def of(
        cls,
        response: Response,
        angle_deg: FloatArray,
        sides: tuple[str, ...],
        swing_V: FloatArray,
        known: Mapping[str, float],
        bend: Bend | None = None,
        spacing_deg: float = 0.0,
    ) -> "Model":
        """Construct the model of a sensor's mean curves.

        Parameters
        ----------
        response
            Response of the design.
        angle_deg
            Equidistant angles of the curves, (n,).
        sides
            ``right`` and ``left``, or one of them.
        swing_V
            Range of each receiver's curve, (r,).
        known
            Standard uncertainties, by key, of the zero angle and of variations between prints.
        bend
            Load line, if the circuit is known.
        spacing_deg
            Angle between samples; the curves are linear between them.
        """
        way_mm = max(response.path_mm(angle_deg), 1.0)
        spread = response.width_mm**2
        shape = [
            Parameter(OFFSET, response.offset_mm, 0.1),
            Parameter(SPREAD, spread, 0.1**2 + 0.1 * response.width_mm),
            Parameter(ZERO, 0.0, 0.5, known.get(ZERO, math.inf)),
            Parameter(LOSS, 0.0, LOSS_WORTH / way_mm),
        ]
        others = [Parameter(key, 0.0, max(known[key], 1e-12), known[key]) for key in response.changes]
        circuit = []
        for side, swing in zip(sides, swing_V.tolist(), strict=True):
            circuit += [Parameter(f"gain {side}", 2.0 * swing, 0.5 * swing), Parameter(f"offset {side}", 0.0, swing)]
        return cls(response, angle_deg, sides, (*shape, *others, *circuit), bend, spacing_deg)

    @cached_property
    def places(self) -> dict[str, int]:
        """Index of each parameter, by name."""
        return {parameter.name: place for place, parameter in enumerate(self.parameters)}

    @cached_property
    def gains(self) -> list[int]:
        """Indices of the gains, by receiver."""
        return [self.places[f"gain {side}"] for side in self.sides]

    @cached_property
    def offsets(self) -> list[int]:
        """Indices of the offsets, by receiver."""
        return [self.places[f"offset {side}"] for side in self.sides]

    @cached_property
    def _nodes(self) -> FloatArray:
        """Quadrature angles for each cell; the outermost cells, which the motion does not fill, have one angle each.

        Averaging over a cell broadens the angle with a standard deviation of the cell width over √12, and linear
        interpolation between samples with a standard deviation of the sample spacing over √6.
        """
        spread = np.full(self.angle_deg.size, self.angle_deg[1] - self.angle_deg[0]) / math.sqrt(12.0)
        spread = np.hypot(spread, self.spacing_deg / math.sqrt(6.0))
        spread[[0, -1]] = 0.0
        return np.concatenate([self.angle_deg + node * spread for node in _NODES.tolist()])

    def _means(self, means: FloatArray) -> FloatArray:
        """Return the means over the cells (n, r) of values at the quadrature angles."""
        return np.asarray(means.reshape(_NODES.size, self.angle_deg.size, -1).mean(axis=0))

    def shares(self, values: FloatArray) -> FloatArray:
        """Return the fractions of the light at the quadrature angles of the cells, (4 n, r)."""
        at = self.places
        moved = {key: float(values[at[key]]) for key in self.response.changes}
        found = self.response.shares(
            self._nodes + values[at[ZERO]], values[at[OFFSET]], values[at[SPREAD]], moved, values[at[LOSS]]
        )
        return found[:, [SIDES.index(side) for side in self.sides]]

    def volts(self, values: FloatArray) -> FloatArray:
        """Return the mean voltages over the cells, (n, r)."""
        return self._volts(values, self.shares(values))

    def _volts(self, values: FloatArray, shares: FloatArray) -> FloatArray:
        return self._means(_receiver_V(shares, values[self.gains], values[self.offsets], self.bend))

    def jacobian(self, values: FloatArray, active: Sequence[int]) -> FloatArray:
        """Return the derivatives (n, r, a) with respect to the active parameters (a,), from central differences."""
        size = (self.angle_deg.size, len(self.sides))
        found = np.zeros((*size, len(active)))
        circuit, shares = {*self.gains, *self.offsets}, self.shares(values)
        for column, place in enumerate(active):
            step = 1e-3 * self.parameters[place].scale
            ends = []
            for sign in (1.0, -1.0):
                moved = values.copy()
                moved[place] += sign * step
                ends.append(self._volts(moved, shares) if place in circuit else self.volts(moved))
            found[..., column] = (ends[0] - ends[1]) / (2.0 * step)
        return found

    def start(self, curve: FloatArray, offset_mm: float, spread_mm2: float) -> FloatArray:
        """Return the starting values for a decentre and a squared chip width, with gains and offsets fitted to curves (n, r)."""
        values = np.array([parameter.start for parameter in self.parameters])
        values[self.places[OFFSET]], values[self.places[SPREAD]] = offset_mm, spread_mm2
        mean = self._means(self.shares(values))
        for n, (gain, offset) in enumerate(zip(self.gains, self.offsets, strict=True)):
            good = np.isfinite(curve[:, n])
            table = np.column_stack([-mean[good, n], np.ones(int(good.sum()))])
            values[gain], values[offset] = np.linalg.lstsq(table, curve[good, n], rcond=None)[0]
        return values


__all__ = ["INDEX", "LOSS", "OFFSET", "SPREAD", "ZERO", "Bend", "Model", "Parameter"]
