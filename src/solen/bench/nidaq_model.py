"""Capabilities of a device of National Instruments, as its driver reports them.

NI-DAQmx reports for each device its inputs and how they may be wired, its ranges and rates, whether inputs share a
converter, its counters that generate pulses, and its static lines. The driver raises an error for a property that a
device does not have; a default value replaces the error.

Public names: `nidaqmx_package`, `model_of`, `answer_or`, `WIRED` and `no_driver`.
"""

import importlib
from collections.abc import Callable
from typing import Any, TypeVar

from solen.bench.daq import Model, Terminal
from solen.errors import BenchError
from solen.extras import need

WIRED: dict[Terminal, str] = {"rse": "RSE", "nrse": "NRSE", "differential": "DIFF"}
"""Kinds of wiring, and their names in NI-DAQmx."""
OUTPUTS = {"USB-621": {"ctr0": ("PFI4", "port1/line0"), "ctr1": ("PFI5", "port1/line1")}}
"""Output terminals of counters, and the static line that drives each terminal afterwards (USB-621x user manual)."""
_Value = TypeVar("_Value")


def nidaqmx_package() -> Any:
    """Return the package; raise `BenchError` if it is not installed."""
    need("nidaqmx", what="daq.driver", value="nidaqmx", error=BenchError)
    for part in ("constants", "errors", "stream_readers", "stream_writers", "system"):
        importlib.import_module(f"nidaqmx.{part}")
    return importlib.import_module("nidaqmx")


def no_driver(bad: Exception) -> BenchError:
    """Return the error if the driver itself is missing or broken."""
    kind = type(bad).__name__
    if kind == "DaqNotSupportedError":
        return BenchError(
            "NI-DAQmx", limit="does not run on this system", remedy="use Windows, or a Linux that it supports"
        )
    if kind == "DaqFunctionNotSupportedError":
        return BenchError("NI-DAQmx", limit="is too old for nidaqmx", remedy="install a newer NI-DAQmx from ni.com")
    return BenchError("NI-DAQmx", limit="must be installed, and is not", remedy="get the driver from ni.com/downloads")


def model_of(device: Any, ni: Any) -> Model:
    """Return the capabilities that a device of NI-DAQmx reports; empty if there are none."""

    def asked(nothing: _Value, ask: Callable[[], _Value]) -> _Value:
        return answer_or(nothing, ask, ni)

    product = str(device.product_type)
    outputs = next((known for begin, known in OUTPUTS.items() if product.startswith(begin)), {})
    no_names: list[str] = []
    ends = asked(list[float](), lambda: list(device.ai_voltage_rngs))
    counters = asked(no_names, lambda: device.co_physical_chans.channel_names)
    rate = asked(0.0, lambda: float(device.ai_max_multi_chan_rate))
    return Model(
        name=product,
        rate_hz=rate,
        alone_hz=asked(rate, lambda: float(device.ai_max_single_chan_rate)),
        ranges_v=tuple(sorted(high for low, high in zip(ends[::2], ends[1::2], strict=True) if low == -high)),
        inputs=_inputs(device, ni),
        switches=tuple((name, *outputs.get(name, ("", ""))) for name in map(_of, counters) if name.startswith("ctr")),
        lines=tuple(map(_of, asked(no_names, lambda: device.do_lines.channel_names))),
        timed_hz=asked(0.0, lambda: float(device.do_max_rate)),
        simultaneous=asked(False, lambda: bool(device.ai_simultaneous_sampling_supported)),
    )


def answer_or(nothing: _Value, ask: Callable[[], _Value], ni: Any) -> _Value:
    """Return a property from the driver, or a default if the device does not have it."""
    try:
        return ask()
    except ni.errors.DaqError:
        return nothing


def _inputs(device: Any, ni: Any) -> dict[Terminal, tuple[str, ...]]:
    """Return the analog inputs by kind of wiring, without the kinds that have no inputs."""
    channels = answer_or(list[Any](), lambda: list(device.ai_physical_chans), ni)
    ways = {_of(channel.name): [way.name for way in channel.ai_term_cfgs] for channel in channels}
    found = {
        terminal: tuple(channel for channel, allowed in ways.items() if name in allowed)
        for terminal, name in WIRED.items()
    }
    return {terminal: names for terminal, names in found.items() if names}


def _of(name: str) -> str:
    """Return a channel's name without that of its device."""
    return name.partition("/")[2]
