"""Responses of many sensors at once, each with several chips: a function call for the compiled batch."""

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
from solen.sensor.numbers_of_y import numbers_of
from solen.sensor.sensor import Sensor
from solen.trace import Limits, Mode, batch
from solen.trace.batch import places
from solen.trace.batch.places import Chips, Places

RAYS = 2**12
"""Number of rays per angle, for a contrast accuracy of about 1e-3 with a chip of 0.2 mm."""
MIN_RAYS = 16
"""Minimum number of rays of one lattice."""


class Responses(NamedTuple):
    """Powers of D sensors with K chips at A angles, as fractions of the power emitted by each chip.

    ``u_power`` is the standard error of either receiver's power due to the positions of the rays; ``truncated`` is the
    largest fraction of light that was not followed further. ``why`` is empty for a sensor that can be built at all
    angles; otherwise it gives the reason, and the powers are NaN.
    """

    right: FloatArray
    left: FloatArray
    u_power: FloatArray
    truncated: FloatArray
    why: list[str]

    @property
    def contrast(self) -> FloatArray:
        """Contrast (R − L)/(R + L); NaN without light."""
        whole = self.right + self.left
        return np.divide(self.right - self.left, whole, out=np.full_like(whole, math.nan), where=whole > 0.0)

    @property
    def u_contrast(self) -> FloatArray:
        """Uncertainty of the contrast, defined as in `solen.sensor.Response`."""
        whole = self.right + self.left
        return np.divide(2.0 * self.u_power, whole, out=np.full_like(whole, math.nan), where=whole > 0.0)


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
    """Return responses of sensors to their own emitters, or to emitters of several widths and decentres.

    Every sensor is traced once for all positions covered by its chips, and the power of each chip is a weighted sum
    over these positions; a mirror-symmetric sensor is traced on one side only.

    Parameters
    ----------
    sensors
        D sensors for which `why_not_batched` is None, all in the plane or all in space.
    angles_deg
        Angles (A,) of the motion.
    widths_mm, offsets_mm
        Width of the chip and decentre, broadcast to (K,) for all sensors or (D, K); None: each sensor's own. The widths
        in one call are either all 0 or all positive.
    rays
        Number of rays at each angle, over all positions together.
    mode
        ``"power"`` or ``"count"``.
    seed
        Seed of the lattices' shifts, which are the same for all sensors: differences are less noisy than responses.
    threads
        Number of threads; default: one per core.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    DesignError
        If the batch does not support a sensor, or the numbers are inconsistent.
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
        self.numbers = numbers_of(sensors)
        self.angle_deg = np.asarray(angles_deg, dtype=float)
        self.width = _of_each(widths_mm, [sensor.light.width_mm for sensor in sensors])
        self.offset = _of_each(offsets_mm, [sensor.design.emitter.offset_mm for sensor in sensors])
        self.width, self.offset = np.broadcast_arrays(self.width, self.offset)
        self.both = self._mirrors()
        opposite = places.are_symmetric(self.angle_deg) if self.both else np.zeros(len(self.angle_deg), bool)
        self.traced = np.flatnonzero(~opposite)
        lattices = places.lattices_for(self.width, self.offset, self.both)
        in_space = bool(self.numbers.thickness[:1].any())
        each, most = max(math.ceil(rays / lattices), MIN_RAYS), int(self.numbers.body[:, -1].max(initial=0))
        self.lattices, self.lots = lattices, local()
        self.places: dict[tuple[bytes, bytes], Places] = {}
        self.new_lot = partial(
            batch.DesignBatch, self.angle_deg[self.traced], lattices, each, most, mode, in_space, Limits()
        )
        shape = (len(sensors), self.width.shape[1], len(self.angle_deg))
        right, left, u = (np.full(shape, math.nan) for _ in range(3))
        self.responses = Responses(right, left, u, np.full(len(sensors), math.nan), [""] * len(sensors))

    def _mirrors(self) -> bool:
        """Return whether every response follows from one side by symmetry, and that side needs fewer rays than both."""
        numbers = self.numbers.body
        symmetric = all(_is_symmetric(batch.Y(*row)) for row in numbers.tolist())
        low, high = self.offset - 0.5 * self.width, self.offset + 0.5 * self.width
        reach = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
        return symmetric and bool(np.all(high.max(axis=1) - low.min(axis=1) >= reach))

    def trace(self, d: int) -> None:
        """Trace a sensor and write its response."""
        if not hasattr(self.lots, "mine"):
            self.lots.mine = self.new_lot()
        where = self._places(d)
        found = self.lots.mine.traced(self.numbers, d, where.bins, self.seed)
        out = self.responses
        out.why[d] = self._why_not(d, self.angle_deg[self.traced[found.sound != batch.SOUND]])
        if out.why[d]:
            return
        if np.any(found.sound < batch.UNSURE):
            raise AssertionError("a body that the batch refuses is a scene")
        by_bin = np.moveaxis(self._all_angles(found.power), -1, 0)
        right, left = where.powers(by_bin)
        u = where.u_powers(by_bin).max(axis=0)
        out.right[d], out.left[d], out.u_power[d] = right.T, left.T, u.T
        out.truncated[d] = found.truncated.max(initial=0.0)

    def _why_not(self, d: int, angle_deg: FloatArray) -> str:
        """Return why a body cannot be built at one of the angles, as its scene reports."""
        try:
            for angle in angle_deg.tolist():
                self.sensors[d].scene(angle, 1)
        except DesignError as bad:
            return str(bad)
        return ""

    def _places(self, d: int) -> Places:
        """Return the positions of a sensor's chips, computed once for consecutive sensors with the same chips."""
        key = (self.width[d].tobytes(), self.offset[d].tobytes())
        where = self.places.get(key)
        if where is None:
            where = Places.of(Chips(self.width[d], self.offset[d]), self.lattices, self.both)
            self.places = {key: where}
        return where

    def _all_angles(self, power: FloatArray) -> FloatArray:
        """Return powers (A, B, 2) at all angles from those at the traced angles."""
        if not self.both:
            return power
        place = {angle: i for i, angle in enumerate(self.angle_deg[self.traced].tolist())}
        rows = []
        for angle in self.angle_deg.tolist():
            own = power[place[angle]] if angle in place else places.mirrored(power[place[-angle]])
            rows.append(0.5 * (own + places.mirrored(own)) if angle == 0.0 else own)
        return np.stack(rows)


def _is_symmetric(y: batch.Y) -> bool:
    """Return whether a sensor at every angle is the mirror image of the sensor at the opposite angle."""
    return y.lens != batch.PIECES and not (y.pivot == batch.AT_POINT and y.pivot_x != 0.0)


def _of_each(given: ArrayLike | None, own: Sequence[float]) -> FloatArray:
    """Return numbers (D, K), one row per sensor."""
    if given is None:
        return np.array(own, dtype=float)[:, None]
    values = np.atleast_1d(np.asarray(given, dtype=float))
    if values.ndim > 2 or (values.ndim == 2 and len(values) != len(own)) or not np.all(np.isfinite(values)):
        raise DesignError("widths_mm, offsets_mm", limit=f"must be finite and of shape (K,) or ({len(own)}, K)")
    return np.broadcast_to(values, (len(own), values.shape[-1]))
