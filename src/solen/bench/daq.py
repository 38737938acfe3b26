"""Setup, samples and losses of a DAQ device, independent of the model.

The device samples the receivers many times in each emitter phase, without regard to the phases. A single ADC is
switched from input to input, so that the second input is sampled slightly later than the first. The source that
switches the emitters is specified separately: an external source, or the device's own counters, which follow the
sampling clock. `solen.bench.phases` determines afterwards when an emitter was on.

Public names: `Setup`, `Model`, `Samples`, `DaqLosses` and `MODELS`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solen.errors import BenchError

Switching = Literal["external", "counter", "lines"]
Terminal = Literal["rse", "nrse", "differential"]

SWITCH_EXTERNALLY = 'switch the emitters externally (switching = "external"), with a sync input if there are several'
MIN_PHASE_SAMPLES = 2
"""Minimum number of settled samples in an emitter phase."""
COUNT_LIMITS = np.array([[-(1 << 15)], [(1 << 15) - 1]], np.int16)
"""Lowest and highest ADC count that a sample can store."""


@dataclass(frozen=True)
class Model:
    """Capabilities of a DAQ device.

    Attributes
    ----------
    name
        Model name reported by the device.
    rate_hz, single_hz
        Highest sampling rate: in total for all inputs, or of each input if the device samples simultaneously; and of a
        single input.
    ranges_v
        Limits of its ranges, ± V.
    inputs
        Names of the inputs for each kind of wiring.
    switches
        Counters that generate pulses, each with its output terminal and the static line on the same terminal; both are
        empty strings if the driver chooses the terminal.
    lines
        Static digital outputs.
    simultaneous
        Whether each input has its own ADC.
    timed_hz
        Highest clock rate of its digital lines; 0 if they can be set by software only.
    """

    name: str
    rate_hz: float
    single_hz: float
    ranges_v: tuple[float, ...]
    inputs: Mapping[Terminal, tuple[str, ...]]
    switches: tuple[tuple[str, str, str], ...]
    lines: tuple[str, ...]
    simultaneous: bool = False
    timed_hz: float = 0.0

    def check(self, setup: "Setup") -> None:
        """Raise `BenchError` if the device cannot do what the setup requests."""
        self._check_channels(setup)
        self._check_rate(setup)
        if setup.range_v not in self.ranges_v:
            ranges = ", ".join(f"±{range_v:g}" for range_v in self.ranges_v)
            limit = f"must be a range of {self.name}: {ranges} V" if ranges else f"{self.name} has no bipolar range"
            raise BenchError("daq.range_v", value=setup.range_v, limit=limit)
        for key, line in setup.static_lines.items():
            if line not in self.lines:
                limit = f"{self.name} has no static outputs"
                if self.lines:
                    limit = f"must be a static output of {self.name}, {self.lines[0]} to {self.lines[-1]}"
                raise BenchError(f"daq.{key}", value=line, limit=limit)
        if setup.switching == "counter":
            self._check_counters(setup)
        elif setup.switching == "lines":
            self._check_lines(setup)

    def highest_hz(self, channels: int) -> float:
        """Return the highest sampling rate per input for a given number of inputs."""
        if channels == 1:
            return self.single_hz
        return self.rate_hz if self.simultaneous else self.rate_hz / channels

    def _check_channels(self, setup: "Setup") -> None:
        known = self.inputs.get(setup.terminal, ())
        if not known:
            limit = f"{self.name} has no analog inputs"
            if self.inputs:
                limit = f"must be a wiring of {self.name}: {', '.join(self.inputs)}"
            raise BenchError("daq.terminal", value=setup.terminal, limit=limit)
        for channel in setup.channels:
            if channel not in known:
                limit = f"must be one of the {setup.terminal} inputs of {self.name}, {known[0]} to {known[-1]}"
                pairs = ", and the first input of a pair" if setup.terminal == "differential" else ""
                raise BenchError("daq.channels", value=channel, limit=limit + pairs)

    def _check_rate(self, setup: "Setup") -> None:
        channels = len(setup.channels)
        highest = self.highest_hz(channels)
        if setup.rate_hz <= highest:
            return
        limit = f"is above the highest rate of an input of {self.name}, {highest:.0f} samples per second"
        if channels > 1 and not self.simultaneous:
            limit = (
                f"gives {setup.rate_hz * channels:.0f} samples per second for {channels} inputs, but the single ADC of "
                f"{self.name} takes at most {self.rate_hz:.0f}"
            )
        raise BenchError("daq.rate_hz", value=setup.rate_hz, limit=limit, remedy=f"specify {highest:.0f} or less")

    def _check_counters(self, setup: "Setup") -> None:
        if setup.emitters > len(self.switches):
            count = len(self.switches)
            counters = "1 counter that generates" if count == 1 else f"{count or 'no'} counters that generate"
            limit = f"is more than {self.name} can alternate: it has {counters} pulses"
            remedy = 'set switching = "lines" to use its digital outputs' if self.timed_hz else SWITCH_EXTERNALLY
            raise BenchError("sensor.emitter", value=setup.emitters, limit=limit, remedy=remedy)
        counter_lines = [line for _, _, line in self.switches[: setup.emitters]]
        for key, line in setup.static_lines.items():
            if line in counter_lines:
                limit = "is the line on which a counter switches an emitter"
                raise BenchError(f"daq.{key}", value=line, limit=limit, remedy="specify another static output")

    def _check_lines(self, setup: "Setup") -> None:
        """Check that the lines that switch emitters can follow the sampling clock."""
        if setup.rate_hz > self.timed_hz:
            limit = f"is impossible: the digital outputs of {self.name} are set by software only"
            if self.timed_hz:
                limit = f"requires daq.rate_hz of at most {self.timed_hz:g}, the limit of the outputs of {self.name}"
            raise BenchError("daq.switching", value="lines", limit=limit, remedy=SWITCH_EXTERNALLY)
        for line in setup.lines:
            if line not in self.lines or line in setup.static_lines.values():
                limit = f"must be an unused digital output of {self.name}, {self.lines[0]} to {self.lines[-1]}"
                raise BenchError("daq.lines", value=line, limit=limit)


def _analog_inputs(*ranges: range) -> tuple[str, ...]:
    return tuple(f"ai{number}" for numbers in ranges for number in numbers)


MODELS = {
    # National Instruments, USB-621x user manual and specifications: one 16-bit ADC, 250 kS/s in total; AI 0 to 31, of
    # which n and n + 8 form a pair; P1.0 to P1.7 on PFI 4 to 7 and 12 to 15 output static levels or counter pulses.
    "USB-6218": Model(
        "USB-6218",
        250_000.0,
        250_000.0,
        (0.2, 1.0, 5.0, 10.0),
        {
            "rse": _analog_inputs(range(32)),
            "nrse": _analog_inputs(range(32)),
            "differential": _analog_inputs(range(8), range(16, 24)),
        },
        (("ctr0", "PFI4", "port1/line0"), ("ctr1", "PFI5", "port1/line1")),
        tuple(f"port1/line{number}" for number in range(8)),
    )
}
"""Models that can be simulated, and against which rig files are checked when they are read."""


@dataclass(frozen=True)
class Setup:
    """Settings of a DAQ device.

    Attributes
    ----------
    channels
        The device's names of the analog inputs, in the order of the rig's inputs; the sync input is last.
    synced
        Whether the last channel records the sync, which is high while emitter 1 is on.
    rate_hz
        Samples of each channel per second.
    emitters, switch_hz
        Number of alternating emitters, and the frequency of each.
    switching, lines
        ``external``, ``counter`` for the device's own counters, or ``lines``: digital outputs, one for each emitter,
        that follow the sampling clock.
    model, range_v, terminal
        The model (if empty, the device is queried), its range ± V, and the wiring of its inputs.
    enable
        A static digital output that is high while samples are taken.
    alive
        A static digital output that toggles with each reading, for an external watchdog.
    settle_us
        Time after each switch whose samples are omitted, in µs.
    buffer_s
        Size of the computer's buffer, in s.

    Raises
    ------
    BenchError
        If the settings contradict each other, or the device does not support them.
    """

    channels: tuple[str, ...]
    synced: bool
    rate_hz: float
    emitters: int
    switch_hz: float
    switching: Switching = "external"
    model: str = ""
    range_v: float = 10.0
    terminal: Terminal = "rse"
    enable: str | None = None
    alive: str | None = None
    settle_us: float = 300.0
    buffer_s: float = 10.0
    lines: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(set(self.channels)) < len(self.channels):
            raise BenchError("daq.channels", value=", ".join(self.channels), limit="must not contain an input twice")
        if self.model in MODELS:
            MODELS[self.model].check(self)
        self._check_phase()
        self._check_slots()
        if self.switching == "external" and self.emitters > 1 and not self.synced:
            limit = f"is required with {self.emitters} alternating emitters: nothing else shows which of them is on"
            remedy = "record the signal that switches emitter 1, or switch all emitters at once"
            raise BenchError("daq.sync", limit=limit, remedy=remedy)
        if self.alive is not None and self.alive == self.enable:
            raise BenchError("daq.alive", value=self.alive, limit="must not be the line of daq.enable")

    @property
    def static_lines(self) -> dict[str, str]:
        """Lines that the program sets, keyed by their keys in the rig file."""
        lines = {"enable": self.enable, "alive": self.alive}
        return {key: line for key, line in lines.items() if line is not None}

    @property
    def inputs(self) -> int:
        """Number of channels other than the sync."""
        return len(self.channels) - self.synced

    @property
    def frame(self) -> int:
        """Number of samples in a frame: about one period of the emitters."""
        return max(1, round(self.rate_hz / self.switch_hz))

    def _check_slots(self) -> None:
        """Check the lines that follow the sampling clock.

        There must be one line for each emitter, and an integer number of samples in each half of a slot.
        """
        if (self.switching == "lines") != bool(self.lines):
            limit = 'are required with switching = "lines", and invalid otherwise'
            raise BenchError("daq.lines", value=", ".join(self.lines) or None, limit=limit)
        if self.switching != "lines":
            return
        if len(self.lines) != self.emitters or len(set(self.lines)) < self.emitters:
            limit = f"must be {self.emitters} different lines, one for each emitter"
            raise BenchError("daq.lines", value=", ".join(self.lines), limit=limit)
        phases_hz = 2 * self.emitters * self.switch_hz
        if abs(self.rate_hz / phases_hz - round(self.rate_hz / phases_hz)) > 1e-9:
            limit = f"must be a multiple of {phases_hz:g} Hz, the rate at which the lines change"
            raise BenchError("daq.rate_hz", value=self.rate_hz, limit=limit)

    def _check_phase(self) -> None:
        phase_s = 0.5 / (self.switch_hz * self.emitters)
        settled = (phase_s - 1e-6 * self.settle_us) * self.rate_hz
        if settled < MIN_PHASE_SAMPLES:
            limit = (
                f"gives {max(settled, 0.0):.1f} samples in a phase of {1e6 * phase_s:.0f} µs after "
                f"{self.settle_us:g} µs of settling; {MIN_PHASE_SAMPLES} are needed"
            )
            remedy = "increase daq.rate_hz, or reduce daq.settle_us"
            raise BenchError("daq.rate_hz", value=self.rate_hz, limit=limit, remedy=remedy)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples without a gap.

    Attributes
    ----------
    segment
        Number of the gapless segment, from 0; it increases by one after each gap.
    first
        Index of the first sample in the segment.
    counts
        Shape (N, channels).
    notices
        Events since the last samples.
    """

    segment: int
    first: int
    counts: NDArray[np.int16]
    notices: tuple[str, ...] = ()


@dataclass
class DaqLosses:
    """Samples that were lost.

    Attributes
    ----------
    samples
        Lost samples of each channel, estimated from the duration of the gaps by the clock of the run.
    overruns
        Number of times that the device or a buffer was full, after which a new segment began.
    """

    samples: int = 0
    overruns: int = 0


def volts_of(counts: NDArray[np.int16], coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert counts (N, channels) to volts with the polynomial of each channel.

    The coefficients have the shape (channels, order + 1), the lowest power first.
    """
    volts = np.broadcast_to(coefficients[:, -1], counts.shape).astype(float)
    for power in range(coefficients.shape[1] - 2, -1, -1):
        volts = volts * counts + coefficients[:, power]
    return np.asarray(volts)


def limits_of(coefficients: NDArray[np.float64], range_V: ArrayLike | None = None) -> NDArray[np.float64]:
    """Return the lowest and highest voltage (2, channels): limits of the counts, or of the range if it is narrower."""
    counts = np.repeat(COUNT_LIMITS, len(coefficients), axis=1)
    low, high = volts_of(counts, coefficients)
    range_limits = np.stack([low, high], axis=1) if range_V is None else np.asarray(range_V)
    return np.stack([np.maximum(low, range_limits[:, 0]), np.minimum(high, range_limits[:, 1])])
