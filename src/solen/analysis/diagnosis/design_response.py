"""Light at the receivers of a design, as a function of emitter position and width and of other tolerances.

A table is computed for the design itself, and the change of this table for every other parameter that may differ
(index, loss). The index and similar parameters have a small effect but shift the bends of the response, so a parabola
through one step to each side is used where a straight line would be wrong by more than the noise. Loss attenuates the
light exponentially along its path.

The width of a chip enters as its square, the **spread** of the light about the chip centre. The effect of a narrow chip
is proportional to its spread, so zero width is not a boundary of the fit. The fitted spread may be below 0, like any
estimate of a number near 0.

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
"""Spread below which the response is interpolated linearly between the response at this spread and that of a point."""
MIN_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a table with a parameter: a parabola within one step to each side, straight lines beyond.

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
        """Return the change in the fractions (n, 2), as in `Table.chip`, if the parameter increases by ``by``."""
        x = by / self.step
        end = min(max(x, -1.0), 1.0)
        found = np.zeros((angle_deg.size, 2))
        for table, side in ((self.up, 1.0), (self.down, -1.0)):
            weight = 0.5 * end * (end + side) + (x - end) * (end + 0.5 * side)
            found += weight * table.chip(angle_deg, offset_mm, width_mm)
        return found


@dataclass(frozen=True, eq=False)
class Response:
    """Tables of a design.

    Attributes
    ----------
    base
        Table of the design.
    changes
        Change of the table with each parameter, by key.
    lossy
        The table with additional absorption `LOSS_STEP`, at some of the angles, minus the design's table.
    width_mm, offset_mm
        Chip width and decentre in the design.
    u_share
        Error of the tables as a fraction of a receiver's swing; the default applies to traced tables.
    """

    base: Table
    changes: Mapping[str, Change]
    lossy: Table
    width_mm: float
    offset_mm: float
    u_share: float = 1e-4

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
            Standard uncertainty of each parameter, by key.
        progress
            Called with the completed fraction.

        Raises
        ------
        SpecError
            If a key does not belong to a real number that affects the light.
        DesignError
            If the design cannot be traced point by point.
        """
        spreads = spreads or {}
        for key in spreads:
            if key != INDEX and (why := why_inert(sensor, key)):
                raise SpecError(key, limit=why, remedy="omit it")
        parts = 3.0 + 2.0 * len(spreads)
        in_space = sensor.design.trace.dimension == "extruded"
        fine = angles_deg(low_deg, high_deg, STEP_IN_SPACE_DEG if in_space else STEP_DEG)

        base = Table.of(sensor, fine, progress=part_of(progress, 0.0, parts, 2.0))
        changes = {}
        for n, (key, u) in enumerate(spreads.items()):
            step = STEP_U * u
            up = Table.of(_moved(sensor, key, step), fine, base, part_of(progress, 2.0 + 2 * n, parts, 1.0)).minus(base)
            down = Table.of(_moved(sensor, key, -step), fine, base, part_of(progress, 3.0 + 2 * n, parts, 1.0)).minus(
                base
            )
            changes[key] = Change(step, up, down)
        dark = Sensor.of(with_values(sensor.design, {LOSS: sensor.material.absorption_per_mm + LOSS_STEP}))
        lossy = Table.of(_same_lens(dark, sensor), fine[::4], base, part_of(progress, parts - 1.0, parts, 1.0)).minus(
            base
        )
        return cls(base, changes, lossy, sensor.light.width_mm, sensor.design.emitter.offset_mm)

    @property
    def reach_mm(self) -> float:
        """Largest distance between a chip edge and the axis."""
        return self.base.reach_mm

    def shares(
        self,
        angle_deg: FloatArray,
        offset_mm: float,
        spread_mm2: float,
        moved: Mapping[str, float] | None = None,
        loss_per_mm: float = 0.0,
    ) -> FloatArray:
        """Return the fractions of the emitted power (n, 2), right and left, at angles (n,).

        Parameters
        ----------
        angle_deg
            Angles within the range of the table.
        offset_mm, spread_mm2
            Decentre of the emitter, and the squared width of its chip.
        moved
            Parameter deviations from the design, by key.
        loss_per_mm
            Absorption coefficient in addition to the design's.
        """
        if spread_mm2 >= MIN_SPREAD_MM2:
            return self._of_width(angle_deg, offset_mm, math.sqrt(spread_mm2), moved or {}, loss_per_mm)
        least = self._of_width(angle_deg, offset_mm, math.sqrt(MIN_SPREAD_MM2), moved or {}, loss_per_mm)
        point = self._of_width(angle_deg, offset_mm, 0.0, moved or {}, loss_per_mm)
        return np.asarray(point + (least - point) * (spread_mm2 / MIN_SPREAD_MM2))

    def path_mm(self, angle_deg: FloatArray) -> float:
        """Return the mean path of the detected light in the material, from the derivative with respect to the absorption."""
        plain = self.base.chip(angle_deg, self.offset_mm, self.width_mm).sum()
        lost = self.lossy.chip(angle_deg, self.offset_mm, self.width_mm).sum()
        return float(-math.log1p(lost / plain) / LOSS_STEP)

    def _of_width(
        self, angle_deg: FloatArray, offset_mm: float, width_mm: float, moved: Mapping[str, float], loss_per_mm: float
    ) -> FloatArray:
        found = self.base.chip(angle_deg, offset_mm, width_mm)
        for key, by in moved.items():
            if by:
                found = found + self.changes[key].chip(angle_deg, offset_mm, width_mm, by)
        if loss_per_mm:
            share = 1.0 + self.lossy.chip(angle_deg, offset_mm, width_mm) / np.maximum(found, MIN_SHARE)
            found = found * np.clip(share, 0.05, 1.0) ** (loss_per_mm / LOSS_STEP)
        return found


def _moved(sensor: Sensor, key: str, by: float) -> Sensor:
    """Return the sensor with a parameter changed by ``by``."""
    if key == INDEX:
        values = {INDEX: sensor.material.index + by, LOSS: sensor.material.absorption_per_mm}
        # the lens keeps the shape for which it was designed
        return replace(Sensor.of(with_values(sensor.design, values)), cut=sensor.cut)
    value = value_at(sensor.design, key)
    if not isinstance(value, float):
        remedy = "set it in the design"
        raise SpecError(key, value=value, limit="must be a real number specified in the design", remedy=remedy)
    try:
        return _same_lens(Sensor.of(with_values(sensor.design, {key: value + by})), sensor)
    except SolenError as bad:
        limit = f"{value + by:g} cannot be traced: {bad}"
        raise SpecError(f"--spread {key}", limit=limit, remedy="specify a smaller spread") from None


def _same_lens(other: Sensor, sensor: Sensor) -> Sensor:
    return replace(other, cut=sensor.cut) if sensor.is_measured else other
