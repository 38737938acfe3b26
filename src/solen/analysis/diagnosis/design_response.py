"""Light at the receivers of a design, as a function of emitter position and width and of other tolerances.

A table of the light by emitter position is computed for the design. For every other parameter that may differ from the
design (such as index or loss), the change of this table is computed. The effect of the index and similar parameters is
small, but they shift the bends of the response. At the bends, a straight line would be wrong by more than the noise, so
a parabola through one step to each side is used. Loss attenuates the light exponentially along its path.

The width of a chip enters as its square, called **spread**. The effect of a narrow chip is proportional to its spread,
so zero width is not a boundary of the fit. The fitted spread may be negative, like any estimate of a number near 0.

Public name: `Response`. A `Change` is the effect of one parameter.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from solen.analysis.diagnosis.response_table import STEP_DEG, STEP_IN_SPACE_DEG, Table, angles_deg
from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.progress import Progress, part_of
from solen.sensor import Sensor, why_inert
from solen.spec import value_at, with_values

INDEX, LOSS = "material.index", "material.absorption_per_mm"
STEP_U = 1.0
"""Step of a parameter, relative to its standard uncertainty."""
LOSS_STEP = 0.01
MIN_SPREAD_MM2 = 0.02**2
"""Spread below which the response is interpolated linearly between the response of a point and that at this spread."""
MIN_FRACTION = 1e-9


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a table with a parameter: a parabola within one step to each side, straight lines outside.

    Attributes
    ----------
    step
        Parameter step.
    up, down
        The table one step above and one step below, minus the design's table.
    """

    step: float
    up: Table
    down: Table

    def chip(self, angle_deg: FloatArray, offset_mm: float, width_mm: float, by: float) -> FloatArray:
        """Return the change in the fractions of the emitted power (n, 2) if the parameter increases by ``by``."""
        x = by / self.step
        inner = min(max(x, -1.0), 1.0)
        change = np.zeros((angle_deg.size, 2))
        for table, side in ((self.up, 1.0), (self.down, -1.0)):
            weight = 0.5 * inner * (inner + side) + (x - inner) * (inner + 0.5 * side)
            change += weight * table.chip(angle_deg, offset_mm, width_mm)
        return change


@dataclass(frozen=True, eq=False)
class Response:
    """Tables of a design.

    Attributes
    ----------
    base
        Table of the design.
    changes
        Change of the table with each parameter, keyed by the parameter.
    lossy
        The table with an additional absorption of `LOSS_STEP`, at some of the angles, minus the design's table.
    width_mm, offset_mm
        Chip width and decentre in the design.
    u_fraction
        Standard uncertainty of the tables as a fraction of a receiver's swing; the default applies to traced tables.
    """

    base: Table
    changes: Mapping[str, Change]
    lossy: Table
    width_mm: float
    offset_mm: float
    u_fraction: float = 1e-4

    @classmethod
    def of(
        cls,
        sensor: Sensor,
        low_deg: float,
        high_deg: float,
        spreads: Mapping[str, float] | None = None,
        progress: Progress | None = None,
    ) -> "Response":
        """Trace the response of a design between two angles, and its change with the specified parameters.

        Parameters
        ----------
        sensor
            The design.
        low_deg, high_deg
            Lowest and highest angle.
        spreads
            Standard uncertainty of each parameter, keyed by the parameter.
        progress
            Called with the completed fraction.

        Raises
        ------
        SpecError
            If a key is not that of a real number that affects the light.
        DesignError
            If the design cannot be traced point by point.
        """
        spreads = spreads or {}
        for key in spreads:
            if key != INDEX and (why := why_inert(sensor, key)):
                raise SpecError(key, limit=why, remedy="omit it")
        parts = 3.0 + 2.0 * len(spreads)
        in_space = sensor.design.trace.dimension == "extruded"
        angles = angles_deg(low_deg, high_deg, STEP_IN_SPACE_DEG if in_space else STEP_DEG)
        base = Table.of(sensor, angles, progress=part_of(progress, 0.0, parts, 2.0))

        def change_of(other: Sensor, every: int, done: float) -> Table:
            return Table.of(other, angles[::every], base, part_of(progress, done, parts, 1.0)).minus(base)

        changes = {}
        for n, (key, u) in enumerate(spreads.items()):
            step = STEP_U * u
            up = change_of(_changed(sensor, key, step), 1, 2.0 + 2 * n)
            down = change_of(_changed(sensor, key, -step), 1, 3.0 + 2 * n)
            changes[key] = Change(step, up, down)
        absorbing = Sensor.of(with_values(sensor.design, {LOSS: sensor.material.absorption_per_mm + LOSS_STEP}))
        lossy = change_of(_same_lens(absorbing, sensor), 4, parts - 1.0)
        return cls(base, changes, lossy, sensor.light.width_mm, sensor.design.emitter.offset_mm)

    @property
    def reach_mm(self) -> float:
        """Largest distance between a chip edge and the axis."""
        return self.base.reach_mm

    def fractions(
        self,
        angle_deg: FloatArray,
        offset_mm: float,
        spread_mm2: float,
        deviations: Mapping[str, float] | None = None,
        loss_per_mm: float = 0.0,
    ) -> FloatArray:
        """Return the fractions of the emitted power (n, 2), right and left, at angles (n,).

        Parameters
        ----------
        angle_deg
            Angles within the range of the table.
        offset_mm, spread_mm2
            Decentre of the emitter, and the squared width of its chip.
        deviations
            Deviations of parameters from the design, keyed by the parameter.
        loss_per_mm
            Absorption coefficient in addition to the design's.
        """
        deviations = deviations or {}
        if spread_mm2 >= MIN_SPREAD_MM2:
            return self._of_width(angle_deg, offset_mm, math.sqrt(spread_mm2), deviations, loss_per_mm)
        narrow = self._of_width(angle_deg, offset_mm, math.sqrt(MIN_SPREAD_MM2), deviations, loss_per_mm)
        point = self._of_width(angle_deg, offset_mm, 0.0, deviations, loss_per_mm)
        return np.asarray(point + (narrow - point) * (spread_mm2 / MIN_SPREAD_MM2))

    def path_mm(self, angle_deg: FloatArray) -> float:
        """Return the mean path of the detected light in the material, from its decrease with absorption."""
        detected = self.base.chip(angle_deg, self.offset_mm, self.width_mm).sum()
        change = self.lossy.chip(angle_deg, self.offset_mm, self.width_mm).sum()
        return float(-math.log1p(change / detected) / LOSS_STEP)

    def _of_width(
        self,
        angle_deg: FloatArray,
        offset_mm: float,
        width_mm: float,
        deviations: Mapping[str, float],
        loss_per_mm: float,
    ) -> FloatArray:
        fractions = self.base.chip(angle_deg, offset_mm, width_mm)
        for key, by in deviations.items():
            if by:
                fractions = fractions + self.changes[key].chip(angle_deg, offset_mm, width_mm, by)
        if loss_per_mm:
            change = self.lossy.chip(angle_deg, offset_mm, width_mm)
            transmission = np.clip(1.0 + change / np.maximum(fractions, MIN_FRACTION), 0.05, 1.0)
            fractions = fractions * transmission ** (loss_per_mm / LOSS_STEP)
        return fractions


def _changed(sensor: Sensor, key: str, by: float) -> Sensor:
    """Return the sensor with a parameter changed by ``by``."""
    if key == INDEX:
        values = {INDEX: sensor.material.index + by, LOSS: sensor.material.absorption_per_mm}
        # the lens keeps the shape for which it was designed
        return replace(Sensor.of(with_values(sensor.design, values)), cut=sensor.cut)
    value = value_at(sensor.design, key)
    if not isinstance(value, float):
        limit = "is not a real number specified in the design"
        raise SpecError(key, value=value, limit=limit, remedy="set it in the design")
    try:
        return _same_lens(Sensor.of(with_values(sensor.design, {key: value + by})), sensor)
    except SolenError as error:
        limit = f"{value + by:g} cannot be traced: {error}"
        raise SpecError(f"--spread {key}", limit=limit, remedy="specify a smaller spread") from None


def _same_lens(other: Sensor, sensor: Sensor) -> Sensor:
    return replace(other, cut=sensor.cut) if sensor.is_measured else other
