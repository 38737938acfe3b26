"""Oscilloscopes, by VISA: each acquisition gives one reading of every input.

An oscilloscope is set up by hand, or by commands in the rig file, to record some periods of the emitters. It is
triggered, and its channels are read as bytes together with the numbers that convert them to volts. In steady light a
reading is the mean of the record. With switched emitters it consists of the means of on and off, which a sync on
another channel distinguishes (`solen.bench.phases`); a record is too short to detect the switching in the signal.
Records are not kept.

The meaning of the numbers in the preamble depends on the manufacturer: Keysight, InfiniiVision Programmer's Guide,
``:WAVeform``; Rigol, DS1000Z Programming Guide, ``:WAVeform``. Oscilloscopes of other manufacturers are not supported.

Public name: `Oscilloscope`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.bench.clock import Clock
from solen.bench.daq import Setup
from solen.bench.drivers import on_failure
from solen.bench.meter import PolledMeter, Reading, steady_reading
from solen.bench.phases import clock_of, states
from solen.bench.visa import Scpi
from solen.errors import DataError

MIN_CODE, MAX_CODE = 1, 255
"""A byte of at most the first or at least the second value is off the screen; on a Keysight, 0 means no sample."""
POLL_S = 0.01
MIN_SAMPLES = 2


@dataclass(frozen=True)
class Dialect:
    """Commands of one manufacturer's oscilloscopes, and the conversion of bytes to volts.

    Attributes
    ----------
    setup
        Commands before the first acquisition.
    acquire
        Function that returns the commands to acquire the given channels, each with a flag: whether to wait until the
        record is complete (True), or until the previous record is discarded (False).
    state, complete
        Query of the state of the record, and the reply to it when the record is complete.
    volts
        Function that converts bytes to volts with the increment, origin and reference in the preamble.
    joins
        Whether a command and a query may be sent as one message, which saves a delay on a network.
    """

    setup: tuple[str, ...]
    acquire: Callable[[tuple[str, ...]], tuple[tuple[str, bool], ...]]
    state: str
    complete: str
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
        lambda _: (
            (":STOP", True),
            (":SING", False),
            (":TFOR", True),
        ),  # before it is armed, it reports the state of the last record
        ":TRIG:STAT?",
        "STOP",
        lambda byte, increment, origin, reference: (byte - origin - reference) * increment,
        joins=False,
    ),
}
DIALECTS["AGILENT"] = DIALECTS["KEYSIGHT"]


class Oscilloscope(PolledMeter):
    """Channels of an oscilloscope.

    Parameters
    ----------
    clock
        Clock of the run.
    address
        VISA address.
    channels, sync
        Channels of the inputs, and that of the sync; None in steady light.
    setup
        Commands before the first acquisition.
    switch_hz, settle_us
        Switching frequency of the emitters, and time after each switch whose samples are omitted; used with a sync.
    backend, timeout_s
        PyVISA's name of the library, and time limit in s for a reply and for an acquisition.

    Raises
    ------
    BenchError
        If it does not reply, is of a manufacturer that is not in `DIALECTS`, or rejects a command.
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
        timeout_s: float = 5.0,
    ) -> None:
        self._scope = Scpi(address, backend=backend, timeout_s=timeout_s)
        with on_failure(self._scope.close):
            manufacturer = self._scope.identity.split(",")[0].split(" ")[0].upper()
            if manufacturer not in DIALECTS:
                limit = f"is {self._scope.identity!r}; supported are those of {', '.join(DIALECTS)}"
                raise self._scope.error(limit, "use a DAQ device, or a multimeter for each input")
            self._dialect = DIALECTS[manufacturer]
            self._scope.send_commands((*self._dialect.setup, *setup))
        self._channels = channels if sync is None else (*channels, sync)
        self._switch_hz, self._settle_us = switch_hz, settle_us
        self._timeout_s = timeout_s
        super().__init__(self._scope.identity, clock, inputs=len(channels), unit="V", switched=sync is not None)

    def measure(self) -> Reading:
        """Return the reading of one acquisition."""
        sent_s = self._clock.now_s()
        for command, complete in self._dialect.acquire(self._channels):
            self._command_and_wait(command, complete, sent_s)
        t_s = self._clock.now_s()
        records = [self._record(channel) for channel in self._channels]
        sizes = [len(record[0]) for record in records]
        if len(set(sizes)) > 1 or sizes[0] < MIN_SAMPLES:
            limit = f"must be equal, and at least {MIN_SAMPLES}"
            raise DataError(f"{self.name}: samples by channel", value=", ".join(map(str, sizes)), limit=limit)
        time_s, volts = records[0][0], np.stack([record[1] for record in records], axis=1)
        clipped = np.array([record[2].any() for record in records[: self.inputs]])
        if not self.switched:
            return steady_reading(sent_s, t_s, volts.mean(axis=0), clipped)
        on, off = self._phase_means(time_s, volts)
        return Reading(sent_s, t_s, on, off, clipped)

    def release(self) -> None:
        """Close the session."""
        self._scope.close()

    def _command_and_wait(self, command: str, complete: bool, sent_s: float) -> None:
        """Send a command, and wait until the record is complete or, if ``complete`` is false, has been discarded."""
        state = self._command_and_query(command, self._dialect.state)
        while (state == self._dialect.complete) != complete:
            if self._clock.now_s() > sent_s + self._timeout_s:
                failure = "acquired nothing" if complete else f"did not start to acquire after {command}"
                raise self._scope.error(f"{failure} within {self._timeout_s:g} s", "check its trigger")
            self._clock.sleep(POLL_S)
            state = self._scope.query(self._dialect.state)

    def _command_and_query(self, command: str, query: str) -> str:
        """Return the reply to a query that is sent after a command."""
        if self._dialect.joins:
            return self._scope.query(f"{command};{query}")
        self._scope.write(command)
        return self._scope.query(query)

    def _record(self, channel: str) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return times, volts, and which samples are off the screen."""
        preamble = self._command_and_query(f":WAV:SOUR CHAN{channel}", ":WAV:PRE?")
        try:
            numbers = np.array([float(number) for number in preamble.split(",")])[[4, 7, 8, 9]]
        except (ValueError, IndexError):
            numbers = np.zeros(4)
        step_s, increment, origin, reference = numbers.tolist()
        if not (np.isfinite(numbers).all() and step_s > 0.0 and increment != 0.0):
            limit = f"replied {preamble[:80]!r} to :WAV:PRE?, without increments of time and voltage"
            raise self._scope.error(limit, "see its programming guide, and check that the channel is on")
        data = np.frombuffer(self._scope.query_block(":WAV:DATA?"), np.uint8)
        volts = self._dialect.volts(data.astype(float), increment, origin, reference)
        return np.asarray(step_s * np.arange(len(data))), np.asarray(volts), (data <= MIN_CODE) | (data >= MAX_CODE)

    def _phase_means(self, time_s: FloatArray, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the means of each input with the emitters on and off."""
        setup = Setup(self._channels, True, 1.0 / time_s[1], 1, self._switch_hz, settle_us=self._settle_us)
        clock = clock_of(time_s, volts[:, -1:], setup, self._switch_hz)
        state = states(clock, 0.0, 1e-6 * self._settle_us, 1)
        if not ((state == 1).any() and (state == 0).any()):
            limit = "leaves no sample with the emitters on or off"
            raise DataError("meter.settle_us", value=self._settle_us, limit=limit, remedy="reduce it")
        return volts[state == 1, : self.inputs].mean(axis=0), volts[state == 0, : self.inputs].mean(axis=0)
