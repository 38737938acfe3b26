"""Light in networks: agreement with the Y and with a scene by hand, complete ledgers, readings and their errors."""

import math
from dataclasses import fields

import numpy as np
import pytest

from solen.curve import CartesianOval, Segment
from solen.errors import DesignError, SolenError, SpecError
from solen.plane import Point, Rigid
from solen.report.design.network import csv_table, network_figure
from solen.scene import Fan, Interface, Region, Scene
from solen.sensor import Sensor
from solen.sensor.network import emitter_sensors, network_check, network_response, network_study, network_trace
from solen.sensor.network.readings import readings_of
from solen.sensor.network.slopes import network_sensitivities
from solen.sensor.traced import with_lit_emitter
from solen.spec import Design, loads, template, with_values
from solen.trace import trace
from solen.trace import trace_reference as reference
from solen.trace.nets import integrate_by_nets
from solen.trace.options import TraceOptions
from tests.geometry.network_support import INDEX, MOTIONS, READINGS, random_network, three_guides, y_network


def y_design() -> Design:
    return Design(name="y", material={"index": INDEX}, emitter={"rays": 400}, trace={"mode": "power"})


def test_y_as_a_network_has_the_powers_of_the_y() -> None:
    design = y_design()
    y_trace, network = Sensor.of(design).trace(), network_trace(y_network(design))
    assert network.power[0, 0].tolist() == [y_trace.detectors[side].power for side in ("right", "left")]
    assert network.ledgers[0] == (y_trace.ledger,)


def intersection(p: Point, p_deg: float, q: Point, q_deg: float) -> Point:
    """Point in which two lines of given headings intersect."""
    (a, b), (c, d) = ((-math.sin(math.radians(deg)), math.cos(math.radians(deg))) for deg in (p_deg, q_deg))
    t = np.linalg.solve(np.array([[a, -c], [b, -d]]), np.subtract(q, p))[0]
    return (p[0] + t * a, p[1] + t * b)


def hand_scene(emitter: str) -> Scene:
    """The scene of `three_guides` with its corners computed line by line."""

    def offset_point(at: Point, axis_deg: float, ahead: float, right: float) -> Point:
        angle = math.radians(axis_deg)
        x = at[0] - ahead * math.sin(angle) + right * math.cos(angle)
        return (x, at[1] + ahead * math.cos(angle) + right * math.sin(angle))

    fork = (0.0, 12.0)
    trunk = {side: (side * 1.5, 0.0) for side in (1, -1)}
    branch = {
        (axis_deg, side): offset_point(fork, axis_deg, 0.0, side) for axis_deg in (-40.0, 40.0) for side in (1, -1)
    }
    tips = {
        (axis_deg, side): offset_point(fork, axis_deg, 10.0 if axis_deg < 0 else 11.0, side)
        for axis_deg in (-40.0, 40.0)
        for side in (1, -1)
    }
    right = intersection(fork, -90.0, branch[-40.0, 1], -40.0)  # on the last section of the trunk, which is wider
    left = intersection(fork, 90.0, branch[40.0, -1], 40.0)
    crotch = intersection(branch[-40.0, -1], -40.0, branch[40.0, 1], 40.0)
    # in a lens's frame, the vertex is at the origin, and its base is at its depth
    ovals = {}
    for name, distance, focus, half, at, axis_deg in (
        ("main", 1.0, 15.0, 1.4, (0.0, 0.0), 0.0),
        ("second", 1.5, 12.0, 1.0, offset_point(fork, -40.0, 10.0, 0.0), 140.0),
    ):
        depth = oval_depth(distance, focus, half)
        edge = math.degrees(math.atan2(half, distance + depth))
        whole = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, INDEX, distance, focus, edge, -edge)
        angle = math.radians(axis_deg)
        turn = Rigid(math.cos(angle), math.sin(angle), offset_point(at, axis_deg, -depth, 0.0))
        ovals[name] = (whole.moved(turn), turn.point((0.0, -distance)), axis_deg)
    main, second = ovals["main"][0], ovals["second"][0]
    faces = [
        ("lens-main", main),
        ("shoulder-right", Segment(main.end, trunk[1])),
        ("trunk-right", Segment(trunk[1], (1.5, 12.0))),
        ("join-right", Segment((1.5, 12.0), right)),
        ("branch-right", Segment(right, tips[-40.0, 1])),
        ("lens-second", second),
        ("branch-left", Segment(tips[-40.0, -1], crotch)),
        ("other-right", Segment(crotch, tips[40.0, 1])),
        ("receiver-end", Segment(tips[40.0, 1], tips[40.0, -1])),
        ("other-left", Segment(tips[40.0, -1], left)),
        ("join-left", Segment(left, (-1.5, 12.0))),
        ("trunk-left.2", Segment((-1.5, 12.0), (-1.5, 5.0))),
        ("receiver-side", Segment((-1.5, 5.0), (-1.5, 2.0))),
        ("trunk-left.1", Segment((-1.5, 2.0), trunk[-1])),
        ("shoulder-left", Segment(trunk[-1], main.start)),
    ]
    interfaces = tuple(
        Interface(name, curve, "body", "air", "receiver", name.removeprefix("receiver-"))
        if name.startswith("receiver")
        else Interface(name, curve, "body", "air")
        for name, curve in faces
    )
    _, position, axis_deg = ovals["main" if emitter == "a" else "second"]
    regions = (Region("air", 1.0), Region("body", INDEX, 0.01))
    return Scene(regions, interfaces, (Fan(position, axis_deg, 120.0, 300),))


def oval_depth(distance: float, focus: float, half: float) -> float:
    """Depth of a Cartesian oval's edge, at which the optical length equals that at the vertex, by bisection."""
    low, high = 0.0, half
    for _ in range(200):
        z = 0.5 * (low + high)
        length = math.hypot(half, distance + z) + INDEX * math.hypot(half, focus - z)
        low, high = (z, high) if length > distance + INDEX * focus else (low, z)
    return 0.5 * (low + high)


def test_three_guides_agree_with_the_scene_by_hand() -> None:
    network = network_trace(three_guides())
    for number, emitter in enumerate(("a", "b")):
        scene = hand_scene(emitter)
        fast = trace(scene, "power")
        slow = reference(scene, "power")
        for receiver, power in zip(network.receivers, network.power[0, number], strict=True):
            assert power == pytest.approx(fast.detectors[receiver].power, abs=1e-9)
            assert power == pytest.approx(slow.detectors[receiver].power, abs=1e-9)
        for part in fields(network.ledgers[0][number]):
            assert getattr(network.ledgers[0][number], part.name) == pytest.approx(
                getattr(fast.ledger, part.name), abs=1e-9
            )
    assert network.power.min() > 1e-4


def check_random_networks(seeds: range) -> int:
    """Check that ledgers are complete and that engine and reference agree; return the number of networks checked."""
    checked = 0
    for seed in seeds:
        design = random_network(seed)
        try:
            scene = Sensor.of(design).scene(0.0, 24)
        except SolenError:
            continue
        fast, slow = trace(scene, "count"), reference(scene, "count")
        assert fast.ledger.total == pytest.approx(1.0, abs=1e-12), seed
        assert fast.undefined == 0, seed
        assert {name: row.power for name, row in fast.detectors.items()} == pytest.approx(
            {name: row.power for name, row in slow.detectors.items()}, abs=1e-12
        ), seed
        checked += 1
    return checked


def test_ledgers_of_random_networks_are_complete() -> None:
    assert check_random_networks(range(8)) >= 7


@pytest.mark.evidence
def test_ledgers_of_two_hundred_random_networks_are_complete() -> None:
    checked = check_random_networks(range(230))
    print(f"{checked} random networks: ledgers complete, engine and reference agree")
    assert checked >= 200


MOTION = [
    {"name": "lean", "kind": "bend", "part": "branch", "from_deg": -10.0, "to_deg": 10.0, "steps": 2},
    {"name": "tilt", "kind": "rotation", "part": "main", "from_deg": -1.0, "to_deg": 1.0, "steps": 1},
]


def test_response_agrees_with_each_state_and_emitter() -> None:
    design = three_guides(motion=MOTION)
    response = network_response(design, [{}, {"lean": 4.0, "tilt": 0.5}], tolerance=1e-3)
    assert response.angle_deg.tolist() == [[0.0, 0.0], [4.0, 0.5]]
    moved = with_values(design, {"network.motion[0].at_deg": 4.0, "network.motion[1].at_deg": 0.5, "network.lit": "b"})
    integrated = Sensor.of(moved).integrate(tolerance=1e-3)
    difference = response.power[1, 1] - [integrated.detectors[name].power for name in response.receivers]
    assert np.abs(difference).max() < 4.0 * response.u_power[1, 1].max() + integrated.u_power
    assert response.u_power.max() <= 1e-3
    assert network_check(design).states == 1 + 3 + 2 + 4


def test_refuses_a_load_on_a_network() -> None:
    with pytest.raises(DesignError, match=r"body\.kind = 'network'; .*network\.motion"):
        _ = Sensor.of(three_guides()).loaded


def test_study_sweeps_each_motion() -> None:
    study = network_study(three_guides(motion=MOTION[:1]), tolerance=1e-3)
    assert study.sweeps["lean"].angle_deg.tolist() == [[-10.0], [0.0], [10.0]]
    assert np.array_equal(study.sweeps["lean"].power[1], study.at_rest.power[0])
    assert np.abs(np.diff(study.sweeps["lean"].power[:, 1], axis=0)).max() > 10.0 * study.at_rest.u_power.max()
    figure = network_figure(study)
    assert figure.get_suptitle().startswith("simulated: ")
    drawing, *panels = figure.axes
    assert {text.get_text() for text in drawing.texts} == {"a emits", "b emits", *study.at_rest.receivers}
    assert [axes.get_title() for axes in panels] == ["a lit", "b lit"]


def test_slope_is_the_difference_of_integrals() -> None:
    design = three_guides(motion=MOTIONS)
    result = network_sensitivities(design, ["network.motion[0].at_deg", "network.emitters[1].distance_mm"])
    assert result.step.tolist() == pytest.approx([1.0, 0.05])
    for number, key in enumerate(result.keys):
        ends = (result.value[number] + sign * result.step[number] for sign in (-1.0, 1.0))
        low, high = (
            Sensor.of(with_values(design, {key: float(end), "network.lit": "b"})).integrate(tolerance=3e-4)
            for end in ends
        )
        for index, receiver in enumerate(result.receivers):
            slope = (high.detectors[receiver].power - low.detectors[receiver].power) / (2.0 * result.step[number])
            u = 4.0 * result.u_slope[number, 1, index] + 6e-4 / result.step[number]
            assert result.slope[number, 1, index] == pytest.approx(slope, abs=u), (key, receiver)


@pytest.mark.parametrize(
    ("state", "message"),
    [({"leans": 1.0}, r"is not the name of a motion; known names: lean"), ({"lean": 11.0}, r"= 11\.0; .*-10 to 10")],
)
def test_refuses_invalid_states(state: dict[str, float], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        network_response(three_guides(motion=MOTION[:1]), [state])


def test_counting_is_an_option_of_a_network_trace() -> None:
    counted = network_trace(three_guides(), TraceOptions(mode="count"))
    assert np.allclose(counted.power * 300, np.round(counted.power * 300))


def contrast(emitter: str) -> dict[str, str]:
    return {
        "name": f"of {emitter}",
        "value": f"({emitter}.right - {emitter}.left) / ({emitter}.right + {emitter}.left)",
    }


def test_reading_gives_the_contrast_of_the_y() -> None:
    design = y_network(y_design())
    lit = design.network.emitters[0].name
    design = with_values(design, {"network.reading": [contrast(lit)]})
    traced = network_trace(design)
    right, left = (traced.power[0, 0, traced.receivers.index(side)] for side in ("right", "left"))
    assert traced.reading.tolist() == [[(right - left) / (right + left)]]


def test_uncertainties_of_readings_bound_the_errors() -> None:
    network = three_guides(reading=READINGS).network
    power = np.array([[0.2, 0.05], [0.03, 0.1]])
    u_power = np.array([[1e-4, 3e-4], [2e-4, 2e-4]])
    values, u = readings_of(network, power, u_power)
    errors = np.random.default_rng(3).normal(size=(4000, 2, 2)) * u_power
    drawn = readings_of(network, power + errors, u_power)[0]
    assert values.tolist() == pytest.approx([1 / 3, (0.2 - 0.06) / 3 + 0.05])
    assert np.all(np.std(drawn, axis=0) <= u * 1.03)  # independent errors are below the bound
    opposed = readings_of(network, power + np.array([[-1.0, -1.0], [1.0, 1.0]]) * u_power, u_power)[0]
    assert np.abs(opposed - values) == pytest.approx(u, rel=3e-3)  # opposite errors reach it
    dark = readings_of(network, np.zeros((2, 2)), u_power)[0]
    assert np.isnan(dark[0])
    assert dark[1] == 0.0
    assert readings_of(network, np.zeros((2, 2)), u_power)[1][1] == pytest.approx((1e-4 + 2 * 2e-4 + 3 * 3e-4) / 3)


@pytest.mark.evidence
def test_readings_of_traces_are_within_their_uncertainties() -> None:
    design = three_guides(motion=MOTIONS, reading=READINGS)
    states = [
        {"lean": lean, "swing": swing} for lean in np.linspace(-8.0, 8.0, 8).tolist() for swing in (-6.0, -1.0, 5.0)
    ]
    coarse, fine = (network_response(design, states, tolerance) for tolerance in (1e-3, 1e-4))
    ratios = np.abs(coarse.reading - fine.reading) / np.hypot(coarse.u_reading, fine.u_reading)
    print(f"{ratios.size} readings: within u {np.mean(ratios <= 1.0):.3f}, within 2 u {np.mean(ratios <= 2.0):.3f}")
    assert np.mean(ratios <= 1.0) >= 0.55
    assert np.mean(ratios <= 2.0) >= 0.9


def test_study_and_slopes_include_readings() -> None:
    design = three_guides(motion=MOTIONS[:1], reading=READINGS)
    assert network_check(design).readings == {reading["name"]: reading["value"] for reading in READINGS}
    study = network_study(with_values(design, {"network.motion[0].steps": 1}), tolerance=1e-3)
    power = study.sweeps["lean"].power
    assert np.array_equal(
        study.sweeps["lean"].reading[:, 0], (power[:, 0, 0] - power[:, 1, 1]) / (power[:, 0, 0] + power[:, 1, 1])
    )
    rows = csv_table(study).splitlines()
    assert rows[0].endswith(",bend,u_bend,most,u_most")
    assert float(rows[1].split(",")[-4]) == study.at_rest.reading[0, 0]
    slopes = network_sensitivities(design, tolerance=1e-3)
    ends = network_response(design, [{"lean": -0.5}, {"lean": 0.5}], tolerance=3e-4).reading[:, 0]
    assert slopes.reading_slope[0, 0] == pytest.approx(ends[1] - ends[0], abs=3.0 * slopes.u_reading_slope[0, 0])


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("a.end + c.end", "c.end"),
        ("a.ends", "did you mean a.end"),
        ("end / 2", "emitters: a, b; receivers: end, side"),
        ("__import__('os')", "functions"),
        ("a.end.real", "a.end.real"),
        ("a.end > 0.1", "condition"),
        ("1 + 2.5", "must contain a power"),
        ("a.end -", "not a valid expression"),
        ("p_0 + a.end", "p_0"),
        ("a.end-2", "space"),
    ],
)
def test_refuses_invalid_readings(value: str, words: str) -> None:
    with pytest.raises(SpecError, match=r"network\.reading") as error:
        three_guides(reading=[{"name": "bend", "value": value}])
    assert words in str(error.value)


def test_one_of_several_emitters_must_be_named() -> None:
    with pytest.raises(SpecError, match=r"--emitter.*a, b"):
        with_lit_emitter(three_guides(), None)
    assert with_lit_emitter(three_guides(), "b").network.lit == "b"
    assert with_lit_emitter(with_values(three_guides(), {"network.lit": "b"}), None).network.lit == "b"
    assert with_lit_emitter(y_design(), None) == y_design()
    with pytest.raises(SpecError, match="network"):
        with_lit_emitter(y_design(), "b")


def check_errors_of_powers(design: Design, lattices: int) -> None:
    """Check that uncertainties cover the errors of powers from different rays, without exceeding them by far."""
    responses = [network_response(design, [{}], 1e-3, lattice=number) for number in range(lattices)]
    sensors = emitter_sensors(design)
    fine = [integrate_by_nets(sensor.scene(), 1.0, "power", first_rays=2**18, seed=999) for sensor in sensors]
    detected = [[each.detectors[name] for name in responses[0].receivers] for each in fine]
    true, u_true = (
        np.array([[getattr(each, name) for each in row] for row in detected]) for name in ("power", "u_power")
    )
    ratios = np.array([(each.power[0] - true) / np.hypot(each.u_power[0], u_true) for each in responses])
    rms, median = np.sqrt(np.mean(ratios**2)), np.median(np.abs(ratios))
    print(f"{design.name}: {ratios.size} errors over u: rms {rms:.3f}, median {median:.3f}")
    print(f"{design.name}: rms by power {np.round(np.sqrt(np.mean(ratios**2, axis=0)), 2).tolist()}")
    assert rms <= 1.0
    assert median > 0.1


def test_uncertainties_cover_the_errors_of_powers() -> None:
    check_errors_of_powers(three_guides(), 12)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["hand-860", "robot-860"])
def test_uncertainties_cover_the_errors_of_template_networks(name: str) -> None:
    check_errors_of_powers(with_values(loads(template(name)), {"trace.dimension": "2d"}), 40)


def test_derivative_is_that_of_the_named_emitter() -> None:
    second = {"name": "other", "lens": "main", "offset_mm": 0.05}
    design = y_network(y_design(), emitters=[{"name": "led", "lens": "main"}, second])
    sensor, key = Sensor.of(design), "emitter.distance_mm"
    with pytest.raises(SpecError, match=r"emitter; is missing: the emitters are led, other"):
        sensor.derivative(key)
    assert sensor.derivative(key, emitter="other").reached
    with pytest.raises(SpecError, match=r"network\.lit"):
        sensor.derivative(key, emitter="none")
