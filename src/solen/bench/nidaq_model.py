"""Capabilities of a device of National Instruments, as its driver reports them.

NI-DAQmx reports for each device its inputs and their possible wirings, its ranges and rates, whether its inputs share
an ADC, its counters that generate pulses, and its digital lines. The driver raises an error for a property that a
device does not have; a default value is then used instead.

Public names: `nidaqmx_package`, `model_of`, `property_or`, `TERMINALS` and `driver_error`.
"""

import importlib
from collections.abc import Callable
from typing import Any, TypeVar

from solen.bench.daq import Model, Terminal
from solen.errors import BenchError
from solen.extras import need

TERMINALS: dict[Terminal, str] = {"rse": "RSE", "nrse": "NRSE", "differential": "DIFF"}
"""Kinds of wiring, and their names in NI-DAQmx."""
COUNTER_OUTPUTS = {"USB-621": {"ctr0": ("PFI4", "port1/line0"), "ctr1": ("PFI5", "port1/line1")}}
"""Output terminal of each counter, and the static line on that terminal, by model series (USB-621x user manual)."""
_Value = TypeVar("_Value")


def nidaqmx_package() -> Any:
    """Return the package; raise `BenchError` if it is not installed."""
    need("nidaqmx", what="daq.driver", value="nidaqmx", error=BenchError)
    for part in ("constants", "errors", "stream_readers", "stream_writers", "system"):
        importlib.import_module(f"nidaqmx.{part}")
    return importlib.import_module("nidaqmx")


def driver_error(bad: Exception) -> BenchError:
    """Return the error for a driver that is missing, too old, or not supported by the system."""
    kind = type(bad).__name__
    if kind == "DaqNotSupportedError":
        limit, remedy = "does not run on this system", "use Windows, or a Linux that it supports"
    elif kind == "DaqFunctionNotSupportedError":
        limit, remedy = "is too old for nidaqmx", "install a newer NI-DAQmx from ni.com"
    else:
        limit, remedy = "is not installed", "install the driver from ni.com/downloads"
    return BenchError("NI-DAQmx", limit=limit, remedy=remedy)


def model_of(device: Any, ni: Any) -> Model:
    """Return the capabilities that a device of NI-DAQmx reports; zero or empty for properties that it does not have."""

    def reported(default: _Value, read: Callable[[], _Value]) -> _Value:
        return property_or(default, read, ni)

    product = str(device.product_type)
    outputs = next((outputs for series, outputs in COUNTER_OUTPUTS.items() if product.startswith(series)), {})
    limits = reported(list[float](), lambda: list(device.ai_voltage_rngs))
    counters = reported(list[str](), lambda: list(device.co_physical_chans.channel_names))
    lines = reported(list[str](), lambda: list(device.do_lines.channel_names))
    rate = reported(0.0, lambda: float(device.ai_max_multi_chan_rate))
    return Model(
        name=product,
        rate_hz=rate,
        single_hz=reported(rate, lambda: float(device.ai_max_single_chan_rate)),
        ranges_v=tuple(sorted(high for low, high in zip(limits[::2], limits[1::2], strict=True) if low == -high)),
        inputs=_inputs(device, ni),
        switches=tuple(
            (name, *outputs.get(name, ("", ""))) for name in map(_short_name, counters) if name.startswith("ctr")
        ),
        lines=tuple(map(_short_name, lines)),
        timed_hz=reported(0.0, lambda: float(device.do_max_rate)),
        simultaneous=reported(False, lambda: bool(device.ai_simultaneous_sampling_supported)),
    )


def property_or(default: _Value, read: Callable[[], _Value], ni: Any) -> _Value:
    """Return a property that the driver reports, or a default if the device does not have it."""
    try:
        return read()
    except ni.errors.DaqError:
        return default


def _inputs(device: Any, ni: Any) -> dict[Terminal, tuple[str, ...]]:
    """Return the analog inputs for each kind of wiring, without the kinds that have no inputs."""
    channels = property_or(list[Any](), lambda: list(device.ai_physical_chans), ni)
    wirings = {_short_name(channel.name): [wiring.name for wiring in channel.ai_term_cfgs] for channel in channels}
    inputs = {
        terminal: tuple(channel for channel, possible in wirings.items() if name in possible)
        for terminal, name in TERMINALS.items()
    }
    return {terminal: names for terminal, names in inputs.items() if names}


def _short_name(name: str) -> str:
    """Return the name of a channel without that of its device."""
    return name.partition("/")[2]
