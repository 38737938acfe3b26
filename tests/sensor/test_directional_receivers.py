"""A receiver with a lens detects less oblique light, in readings, on the simulated bench and in a diagnosis."""

from pathlib import Path

import numpy as np
import pytest

from solen.analysis.diagnosis import Table
from solen.analysis.diagnosis.response_table import angles_deg
from solen.bench.rig import load_rig
from solen.bench.simulated.networks import traced_network
from solen.bench.simulated.sensors import simulated_sensors
from solen.curve import Segment
from solen.readout import volts
from solen.readout.transistor import angular_factor
from solen.scene import Extrusion, Interface, Region, Scene
from solen.scene.sources import Emitter
from solen.scene.sources.pattern import CosinePower
from solen.sensor import Sensor
from solen.sensor.acceptance import Acceptance
from solen.sensor.network import network_response, network_signals
from solen.sensor.readings import readings
from solen.spec import Design, load, with_values
from solen.spec.placed import state_of
from solen.trace import trace
from tests.geometry.network_support import MOTIONS, three_guides

PART = 'schema = 1\nname = "Narrow"\nkind = "receiver"\nmaker = "me"\ndocument = "notes"\n' + "".join(
    f'[{key}]\ntypical = {value}\nbasis = "measured"\nsource = "bench"\n'
    for key, value in (("current_ua_per_mw_cm2", 450), ("half_angle_deg", 20))
)
DESIGN = """
schema = 1
name = "directional"
[material]
index = 1.44
[emitter]
width_mm = 0.2
[motion]
from_deg = -0.5
to_deg = 0.5
step_deg = 0.5
[readout]
part = "narrow.toml"
"""
RIG = """
schema = 1
name = "one sensor"
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
"""
NETWORK_RIG = """
schema = 1
name = "rig of a network"
[stages.lean]
[stages.swing]
[board]
rate_hz = 100.0
[[sensor]]
name = "three"
design = "sensor.toml"
emitters = {b = 1, a = 2}
inputs = {side = 2, end = 1}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("directional")
    for name, text in {"narrow.toml": PART, "sensor.toml": DESIGN, "rig.toml": RIG}.items():
        (path / name).write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def design(folder: Path) -> Design:
    return load(folder / "sensor.toml")


def test_flat_window_detects_all_light(design: Design) -> None:
    flat = Sensor.of(with_values(design, {"readout.part": "TEMT7100X01"}))
    assert Acceptance.of(flat).is_flat
    assert readings(flat).power_fraction[1] == pytest.approx([0.2604, 0.2604], abs=2e-4)


def test_readings_bench_and_diagnosis_agree_for_a_half_angle_of_20_deg(folder: Path, design: Design) -> None:
    """At rest, 0.2228 of the emitted light is detected, and 0.2604 behind a flat window."""
    sensor = Sensor.of(design)
    at_rest = readings(sensor).power_fraction[1]
    assert at_rest == pytest.approx([0.2228, 0.2228], abs=2e-4)
    simulated = simulated_sensors(load_rig(folder / "rig.toml"), folder, 0.2, np.random.default_rng(1))[0]
    assert simulated.at(np.zeros(1))[0] == pytest.approx(at_rest, abs=2e-4)
    diagnosed = Table.of(sensor, angles_deg(-0.2, 0.2)).chip(np.zeros(1), 0.0, 0.2)[0]
    assert diagnosed == pytest.approx(at_rest, abs=2e-4)


def test_readings_and_bench_agree_for_a_network(folder: Path) -> None:
    """The readout and the rig give the same voltages, with less than a tenth of the power through a face detected."""
    design = with_values(three_guides(motion=MOTIONS), {"readout.part": "narrow.toml"}).in_folder(folder)
    (folder / "network.toml").write_text(NETWORK_RIG, encoding="utf-8")
    state = {"lean": 3.0, "swing": -2.0}
    moved = state_of(design, state)
    rig = traced_network(
        load_rig(folder / "network.toml").sensor[0], design, {motion: (angle, angle) for motion, angle in state.items()}
    )
    response = network_response(design, [state])
    signals = network_signals([moved], response.power, response.u_power)
    assert 0.0 < signals.received[0, 0, 0] < 0.1 * response.power[0, 0, 0]
    for index, emitter in enumerate((1, 0)):  # the board lights b first
        (light,) = rig.received(np.array([[*state.values()]]), np.array([emitter]))
        detected = volts(light, rig.circuit, moved.readout.ambient_mw_cm2, moved.readout.temperature_c)[::-1]
        assert (signals.off_V - detected)[0] > 0.01
        assert detected == pytest.approx(signals.voltage_V[0, index], rel=5e-4)


@pytest.mark.parametrize("exponent", [1.0, 3.0, 11.0])
def test_wide_directional_receivers_of_a_lambertian_point(exponent: float) -> None:
    """Of power arriving as cos θ dΩ in space, a receiver with cos^m detects 2/(m + 1), on either side equally."""
    low, high, far = -1.0, 1.0, 1000.0
    corners = [(-far, low), (far, low), (far, high), (0.0, high), (-far, high)]
    names = ["back", "side", "right", "left", "other"]
    walls = tuple(
        Interface(name, Segment(corners[i], corners[(i + 1) % 5]), "inside", "outside", "receiver", name)
        for i, name in enumerate(names)
    )
    source = Emitter((0.0, 0.0), 0.0, 2**15, CosinePower(1.0))
    regions = (Region("inside", 1.0), Region("outside", 1.0))
    scene = Scene(regions, walls, (source,), extrusion=Extrusion(2.0 * far))
    assert Acceptance(exponent).factors(scene) == pytest.approx(2.0 / (exponent + 1.0), abs=2e-3)


IN_SPACE = {"trace.dimension": "extruded", "emitter.pattern": "lambertian", "emitter.cone_deg": 120.0}


def test_single_layer_has_the_factor_of_the_cylinder(design: Design) -> None:
    """A lens of a single layer is a cylinder that is traced as a lens with a varying cross-section."""
    slab = {"lens.shape": "layered", "lens.layer_mm": 9.0}
    cylinder, layer = (Sensor.of(with_values(design, IN_SPACE | values)) for values in ({}, slab))
    detected = Acceptance.of(cylinder).factors(cylinder.scene(-0.3, 2**12))
    assert 0.2 < detected[1] < 0.9
    assert Acceptance.of(layer).factors(layer.scene(-0.3, 2**12)) == pytest.approx(detected, abs=1e-4)


def test_collimated_light_has_the_factor_of_projected_angles(design: Design) -> None:
    """The light has no y-component in the body, so the angles of incidence equal their projections."""
    lens = {"lens.shape": "line-focus", "lens.y_focus_mm": "collimated", "emitter.width_mm": 0.0}
    sensor = Sensor.of(with_values(design, IN_SPACE | lens))
    scene, acceptance = sensor.scene(-0.3, 2**14), Acceptance.of(sensor)
    detectors = trace(scene, "power", angle_bins=90).detectors
    edges = np.linspace(-90.0, 90.0, 91)
    sine = acceptance.index * np.sin(np.radians(0.5 * (edges[1:] + edges[:-1])))
    projected = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0)))
    powers = np.array([detectors[side].power_by_angle for side in ("right", "left")])
    detected = angular_factor(acceptance.exponent, projected, powers)
    assert acceptance.factors(scene) == pytest.approx(detected, rel=0.02)
