"""solen: from the index of a resin to the response curve of a 3D-printed soft optical sensor.

Axes and units everywhere: x is lateral (right is +x), z runs along the undeformed optical axis from the lens vertex
into the body, y is out of plane; the undeformed lens vertex is the origin. Lengths are mm, wavelengths nm, angles
degrees, counter-clockwise with z up and x to the right, so a turn by −3° brightens the right receiver. Powers are
fractions of the emitted power.

Public names are loaded on first use::

    import solen

    sensor = solen.Sensor.of("my-sensor/sensor.toml")
    print(sensor.set(focus_mm=25).power().contrast)
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_NAMES = {
    "Decoder": "solen.analysis.calibration",
    "Outcome": "solen.results",
    "Result": "solen.results",
    "Sensor": "solen.sensor",
    "SolenError": "solen.errors",
    "analyse": "solen.api",
    "calibrate_printer": "solen.api",
    "calibrate_sensor": "solen.api",
    "diagnose": "solen.api",
    "export": "solen.api",
    "index_of_layer": "solen.api",
    "load": "solen.spec",
    "loss_of_guide": "solen.api",
    "measure_lens": "solen.api",
    "plot": "solen.report.plot",
    "read": "solen.recording",
    "save": "solen.spec",
    "working_curve": "solen.api",
}
"""Modules of the public names, keyed by name; `__init__.pyi` lists the same names for type checkers."""

__all__ = ["__version__", *_NAMES]


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'solen' has no attribute {name!r}")
    value = getattr(import_module(_NAMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
