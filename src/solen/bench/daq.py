"""Setup, samples and losses of a data acquisition, independent of the instrument.

The instrument samples the receivers many times in each emitter phase, without regard to the phases. A single converter
is switched from input to input, so the second input is sampled slightly later than the first. The source that switches
the emitters is specified separately: an external source, or the instrument's own counters, which follow the sampling
clock. `solen.bench.phases` determines afterwards when an emitter was on.

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

OUTSIDE = 'switch them externally (switching = "external"), with a sync input if there are several'
MIN_IN_PHASE = 2
"""Minimum number of settled samples in an emitter phase."""
ENDS = np.array([[-(1 << 15)], [(1 << 15) - 1]], np.int16)
"""Minimum and maximum count."""


@dataclass(frozen=True)
class Model:
    """Capabilities of an instrument.

    Attributes
    ----------
    name
        Name reported by the instrument.
    rate_hz, alone_hz
        Highest sampling rate: in total for all inputs, or of each input if the instrument samples simultaneously; and
        of a single input.
    ranges_v
        Limits of its ranges, ± V.
    inputs
        Number of inputs for each kind of wiring.
    switches
        Counters that generate pulses, each with its output terminal and the static line on the same terminal; empty if
        the driver chooses the terminal, or if there is no such line.
    lines
        Static digital outputs.
    simultaneous
        Whether each input has its own converter.
    timed_hz
        Highest clock rate of its digital lines; 0 if they are set by software only.
    """

    name: str
    rate_hz: float
    alone_hz: float
    ranges_v: tuple[float, ...]
    inputs: Mapping[Terminal, tuple[str, ...]]
    switches: tuple[tuple[str, str, str], ...]
    lines: tuple[str, ...]
    simultaneous: bool = False
    timed_hz: float = 0.0

    def check(self, setup: "Setup") -> None:
        """Raise `BenchError` if the instrument cannot do what the setup requests."""
        self._check_channels(setup)
        self._check_rate(setup)
        if setup.range_v not in self.ranges_v:
            ranges = ", ".join(f"{one:g}" for one in self.ranges_v) or "no range that is symmetric about 0"
            raise BenchError("daq.range_v", value=setup.range_v, limit=f"{self.name} has ±{ranges} V")
        for key, line in setup.static_lines.items():
            if line not in self.lines:
                which = (
                    f"one of {self.name}'s static outputs, {self.lines[0]} to {self.lines[-1]}" if self.lines else ""
                )
                limit = f"must be {which}" if which else (f"is not a line of {self.name}, which has no static outputs")
                raise BenchError(f"daq.{key}", value=line, limit=limit)
        if setup.switching == "counter":
            self._check_counters(setup)
        elif setup.switching == "lines":
            self._check_lines(setup)

    def highest_hz(self, channels: int) -> float:
        """Return the highest sampling rate per input for the specified number of inputs."""
        if channels == 1:
            return self.alone_hz
        return self.rate_hz if self.simultaneous else self.rate_hz / channels

    def _check_channels(self, setup: "Setup") -> None:
        known = self.inputs.get(setup.terminal, ())
        if not known:
            limit = f"is not a wiring of {self.name}, which has {', '.join(self.inputs) or 'no analog inputs'}"
            raise BenchError("daq.terminal", value=setup.terminal, limit=limit)
        for channel in setup.channels:
            if channel not in known:
                limit = f"is not among the {setup.terminal} inputs of {self.name}: {known[0]} to {known[-1]}"
                pairs = ", without the second inputs of pairs" if setup.terminal == "differential" else ""
                raise BenchError("daq.channels", value=channel, limit=limit + pairs)

    def _check_rate(self, setup: "Setup") -> None:
        channels = len(setup.channels)
        highest = self.highest_hz(channels)
        if setup.rate_hz <= highest:
            return
        limit = f"is too fast: the highest rate of an input of {self.name} is {highest:.0f} samples per second"
        if channels > 1 and not self.simultaneous:
            limit = (
                f"for {channels} inputs is {setup.rate_hz * channels:.0f} samples per second in total; one converter "
                f"serves all inputs of {self.name}, and its highest rate is {self.rate_hz:.0f}"
            )
        raise BenchError("daq.rate_hz", value=setup.rate_hz, limit=limit, remedy=f"{highest:.0f} or less")

    def _check_counters(self, setup: "Setup") -> None:
        if setup.emitters > len(self.switches):
            has = f"{len(self.switches) or 'no'} counters that generate pulses"
            others = "follow a clock" if self.timed_hz else "are not timed"
            limit = f"is too many alternating emitters; {self.name} has {has}, and its other outputs {others}"
            remedy = 'switching = "lines" uses these' if self.timed_hz else OUTSIDE
            raise BenchError("sensor.emitter", value=setup.emitters, limit=limit, remedy=remedy)
        taken = [line for _, _, line in self.switches[: setup.emitters]]
        for key, line in setup.static_lines.items():
            if line in taken:
                raise BenchError(f"daq.{key}", value=line, limit="is the line on which a counter switches an emitter")

    def _check_lines(self, setup: "Setup") -> None:
        """Check that the lines that switch emitters can follow the sampling clock."""
        if setup.rate_hz > self.timed_hz:
            follow = (
                f"follow a clock of at most {self.timed_hz:g} Hz" if self.timed_hz else "are set by the program only"
            )
            limit = f"is not possible: the digital outputs of {self.name} {follow}"
            raise BenchError("daq.switching", value="lines", limit=limit, remedy=OUTSIDE)
        for line in setup.lines:
            if line not in self.lines or line in setup.static_lines.values():
                limit = (
                    f"must be one of {self.name}'s digital outputs, {self.lines[0]} to {self.lines[-1]}, "
                    "that is not in use"
                )
                raise BenchError("daq.lines", value=line, limit=limit)


def _named(*numbers: range) -> tuple[str, ...]:
    return tuple(f"ai{number}" for some in numbers for number in some)


MODELS = {
    # National Instruments, USB-621x user manual and specifications: one 16-bit converter, 250 kS/s in total; AI 0 to
    # 31, of which n and n + 8 form a pair; P1.0 to P1.7 on PFI 4 to 7 and 12 to 15 output static levels or counters.
    "USB-6218": Model(
        "USB-6218",
        250_000.0,
        250_000.0,
        (0.2, 1.0, 5.0, 10.0),
        {
            "rse": _named(range(32)),
            "nrse": _named(range(32)),
            "differential": _named(range(8), range(16, 24)),
        },
        (("ctr0", "PFI4", "port1/line0"), ("ctr1", "PFI5", "port1/line1")),
        tuple(f"port1/line{number}" for number in range(8)),
    )
}
"""Instruments that can be simulated, and against which rig files are checked when they are read."""


@dataclass(frozen=True)
class Setup:
    """Settings of a data acquisition.

    Attributes
    ----------
    channels
        Its analogue inputs by the instrument's names, in the order of the rig's inputs; the sync input is last.
    synced
        Whether the last channel records the switching signal: high while emitter 1 is on.
    rate_hz
        Samples of each channel per second.
    emitters, switch_hz
        Number of alternating emitters, and the frequency of each.
    switching, lines
        ``external``, ``counter`` for the instrument's own counters, or ``lines``: digital outputs, one for each
        emitter, that follow the clock of the samples.
    model, range_v, terminal
        The instrument (empty: query it), its range ± V, and the wiring of its inputs.
    enable
        A static digital output that is high during acquisition.
    alive
        A static digital output that toggles with each reading, for an external watchdog.
    settle_us
        Time that is omitted after each switch.
    buffer_s
        Size of the computer's buffer.

    Raises
    ------
    BenchError
        If the instrument does not support the settings.
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
            raise BenchError("daq.channels", value=", ".join(self.channels), limit="name an input twice")
        if self.model in MODELS:
            MODELS[self.model].check(self)
        self._check_phase()
        self._check_slots()
        if self.switching == "external" and self.emitters > 1 and not self.synced:
            limit = f"is needed with {self.emitters} alternating emitters: nothing else shows which of them is on"
            raise BenchError(
                "daq.sync",
                limit=limit,
                remedy="record the signal that switches emitter 1, or switch all emitters at once",
            )
        if self.alive is not None and self.alive == self.enable:
            raise BenchError("daq.alive", value=self.alive, limit="is also the line of daq.enable")

    @property
    def static_lines(self) -> dict[str, str]:
        """Lines that the program sets, by their keys."""
        stated = {"enable": self.enable, "alive": self.alive}
        return {key: line for key, line in stated.items() if line is not None}

    @property
    def inputs(self) -> int:
        """Channels that are receivers."""
        return len(self.channels) - self.synced

    @property
    def frame(self) -> int:
        """Samples per block: about one period of the emitters."""
        return max(1, round(self.rate_hz / self.switch_hz))

    def _check_slots(self) -> None:
        """Check the lines that follow the sampling clock.

        There must be one line per emitter, and a whole number of samples in each half of a slot.
        """
        if (self.switching == "lines") != bool(self.lines):
            limit = 'are required with switching = "lines", and not allowed otherwise'
            raise BenchError("daq.lines", value=", ".join(self.lines), limit=limit)
        if self.switching != "lines":
            return
        if len(self.lines) != self.emitters or len(set(self.lines)) < self.emitters:
            limit = f"must be one for each of {self.emitters} emitters"
            raise BenchError("daq.lines", value=", ".join(self.lines), limit=limit)
        halves = 2 * self.emitters * self.switch_hz
        if abs(self.rate_hz / halves - round(self.rate_hz / halves)) > 1e-9:
            limit = f"must be a multiple of {halves:g} Hz, the rate of the halves of slots"
            raise BenchError("daq.rate_hz", value=self.rate_hz, limit=limit, remedy="lines change only with a sample")

    def _check_phase(self) -> None:
        phase_s = 0.5 / (self.switch_hz * self.emitters)
        settled = (phase_s - 1e-6 * self.settle_us) * self.rate_hz
        if settled < MIN_IN_PHASE:
            limit = (
                f"leaves {max(settled, 0.0):.1f} samples of a phase of {1e6 * phase_s:.0f} µs after "
                f"{self.settle_us:g} µs of settling; {MIN_IN_PHASE} are needed"
            )
            raise BenchError("daq.rate_hz", value=self.rate_hz, limit=limit, remedy="sample faster or settle less")


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples without a gap.

    Attributes
    ----------
    stretch
        Number of the gapless segment, from 0; it increases by one after each gap.
    first
        Number of the first sample since the segment began.
    counts
        Shape (N, channels).
    remarks
        Events since the last samples.
    """

    stretch: int
    first: int
    counts: NDArray[np.int16]
    remarks: tuple[str, ...] = ()


@dataclass
class DaqLosses:
    """Samples that were lost.

    Attributes
    ----------
    samples
        Lost samples of each channel: as many as fit, by the clock of the run, between the last that arrived and the
        next segment.
    overruns
        How often the instrument or its buffer was full, after which a new segment began.
    """

    samples: int = 0
    overruns: int = 0


def volts_of(counts: NDArray[np.int16], coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert counts to volts (N, channels) with each channel's polynomial, lowest power first.

    The polynomials have the shape (channels, order + 1).
    """
    volts = np.broadcast_to(coefficients[:, -1], counts.shape).astype(float)
    for power in range(coefficients.shape[1] - 2, -1, -1):
        volts = volts * counts + coefficients[:, power]
    return np.asarray(volts)


def ends_of(coefficients: NDArray[np.float64], limits_V: ArrayLike | None = None) -> NDArray[np.float64]:
    """Return the lowest and highest voltage (2, channels): limits of the counts, or of the range if it is narrower."""
    counts = np.repeat(ENDS, len(coefficients), axis=1)
    low, high = volts_of(counts, coefficients)
    stated = np.stack([low, high], axis=1) if limits_V is None else np.asarray(limits_V)
    return np.stack([np.maximum(low, stated[:, 0]), np.minimum(high, stated[:, 1])])
