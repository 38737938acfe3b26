"""Setup, samples and losses of a data acquisition, whichever instrument it is.

The idea: it samples the receivers as they are, many times in each phase of the emitters, and knows nothing of phases.
One converter is switched from input to input, so that a sample of the second input is a little later than that of the
first. What switches the emitters is stated separately: something outside, or the instrument's own counters, which run
by the clock of the samples. When an emitter is on is found afterwards (`solen.bench.phases`).

The interface: `Setup`, checked before the hardware is touched; `Samples` that came, `DaqLosses` that did not; `MODELS`,
the instruments whose limits are known.
"""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solen.errors import BenchError

Switching = Literal["external", "counter"]
Terminal = Literal["rse", "nrse", "differential"]

LEAST_IN_PHASE = 2
"""Settled samples of a phase of the emitters, at the least."""


@dataclass(frozen=True)
class Model:
    """Limits of an instrument.

    Attributes
    ----------
    name
        As the instrument itself tells it.
    rate_hz
        Highest number of samples per second of all inputs together.
    ranges_v
        Ends of its ranges, ± V.
    single, differential
        Numbers of its inputs for each way of wiring.
    switches
        Counters, each with the terminal on which its pulses come out and the static line on the same terminal.
    lines
        Static digital outputs.
    """

    name: str
    rate_hz: float
    ranges_v: tuple[float, ...]
    single: tuple[int, ...]
    differential: tuple[int, ...]
    switches: tuple[tuple[str, str, str], ...]
    lines: tuple[str, ...]


MODELS = {
    # National Instruments, USB-621x user manual and specifications: one 16-bit converter, 250 kS/s in all; AI 0 to 31,
    # of which n and n + 8 make a pair; P1.0 to P1.7 on PFI 4 to 7 and 12 to 15 put out static levels or counters.
    "USB-6218": Model(
        "USB-6218",
        250_000.0,
        (0.2, 1.0, 5.0, 10.0),
        tuple(range(32)),
        (*range(8), *range(16, 24)),
        (("ctr0", "PFI4", "port1/line0"), ("ctr1", "PFI5", "port1/line1")),
        tuple(f"port1/line{number}" for number in range(8)),
    )
}


@dataclass(frozen=True)
class Setup:
    """What is asked of a data acquisition.

    Attributes
    ----------
    channels
        Its analog inputs, as the instrument calls them, in the order of the rig's inputs; a sync comes last.
    synced
        Whether the last channel records what switches the emitters: high while emitter 1 is on.
    rate_hz
        Samples of each channel per second.
    emitters, switch_hz
        How many take turns, and how often each is lit per second.
    switching
        ``external``, or ``counter`` for the instrument's own.
    model, range_v, terminal
        The instrument, its range ± V, and how inputs are wired.
    enable
        A static digital output that is high while samples are taken.
    alive
        One that changes its level with each reading, for a watchdog outside.
    settle_us
        Left out after each switch.
    buffer_s
        What the computer holds until it is read.

    Raises
    ------
    BenchError
        Where the instrument cannot do it.
    """

    channels: tuple[str, ...]
    synced: bool
    rate_hz: float
    emitters: int
    switch_hz: float
    switching: Switching = "external"
    model: str = "USB-6218"
    range_v: float = 10.0
    terminal: Terminal = "rse"
    enable: str | None = None
    alive: str | None = None
    settle_us: float = 300.0
    buffer_s: float = 10.0

    def __post_init__(self) -> None:
        model = MODELS[self.model]
        self._check_channels(model)
        self._check_rate(model)
        if self.range_v not in model.ranges_v:
            ranges = ", ".join(f"{one:g}" for one in model.ranges_v)
            raise BenchError("daq.range_v", value=self.range_v, limit=f"{self.model} has ±{ranges} V")
        if self.switching == "counter":
            self._check_counters(model)
        elif self.emitters > 1 and not self.synced:
            limit = f"is needed with {self.emitters} emitters in turn: nothing else tells which of them is on"
            raise BenchError("daq.sync", limit=limit, remedy="record what lights emitter 1, or light all at once")
        for key, line in (("enable", self.enable), ("alive", self.alive)):
            if line is not None and line not in model.lines:
                limit = f"must be one of {self.model}'s static outputs, {model.lines[0]} to {model.lines[-1]}"
                raise BenchError(f"daq.{key}", value=line, limit=limit)
        if self.alive is not None and self.alive == self.enable:
            raise BenchError("daq.alive", value=self.alive, limit="is the line of daq.enable")

    @property
    def inputs(self) -> int:
        """Channels that are receivers."""
        return len(self.channels) - self.synced

    @property
    def frame(self) -> int:
        """Samples that are kept together: about those of a period of the emitters."""
        return max(1, round(self.rate_hz / self.switch_hz))

    def _check_channels(self, model: Model) -> None:
        known = model.differential if self.terminal == "differential" else model.single
        for channel in self.channels:
            match = re.fullmatch(r"ai(\d+)", channel)
            if match is None or int(match[1]) not in known:
                limit = f"is not among the {self.terminal} inputs of {self.model}: ai{known[0]} to ai{known[-1]}"
                pairs = ", without the second inputs of pairs" if self.terminal == "differential" else ""
                raise BenchError("daq.channels", value=channel, limit=limit + pairs)
        if len(set(self.channels)) < len(self.channels):
            raise BenchError("daq.channels", value=", ".join(self.channels), limit="name an input twice")

    def _check_rate(self, model: Model) -> None:
        total = self.rate_hz * len(self.channels)
        if total > model.rate_hz:
            limit = (
                f"of {len(self.channels)} inputs are {total:.0f} samples per second; one converter serves all inputs "
                f"of {self.model} and takes {model.rate_hz:.0f}"
            )
            remedy = f"{model.rate_hz / len(self.channels):.0f} or less"
            raise BenchError("daq.rate_hz", value=self.rate_hz, limit=limit, remedy=remedy)
        phase_s = 0.5 / (self.switch_hz * self.emitters)
        settled = (phase_s - 1e-6 * self.settle_us) * self.rate_hz
        if settled < LEAST_IN_PHASE:
            limit = (
                f"leaves {max(settled, 0.0):.1f} samples of a phase of {1e6 * phase_s:.0f} µs after "
                f"{self.settle_us:g} µs of settling; {LEAST_IN_PHASE} are needed"
            )
            raise BenchError("daq.rate_hz", value=self.rate_hz, limit=limit, remedy="sample faster or settle less")

    def _check_counters(self, model: Model) -> None:
        if self.emitters > len(model.switches):
            limit = f"take turns; {self.model} has {len(model.switches)} counters, and its other outputs are not timed"
            remedy = 'light them all at once, or by something outside (switching = "external" with a sync)'
            raise BenchError("sensor.emitter", value=self.emitters, limit=limit, remedy=remedy)
        taken = [line for _, _, line in model.switches[: self.emitters]]
        for key, line in (("enable", self.enable), ("alive", self.alive)):
            if line in taken:
                raise BenchError(f"daq.{key}", value=line, limit="is the line on which a counter lights an emitter")


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples without a gap.

    Attributes
    ----------
    stretch
        One more after each gap, from 0.
    first
        Number of the first sample since the stretch began.
    counts
        Shape (N, channels).
    remarks
        What happened since the last samples.
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
        Of each channel, by the clock of the run: as many as fit between the last that came and the next stretch.
    overruns
        How often the instrument or its buffer was full, so that a new stretch began.
    """

    samples: int = 0
    overruns: int = 0


def volts_of(counts: NDArray[np.int16], coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Volts (N, channels) of counts by each channel's polynomial (channels, order + 1), lowest power first."""
    volts = np.broadcast_to(coefficients[:, -1], counts.shape).astype(float)
    for power in range(coefficients.shape[1] - 2, -1, -1):
        volts = volts * counts + coefficients[:, power]
    return np.asarray(volts)
