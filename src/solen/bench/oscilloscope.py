"""Oscilloscopes as receivers, by VISA: each acquisition becomes one reading of every input.

An oscilloscope is set up by hand, or by commands of the rig, to record some periods of the emitters. It is triggered,
and its channels are read as bytes together with the numbers that convert them to volts. In steady light a reading is
the mean of the record. With switched emitters it is the means of on and off, which a sync on another channel
distinguishes (`solen.bench.phases`): a record is too short to find the switching in the signal. Records are not kept.

The meaning of the preamble's numbers differs by manufacturer: Keysight, InfiniiVision Programmer's Guide,
``:WAVeform``; Rigol, DS1000Z Programming Guide, ``:WAVeform``. Others are not supported.

Public name: `Oscilloscope`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.bench.clock import Clock
from solen.bench.daq import Setup
from solen.bench.meter import AskingMeter, Reading, steady
from solen.bench.phases import clock_of, states
from solen.bench.visa import Scpi, all_or_none
from solen.errors import DataError

MIN_CODE, MAX_CODE = 1, 255
"""Bytes at and beyond which a sample is off the screen; 0 means no sample on a Keysight."""
LOOK_S = 0.01
MIN_SAMPLES = 2


@dataclass(frozen=True)
class Dialect:
    """Commands of one manufacturer's oscilloscopes, and the conversion of a byte to volts.

    Attributes
    ----------
    setup
        Commands before the first acquisition.
    acquire
        Commands of one acquisition, for the channels, each with whether the question is then answered by ``answer``, or
        no longer.
    done
        The question that is answered by ``answer`` when the record is complete.
    volts
        Volts of bytes, by the increment, origin and reference of the preamble.
    joins
        Whether a command and a question may be sent as one message: over a network two messages cost a delay.
    """

    setup: tuple[str, ...]
    acquire: Callable[[tuple[str, ...]], tuple[tuple[str, bool], ...]]
    done: str
    answer: str
    volts: Callable[[FloatArray, float, float, float], FloatArray]
    joins: bool


DIALECTS = {
    "KEYSIGHT": Dialect(
        (":TRIG:SWE AUTO", ":WAV:FORM BYTE", ":WAV:UNS 1"),
        lambda channels: ((":DIG " + ",".join(f"CHAN{channel}" for channel in channels), True),),
        "*OPC?",
        "1",
        lambda byte, increment, origin, reference: (byte - reference) * increment + origin,
        joins=True,
    ),
    "RIGOL": Dialect(
        (":WAV:MODE NORM", ":WAV:FORM BYTE"),
        lambda _: ((":STOP", True), (":SING", False), (":TFOR", True)),  # before it is armed it reports the last record
        ":TRIG:STAT?",
        "STOP",
        lambda byte, increment, origin, reference: (byte - origin - reference) * increment,
        joins=False,
    ),
}
DIALECTS["AGILENT"] = DIALECTS["KEYSIGHT"]


class Oscilloscope(AskingMeter):
    """Channels of an oscilloscope.

    Parameters
    ----------
    clock
        Clock of the run.
    address
        Its VISA address.
    channels, sync
        Channels of the inputs, and of the switching signal; None in steady light.
    setup
        Commands before the first acquisition.
    switch_hz, settle_us
        Frequency of the emitters, and the time that is omitted after each switch, with a sync.
    backend, answer_s
        PyVISA's name of the library, and the longest duration of an answer and an acquisition.

    Raises
    ------
    BenchError
        If it is not connected, has none of `DIALECTS`, or rejects a command.
    """

    def __init__(
        self,
        clock: Clock,
        address: str,
        channels: tuple[str, ...],
        *,
        sync: str | None = None,
        setup: tuple[str, ...] = (),
        switch_hz: float = 200.0,
        settle_us: float = 300.0,
        backend: str = "@py",
        answer_s: float = 5.0,
    ) -> None:
        self._scope = Scpi(address, backend=backend, answer_s=answer_s)
        with all_or_none([self._scope]):
            maker = self._scope.identity.split(",")[0].split(" ")[0].upper()
            if maker not in DIALECTS:
                limit = f"is {self._scope.identity!r}; supported are those of {', '.join(DIALECTS)}"
                raise self._scope.refusal(limit, "use a data acquisition, or a multimeter for each input")
            self._dialect = DIALECTS[maker]
            self._scope.commanded((*self._dialect.setup, *setup))
        self._channels = channels if sync is None else (*channels, sync)
        self._switch_hz, self._settle_us = switch_hz, settle_us
        self._answer_s = answer_s
        super().__init__(self._scope.identity, clock, inputs=len(channels), unit="V", switched=sync is not None)

    def measure(self) -> Reading:
        """Return the reading of one acquisition."""
        sent_s = self._clock.now_s()
        for command, whole in self._dialect.acquire(self._channels):
            self._comes_to(command, whole, sent_s)
        t_s = self._clock.now_s()
        waves = [self._wave(channel) for channel in self._channels]
        sizes = [len(wave[0]) for wave in waves]
        if len(set(sizes)) > 1 or sizes[0] < MIN_SAMPLES:
            limit = f"samples are in the records of its channels; equal numbers of at least {MIN_SAMPLES} are needed"
            raise DataError(self.name, value=", ".join(map(str, sizes)), limit=limit)
        time_s, volts = waves[0][0], np.stack([wave[1] for wave in waves], axis=1)
        clipped = np.array([wave[2].any() for wave in waves[: self.inputs]])
        if not self.switched:
            return steady(sent_s, t_s, volts.mean(axis=0), clipped)
        on, off = self._phases(time_s, volts)
        return Reading(sent_s, t_s, on, off, clipped)

    def release(self) -> None:
        """Close the session."""
        self._scope.close()

    def _comes_to(self, command: str, whole: bool, sent_s: float) -> None:
        """Send a command and wait until the record is complete, or no longer is."""
        state = self._asked(command, self._dialect.done)
        while (state == self._dialect.answer) != whole:
            if self._clock.now_s() > sent_s + self._answer_s:
                what = "acquires nothing" if whole else f"does not start acquiring after {command}"
                raise self._scope.refusal(f"{what} within {self._answer_s:g} s", "does it trigger?")
            self._clock.sleep(LOOK_S)
            state = self._scope.ask(self._dialect.done)

    def _asked(self, command: str, question: str) -> str:
        """Return the answer to a question after a command."""
        if self._dialect.joins:
            return self._scope.ask(f"{command};{question}")
        self._scope.say(command)
        return self._scope.ask(question)

    def _wave(self, channel: str) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return times, volts, and which samples are off the screen."""
        preamble = self._asked(f":WAV:SOUR CHAN{channel}", ":WAV:PRE?")
        try:
            numbers = np.array([float(one) for one in preamble.split(",")])[[4, 7, 8, 9]]
        except (ValueError, IndexError):
            numbers = np.zeros(4)
        step_s, increment, origin, reference = numbers.tolist()
        if not (np.isfinite(numbers).all() and step_s > 0.0 and increment != 0.0):
            limit = f"answered {preamble[:80]!r} to :WAV:PRE?, without steps in time and volts"
            raise self._scope.refusal(limit, "see its programming guide, and check that the channel is on")
        data = np.frombuffer(self._scope.block(":WAV:DATA?"), np.uint8)
        volts = self._dialect.volts(data.astype(float), increment, origin, reference)
        return np.asarray(step_s * np.arange(len(data))), np.asarray(volts), (data <= MIN_CODE) | (data >= MAX_CODE)

    def _phases(self, time_s: FloatArray, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the means with the emitters on and off, of each input."""
        setup = Setup(self._channels, True, 1.0 / time_s[1], 1, self._switch_hz, settle_us=self._settle_us)
        clock = clock_of(time_s, volts[:, -1:], setup, self._switch_hz)
        state = states(clock, 0.0, 1e-6 * self._settle_us, 1)
        if not ((state == 1).any() and (state == 0).any()):
            raise DataError("meter.settle_us", value=self._settle_us, limit="leaves no sample of a phase")
        return volts[state == 1, : self.inputs].mean(axis=0), volts[state == 0, : self.inputs].mean(axis=0)
