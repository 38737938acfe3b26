"""Recordings whose truth is known: a protocol, a response with hysteresis, and what a rig adds to it."""

from dataclasses import dataclass, replace

import numpy as np

from solen.analysis import Signals
from solen.arrays import FloatArray

LEVELS = (0.0, 3.0, 0.0, -3.0)
"""Levels of one cycle of the paper; it comes back to the first."""


@dataclass(frozen=True)
class Protocol:
    """Levels of a cycle, how fast they are reached and how long each is held."""

    levels_deg: tuple[float, ...] = LEVELS
    speed_deg_per_s: float = 15.0
    hold_s: float = 0.8
    rest_hold_s: float = 0.0
    cycles: float = 6
    before_s: float = 1.0
    after_s: float = 1.0

    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Times and angles between which the angle is straight."""
        rest = self.levels_deg[0]
        times, angles = [0.0, self.before_s], [rest, rest]
        for place in range(1, round(self.cycles * len(self.levels_deg)) + 1):
            level = self.levels_deg[place % len(self.levels_deg)]
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
        """When each cycle leaves its rest."""
        took = sum(
            abs(a - b) / self.speed_deg_per_s
            for a, b in zip(self.levels_deg, (*self.levels_deg[1:], self.levels_deg[0]), strict=True)
        )
        took += self.hold_s * (len(self.levels_deg) - self.levels_deg.count(self.levels_deg[0]))
        took += self.rest_hold_s * self.levels_deg.count(self.levels_deg[0])
        return np.asarray(self.before_s + took * np.arange(int(self.cycles)), dtype=np.float64)


@dataclass(frozen=True)
class Truth:
    """What a made recording has in it."""

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
        """Left and right, (n, 2): a rising angle brightens the left, so that its voltage falls."""
        shape = np.tanh(angle_deg / self.width_deg)
        return np.column_stack([self.offset_V - self.swing_V * shape, self.offset_V + self.swing_V * shape])


def made(truth: Truth, label: str = "S1") -> Signals:
    """Signals of a truth."""
    draw = np.random.default_rng(truth.seed)
    end = truth.protocol.corners()[0][-1]
    time_s = np.arange(0.0, end, 1.0 / truth.rate_hz)
    time_s = np.sort(time_s + truth.irregular / truth.rate_hz * draw.uniform(-0.5, 0.5, time_s.size))
    angle = truth.protocol.angle_deg(time_s)
    volts = truth.response_V(angle) + _hysteresis(angle)[:, None] * 0.5 * truth.hysteresis_V
    volts += truth.drift_V_per_min * time_s[:, None] / 60.0
    volts += truth.flicker_V * np.sin(2.0 * np.pi * truth.flicker_hz * time_s + 0.3)[:, None]
    volts += truth.noise_V * draw.standard_normal(volts.shape)
    shown = angle + truth.angle_noise_deg * draw.standard_normal(angle.size)
    if truth.angle_step_deg:
        shown = truth.angle_step_deg * np.round(shown / truth.angle_step_deg)
    if truth.rails_V is not None:
        volts = np.clip(volts, *truth.rails_V)
    return Signals(label, ("left", "right"), time_s, shown, volts, truth.lens, f"{label}.csv")


def _hysteresis(angle: FloatArray) -> FloatArray:
    """1 on rising ways, −1 on falling ones; kept through a hold."""
    sign = np.sign(np.diff(angle, prepend=angle[0]))
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(sign.size), 0))
    return sign[last]


def part(signals: Signals, start_s: float, stop_s: float) -> Signals:
    """Signals between two times."""
    held = (signals.time_s >= start_s) & (signals.time_s < stop_s)
    kept = (signals.time_s[held], signals.angle_deg[held], signals.volts[held])
    return replace(signals, time_s=kept[0], angle_deg=kept[1], volts=kept[2])
