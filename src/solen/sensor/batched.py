"""Responses of many sensors at once, each with several chips, from the compiled batch tracer.

Public names: `respond` and `Responses`.
"""

import math
from collections.abc import Sequence
from functools import partial
from threading import local
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.curve import check_count, check_numbers
from solen.errors import DesignError
from solen.progress import Progress, on_threads
from solen.sensor.batch_input import batch_input
from solen.sensor.sensor import Sensor
from solen.trace import Limits, Mode, batch
from solen.trace.batch import position_bins
from solen.trace.batch.position_bins import Chips, PositionBins

RAYS = 2**12
"""Number of rays per angle, for a contrast accuracy of about 1e-3 with a chip of 0.2 mm."""
MIN_RAYS = 16
"""Minimum number of rays of one lattice."""


class Responses(NamedTuple):
    """Responses of D sensors with K chips at A angles.

    Parameters
    ----------
    right, left
        Power (D, K, A) at each receiver, as a fraction of the power emitted by the chip.
    u_power
        Standard error (D, K, A) of either power due to the positions of the rays.
    truncated
        Largest fraction (D,) of light that was not traced to its end.
    why
        Reason why a sensor cannot be built at some angle, in which case its powers are NaN; empty if it can.
    """

    right: FloatArray
    left: FloatArray
    u_power: FloatArray
    truncated: FloatArray
    why: list[str]

    @property
    def contrast(self) -> FloatArray:
        """Contrast (R − L)/(R + L); NaN without light."""
        total = self.right + self.left
        return np.divide(self.right - self.left, total, out=np.full_like(total, math.nan), where=total > 0.0)

    @property
    def u_contrast(self) -> FloatArray:
        """Uncertainty of the contrast, defined as in `solen.sensor.Response`."""
        total = self.right + self.left
        return np.divide(2.0 * self.u_power, total, out=np.full_like(total, math.nan), where=total > 0.0)


def respond(
    sensors: Sequence[Sensor],
    angles_deg: Sequence[float],
    widths_mm: ArrayLike | None = None,
    offsets_mm: ArrayLike | None = None,
    *,
    rays: int = RAYS,
    mode: Mode = "power",
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Responses:
    """Return responses of sensors with their own emitters, or with emitters of several widths and decentres.

    Every sensor is traced once for all positions covered by its chips, and the power from each chip is a weighted sum
    over these positions; a mirror-symmetric sensor is traced on one side only.

    Parameters
    ----------
    sensors
        D sensors for which `why_not_batched` is None, all in the plane or all in space.
    angles_deg
        Angles (A,) of the motion.
    widths_mm, offsets_mm
        Widths and decentres of the chips, broadcast to (K,) for all sensors or to (D, K); None: each sensor's own. The
        widths in one call must be either all 0 or all positive.
    rays
        Number of rays at each angle, over all positions together.
    mode
        ``"power"`` or ``"count"``.
    seed
        Seed of the random shifts of the lattices. All sensors have the same shifts, so that differences between
        responses are less noisy than the responses.
    threads
        Number of threads; default: one per core.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    DesignError
        If the batch does not support a sensor, or the widths and decentres have unsuitable shapes.
    """
    check_count("rays", rays, 1)
    check_count("seed", seed, 0)
    if threads is not None:
        check_count("threads", threads, 1)
    check_numbers("angles_deg", *angles_deg)
    batched = _Batch(sensors, angles_deg, widths_mm, offsets_mm, rays, mode, seed)
    on_threads(batched.trace, range(len(sensors)), progress, threads)
    return batched.responses


class _Batch:
    """Data shared by all sensors of a call."""

    def __init__(
        self,
        sensors: Sequence[Sensor],
        angles_deg: Sequence[float],
        widths_mm: ArrayLike | None,
        offsets_mm: ArrayLike | None,
        rays: int,
        mode: Mode,
        seed: int,
    ) -> None:
        self.sensors, self.seed = sensors, seed
        self.numbers = batch_input(sensors)
        self.angle_deg = np.asarray(angles_deg, dtype=float)
        self.width = _per_sensor(widths_mm, [sensor.light.width_mm for sensor in sensors])
        self.offset = _per_sensor(offsets_mm, [sensor.design.emitter.offset_mm for sensor in sensors])
        self.width, self.offset = np.broadcast_arrays(self.width, self.offset)
        self.mirrors = self._mirrors()
        opposite = (
            position_bins.follows_by_symmetry(self.angle_deg) if self.mirrors else np.zeros(len(self.angle_deg), bool)
        )
        self.traced = np.flatnonzero(~opposite)
        self.lattices = position_bins.lattices_for(self.width, self.offset, self.mirrors)
        self.workspaces = local()
        self.places: dict[tuple[bytes, bytes], PositionBins] = {}
        self.new_workspace = partial(
            batch.DesignBatch,
            self.angle_deg[self.traced],
            self.lattices,
            max(math.ceil(rays / self.lattices), MIN_RAYS),
            int(self.numbers.body[:, -1].max(initial=0)),
            mode,
            bool(self.numbers.thickness[:1].any()),
            Limits(),
        )
        shape = (len(sensors), self.width.shape[1], len(self.angle_deg))
        right, left, u = (np.full(shape, math.nan) for _ in range(3))
        self.responses = Responses(right, left, u, np.full(len(sensors), math.nan), [""] * len(sensors))

    def _mirrors(self) -> bool:
        """Return whether all responses follow from one side by symmetry, and one side requires fewer rays than both."""
        numbers = self.numbers.body
        symmetric = all(_is_symmetric(batch.Y(*row)) for row in numbers.tolist())
        low, high = self.offset - 0.5 * self.width, self.offset + 0.5 * self.width
        reach = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
        return symmetric and bool(np.all(high.max(axis=1) - low.min(axis=1) >= reach))

    def trace(self, d: int) -> None:
        """Trace a sensor and write its response."""
        if not hasattr(self.workspaces, "batch_workspace"):
            self.workspaces.batch_workspace = self.new_workspace()
        positions = self._positions_of(d)
        result = self.workspaces.batch_workspace.trace(self.numbers, d, positions.bins, self.seed)
        out = self.responses
        out.why[d] = self._why_not(d, self.angle_deg[self.traced[result.soundness != batch.SOUND]])
        if out.why[d]:
            return
        if np.any(result.soundness < batch.UNSURE):
            raise AssertionError("the batch rejects a body that can be built")
        by_bin = np.moveaxis(self._all_angles(result.power), -1, 0)
        right, left = positions.powers(by_bin)
        u = positions.u_powers(by_bin).max(axis=0)
        out.right[d], out.left[d], out.u_power[d] = right.T, left.T, u.T
        out.truncated[d] = result.truncated.max(initial=0.0)

    def _why_not(self, d: int, angle_deg: FloatArray) -> str:
        """Return the error of the first angle at which a sensor cannot be built; empty if there is none."""
        try:
            for angle in angle_deg.tolist():
                self.sensors[d].scene(angle, 1)
        except DesignError as error:
            return str(error)
        return ""

    def _positions_of(self, d: int) -> PositionBins:
        """Return the positions of a sensor's chips, cached for consecutive sensors with the same chips."""
        key = (self.width[d].tobytes(), self.offset[d].tobytes())
        positions = self.places.get(key)
        if positions is None:
            positions = PositionBins.of(Chips(self.width[d], self.offset[d]), self.lattices, self.mirrors)
            self.places = {key: positions}
        return positions

    def _all_angles(self, power: FloatArray) -> FloatArray:
        """Return powers (A, B, 2) of B emitter positions at all angles, from those at the traced angles by symmetry."""
        if not self.mirrors:
            return power
        row = {angle: i for i, angle in enumerate(self.angle_deg[self.traced].tolist())}
        rows = []
        for angle in self.angle_deg.tolist():
            at_angle = power[row[angle]] if angle in row else position_bins.mirrored(power[row[-angle]])
            rows.append(0.5 * (at_angle + position_bins.mirrored(at_angle)) if angle == 0.0 else at_angle)
        return np.stack(rows)


def _is_symmetric(y: batch.Y) -> bool:
    """Return whether a sensor at any angle is the mirror image of the sensor at the opposite angle."""
    return y.lens != batch.PIECES and not (y.pivot == batch.AT_POINT and y.pivot_x != 0.0)


def _per_sensor(values: ArrayLike | None, defaults: Sequence[float]) -> FloatArray:
    """Return values (D, K), one row per sensor, by default each sensor's own."""
    if values is None:
        return np.array(defaults, dtype=float)[:, None]
    rows = np.atleast_1d(np.asarray(values, dtype=float))
    if rows.ndim > 2 or (rows.ndim == 2 and len(rows) != len(defaults)) or not np.all(np.isfinite(rows)):
        raise DesignError("widths_mm, offsets_mm", limit=f"must be finite and of shape (K,) or ({len(defaults)}, K)")
    return np.broadcast_to(rows, (len(defaults), rows.shape[-1]))
