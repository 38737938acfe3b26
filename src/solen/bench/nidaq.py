"""Instruments of National Instruments by NI-DAQmx: inputs sampled by their clock, emitters switched by counters.

The instrument's clock determines when samples are taken, and its driver buffers them until they are read; the program
only has to read often enough. Samples are read as counts, without the driver's scaling, whose coefficients are queried
once. The capabilities of the instrument are also queried (`solen.bench.nidaq_model`). Its static digital outputs are
set by the program, not by a clock; therefore only counters can switch emitters 200 times a second. The counters begin
with the first sample and run by the same quartz.

If the program reads too late, samples are overwritten: the loss is counted and reported, and a new segment begins. Any
other fault ends the run. However it ends, the counters are released and their lines, and the enabling line, set low.
The instrument has no watchdog: only its driver can switch off the emitters that a killed program leaves on.

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
from solen.bench.nidaq_emitters import clear, pulses, turns
from solen.bench.nidaq_model import WIRED, answer_or, model_of, nidaqmx_package, no_driver
from solen.errors import BenchError

OVERRUNS = {
    -200279: "samples were overwritten before the program read them",
    -200222: "the driver's buffer was full before the program read it",
    -200361: "the instrument's own memory was full before the computer fetched its samples",
}
"""Error codes of NI-DAQmx after which sampling restarts."""
FAULTS = {
    -200170: ("has no such channel or line", "compare the rig file's [daq] with the instrument's terminals"),
    -200220: ("is not a device that NI-DAQmx knows", ""),
    -200324: ("was removed", "check its cable"),
    -201003: ("cannot be reached", "check the cable and the power"),
    -50103: ("is in use by another program or task", "close that program, or reset the device in NI MAX"),
    -200089: ("has a task of that name already", "close the other program"),
    -200081: ("cannot sample so many channels at this rate", "lower daq.rate_hz"),
    -50405: ("was unplugged while samples were being transferred", "check its cable"),
    -50401: ("does not answer", "check its cable"),
    -88709: ("was unplugged or reset", "check its cable"),
    -88710: ("was unplugged or reset", "check its cable"),
}
"""Meaning of other error codes, and remedies."""
MAX_BITS = 16
"""Most bits of a converter; wider ones do not fit in the counts that are stored."""
MAX_OVERRUNS, WITHIN_S = 3, 10.0
"""Number of overruns, and the time in s within which they end the run."""


class NiDaq:
    """A real data acquisition.

    Parameters
    ----------
    clock
        Clock of the run.
    device
        Its name in NI-DAQmx.
    setup
        Its settings.

    Raises
    ------
    BenchError
        If nidaqmx or NI-DAQmx is not installed, or the device is missing, of another model, in use or faulty, or cannot
        do what the settings request.
    """

    def __init__(self, clock: Clock, device: str, setup: Setup) -> None:
        self.losses = DaqLosses()
        self._clock, self._device = clock, device
        self._ni = nidaqmx_package()
        self._model = self._checked(setup)
        self.setup = replace(setup, model=setup.model or self._model.name)
        self.name = f"{self.setup.model} {device}"
        self._switches = self._model.switches[: setup.emitters] if setup.switching == "counter" else ()
        self._remarks: list[str] = []
        self.switch_hz = setup.switch_hz
        self._tasks: list[Any] = []
        self._stretch, self._next, self._begun_s = 0, 0, 0.0
        self._overruns_s: list[float] = []
        self._beat = False
        self._low = True
        with on_failure(self._off):
            self._lower()
            self._prepare()

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """Calibration of its converter, by channel."""
        return self._coefficients

    @property
    def limits_V(self) -> NDArray[np.float64]:
        """Limits of each channel's range as reported by the instrument, shape (channels, 2)."""
        return self._limits_V

    @property
    def no_watchdog(self) -> str | None:
        """State left by a killed program, and the remedy; None if an external watchdog is connected."""
        lights = self.setup.switching != "external" or self.setup.enable is not None
        if not lights or self.setup.alive is not None:
            return None
        return (
            f"{self.name} has no watchdog: a killed program leaves the emitters on; daq.alive names a line that "
            "triggers a retriggerable monostable in their supply"
        )

    def start(self) -> None:
        """Start sampling, and switching the emitters if the instrument drives them."""
        with on_failure(self._off):
            if not self._tasks:
                self._prepare()
            if self.setup.enable is not None:
                self._put(self.setup.enable, True)
            self._begin()

    def read(self) -> Samples:
        """Return the samples since the last call; none, and a remark, if some were overwritten."""
        channels = len(self.setup.channels)
        if not self._tasks:
            return Samples(self._stretch, self._next, np.zeros((0, channels), np.int16))
        try:
            with self._translated("read"):
                stream = self._tasks[-1].in_stream
                counts = np.zeros((channels, stream.avail_samp_per_chan), np.int16)
                if counts.shape[1]:
                    reader = self._ni.stream_readers.AnalogUnscaledReader(stream)
                    reader.verify_array_shape = False  # it asks the driver for the number of channels each time
                    got = reader.read_int16(counts, counts.shape[1], timeout=1.0)
                    counts = counts.ravel()[: channels * got].reshape(channels, got)
            self._check_emitters()
        except _OverrunError as bad:
            return self._again(bad.code)
        except BenchError:
            self._off()
            raise
        if self.setup.alive is not None:
            self._beat = not self._beat
            self._put(self.setup.alive, self._beat)
        first, self._next = self._next, self._next + counts.shape[1]
        remarks, self._remarks = tuple(self._remarks), []
        return Samples(self._stretch, first, np.ascontiguousarray(counts.T), remarks)

    def stop(self) -> None:
        """Switch the emitters off and stop sampling; raise `BenchError` if the lines cannot be set."""
        failed = self._off()
        if failed is not None:
            raise failed

    def close(self) -> None:
        """Stop and release the instrument; setting lines low that could not be set before is tried again."""
        if self._tasks or not self._low:
            self.stop()

    def _checked(self, setup: Setup) -> Model:
        """Return the capabilities of the device.

        Raises `BenchError` if it is not the rig's, or cannot do what is requested.
        """
        with self._translated("find"):
            device = self._ni.system.Device(self._device)
            product = device.product_type
            if setup.model not in product:
                limit = f"is a {product}, not a {setup.model}"
                raise BenchError(f"NI-DAQmx device {self._device}", limit=limit, remedy="name another device")
            model = model_of(device, self._ni)
        model.check(setup)
        return model

    def _prepare(self) -> None:
        """Return the tasks of the counters and of the inputs, reserved and not started; the inputs are last."""
        with self._translated("configure"):
            for place, (counter, terminal, _) in enumerate(self._switches):
                task, self.switch_hz = pulses(self._ni, self._device, self.setup, place, counter, terminal)
                self._tasks.append(task)
            if self.setup.lines:
                self._tasks.append(turns(self._ni, self._device, self.setup))
            self._tasks.append(self._inputs())
            if self.setup.lines:
                self.switch_hz = self.rate_hz / self.setup.frame

    def _inputs(self) -> Any:
        constants, setup = self._ni.constants, self.setup
        task = self._ni.Task()
        with on_failure(lambda: clear(task, self._ni)):
            wired = WIRED[setup.terminal]
            channels = [
                task.ai_channels.add_ai_voltage_chan(
                    f"{self._device}/{channel}",
                    terminal_config=constants.TerminalConfiguration[wired],
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
            self.convert_s = self._converts(task) if len(channels) > 1 and not self._model.simultaneous else 0.0
            self._coefficients = np.array([channel.ai_dev_scaling_coeff for channel in channels], dtype=float)
            self._limits_V = np.array([(channel.ai_rng_low, channel.ai_rng_high) for channel in channels], dtype=float)
            self._check_bits([channel.ai_resolution for channel in channels])
        return task

    def _check_bits(self, bits: list[float]) -> None:
        if max(bits) > MAX_BITS:
            limit = f"has a converter of {max(bits):g} bits; counts have at most {MAX_BITS} bits"
            raise BenchError(self.name, limit=limit, remedy="use a device of 16 bits or less")

    def _converts(self, task: Any) -> float:
        """Return the interval between channels in s, or its upper limit if the driver does not state it.

        Overestimating the time of a sample never assigns it to the previous phase.
        """
        channels = len(self.setup.channels)
        stated = answer_or(0.0, lambda: float(task.timing.ai_conv_rate), self._ni)
        if stated:
            return 1.0 / stated
        longest, shortest = 1.0 / (self.rate_hz * channels), 1.0 / self._model.rate_hz
        self._remarks = [
            f"{self.name} does not state when it converts: inputs are assumed to follow one another by "
            f"{1e6 * longest:.3g} µs, and it may be {1e6 * shortest:.3g} µs"
        ]
        return longest

    def _begin(self) -> None:
        """Start the counters first: they wait for the start of the inputs."""
        with self._translated("start"):
            for task in self._tasks:
                task.start()
        self._next, self._begun_s = 0, self._clock.now_s()

    def _again(self, code: int) -> Samples:
        """Count an overrun and begin another segment; raise `BenchError` if too many follow one another."""
        now = self._clock.now_s()
        lost = max(0, round((now - self._begun_s) * self.rate_hz) - self._next)
        self.losses.samples += lost
        self.losses.overruns += 1
        self._overruns_s = [at for at in self._overruns_s if now - at < WITHIN_S] + [now]
        if len(self._overruns_s) >= MAX_OVERRUNS:
            self._off()
            limit = f"{OVERRUNS[code]}, {MAX_OVERRUNS} times in {WITHIN_S:g} s"
            raise BenchError(self.name, limit=limit, remedy="lower daq.rate_hz, or relieve the computer")
        with on_failure(self._off), self._translated("start"):
            for task in self._tasks[:-1]:
                task.stop()
            with contextlib.suppress(self._ni.errors.DaqError):  # the inputs' task failed already
                self._tasks[-1].stop()
            self._begin()
        self._stretch += 1
        remark = f"{self.name}: {OVERRUNS[code]}; about {lost} samples of each channel are lost"
        return Samples(self._stretch, 0, np.zeros((0, len(self.setup.channels)), np.int16), (remark,))

    def _check_emitters(self) -> None:
        """Raise `BenchError` if a task that switches emitters has ended.

        Its lines then freeze while the inputs continue.
        """
        with self._translated("switch the emitters"):
            ended = any(task.is_task_done() for task in self._tasks[:-1])
        if ended:
            limit = "has stopped switching its emitters: one of its tasks has ended"
            raise BenchError(self.name, limit=limit, remedy="check the cable and the power, then run again")

    def _off(self) -> BenchError | None:
        """Release the tasks and set the lines low; return the error of the lines, if there is one."""
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            clear(task, self._ni)
        try:
            self._lower()
        except BenchError as bad:
            limit, remedy = "its lines could not be set low: emitters may be on", "cut their supply"
            return BenchError(self.name, limit=f"{limit} ({bad})", remedy=remedy)
        return None

    def _lower(self) -> None:
        """Set every line that switches something low, the enabling line first.

        Raises `BenchError` after all were tried.
        """
        taken = tuple(line for _, _, line in self._switches if line)
        faults = []
        for line in (*self.setup.static_lines.values(), *taken, *self.setup.lines):
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
            raise no_driver(bad) from None

    def _fault(self, what: str, bad: Any) -> BenchError:
        code, name = bad.error_code, f"NI-DAQmx device {self._device}"
        if code == -200220:
            return BenchError(name, limit=FAULTS[code][0], remedy=self._known())
        if code in FAULTS:
            limit, remedy = FAULTS[code]
            return BenchError(name, limit=f"{limit} (NI-DAQmx error {code})", remedy=remedy)
        words = str(bad).strip().split("\n")[0]
        return BenchError(name, limit=f"cannot {what}: {words} (NI-DAQmx error {code})")

    def _known(self) -> str:
        """Return the devices that are connected."""
        try:
            names = ", ".join(self._ni.system.System.local().devices.device_names)
        except self._ni.errors.Error:
            names = ""
        return f"there are {names}" if names else "there is none: check the cable, then NI MAX"


class _OverrunError(Exception):
    def __init__(self, code: int) -> None:
        self.code = code
