"""Networks swept, varied and optimised: merits, built lenses, and options that do not apply."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from solen.errors import SolenError
from solen.explore import (
    OptimiseOptions,
    Optimum,
    Store,
    Sweep,
    SweepOptions,
    ToleranceOptions,
    optimise,
    sweep,
    tolerance,
)
from solen.explore.measures import measure_of
from solen.explore.merits import table_merits
from solen.sensor import Sensor, why_inert
from solen.sensor.effects import with_deviations
from solen.sensor.network import emitter_sensors, network_response, network_sensitivities
from solen.spec import Design
from solen.spec.network import Network

WIDTH, COARSE = "network.guides[1].width_mm", 1e-2
DESIGN = Design(
    name="fork",
    material={"index": 1.44},
    emitter={"width_mm": 0.25, "pattern": "lambertian", "cone_deg": 180.0},
    body={"kind": "network"},
    network={
        "nodes": [{"name": name} for name in ("base", "fork", "tip", "end")],
        "guides": [
            {"name": "trunk", "nodes": ["base", "fork"], "width_mm": 3.0, "direction_deg": 0.0, "length_mm": 8.0},
            {"name": "arm", "nodes": ["fork", "tip"], "width_mm": 2.0, "direction_deg": -30.0, "length_mm": 8.0},
            {"name": "other", "nodes": ["fork", "end"], "width_mm": 2.0, "direction_deg": 30.0, "length_mm": 8.0},
        ],
        "lenses": [{"name": "main", "node": "base"}, {"name": "second", "node": "tip", "focus_mm": 12.0}],
        "emitters": [{"name": "a", "lens": "main"}, {"name": "b", "lens": "second", "distance_mm": 1.2}],
        "receivers": [
            {"name": "end", "node": "end"},
            {"name": "side", "guide": "trunk", "side": "left", "from_mm": 2.0, "to_mm": 4.0},
        ],
        "motion": [{"name": "arm-bends", "kind": "bend", "part": "arm", "from_deg": -8.0, "to_deg": 8.0, "steps": 2}],
        "reading": [{"name": "end of b", "value": "b.end / (b.end + b.side)"}],
    },
    trace={"mode": "power", "dimension": "2d"},
)

PARTS = ("nodes", "guides", "lenses", "emitters", "receivers")
WITHOUT_MOTION = DESIGN.model_copy(update={"network": Network(**{key: getattr(DESIGN.network, key) for key in PARTS})})


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Sweep]:
    folder = tmp_path_factory.mktemp("swept")
    return folder, sweep(DESIGN, SweepOptions(over=(f"{WIDTH}=1.8,2.2",), tolerance=COARSE), Store(folder))


def test_merits_follow_from_response(swept: tuple[Path, Sweep]) -> None:
    _, result = swept
    states = [{}, {"arm-bends": -8.0}, {"arm-bends": 8.0}]
    response = network_response(DESIGN.set({WIDTH: 2.2}), states, COARSE)
    assert result.merits["light"][1] == response.power.sum(axis=2).min()
    assert result.merits["light_b_side"][1] == response.power[:, 1, 1].min()
    reading = response.power[:, 1, 0] / response.power[:, 1].sum(axis=1)
    assert result.merits["span_end_of_b_arm_bends"][1] == pytest.approx(np.ptp(reading))
    slope, u = (result.merits[f"{u}slope_end_of_b_arm_bends_per_deg"][1] for u in ("", "u_"))
    assert slope == pytest.approx((reading[2] - reading[1]) / 16.0)
    assert u > response.u_reading[0, 0] / 16.0


def test_sd_of_motion_equals_that_of_sensitivity(swept: tuple[Path, Sweep]) -> None:
    _, result = swept
    design = DESIGN.set({WIDTH: 2.2, "network.motion[0].steps": 8})
    sensitivities = network_sensitivities(design, tolerance=COARSE)
    assert sensitivities.by_voltages is not None
    assert result.merits["sd_arm_bends_deg"][1] == pytest.approx(sensitivities.by_voltages.sd_deg[0], rel=1e-9)
    assert result.merits["worst_sd_deg"].tolist() == result.merits["sd_arm_bends_deg"].tolist()
    assert "worst_sd_deg" in table_merits(result.merits)
    assert "worst_light" not in table_merits({**result.merits, "worst_light": 0.0})


def test_sweep_is_stored_with_network_dimensions(swept: tuple[Path, Sweep]) -> None:
    pytest.importorskip("xarray")
    folder, result = swept
    repeated = sweep(DESIGN, SweepOptions(over=(f"{WIDTH}=1.8,2.2",), tolerance=COARSE), Store(folder))
    assert repeated.traced == 0
    data = repeated.to_dataset()
    assert data["power"].dims == (WIDTH, "state", "emitter", "receiver")
    assert np.array_equal(data["power"].to_numpy().reshape(result.power.shape), result.power)
    assert data["angle_deg"].to_numpy().tolist() == [[0.0], [-8.0], [8.0], [-1.0], [1.0]]


def lens_depths(sensor: Sensor) -> list[float]:
    return [lens.depth_mm for lens in sensor.all_lenses]


@pytest.mark.parametrize(
    ("key", "step", "unchanged"),
    [
        ("network.emitters[1].distance_mm", 0.3, True),
        ("emitter.distance_mm", 0.3, True),
        ("material.index", 0.02, True),
        ("network.lenses[1].focus_mm", 3.0, False),
        (WIDTH, 0.2, False),
    ],
)
def test_emitter_position_does_not_change_lens(key: str, step: float, unchanged: bool) -> None:
    for sensor in emitter_sensors(DESIGN):
        built = with_deviations(sensor, {key: step})
        assert (lens_depths(built) == lens_depths(sensor)) is unchanged
    (front,) = (face.curve for face in built.body().all_faces if face.name == "lens-second")
    assert np.hypot(*np.subtract(front.start, front.end)) == pytest.approx(2.2 if key == WIDTH else 2.0)
    moved = key == "network.emitters[1].distance_mm"
    gap = np.hypot(*np.subtract(built.body().emitter.point, sensor.body().emitter.point))
    assert gap == pytest.approx(step if moved else gap)


def test_result_of_search_is_retraced_with_other_lattice() -> None:
    pytest.importorskip("cma")
    far = WITHOUT_MOTION.set({"network.emitters[1].distance_mm": 4.0})
    free = ("network.emitters[1].distance_mm=0.8:4",)
    result = optimise(far, OptimiseOptions(maximise=("light_b_end",), free=free, evaluations=20, tolerance=COARSE))
    assert isinstance(result, Optimum)
    assert result.after.goal - result.before.goal > 2.0 * np.hypot(result.before.u_goal, result.after.u_goal)
    assert result.after.goal != result.claimed  # not the same rays
    assert abs(result.after.goal - result.claimed) < 3.0 * COARSE
    fine = network_response(result.design, [{}], 2e-3, lattice=7)
    assert fine.power[0, 1, 0] == pytest.approx(result.after.goal, abs=3.0 * np.hypot(result.after.u_goal, 2e-3))
    assert result.design.network.lit is None


def test_tolerance_analysis_of_network() -> None:
    sensor = Sensor.of(DESIGN)
    assert not why_inert(sensor, "emitter.offset_mm")
    assert not why_inert(sensor, "lens.focus_mm")
    assert "its own" in why_inert(
        Sensor.of(DESIGN.set({"network.emitters[0].distance_mm": 1.0})), "emitter.distance_mm"
    )
    assert "network" in why_inert(sensor, "body.arm_width_mm")
    vary = (f"{WIDTH}=uniform:-0.1:0.1",)
    result = tolerance(
        WITHOUT_MOTION, ToleranceOptions(vary=vary, prints=32, tolerance=COARSE, require=("light > 0.5*base",))
    )
    assert result.yields[0].share == 1.0
    assert result.yields[0].calibrated_share is None


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (partial(ToleranceOptions, adjust="emitter.offset_mm=0.05"), "two receivers"),
        (partial(ToleranceOptions, vary=("network.motion[0].at_deg=uniform:-1:1",)), r"network\.motion\[0\]\.at_deg"),
        (partial(ToleranceOptions, require=("null_deg < 1",)), "null_deg is not a merit"),
        (partial(SweepOptions, over=("network.motion[0].at_deg=0,2",)), "same angles"),
        (partial(OptimiseOptions, minimise=("light",), free=(f"{WIDTH}=1:2",), as_printed=True), "network"),
    ],
)
def test_refuses_inapplicable_options(options: partial[SweepOptions], reason: str) -> None:
    commands = {ToleranceOptions: tolerance, SweepOptions: sweep, OptimiseOptions: optimise}
    with pytest.raises(SolenError, match=reason) as error:
        commands[options.func](DESIGN, options())  # type: ignore[operator,index]
    assert "\n" not in str(error.value)


def test_refuses_single_step_and_equal_merit_names() -> None:
    with pytest.raises(SolenError, match=r"network\.motion\[0\]\.steps = 1"):
        measure_of(DESIGN.set({"network.motion[0].steps": 1}))
    twins = DESIGN.set(
        {"network.receivers[0].name": "x-1", "network.receivers[1].name": "x_1", "network.reading[0].value": "b.x_1"}
    )
    with pytest.raises(SolenError, match="light_a_x_1"):
        measure_of(twins)
