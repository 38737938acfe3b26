"""A circuit with round numbers, and the paper's circuit."""

import math

from solen.readout import Adc, Circuit, Drive, Phototransistor, circuit_of, face_areas_mm2
from solen.sensor import Sensor
from solen.spec import Design, loads, template, with_values

DRIVE = Drive("LED", 10.0, 1.0, 0.5, 1.5, 0.0035, 850.0, 100.0)
PART = Phototransistor("PT", 400.0, 200.0, 600.0, dark_nA=1.0, rise_per_K=0.01)
FINE = Adc("fine", 24, -10.0, 10.0)


def plain_circuit(**changes: object) -> Circuit:
    """Circuit with two receivers of 10 mm²: half of 1 mW gives 5 mW/cm², 2 mA and 4 V across 2 kΩ."""
    values: dict[str, object] = {
        "names": ("right", "left"),
        "area_mm2": (10.0, 10.0),
        "drive": DRIVE,
        "transistor": PART,
        "adc": FINE,
        "sensitivity_uA": (400.0, 400.0),
        "load_ohm": (2000.0, 2000.0),
        "supply_V": 5.0,
    }
    return Circuit(**(values | changes))  # type: ignore[arg-type]


def paper_design(**values: object) -> Design:
    return with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})


def paper_circuit(**values: object) -> Circuit:
    design = paper_design(**values)
    return circuit_of(design, face_areas_mm2(design, Sensor.of(design).body()))


def implicit_current_A(volts: float, photocurrent_A: float, part: Phototransistor) -> float:
    """Collector current from the model of the knee, without the closed form."""
    return photocurrent_A * (1.0 - math.exp(-(volts - part.saturation_V) / part.knee_V))
