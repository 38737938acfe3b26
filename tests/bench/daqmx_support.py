"""Simulated C functions of NI-DAQmx, as `nidaqmx` calls them, with a transcript of the calls.

The package itself is unchanged: each simulated function checks its arguments against the ctypes argument types that the
package declares, records the call, and returns what a device would return, or an error code that a test has set.
Numbers of attributes and constants are those of NIDAQmx.h.
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
ERROR_TEXTS = {
    -200220: "Device identifier is invalid.\nDevice Specified: Dev9",
    -50103: "The specified resource is reserved. The operation could not be completed as specified.",
    -200279: "The application is not able to keep up with the hardware acquisition.",
    -200361: "Onboard device memory overflow.",
    -88709: "The specified operation cannot be performed because a task has been aborted or a device is being removed.",
    -200170: "Physical channel specified does not exist on this device.",
    -200197: "Specified property is not supported by the device or is not applicable to the task.",
    -200999: "An unknown error.\nSecond line",
}
NOT_RECORDED = {
    "DAQmxGetSystemInfoAttribute",
    "DAQmxGetTaskAttribute",
    "DAQmxGetExtendedErrorInfo",
    "DAQmxSetRuntimeEnvironment",
    "DAQmxGetDeviceAttribute",
    "DAQmxGetPhysicalChanAttribute",
}
"""Internal calls of the package, and queries of the properties of a device."""


class Function:
    """A C function, called by the package with ctypes arguments."""

    def __init__(self, library: "Library", name: str) -> None:
        self.argtypes: list[Any] | None = None
        self._library, self._name = library, name

    def __call__(self, *arguments: Any) -> int:
        for kind, value in zip(self.argtypes or (), arguments, strict=False):
            kind.from_param(value)  # raises an error for a type that the C function does not accept
        named = len(self.argtypes or ())
        plain = [_plain(value) for value in arguments[:named]] + [_plain_extra(value) for value in arguments[named:]]
        name = self._name.removeprefix("DAQmx")
        if self._name not in NOT_RECORDED:
            self._library.calls.append(f"{name}({', '.join(map(_text, plain))})")
        codes = self._library.faults.get(self._name, [])
        if codes and (code := codes.pop(0)):
            self._library.error_text = ERROR_TEXTS[code]
            return code
        function: Callable[..., int | None] = getattr(self._library, f"_{name}")
        return function(*plain) or 0


class Pointer:
    """Pointer to a result."""

    def __init__(self, target: Any) -> None:
        self.target = target


def _plain(value: Any) -> Any:
    if hasattr(value, "_obj"):
        return Pointer(value._obj)
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, ctypes.Array | np.ndarray) or (isinstance(value, ctypes.c_void_p) and value.value is None):
        return value
    return value.value if isinstance(value, ctypes._SimpleCData) else value


def _plain_extra(value: Any) -> Any:
    """Return an argument beyond the declared types, of which an address is the pointer to an array."""
    return Pointer(value) if isinstance(value, ctypes.c_void_p) else _plain(value)


def _text(value: Any) -> str:
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
    calls
        Calls in their order.
    faults
        Error codes that the next calls of a function return; 0 for success.
    sampled
        Counts (channels, N) that were sampled but not read.
    lines, running, pattern
        Levels of static lines; tasks that output pulses or a pattern, and that pattern, (lines, samples).
    tasks
        Channels of each task that is not cleared, keyed by number.
    missing
        Functions that an older driver does not have.
    """

    coefficients = (1.5e-3, 1.6e-4, 2e-13, -1e-18)

    def __init__(self, kind: str = "USB-6218") -> None:
        self.devices = {"Dev1": kind, "Dev2": "USB-6009"}
        self.device = DEVICES[kind]
        self.calls: list[str] = []
        self.faults: dict[str, list[int]] = {}
        self.error_text = ""
        self.sampled = np.zeros((0, 0), np.int16)
        self.lines: dict[str, bool] = {}
        self.running: set[int] = set()
        self.tasks: dict[int, list[str]] = {}
        self.pattern: NDArray[np.bool_] | None = None
        self.missing: set[str] = {"DAQmxInternalGetLastCreatedChan"}
        self._last_task, self._rate, self._frequency, self._range_v = 0, 0.0, 0.0, 0.0
        self._functions: dict[str, Function] = {}

    def __getattr__(self, name: str) -> Function:
        if not name.startswith("DAQmx") or name in self.missing or not hasattr(type(self), "_" + name[5:]):
            raise AttributeError(name)
        return self._functions.setdefault(name, Function(self, name))

    @property
    def dark(self) -> bool:
        """Whether all emitters are off: no task runs or is reserved, and every line is low."""
        return not self.running and not any(self.lines.values()) and not self.tasks

    def _SetRuntimeEnvironment(self, *_: Any) -> None:
        pass

    def _GetSystemInfoAttribute(self, attribute: int, to: Any, size: int = 0) -> int:
        if SYSTEM[attribute] == "DevNames":
            return _put_text(", ".join(self.devices), to, size)
        to.target.value = 20
        return 0

    def _GetDeviceAttribute(self, device: str, attribute: int, to: Any, size: int = 0) -> int:
        if device not in self.devices:
            self.error_text = ERROR_TEXTS[-200220]
            return -200220
        value = DEVICES[self.devices[device]].property(attribute)
        if value is None:
            return self._unknown()
        if isinstance(value, str):
            return _put_text(value, to, size)
        if not isinstance(value, tuple):
            to.target.value = value
        elif value and isinstance(value[0], float):
            return _put_numbers(value, to, size)
        else:
            return _put_text(", ".join(f"{device}/{name}" for name in value), to, size)
        return 0

    def _GetPhysicalChanAttribute(self, channel: str, attribute: int, to: Any) -> int:
        assert attribute == 0x2342
        device, _, name = channel.partition("/")
        to.target.value = DEVICES[self.devices[device]].wirings[name]
        return 0

    def _unknown(self) -> int:
        self.error_text = ERROR_TEXTS[-200197]
        return -200197

    def _GetExtendedErrorInfo(self, to: Any, _: int) -> None:
        to.value = self.error_text.encode()

    def _CreateTask(self, _: str, to: Pointer) -> None:
        self._last_task += 1
        self.tasks[self._last_task] = []
        to.target.value = self._last_task

    def _GetTaskAttribute(self, task: int, attribute: int, to: Any, size: int) -> int:
        text = {0x1276: f"_unnamedTask<{task}>", 0x1273: ", ".join(self.tasks[task])}[attribute]
        return _put_text(text, to, size)

    def _CreateAIVoltageChan(
        self, task: int, channel: str, _: str, terminal: int, _low: float, high: float, *__: Any
    ) -> None:
        self.tasks[task].append(channel)
        single_ended_v = self.device.single_ended_v if terminal != 10106 else 0.0
        self._range_v = single_ended_v or high

    def _CreateCOPulseChanFreq(self, task: int, counter: str, *settings: Any) -> None:
        self.tasks[task].append(counter)
        self._frequency = settings[4]

    def _CreateDOChan(self, task: int, line: str, *_: Any) -> None:
        self.tasks[task].append(line)

    def _CfgSampClkTiming(self, _task: int, _: str, rate: float, *__: Any) -> None:
        self._rate = 20e6 / round(20e6 / rate)  # an integer number of ticks at 20 MHz

    def _CfgImplicitTiming(self, *_: Any) -> None:
        pass

    def _CfgDigEdgeStartTrig(self, *_: Any) -> None:
        pass

    def _SetBufferAttribute(self, _task: int, attribute: int, _: int) -> None:
        assert attribute == 0x186C

    def _SetChanAttribute(self, _task: int, _channel: str, attribute: int, _: str) -> None:
        assert CHANNEL[attribute] == "CO.Pulse.Term"

    def _GetTimingAttribute(self, _task: int, attribute: int, to: Pointer) -> int:
        if TIMING[attribute] == "AIConv.Rate" and not self.device.reports_conversion:
            return self._unknown()
        to.target.value = self._rate if TIMING[attribute] == "SampClk.Rate" else 71_428.0
        return 0

    def _GetChanAttribute(self, _task: int, _channel: str, attribute: int, to: Any, size: int = 0) -> int:
        name = CHANNEL[attribute]
        if name == "AI.DevScalingCoeff":
            return _put_numbers(self.coefficients, to, size)
        to.target.value = {
            "AI.Rng.High": self._range_v,
            "AI.Rng.Low": -self._range_v,
            "AI.Resolution": float(self.device.bits),
            "CO.Pulse.Freq": self._frequency,
            "ChanType": 10153,
            "DO.NumLines": 1,
        }[name]
        return 0

    def _GetWriteAttribute(self, _task: int, attribute: int, to: Pointer) -> None:
        to.target.value = {0x217F: 1, 0x217E: len(self.tasks[_task])}[attribute]

    def _GetReadAttribute(self, _task: int, attribute: int, to: Pointer) -> None:
        assert READ[attribute] == "AvailSampPerChan"
        to.target.value = self.sampled.shape[1]

    def _TaskControl(self, *_: Any) -> None:
        pass

    def _StartTask(self, task: int) -> None:
        if any("ctr" in channel or "port" in channel for channel in self.tasks[task]):
            self.running.add(task)

    def _IsTaskDone(self, task: int, to: Pointer) -> None:
        to.target.value = task not in self.running

    def _StopTask(self, task: int) -> None:
        self.running.discard(task)

    def _ClearTask(self, task: int) -> None:
        self.running.discard(task)
        del self.tasks[task]

    def _ReadBinaryI16(
        self, task: int, n: int, _timeout: float, fill: int, to: NDArray[np.int16], size: int, read: Pointer, *_: Any
    ) -> None:
        assert fill == 0  # grouped by channel
        assert size >= n * len(self.tasks[task])
        to.ravel()[: self.sampled.size] = self.sampled[:, :n].ravel()
        read.target.value = n
        self.sampled = self.sampled[:, n:]

    def _WriteDigitalLines(
        self, task: int, n: int, auto: bool, _timeout: float, _layout: int, data: NDArray[np.bool_], *_: Any
    ) -> None:
        lines = self.tasks[task]
        if auto:
            (line,) = lines
            self.lines[line] = bool(data[0])
        else:
            self.pattern = np.array(data, bool).reshape(len(lines), n)


def _put_text(text: str, to: Any, size: int) -> int:
    """Write a string to a buffer; without a buffer, return its length."""
    if size == 0:
        return len(text) + 1
    to.value = text.encode()
    return 0


def _put_numbers(values: tuple[float, ...], to: Any, size: int) -> int:
    """Write numbers to a buffer; without a buffer, return their count."""
    if size == 0:
        return len(values)
    ctypes.memmove(to.target.value, (ctypes.c_double * size)(*values), 8 * size)
    return 0


class SimulatedRig(Library):
    """A device whose inputs respond to an emitter that it switches.

    Parameters
    ----------
    clock
        Clock of the device.
    on, off
        Counts of the inputs with the emitter on and off.
    """

    def __init__(self, clock: Clock, on: tuple[int, ...], off: tuple[int, ...], kind: str = "USB-6218") -> None:
        super().__init__(kind)
        self._clock, self._levels = clock, np.array([on, off])
        self._begin_s, self._read = 0.0, 0

    def _StartTask(self, task: int) -> None:
        super()._StartTask(task)
        self._begin_s, self._read = self._clock.now_s(), 0

    def _sample(self) -> None:
        """Set the samples that were taken up to now but not read."""
        taken = int((self._clock.now_s() - self._begin_s) * self._rate + 1e-6)
        number = np.arange(self._read, taken)
        if self.pattern is None:
            on = (number * self._frequency / self._rate + 1e-9) % 1.0 < 0.5
        else:
            on = self.pattern[0, number % self.pattern.shape[1]]
        self.sampled = np.where(on, *self._levels[:, :, None]).astype(np.int16)

    def _GetReadAttribute(self, task: int, attribute: int, to: Pointer) -> None:
        self._sample()
        super()._GetReadAttribute(task, attribute, to)

    def _ReadBinaryI16(self, task: int, n: int, *arguments: Any) -> None:
        super()._ReadBinaryI16(task, n, *arguments)
        self._read += n
