"""Devices behind NI-DAQmx's C functions, as `nidaqmx` calls them, and the conversation with it in writing.

The package itself runs as it is: each function takes its arguments as ctypes would pass them, by the argument types
that the package states, writes them down as the C call they make, and answers by what the instrument would hold. Errors
of the driver are answered where a test asks for them. Numbers of attributes and constants are those of NIDAQmx.h.
"""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.bench.clock import Clock
from tests.bench.daqmx_devices import DEVICES

READ = {0x1223: "AvailSampPerChan"}
TIMING = {0x1344: "SampClk.Rate", 0x1848: "AIConv.Rate"}
CHANNEL = {
    0x1930: "AI.DevScalingCoeff",
    0x1178: "CO.Pulse.Freq",
    0x18E1: "CO.Pulse.Term",
    0x1815: "AI.Rng.High",
    0x1816: "AI.Rng.Low",
    0x1765: "AI.Resolution",
    0x187F: "ChanType",
    0x2179: "DO.NumLines",
}
SYSTEM = {0x1272: "MajorVersion", 0x1923: "MinorVersion", 0x2F22: "UpdateVersion", 0x193B: "DevNames"}
WORDS = {
    -200220: "Device identifier is invalid.\nDevice Specified: Dev9",
    -50103: "The specified resource is reserved. The operation could not be completed as specified.",
    -200279: "The application is not able to keep up with the hardware acquisition.",
    -200361: "Onboard device memory overflow.",
    -88709: "The specified operation cannot be performed because a task has been aborted or a device is being removed.",
    -200170: "Physical channel specified does not exist on this device.",
    -200197: "Specified property is not supported by the device or is not applicable to the task.",
    -200999: "Words that nobody foresaw.\nSecond line",
}
SILENT = {
    "DAQmxGetSystemInfoAttribute",
    "DAQmxGetTaskAttribute",
    "DAQmxGetExtendedErrorInfo",
    "DAQmxSetRuntimeEnvironment",
    "DAQmxGetDeviceAttribute",
    "DAQmxGetPhysicalChanAttribute",
}
"""Calls that the package makes for itself, and questions for what a device can do."""


class Function:
    """One C function: arguments as ctypes takes them, written down, and answered."""

    def __init__(self, library: "Library", name: str) -> None:
        self.argtypes: list[Any] | None = None
        self._library, self._name = library, name

    def __call__(self, *given: Any) -> int:
        for kind, value in zip(self.argtypes or (), given, strict=False):
            kind.from_param(value)  # refuses what the C function would not take
        named = len(self.argtypes or ())
        plain = [_plain(value) for value in given[:named]] + [_plain_more(value) for value in given[named:]]
        if self._name not in SILENT:
            self._library.said.append(
                f"{self._name.removeprefix('DAQmx')}({', '.join(_written(one) for one in plain)})"
            )
        code = self._library.faults.get(self._name, [])
        if code and (now := code.pop(0)):
            self._library.words = WORDS[now]
            return now
        answer: Callable[..., int | None] = getattr(self._library, "_" + self._name.removeprefix("DAQmx"))
        return answer(*plain) or 0


class Pointer:
    """Where an answer goes."""

    def __init__(self, to: Any) -> None:
        self.to = to


def _plain(value: Any) -> Any:
    if hasattr(value, "_obj"):
        return Pointer(value._obj)
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, ctypes.Array | np.ndarray) or (isinstance(value, ctypes.c_void_p) and value.value is None):
        return value
    return value.value if isinstance(value, ctypes._SimpleCData) else value


def _plain_more(value: Any) -> Any:
    """Of what a function takes beyond its stated types, an address is where an array's answer goes."""
    return Pointer(value) if isinstance(value, ctypes.c_void_p) else _plain(value)


def _written(value: Any) -> str:
    if isinstance(value, Pointer):
        return "&"
    if isinstance(value, np.ndarray):
        return f"{value.dtype}[{value.size}]" if value.dtype == np.int16 else str(value.astype(int).tolist())
    if isinstance(value, ctypes.Array):
        return f"char[{len(value)}]"
    return f"{value:g}" if isinstance(value, float) else repr(value)


class Library:
    """The C library.

    Attributes
    ----------
    said
        Calls in their order.
    faults
        Error codes that the next calls of a function are answered with; 0 for none.
    waiting
        Counts (channels, N) that were sampled and not read.
    lines, running, pattern
        Levels of static lines; tasks that put out pulses or a pattern, and that, (lines, samples).
    tasks
        Numbers of tasks that are not cleared, each with its channels.
    missing
        Functions that an older driver does not have.
    """

    coefficients = (1.5e-3, 1.6e-4, 2e-13, -1e-18)

    def __init__(self, kind: str = "USB-6218") -> None:
        self.devices = {"Dev1": kind, "Dev2": "USB-6009"}
        self.facts = DEVICES[kind]
        self.said: list[str] = []
        self.faults: dict[str, list[int]] = {}
        self.words = ""
        self.waiting = np.zeros((0, 0), np.int16)
        self.lines: dict[str, bool] = {}
        self.running: set[int] = set()
        self.tasks: dict[int, list[str]] = {}
        self.pattern: NDArray[np.bool_] | None = None
        self.missing: set[str] = {"DAQmxInternalGetLastCreatedChan"}
        self._made, self._rate, self._frequency, self._range_v = 0, 0.0, 0.0, 0.0
        self._functions: dict[str, Function] = {}

    def __getattr__(self, name: str) -> Function:
        if not name.startswith("DAQmx") or name in self.missing or not hasattr(type(self), "_" + name[5:]):
            raise AttributeError(name)
        return self._functions.setdefault(name, Function(self, name))

    @property
    def dark(self) -> bool:
        """Whether nothing lights an emitter: no counter runs, every line is low, and no task is held."""
        return not self.running and not any(self.lines.values()) and not self.tasks

    def _SetRuntimeEnvironment(self, *_: Any) -> None:
        pass

    def _GetSystemInfoAttribute(self, attribute: int, to: Any, size: int = 0) -> int:
        if SYSTEM[attribute] == "DevNames":
            return _text(", ".join(self.devices), to, size)
        to.to.value = 20
        return 0

    def _GetDeviceAttribute(self, device: str, attribute: int, to: Any, size: int = 0) -> int:
        if device not in self.devices:
            self.words = WORDS[-200220]
            return -200220
        value = DEVICES[self.devices[device]].property(attribute)
        if value is None:
            return self._unknown()
        if isinstance(value, str):
            return _text(value, to, size)
        if not isinstance(value, tuple):
            to.to.value = value
        elif value and isinstance(value[0], float):
            return _numbers(value, to, size)
        else:
            return _text(", ".join(f"{device}/{name}" for name in value), to, size)
        return 0

    def _GetPhysicalChanAttribute(self, channel: str, attribute: int, to: Any) -> int:
        assert attribute == 0x2342
        device, _, name = channel.partition("/")
        to.to.value = DEVICES[self.devices[device]].wired[name]
        return 0

    def _unknown(self) -> int:
        self.words = WORDS[-200197]
        return -200197

    def _GetExtendedErrorInfo(self, to: Any, _: int) -> None:
        to.value = self.words.encode()

    def _CreateTask(self, _: str, to: Pointer) -> None:
        self._made += 1
        self.tasks[self._made] = []
        to.to.value = self._made

    def _GetTaskAttribute(self, task: int, attribute: int, to: Any, size: int) -> int:
        text = {0x1276: f"_unnamedTask<{task}>", 0x1273: ", ".join(self.tasks[task])}[attribute]
        return _text(text, to, size)

    def _CreateAIVoltageChan(
        self, task: int, channel: str, _: str, wired: int, _low: float, high: float, *__: Any
    ) -> None:
        self.tasks[task].append(channel)
        alone = self.facts.real_v if wired != 10106 else 0.0
        self._range_v = alone or high

    def _CreateCOPulseChanFreq(self, task: int, counter: str, *more: Any) -> None:
        self.tasks[task].append(counter)
        self._frequency = more[4]

    def _CreateDOChan(self, task: int, line: str, *_: Any) -> None:
        self.tasks[task].append(line)

    def _CfgSampClkTiming(self, _task: int, _: str, rate: float, *__: Any) -> None:
        self._rate = 20e6 / round(20e6 / rate)  # a whole number of ticks of 20 MHz

    def _CfgImplicitTiming(self, *_: Any) -> None:
        pass

    def _CfgDigEdgeStartTrig(self, *_: Any) -> None:
        pass

    def _SetBufferAttribute(self, _task: int, attribute: int, _: int) -> None:
        assert attribute == 0x186C

    def _SetChanAttribute(self, _task: int, _channel: str, attribute: int, _: str) -> None:
        assert CHANNEL[attribute] == "CO.Pulse.Term"

    def _GetTimingAttribute(self, _task: int, attribute: int, to: Pointer) -> int:
        if TIMING[attribute] == "AIConv.Rate" and not self.facts.converts:
            return self._unknown()
        to.to.value = self._rate if TIMING[attribute] == "SampClk.Rate" else 71_428.0
        return 0

    def _GetChanAttribute(self, _task: int, _channel: str, attribute: int, to: Any, size: int = 0) -> int:
        name = CHANNEL[attribute]
        if name == "AI.DevScalingCoeff":
            return _numbers(self.coefficients, to, size)
        ends = {"AI.Rng.High": self._range_v, "AI.Rng.Low": -self._range_v, "AI.Resolution": float(self.facts.bits)}
        known = {"CO.Pulse.Freq": self._frequency, "ChanType": 10153, "DO.NumLines": 1}
        to.to.value = (known | ends)[name]
        return 0

    def _GetWriteAttribute(self, _task: int, attribute: int, to: Pointer) -> None:
        to.to.value = {0x217F: 1, 0x217E: len(self.tasks[_task])}[attribute]

    def _GetReadAttribute(self, _task: int, attribute: int, to: Pointer) -> None:
        assert READ[attribute] == "AvailSampPerChan"
        to.to.value = self.waiting.shape[1]

    def _TaskControl(self, *_: Any) -> None:
        pass

    def _StartTask(self, task: int) -> None:
        if any("ctr" in channel or "port" in channel for channel in self.tasks[task]):
            self.running.add(task)

    def _IsTaskDone(self, task: int, to: Pointer) -> None:
        to.to.value = task not in self.running

    def _StopTask(self, task: int) -> None:
        self.running.discard(task)

    def _ClearTask(self, task: int) -> None:
        self.running.discard(task)
        del self.tasks[task]

    def _ReadBinaryI16(
        self, task: int, n: int, _timeout: float, fill: int, to: NDArray[np.int16], size: int, got: Pointer, *_: Any
    ) -> None:
        assert fill == 0  # grouped by channel
        assert size >= n * len(self.tasks[task])
        to.ravel()[: self.waiting.size] = self.waiting[:, :n].ravel()
        got.to.value = n
        self.waiting = self.waiting[:, n:]

    def _WriteDigitalLines(
        self, task: int, n: int, auto: bool, _timeout: float, _layout: int, data: NDArray[np.bool_], *_: Any
    ) -> None:
        lines = self.tasks[task]
        if auto:
            (line,) = lines
            self.lines[line] = bool(data[0])
        else:
            self.pattern = np.array(data, bool).reshape(len(lines), n)


def _text(text: str, to: Any, size: int) -> int:
    """How a string is answered: its length where no place is given."""
    if size == 0:
        return len(text) + 1
    to.value = text.encode()
    return 0


def _numbers(values: tuple[float, ...], to: Any, size: int) -> int:
    """How an array is answered: its length where no place is given."""
    if size == 0:
        return len(values)
    ctypes.memmove(to.to.value, (ctypes.c_double * size)(*values), 8 * size)
    return 0


class Rig(Library):
    """An instrument whose inputs see an emitter that its counter switches.

    Parameters
    ----------
    clock
        What time passes by.
    lit, dark_counts
        Counts of the inputs with the emitter on and off.
    """

    def __init__(
        self, clock: Clock, lit: tuple[int, ...], dark_counts: tuple[int, ...], kind: str = "USB-6218"
    ) -> None:
        super().__init__(kind)
        self._clock, self._levels = clock, np.array([lit, dark_counts])
        self._begun_s, self._read = 0.0, 0

    def _StartTask(self, task: int) -> None:
        super()._StartTask(task)
        self._begun_s, self._read = self._clock.now_s(), 0

    def _sample(self) -> None:
        """What was sampled up to now and is not read."""
        taken = int((self._clock.now_s() - self._begun_s) * self._rate + 1e-6)
        number = np.arange(self._read, taken)
        if self.pattern is None:
            on = (number * self._frequency / self._rate + 1e-9) % 1.0 < 0.5
        else:
            on = self.pattern[0, number % self.pattern.shape[1]]
        self.waiting = np.where(on, *self._levels[:, :, None]).astype(np.int16)

    def _GetReadAttribute(self, task: int, attribute: int, to: Pointer) -> None:
        self._sample()
        super()._GetReadAttribute(task, attribute, to)

    def _ReadBinaryI16(self, task: int, n: int, *more: Any) -> None:
        super()._ReadBinaryI16(task, n, *more)
        self._read += n
