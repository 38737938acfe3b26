"""A simple simulated rig: a DAQ device that samples while the emitter is switched, and a stage log on another clock.

It is independent of solen's simulator: the response has a closed form, the circuit is a first-order low-pass, the lamps
in the room flicker, the ADC rounds and clips, and the corners of the motion are sharp or smoothed.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.signal import lfilter

from solen.arrays import FloatArray
from tests.analysis.diagnosis_support import integral
from tests.analysis.simulated_support import Protocol


@dataclass(frozen=True)
class Rig:
    """Properties of a rig in V, s and degrees; pairs of numbers are for the left and the right receiver."""

    protocol: Protocol = field(default_factory=lambda: Protocol(before_s=1.0, after_s=1.0))
    sampled_hz: float = 10_000.0
    switch_hz: float = 200.0
    ppm: float = 30.0
    start: float = 0.3
    offset_mm: float = 0.02
    width_mm: float = 0.2
    gain_V: tuple[float, float] = (7.0, 8.0)
    zero_deg: float = 0.0
    index: float = 0.0
    hysteresis_deg: float = 0.0
    dark_V: tuple[float, float] = (4.9, 4.85)
    constant_s: float = 20e-6
    room_V: float = 0.2
    lamps_V: float = 0.0
    mains_hz: float = 50.02
    drift_V_per_min: float = 0.0
    noise_V: float = 0.003
    adc_step_V: float = 5.0 / 65536
    rails_V: tuple[float, float] = (0.0, 5.0)
    log_hz: float = 50.0
    lag_s: float = 0.035
    log_noise_deg: float = 0.0005
    encoder_deg: float = 0.0
    stamp_s: float = 0.0
    smooth_s: float = 0.0
    seed: int = 1

    def angle_deg(self, time_s: FloatArray) -> FloatArray:
        """Return the angle of the stage; its speed changes linearly over ``smooth_s`` at each corner."""
        if not self.smooth_s:
            return self.protocol.angle_deg(time_s)
        times, angles = self.protocol.corners()
        fine = np.arange(-1.0, times[-1] + 1.0, 2e-4)
        width = max(1, round(self.smooth_s / 2e-4))
        smooth = np.convolve(np.interp(fine, times, angles), np.ones(width) / width, mode="same")
        return np.asarray(np.interp(time_s, fine, smooth))

    def light_V(self, angle_deg: FloatArray) -> FloatArray:
        """Return the voltages by which the emitter's light lowers the left and right signals, (n, 2)."""
        ends = [
            integral(angle_deg + self.zero_deg, np.full(angle_deg.shape, position), self.index)
            for position in (self.offset_mm + 0.5 * self.width_mm, self.offset_mm - 0.5 * self.width_mm)
        ]
        right, left = (ends[0] - ends[1]) / self.width_mm
        return np.asarray(np.column_stack([left, right]) * np.array(self.gain_V))

    def sampled(self) -> tuple[FloatArray, FloatArray]:
        """Return the times (n,) and voltages (n, 2) of the DAQ device."""
        rng = np.random.default_rng(self.seed)
        time_s = np.arange(0.0, float(self.protocol.corners()[0][-1]), 1.0 / self.sampled_hz)
        on = (time_s * self.switch_hz * (1.0 + 1e-6 * self.ppm) - self.start) % 1.0 < 0.5
        angle = self.angle_deg(time_s)
        rising = np.sign(np.gradient(angle)) * self.hysteresis_deg / 2.0
        light = on[:, None] * self.light_V(angle - rising)
        if self.constant_s:
            weight = 1.0 - np.exp(-1.0 / self.sampled_hz / self.constant_s)
            light = lfilter([weight], [1.0, weight - 1.0], light, axis=0)
        phase = 2.0 * np.pi * (2.0 * self.mains_hz * time_s + rng.uniform())
        lamps = self.lamps_V * (np.cos(phase) + 0.15 * np.cos(2.0 * phase + 1.0))
        room = self.room_V + lamps + self.drift_V_per_min * time_s / 60.0
        volts = np.array(self.dark_V) - light - room[:, None] * np.array([1.0, 0.9])
        volts += self.noise_V * rng.standard_normal(volts.shape)
        volts = self.adc_step_V * np.round(volts / self.adc_step_V)
        return time_s, np.clip(volts, *self.rails_V)

    def logged(self) -> tuple[FloatArray, FloatArray]:
        """Return the times and angles of the stage log, whose clock is ahead by ``lag_s``."""
        rng = np.random.default_rng(self.seed + 1000)
        end = float(self.protocol.corners()[0][-1])
        time_s = np.arange(rng.uniform(0.0, 1.0 / self.log_hz), end, 1.0 / self.log_hz)
        angle = self.angle_deg(time_s) + self.log_noise_deg * rng.standard_normal(time_s.size)
        if self.encoder_deg:
            angle = self.encoder_deg * np.round(angle / self.encoder_deg)
        stamps = time_s + self.lag_s
        return (self.stamp_s * np.floor(stamps / self.stamp_s) if self.stamp_s else stamps), angle

    def write(self, folder: Path, *, log: bool = True, german: bool = False, name: str = "daq.csv") -> Path:
        """Write the recording as a table or a .mat file (faster), with its angle or with a stage log, ``stage.csv``."""
        time_s, volts = self.sampled()
        columns = {"time_s": time_s, "left_V": volts[:, 0], "right_V": volts[:, 1]}
        if log:
            _table(folder / "stage.csv", dict(zip(("time_s", "angle_deg"), self.logged(), strict=True)), german=german)
        else:
            columns["angle_deg"] = self.angle_deg(time_s)
        if name.endswith(".mat"):
            savemat(folder / name, columns)
        else:
            _table(folder / name, columns, german=german)
        return folder / name


def _table(path: Path, columns: dict[str, FloatArray], *, german: bool) -> None:
    separator, decimal = (";", ",") if german else (",", ".")
    rows = np.column_stack(list(columns.values())).tolist()
    body = "\n".join(separator.join(f"{value:.6f}".replace(".", decimal) for value in row) for row in rows)
    path.write_text(f"{separator.join(columns)}\n{body}\n", encoding="utf-8")
