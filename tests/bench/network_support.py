"""A network of two emitters and three receivers whose response is a formula, with a rig and a protocol."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.bench.rig import Rig
from solen.bench.simulated import instruments
from solen.bench.simulated.networks import SimulatedNetwork
from solen.bench.simulated.sensors import adc_of
from solen.readout import circuit_of
from solen.spec import loads

LEAN, SWAY = np.linspace(-10.0, 10.0, 21), np.linspace(-8.0, 8.0, 17)
EMITTERS, RECEIVERS = ("a", "b"), ("end", "side", "right")

DESIGN = """
schema = 1
name = "Two lenses"
[material]
index = 1.44
[body]
kind = "network"
[network]
nodes = [{name = "base"}, {name = "fork"}, {name = "tip"}, {name = "end"}]
guides = [
    {name = "trunk", nodes = ["base", "fork"], width_mm = 3.0, direction_deg = 0.0, length_mm = 12.0},
    {name = "branch", nodes = ["fork", "tip"], width_mm = 2.0, direction_deg = -40.0, length_mm = 10.0},
    {name = "other", nodes = ["fork", "end"], width_mm = 2.0, direction_deg = 40.0, length_mm = 11.0},
]
lenses = [{name = "main", node = "base"}, {name = "second", node = "tip"}]
emitters = [{name = "a", lens = "main"}, {name = "b", lens = "second"}]
receivers = [
    {name = "end", node = "end"},
    {name = "side", guide = "trunk", side = "left", from_mm = 2.0, to_mm = 5.0},
    {name = "right", guide = "trunk", side = "right", from_mm = 2.0, to_mm = 5.0},
]
motion = [
    {name = "lean", kind = "bend", part = "branch", from_deg = -10.0, to_deg = 10.0},
    {name = "sway", kind = "bend", part = "other", from_deg = -8.0, to_deg = 8.0},
]
"""
RIG = """
schema = 1
name = "rig of a network"
seed = 3
[stages.lean]
[stages.sway]
[board]
rate_hz = 100.0
[[sensor]]
name = "fork"
design = "sensor.toml"
emitters = {a = 1, b = 3}
inputs = {end = 2, side = 1, right = 4}
[ambient]
mean_mw_cm2 = 0.05
flicker_percent = 20.0
"""
PLAN = """
schema = 1
name = "grid"
rest_s = 0.1
[grid]
velocity_deg_per_s = 20.0
hold_s = 0.2
[grid.to_deg]
lean = [-10.0, 0.0, 10.0]
sway = [-8.0, 0.0, 8.0]
"""


def light(lean_deg: FloatArray, sway_deg: FloatArray) -> FloatArray:
    """Return fractions of the emitted power (..., emitters, receivers): smooth, and different for each motion."""
    lean, sway = lean_deg / 10.0, sway_deg / 8.0
    a = np.stack([0.12 + 0.05 * np.tanh(1.5 * lean), 0.06 - 0.03 * lean * sway, 0.04 + 0.02 * np.sin(2.0 * sway)], -1)
    b = np.stack([0.03 + 0.01 * sway**2, 0.08 + 0.04 * sway, 0.05 + 0.03 * np.cos(1.2 * lean + sway)], -1)
    return np.stack([a, b], axis=-2)


def network_of(rig: Rig, fractions: Any = light) -> SimulatedNetwork:
    """Return the network of a rig, with typical parts."""
    design = loads(DESIGN)
    mesh = np.meshgrid(LEAN, SWAY, indexing="ij")
    circuit = circuit_of(design, dict.fromkeys(RECEIVERS, 6.0)).with_load(300.0)
    circuit = replace(circuit, adc=adc_of(rig), rate_hz=100.0)
    return SimulatedNetwork(rig.sensor[0], {}, (LEAN, SWAY), fractions(*mesh), np.ones(2), circuit)


def without_tracing(patch: pytest.MonkeyPatch, fractions: Any = light) -> None:
    """Make simulated rigs use this network without tracing it."""

    def networks(rig: Rig, folder: Path, ranges_deg: Mapping[str, Any], *_: Any) -> tuple[SimulatedNetwork, ...]:
        assert set(ranges_deg) == {"lean", "sway"}
        assert (folder / "sensor.toml").exists()
        return (network_of(rig, fractions),)

    patch.setattr(instruments, "simulated_networks", networks)


def write(folder: Path, **texts: str) -> Path:
    """Write the files of the rig, some of them with other texts, and return their folder."""
    for name, text in ({"sensor": DESIGN, "rig": RIG, "plan": PLAN} | texts).items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return folder
