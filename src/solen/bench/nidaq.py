"""DAQ devices of National Instruments by NI-DAQmx: inputs sampled by a clock, emitters switched by counters or lines.

The device's clock determines when samples are taken, and its driver buffers them until they are read; the program only
has to read often enough. Samples are read as counts, without the driver's scaling, whose coefficients are queried once.
The capabilities of the device are also queried (`solen.bench.nidaq_model`). Static digital outputs are set by software;
only counters, and digital lines that follow the sampling clock, can switch emitters 200 times a second. Both begin with
the first sample and run by the same quartz.

If the program reads too late, samples are overwritten: the loss is counted and reported, and a new segment begins. Any
other fault ends the run. However it ends, the tasks are released and all lines set low. The device has no watchdog: the
emitters stay on after a killed program, unless an external watchdog switches them off.

Public name: `NiDaq`. Extra ``bench``; NI-DAQmx itself has to be installed from National Instruments.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.bench.clock import Clock
from solen.bench.daq import DaqLosses, Model, Samples, Setup
from solen.bench.drivers import on_failure
from solen.bench.nidaq_emitters import clear, counter_task, lines_task
from solen.bench.nidaq_model import TERMINALS, driver_error, model_of, nidaqmx_package, property_or
from solen.errors import BenchError

OVERRUNS = {
    -200279: "samples were overwritten before the program read them",
    -200222: "the driver's buffer was full before the program read it",
    -200361: "the device's memory was full before the computer fetched the samples",
}
"""Error codes of NI-DAQmx after which sampling restarts."""
FAULTS = {
    -200170: ("has no such channel or line", "compare [daq] in the rig file with the terminals of the device"),
    -200220: ("is not known to NI-DAQmx", ""),
    -200324: ("was removed", "check its cable"),
    -201003: ("cannot be reached", "check the cable and the power"),
    -50103: ("is in use by another program or task", "close that program, or reset the device in NI MAX"),
    -200089: ("already has a task of that name", "close the other program"),
    -200081: ("cannot sample so many channels at this rate", "reduce daq.rate_hz"),
    -50405: ("was unplugged while samples were being transferred", "check its cable"),
    -50401: ("does not respond", "check its cable"),
    -88709: ("was unplugged or reset", "check its cable"),
    -88710: ("was unplugged or reset", "check its cable"),
}
"""Meanings of other error codes, and remedies."""
MAX_BITS = 16
"""Largest number of bits of an ADC whose counts can be stored."""
MAX_OVERRUNS, OVERRUN_WINDOW_S = 3, 10.0
"""Number of overruns that end the run, and the time in s in which they must occur."""


class NiDaq:
    """A real DAQ device.

    Parameters
    ----------
    clock
        Clock of the run.
    device
        Name of the device in NI-DAQmx.
    setup
        Settings of the device.

    Raises
    ------
    BenchError
        If nidaqmx or NI-DAQmx is not installed, or the device is missing, of another model, in use or faulty, or does
        not support the settings.
    """

    def __init__(self, clock: Clock, device: str, setup: Setup) -> None:
        self.losses = DaqLosses()
        self._clock, self._device = clock, device
        self._ni = nidaqmx_package()
        self._model = self._checked(setup)
        self.setup = replace(setup, model=setup.model or self._model.name)
        self.name = f"{self.setup.model} {device}"
        self._switches = self._model.switches[: setup.emitters] if setup.switching == "counter" else ()
        self._notices: list[str] = []
        self.switch_hz = setup.switch_hz
        self._tasks: list[Any] = []
        self._segment, self._next, self._begun_s = 0, 0, 0.0
        self._overruns_s: list[float] = []
        self._alive_level = False
        self._low = True
        with on_failure(self._off):
            self._lower()
            self._prepare()

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """Volts = Σ c[k] countsᵏ of each channel, shape (channels, order + 1)."""
        return self._coefficients

    @property
    def limits_V(self) -> NDArray[np.float64]:
        """Limits of the range of each channel as reported by the device, shape (channels, 2)."""
        return self._limits_V

    @property
    def no_watchdog(self) -> str | None:
        """Warning that the emitters stay on if the program is killed; None if they do not."""
        drives_emitters = self.setup.switching != "external" or self.setup.enable is not None
        if not drives_emitters or self.setup.alive is not None:
            return None
        return (
            f"{self.name} has no watchdog: a killed program leaves the emitters on; set daq.alive to a line that "
            "triggers a retriggerable monostable in their supply"
        )

    def start(self) -> None:
        """Start sampling, and switching the emitters if the device drives them."""
        with on_failure(self._off):
            if not self._tasks:
                self._prepare()
            if self.setup.enable is not None:
                self._put(self.setup.enable, True)
            self._begin()

    def read(self) -> Samples:
        """Return the samples since the last call; if some were overwritten, return only a notice."""
        channels = len(self.setup.channels)
        if not self._tasks:
            return Samples(self._segment, self._next, np.zeros((0, channels), np.int16))
        try:
            with self._translated("read"):
                stream = self._tasks[-1].in_stream
                counts = np.zeros((channels, stream.avail_samp_per_chan), np.int16)
                if counts.shape[1]:
                    reader = self._ni.stream_readers.AnalogUnscaledReader(stream)
                    reader.verify_array_shape = False  # would query the number of channels in each call
                    samples = reader.read_int16(counts, counts.shape[1], timeout=1.0)
                    counts = counts.ravel()[: channels * samples].reshape(channels, samples)
            self._check_emitters()
        except _OverrunError as bad:
            return self._restart(bad.code)
        except BenchError:
            self._off()
            raise
        if self.setup.alive is not None:
            self._alive_level = not self._alive_level
            self._put(self.setup.alive, self._alive_level)
        first, self._next = self._next, self._next + counts.shape[1]
        notices, self._notices = tuple(self._notices), []
        return Samples(self._segment, first, np.ascontiguousarray(counts.T), notices)

    def stop(self) -> None:
        """Switch the emitters off and stop sampling; raise `BenchError` if the lines cannot be set."""
        error = self._off()
        if error is not None:
            raise error

    def close(self) -> None:
        """Stop and release the device; lines that could not be set low are tried again."""
        if self._tasks or not self._low:
            self.stop()

    def _checked(self, setup: Setup) -> Model:
        """Return the capabilities of the device.

        Raises `BenchError` if its model is not that in the rig file, or if it does not support the settings.
        """
        with self._translated("find"):
            device = self._ni.system.Device(self._device)
            product = device.product_type
            if setup.model not in product:
                limit = f"is a {product}, not a {setup.model}"
                raise BenchError(f"NI-DAQmx device {self._device}", limit=limit, remedy="specify another daq.device")
            model = model_of(device, self._ni)
        model.check(setup)
        return model

    def _prepare(self) -> None:
        """Make and reserve the tasks that switch the emitters, then that of the inputs; none is started."""
        with self._translated("configure"):
            for emitter, (counter, terminal, _) in enumerate(self._switches):
                task, self.switch_hz = counter_task(self._ni, self._device, self.setup, emitter, counter, terminal)
                self._tasks.append(task)
            if self.setup.lines:
                self._tasks.append(lines_task(self._ni, self._device, self.setup))
            self._tasks.append(self._input_task())
            if self.setup.lines:
                self.switch_hz = self.rate_hz / self.setup.frame

    def _input_task(self) -> Any:
        constants, setup = self._ni.constants, self.setup
        task = self._ni.Task()
        with on_failure(lambda: clear(task, self._ni)):
            terminal_config = constants.TerminalConfiguration[TERMINALS[setup.terminal]]
            channels = [
                task.ai_channels.add_ai_voltage_chan(
                    f"{self._device}/{channel}",
                    terminal_config=terminal_config,
                    min_val=-setup.range_v,
                    max_val=setup.range_v,
                )
                for channel in setup.channels
            ]
            buffer = round(setup.buffer_s * setup.rate_hz)
            task.timing.cfg_samp_clk_timing(
                setup.rate_hz, sample_mode=constants.AcquisitionType.CONTINUOUS, samps_per_chan=buffer
            )
            task.in_stream.input_buf_size = buffer
            task.control(constants.TaskMode.TASK_COMMIT)
            self.rate_hz = float(task.timing.samp_clk_rate)
            self.convert_s = (
                self._convert_interval_s(task) if len(channels) > 1 and not self._model.simultaneous else 0.0
            )
            self._coefficients = np.array([channel.ai_dev_scaling_coeff for channel in channels], dtype=float)
            self._limits_V = np.array([(channel.ai_rng_low, channel.ai_rng_high) for channel in channels], dtype=float)
            self._check_bits([channel.ai_resolution for channel in channels])
        return task

    def _check_bits(self, bits: list[float]) -> None:
        if max(bits) > MAX_BITS:
            limit = f"has an ADC of {max(bits):g} bits; at most {MAX_BITS} can be stored"
            raise BenchError(self.name, limit=limit, remedy=f"use a device of {MAX_BITS} bits or less")

    def _convert_interval_s(self, task: Any) -> float:
        """Return the interval between channels in s, or its upper limit if the driver does not report it.

        A sample whose time is overestimated is never assigned to the previous phase.
        """
        channels = len(self.setup.channels)
        rate_hz = property_or(0.0, lambda: float(task.timing.ai_conv_rate), self._ni)
        if rate_hz:
            return 1.0 / rate_hz
        longest, shortest = 1.0 / (self.rate_hz * channels), 1.0 / self._model.rate_hz
        self._notices = [
            f"{self.name} does not report its conversion rate: successive inputs are assumed to be sampled "
            f"{1e6 * longest:.3g} µs apart, but the interval may be as short as {1e6 * shortest:.3g} µs"
        ]
        return longest

    def _begin(self) -> None:
        """Start the tasks; those of the emitters come first and wait for the start of the inputs."""
        with self._translated("start"):
            for task in self._tasks:
                task.start()
        self._next, self._begun_s = 0, self._clock.now_s()

    def _restart(self, code: int) -> Samples:
        """Count an overrun and begin another segment; raise `BenchError` after too many of them."""
        now = self._clock.now_s()
        lost = max(0, round((now - self._begun_s) * self.rate_hz) - self._next)
        self.losses.samples += lost
        self.losses.overruns += 1
        self._overruns_s = [t_s for t_s in self._overruns_s if now - t_s < OVERRUN_WINDOW_S] + [now]
        if len(self._overruns_s) >= MAX_OVERRUNS:
            self._off()
            limit = f"{OVERRUNS[code]}, {MAX_OVERRUNS} times in {OVERRUN_WINDOW_S:g} s"
            raise BenchError(self.name, limit=limit, remedy="reduce daq.rate_hz, or close other programs")
        with on_failure(self._off), self._translated("start"):
            for task in self._tasks[:-1]:
                task.stop()
            with contextlib.suppress(self._ni.errors.DaqError):  # the task of the inputs has already failed
                self._tasks[-1].stop()
            self._begin()
        self._segment += 1
        notice = f"{self.name}: {OVERRUNS[code]}; about {lost} samples of each channel are lost"
        return Samples(self._segment, 0, np.zeros((0, len(self.setup.channels)), np.int16), (notice,))

    def _check_emitters(self) -> None:
        """Raise `BenchError` if a task that switches emitters has ended; the inputs would continue without it."""
        with self._translated("switch the emitters"):
            ended = any(task.is_task_done() for task in self._tasks[:-1])
        if ended:
            limit = "has stopped switching the emitters: one of its tasks has ended"
            raise BenchError(self.name, limit=limit, remedy="check the cable and the power, and run again")

    def _off(self) -> BenchError | None:
        """Release the tasks and set all lines low; return the error if that fails."""
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            clear(task, self._ni)
        try:
            self._lower()
        except BenchError as bad:
            limit = f"its lines could not be set low, and emitters may be on ({bad})"
            return BenchError(self.name, limit=limit, remedy="switch their supply off")
        return None

    def _lower(self) -> None:
        """Set every line in use low, the enabling line first; if one fails, raise `BenchError` after the last."""
        counter_lines = tuple(line for _, _, line in self._switches if line)
        faults = []
        for line in (*self.setup.static_lines.values(), *counter_lines, *self.setup.lines):
            try:
                self._put(line, False)
            except BenchError as bad:
                faults.append(bad)
        self._low = not faults
        if faults:
            raise faults[0]

    def _put(self, line: str, high: bool) -> None:
        with self._translated("set a line"):
            task = self._ni.Task()
            try:
                task.do_channels.add_do_chan(f"{self._device}/{line}")
                writer = self._ni.stream_writers.DigitalSingleChannelWriter(task.out_stream, auto_start=True)
                writer.write_one_sample_one_line(high, timeout=1.0)
            finally:
                clear(task, self._ni)

    @contextlib.contextmanager
    def _translated(self, what: str) -> Iterator[None]:
        """Convert errors of NI-DAQmx to `BenchError`."""
        errors = self._ni.errors
        try:
            yield
        except errors.DaqError as bad:
            if what == "read" and bad.error_code in OVERRUNS:
                raise _OverrunError(bad.error_code) from None
            raise self._fault(what, bad) from None
        except (errors.DaqNotFoundError, errors.DaqNotSupportedError, errors.DaqFunctionNotSupportedError) as bad:
            raise driver_error(bad) from None

    def _fault(self, what: str, bad: Any) -> BenchError:
        code, name = bad.error_code, f"NI-DAQmx device {self._device}"
        if code == -200220:
            return BenchError(name, limit=FAULTS[code][0], remedy=self._known_devices())
        if code in FAULTS:
            limit, remedy = FAULTS[code]
            return BenchError(name, limit=f"{limit} (NI-DAQmx error {code})", remedy=remedy)
        reason = str(bad).strip().split("\n")[0]
        return BenchError(name, limit=f"cannot {what}: {reason} (NI-DAQmx error {code})")

    def _known_devices(self) -> str:
        """Return the remedy that lists the devices that are connected."""
        try:
            names = ", ".join(self._ni.system.System.local().devices.device_names)
        except self._ni.errors.Error:
            names = ""
        return f"use one of {names}" if names else "no device is connected: check the cable and NI MAX"


class _OverrunError(Exception):
    def __init__(self, code: int) -> None:
        self.code = code
