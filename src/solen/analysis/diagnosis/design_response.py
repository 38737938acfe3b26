"""Light at the receivers of a design, by position and width of the emitter and by other tolerances of a print.

The idea: the table of the design as it is, and for every other number that may differ (index, loss) how the table
changes with it. Index and the like change little, but the bends of the response wander with them: a parabola through a
step to each side serves where a straight line is off by more than noise. Loss takes its share of the light along the
way, which is an exponential.

A chip's width enters as its square, the **spread** of the light about the chip's middle: what a narrow chip changes is
in proportion to it, and a chip of no width is then no edge. The spread may come out below 0, as any number near 0 may.

The interface: `Response.of` a `Sensor`; `Response.shares`. A `Change` is that by one number.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from solen.analysis.diagnosis.response_table import STEP_DEG, STEP_IN_SPACE_DEG, Table, angles_deg
from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.progress import Progress, part_of
from solen.sensor import Sensor, inert
from solen.spec import value_at, with_values

INDEX, LOSS = "material.index", "material.absorption_per_mm"
STEP_U = 1.0
"""Step of a number, in its standard uncertainty."""
LOSS_STEP = 0.01
LEAST_SPREAD_MM2 = 0.02**2
"""Below this spread the response is continued as the straight line through it and a point."""
LEAST_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a table with a number: a parabola within one step to each side, straight lines beyond.

    Attributes
    ----------
    step
        Step of the number.
    up, down
        The table a step above and below, less the design's.
    """

    step: float
    up: Table
    down: Table

    def chip(self, angle_deg: FloatArray, offset_mm: float, width_mm: float, by: float) -> FloatArray:
        """Change of the shares (n, 2), as in `Table.chip`, if the number increases by ``by``."""
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
        Of the design.
    changes
        By the key of a number: how the table changes with it.
    lossy
        The table with `LOSS_STEP` more absorption at some of the angles, less the design's.
    width_mm, offset_mm
        Of the design's chip.
    u_share
        Error of the tables as a share of a receiver's swing: that of traced ones by default.
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
        """Response of a design between two angles, and its change with given numbers.

        Parameters
        ----------
        sensor
            The design.
        low_deg, high_deg
            The angles.
        spreads
            By the key of a number, its standard uncertainty.
        progress
            Called with the share that is done.

        Raises
        ------
        SpecError
            If a key is not one of a real number that the light depends on.
        DesignError
            If the design cannot be traced point by point.
        """
        spreads = spreads or {}
        for key in spreads:
            if key != INDEX and (why := inert(sensor, key)):
                raise SpecError(key, limit=why, remedy="leave it out")
        parts = 3.0 + 2.0 * len(spreads)
        in_space = sensor.design.trace.dimension == "extruded"
        fine = angles_deg(low_deg, high_deg, STEP_IN_SPACE_DEG if in_space else STEP_DEG)

        base = Table.of(sensor, fine, progress=part_of(progress, 0.0, parts, 2.0))
        changes = {}
        for n, (key, u) in enumerate(spreads.items()):
            step = STEP_U * u
            up = Table.of(_moved(sensor, key, step), fine, base, part_of(progress, 2.0 + 2 * n, parts, 1.0)).less(base)
            down = Table.of(_moved(sensor, key, -step), fine, base, part_of(progress, 3.0 + 2 * n, parts, 1.0)).less(
                base
            )
            changes[key] = Change(step, up, down)
        dark = Sensor.of(with_values(sensor.design, {LOSS: sensor.material.absorption_per_mm + LOSS_STEP}))
        lossy = Table.of(_same_lens(dark, sensor), fine[::4], base, part_of(progress, parts - 1.0, parts, 1.0)).less(
            base
        )
        return cls(base, changes, lossy, sensor.light.width_mm, sensor.design.emitter.offset_mm)

    @property
    def reach_mm(self) -> float:
        """Largest distance of a chip's edge from the axis."""
        return self.base.reach_mm

    def shares(
        self,
        angle_deg: FloatArray,
        offset_mm: float,
        spread_mm2: float,
        moved: Mapping[str, float] | None = None,
        loss_per_mm: float = 0.0,
    ) -> FloatArray:
        """Shares of the emitted power (n, 2), right and left, at angles (n,).

        Parameters
        ----------
        angle_deg
            Angles within the table's.
        offset_mm, spread_mm2
            Decentre of the emitter, and the square of its chip's width.
        moved
            By key, how far a number is from the design's.
        loss_per_mm
            Absorption beyond the design's.
        """
        if spread_mm2 >= LEAST_SPREAD_MM2:
            return self._of_width(angle_deg, offset_mm, math.sqrt(spread_mm2), moved or {}, loss_per_mm)
        least = self._of_width(angle_deg, offset_mm, math.sqrt(LEAST_SPREAD_MM2), moved or {}, loss_per_mm)
        point = self._of_width(angle_deg, offset_mm, 0.0, moved or {}, loss_per_mm)
        return np.asarray(point + (least - point) * (spread_mm2 / LEAST_SPREAD_MM2))

    def path_mm(self, angle_deg: FloatArray) -> float:
        """Mean path in the material of the detected light, from its derivative by the loss."""
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
            share = 1.0 + self.lossy.chip(angle_deg, offset_mm, width_mm) / np.maximum(found, LEAST_SHARE)
            found = found * np.clip(share, 0.05, 1.0) ** (loss_per_mm / LOSS_STEP)
        return found


def _moved(sensor: Sensor, key: str, by: float) -> Sensor:
    """The sensor with a number changed by ``by``."""
    if key == INDEX:
        values = {INDEX: sensor.material.index + by, LOSS: sensor.material.absorption_per_mm}
        # its lens keeps the shape that it was designed with
        return replace(Sensor.of(with_values(sensor.design, values)), cut=sensor.cut)
    value = value_at(sensor.design, key)
    if not isinstance(value, float):
        remedy = "set it in the design"
        raise SpecError(key, value=value, limit="must be a real number that the design states", remedy=remedy)
    try:
        return _same_lens(Sensor.of(with_values(sensor.design, {key: value + by})), sensor)
    except SolenError as bad:
        limit = f"{value + by:g} cannot be traced: {bad}"
        raise SpecError(f"--spread {key}", limit=limit, remedy="state a smaller spread") from None


def _same_lens(other: Sensor, sensor: Sensor) -> Sensor:
    return replace(other, cut=sensor.cut) if sensor.is_measured else other
