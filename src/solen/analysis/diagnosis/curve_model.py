"""Model of a recording's mean curves: its parameters with their priors, and the receiver voltages.

Light I lowers the voltage of a receiver by gain times I, until the transistor saturates. Saturation follows
`solen.readout.transistor.load_line`, and is modelled only if the circuit is known. Without light, the voltage is 0 if
the voltage without the emitter was subtracted, otherwise the supply voltage; an offset for each receiver accounts for
both cases.

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
_OHM = 1e3  # with this load, a photocurrent in mA is numerically the voltage drop in V
MAX_U_LOSS = 0.05
"""Largest useful uncertainty of the loss along the path, as a fraction of the light."""
_NODES = math.sqrt(3.0) * np.array([-0.794654472, -0.187592474, 0.187592474, 0.794654472])
"""Positions in a cell, in standard deviations of the position: the mean of a function at these positions approximates
its mean over the cell (Chebyshev quadrature).
"""


@dataclass(frozen=True)
class LoadLines:
    """Load lines of the receivers, which saturate.

    Attributes
    ----------
    supply_V, saturation_V, knee_V
        Supply voltage, saturation voltage of the transistors, and width of the knee above it.
    ambient_drop_V
        Voltage drop of each receiver due to ambient light, (r,).
    """

    supply_V: float
    saturation_V: float
    knee_V: float
    ambient_drop_V: tuple[float, ...]

    @classmethod
    def of(cls, circuit: Circuit, ambient_drop_V: tuple[float, ...]) -> "LoadLines":
        """Return the load lines of a circuit in the specified ambient light."""
        transistor = circuit.transistor
        return cls(circuit.supply_V, transistor.saturation_V, transistor.knee_V, ambient_drop_V)

    def __call__(self, drop_V: FloatArray) -> FloatArray:
        """Return the voltage drops (n, r) due to light for which a linear circuit would have the drops ``drop_V``."""
        ambient = np.maximum(np.array(self.ambient_drop_V), 0.0)
        total = drop_V + ambient
        line = (self.supply_V, self.saturation_V, self.knee_V)
        volts = load_line(np.vstack([ambient, np.maximum(total, 0.0)]), _OHM, *line).volts
        return np.asarray(volts[0] - volts[1:] + np.minimum(total, 0.0))


def _receiver_V(
    fractions: FloatArray, gain_V: FloatArray, offset_V: FloatArray, load_lines: LoadLines | None
) -> FloatArray:
    """Return the voltages (n, r) for fractions of the light (n, r), with gains and offsets (r,)."""
    drop_V = fractions * gain_V
    return np.asarray(offset_V - (drop_V if load_lines is None else load_lines(drop_V)))


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
    u_prior
        Standard uncertainty of ``start`` as a prior; inf without a prior.
    """

    name: str
    start: float
    scale: float
    u_prior: float = math.inf


@dataclass(frozen=True, eq=False)
class Model:
    """Model of the curves (n, r) of one or both receivers at angles (n,), as a function of its parameters (p,)."""

    response: Response
    angle_deg: FloatArray
    sides: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    load_lines: LoadLines | None = None
    spacing_deg: float = 0.0

    @classmethod
    def of(
        cls,
        response: Response,
        angle_deg: FloatArray,
        sides: tuple[str, ...],
        swing_V: FloatArray,
        priors: Mapping[str, float],
        load_lines: LoadLines | None = None,
        spacing_deg: float = 0.0,
    ) -> "Model":
        """Construct the model of a sensor's mean curves.

        Parameters
        ----------
        response
            Response of the design.
        angle_deg
            Evenly spaced angles of the curves, (n,).
        sides
            ``right`` and ``left``, or one of them.
        swing_V
            Range of each receiver's curve, (r,).
        priors
            Standard uncertainties of the zero angle and of parameters that vary between prints, keyed by name.
        load_lines
            Load lines, if the circuit is known.
        spacing_deg
            Angle between samples, between which the curves are interpolated linearly.
        """
        path_mm = max(response.path_mm(angle_deg), 1.0)
        spread = response.width_mm**2
        shape = [
            Parameter(OFFSET, response.offset_mm, 0.1),
            Parameter(SPREAD, spread, 0.1**2 + 0.1 * response.width_mm),
            Parameter(ZERO, 0.0, 0.5, priors.get(ZERO, math.inf)),
            Parameter(LOSS, 0.0, MAX_U_LOSS / path_mm),
        ]
        others = [Parameter(key, 0.0, max(priors[key], 1e-12), priors[key]) for key in response.changes]
        circuit = []
        for side, swing in zip(sides, swing_V.tolist(), strict=True):
            circuit += [Parameter(f"gain {side}", 2.0 * swing, 0.5 * swing), Parameter(f"offset {side}", 0.0, swing)]
        return cls(response, angle_deg, sides, (*shape, *others, *circuit), load_lines, spacing_deg)

    @cached_property
    def indices(self) -> dict[str, int]:
        """Index of each parameter, keyed by name."""
        return {parameter.name: index for index, parameter in enumerate(self.parameters)}

    @cached_property
    def gains(self) -> list[int]:
        """Index of the gain of each receiver."""
        return [self.indices[f"gain {side}"] for side in self.sides]

    @cached_property
    def offsets(self) -> list[int]:
        """Index of the offset of each receiver."""
        return [self.indices[f"offset {side}"] for side in self.sides]

    @cached_property
    def _nodes(self) -> FloatArray:
        """Quadrature angles for each cell; the outermost cells, which the motion does not fill, have one angle each.

        Averaging over a cell spreads the angle with a standard deviation of 1/√12 of the cell width; linear
        interpolation between samples spreads it with a standard deviation of 1/√6 of the sample spacing.
        """
        spread = np.full(self.angle_deg.size, self.angle_deg[1] - self.angle_deg[0]) / math.sqrt(12.0)
        spread = np.hypot(spread, self.spacing_deg / math.sqrt(6.0))
        spread[[0, -1]] = 0.0
        return np.concatenate([self.angle_deg + node * spread for node in _NODES.tolist()])

    def _means(self, means: FloatArray) -> FloatArray:
        """Return the means over the cells (n, r) of values at the quadrature angles."""
        return np.asarray(means.reshape(_NODES.size, self.angle_deg.size, -1).mean(axis=0))

    def fractions(self, values: FloatArray) -> FloatArray:
        """Return the fractions of the light at the quadrature angles of the cells, (4 n, r)."""
        named = dict(zip(self.indices, values.tolist(), strict=True))
        deviations = {key: named[key] for key in self.response.changes}
        angles_deg = self._nodes + named[ZERO]
        fractions = self.response.fractions(angles_deg, named[OFFSET], named[SPREAD], deviations, named[LOSS])
        return fractions[:, [SIDES.index(side) for side in self.sides]]

    def volts(self, values: FloatArray) -> FloatArray:
        """Return the mean voltages over the cells, (n, r)."""
        return self._volts(values, self.fractions(values))

    def _volts(self, values: FloatArray, fractions: FloatArray) -> FloatArray:
        return self._means(_receiver_V(fractions, values[self.gains], values[self.offsets], self.load_lines))

    def jacobian(self, values: FloatArray, active: Sequence[int]) -> FloatArray:
        """Return the derivatives (n, r, a) with respect to the active parameters (a,), from central differences."""
        derivatives = np.zeros((self.angle_deg.size, len(self.sides), len(active)))
        circuit, fractions = {*self.gains, *self.offsets}, self.fractions(values)
        for column, index in enumerate(active):
            step = 1e-3 * self.parameters[index].scale
            ends = []
            for sign in (1.0, -1.0):
                moved = values.copy()
                moved[index] += sign * step
                ends.append(self._volts(moved, fractions) if index in circuit else self.volts(moved))
            derivatives[..., column] = (ends[0] - ends[1]) / (2.0 * step)
        return derivatives

    def start(self, curve: FloatArray, offset_mm: float, spread_mm2: float) -> FloatArray:
        """Return starting values for a decentre and a squared chip width; gains and offsets fit the curves (n, r)."""
        values = np.array([parameter.start for parameter in self.parameters])
        values[self.indices[OFFSET]], values[self.indices[SPREAD]] = offset_mm, spread_mm2
        mean = self._means(self.fractions(values))
        for n, (gain, offset) in enumerate(zip(self.gains, self.offsets, strict=True)):
            finite = np.isfinite(curve[:, n])
            columns = np.column_stack([-mean[finite, n], np.ones(int(finite.sum()))])
            values[gain], values[offset] = np.linalg.lstsq(columns, curve[finite, n], rcond=None)[0]
        return values


__all__ = ["INDEX", "LOSS", "OFFSET", "SPREAD", "ZERO", "LoadLines", "Model", "Parameter"]
