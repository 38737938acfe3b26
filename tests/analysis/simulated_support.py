"""Simulated recordings with known true values: a protocol, a response with hysteresis, and errors of a rig."""

from dataclasses import dataclass, replace

import numpy as np

from solen.analysis import Signals
from solen.arrays import FloatArray

LEVELS = (0.0, 3.0, 0.0, -3.0)
"""Levels of one cycle of the paper; the next cycle begins at the first level again."""


@dataclass(frozen=True)
class Protocol:
    """Levels of a cycle, speed between them, and duration of each hold."""

    levels_deg: tuple[float, ...] = LEVELS
    speed_deg_per_s: float = 15.0
    hold_s: float = 0.8
    rest_hold_s: float = 0.0
    cycles: float = 6
    before_s: float = 1.0
    after_s: float = 1.0

    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Return the times and angles at which the speed changes."""
        rest = self.levels_deg[0]
        times, angles = [0.0, self.before_s], [rest, rest]
        for index in range(1, round(self.cycles * len(self.levels_deg)) + 1):
            level = self.levels_deg[index % len(self.levels_deg)]
            times.append(times[-1] + abs(level - angles[-1]) / self.speed_deg_per_s)
            angles.append(level)
            hold = self.rest_hold_s if level == rest else self.hold_s
            if hold:
                times.append(times[-1] + hold)
                angles.append(level)
        return np.array([*times, times[-1] + self.after_s]), np.array([*angles, angles[-1]])

    def angle_deg(self, time_s: FloatArray) -> FloatArray:
        return np.asarray(np.interp(time_s, *self.corners()), dtype=np.float64)

    def starts_s(self) -> FloatArray:
        """Return the times at which the cycles leave the first level."""
        duration_s = sum(
            abs(a - b) / self.speed_deg_per_s
            for a, b in zip(self.levels_deg, (*self.levels_deg[1:], self.levels_deg[0]), strict=True)
        )
        duration_s += self.hold_s * (len(self.levels_deg) - self.levels_deg.count(self.levels_deg[0]))
        duration_s += self.rest_hold_s * self.levels_deg.count(self.levels_deg[0])
        return np.asarray(self.before_s + duration_s * np.arange(int(self.cycles)), dtype=np.float64)


@dataclass(frozen=True)
class Truth:
    """True values of a simulated recording."""

    protocol: Protocol = Protocol()
    rate_hz: float = 200.0
    swing_V: float = 1.0
    offset_V: float = 2.0
    width_deg: float = 2.0
    hysteresis_V: float = 0.0
    noise_V: float = 0.0
    drift_V_per_min: float = 0.0
    angle_noise_deg: float = 0.0
    angle_step_deg: float = 0.0
    flicker_V: float = 0.0
    flicker_hz: float = 100.0
    irregular: float = 0.0
    rails_V: tuple[float, float] | None = None
    lens: bool | None = None
    seed: int = 1

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        """Return the left and right voltages, (n, 2): the left receiver gets brighter as the angle rises."""
        shape = np.tanh(angle_deg / self.width_deg)
        return np.column_stack([self.offset_V - self.swing_V * shape, self.offset_V + self.swing_V * shape])


def simulated(truth: Truth, label: str = "S1") -> Signals:
    """Return the signals of a recording with given true values."""
    rng = np.random.default_rng(truth.seed)
    end = truth.protocol.corners()[0][-1]
    time_s = np.arange(0.0, end, 1.0 / truth.rate_hz)
    time_s = np.sort(time_s + truth.irregular / truth.rate_hz * rng.uniform(-0.5, 0.5, time_s.size))
    angle = truth.protocol.angle_deg(time_s)
    volts = truth.response_V(angle) + _hysteresis(angle)[:, None] * 0.5 * truth.hysteresis_V
    volts += truth.drift_V_per_min * time_s[:, None] / 60.0
    volts += truth.flicker_V * np.sin(2.0 * np.pi * truth.flicker_hz * time_s + 0.3)[:, None]
    volts += truth.noise_V * rng.standard_normal(volts.shape)
    measured = angle + truth.angle_noise_deg * rng.standard_normal(angle.size)
    if truth.angle_step_deg:
        measured = truth.angle_step_deg * np.round(measured / truth.angle_step_deg)
    if truth.rails_V is not None:
        volts = np.clip(volts, *truth.rails_V)
    return Signals(label, ("left", "right"), time_s, measured, volts, truth.lens, f"{label}.csv")


def _hysteresis(angle: FloatArray) -> FloatArray:
    """Return 1 while the angle rises and −1 while it falls; a hold keeps the sign of the preceding motion."""
    sign = np.sign(np.diff(angle, prepend=angle[0]))
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(sign.size), 0))
    return sign[last]


def section(signals: Signals, start_s: float, stop_s: float) -> Signals:
    """Return the signals between two times."""
    kept = (signals.time_s >= start_s) & (signals.time_s < stop_s)
    return replace(signals, time_s=signals.time_s[kept], angle_deg=signals.angle_deg[kept], volts=signals.volts[kept])
