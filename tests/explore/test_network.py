"""Networks swept, varied and optimised: their merits, what a built part keeps, and what does not apply to them."""

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
        "reading": [{"name": "share of b", "value": "b.end / (b.end + b.side)"}],
    },
    trace={"mode": "power", "dimension": "2d"},
)

PARTS = ("nodes", "guides", "lenses", "emitters", "receivers")
STILL = DESIGN.model_copy(update={"network": Network(**{key: getattr(DESIGN.network, key) for key in PARTS})})


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Sweep]:
    folder = tmp_path_factory.mktemp("swept")
    return folder, sweep(DESIGN, SweepOptions(over=(f"{WIDTH}=1.8,2.2",), tolerance=COARSE), Store(folder))


def test_merits_of_a_network_are_those_of_its_response(swept: tuple[Path, Sweep]) -> None:
    _, found = swept
    states = [{}, {"arm-bends": -8.0}, {"arm-bends": 8.0}]
    own = network_response(DESIGN.set({WIDTH: 2.2}), states, COARSE)
    assert found.merits["light"][1] == own.power.sum(axis=2).min()
    assert found.merits["light_b_side"][1] == own.power[:, 1, 1].min()
    share = own.power[:, 1, 0] / own.power[:, 1].sum(axis=1)
    assert found.merits["span_share_of_b_arm_bends"][1] == pytest.approx(np.ptp(share))
    slope, u = (found.merits[f"{u}slope_share_of_b_arm_bends_per_deg"][1] for u in ("", "u_"))
    assert slope == pytest.approx((share[2] - share[1]) / 16.0)
    assert u > own.u_reading[0, 0] / 16.0


def test_motions_are_known_as_well_as_by_the_derivatives_of_the_voltages(swept: tuple[Path, Sweep]) -> None:
    _, found = swept
    sensitive = network_sensitivities(DESIGN.set({WIDTH: 2.2, "network.motion[0].steps": 8}), tolerance=COARSE)
    assert sensitive.by_voltages is not None
    assert found.merits["sd_arm_bends_deg"][1] == pytest.approx(sensitive.by_voltages.sd_deg[0], rel=1e-9)
    assert found.merits["worst_sd_deg"].tolist() == found.merits["sd_arm_bends_deg"].tolist()
    assert "worst_sd_deg" in table_merits(found.merits)
    assert "worst_light" not in table_merits({**found.merits, "worst_light": 0.0})


def test_a_sweep_of_a_network_is_kept_and_has_its_own_dimensions(swept: tuple[Path, Sweep]) -> None:
    pytest.importorskip("xarray")
    folder, found = swept
    again = sweep(DESIGN, SweepOptions(over=(f"{WIDTH}=1.8,2.2",), tolerance=COARSE), Store(folder))
    assert again.traced == 0
    data = again.to_dataset()
    assert data["power"].dims == (WIDTH, "state", "emitter", "receiver")
    assert np.array_equal(data["power"].to_numpy().reshape(found.power.shape), found.power)
    assert data["angle_deg"].to_numpy().tolist() == [[0.0], [-8.0], [8.0], [-1.0], [1.0]]


def lens_widths(sensor: Sensor) -> list[float]:
    return [lens.depth_mm for lens in sensor.all_lenses]


@pytest.mark.parametrize(
    ("key", "step", "stays"),
    [
        ("network.emitters[1].distance_mm", 0.3, True),
        ("emitter.distance_mm", 0.3, True),
        ("material.index", 0.02, True),
        ("network.lenses[1].focus_mm", 3.0, False),
        (WIDTH, 0.2, False),
    ],
)
def test_a_built_lens_is_the_drawn_one_wherever_the_emitter_stands(key: str, step: float, stays: bool) -> None:
    for sensor in emitter_sensors(DESIGN):
        built = with_deviations(sensor, {key: step})
        assert (lens_widths(built) == lens_widths(sensor)) is stays
    (front,) = (face.curve for face in built.body().all_faces if face.name == "lens-second")
    assert np.hypot(*np.subtract(front.start, front.end)) == pytest.approx(2.2 if key == WIDTH else 2.0)
    moved = key == "network.emitters[1].distance_mm"
    gap = np.hypot(*np.subtract(built.body().emitter.point, sensor.body().emitter.point))
    assert gap == pytest.approx(step if moved else gap)


def test_a_search_traces_its_result_again_by_another_lattice() -> None:
    pytest.importorskip("cma")
    far = STILL.set({"network.emitters[1].distance_mm": 4.0})
    free = ("network.emitters[1].distance_mm=0.8:4",)
    found = optimise(far, OptimiseOptions(maximise=("light_b_end",), free=free, evaluations=20, tolerance=COARSE))
    assert isinstance(found, Optimum)
    assert found.after.goal - found.before.goal > 2.0 * np.hypot(found.before.u_goal, found.after.u_goal)
    assert found.after.goal != found.claimed  # not the same rays
    assert abs(found.after.goal - found.claimed) < 3.0 * COARSE
    again = network_response(found.design, [{}], 2e-3, lattice=7)
    assert again.power[0, 1, 0] == pytest.approx(found.after.goal, abs=3.0 * np.hypot(found.after.u_goal, 2e-3))
    assert found.design.network.lit is None


def test_numbers_of_a_network_vary_with_what_is_usual_of_them() -> None:
    sensor = Sensor.of(DESIGN)
    assert not why_inert(sensor, "emitter.offset_mm")
    assert not why_inert(sensor, "lens.focus_mm")
    assert "its own" in why_inert(
        Sensor.of(DESIGN.set({"network.emitters[0].distance_mm": 1.0})), "emitter.distance_mm"
    )
    assert "network" in why_inert(sensor, "body.arm_width_mm")
    vary = (f"{WIDTH}=uniform:-0.1:0.1",)
    found = tolerance(STILL, ToleranceOptions(vary=vary, prints=32, tolerance=COARSE, require=("light > 0.5*base",)))
    assert found.yields[0].share == 1.0
    assert found.yields[0].calibrated_share is None


@pytest.mark.parametrize(
    ("ask", "named"),
    [
        (partial(ToleranceOptions, adjust="emitter.offset_mm=0.05"), "two receivers"),
        (partial(ToleranceOptions, vary=("network.motion[0].at_deg=uniform:-1:1",)), r"network\.motion\[0\]\.at_deg"),
        (partial(ToleranceOptions, require=("null_deg < 1",)), "null_deg is not a merit"),
        (partial(SweepOptions, over=("network.motion[0].at_deg=0,2",)), "same angles"),
        (partial(OptimiseOptions, minimise=("light",), free=(f"{WIDTH}=1:2",), as_printed=True), "network"),
    ],
)
def test_what_does_not_apply_is_refused_in_one_line(ask: partial[SweepOptions], named: str) -> None:
    commands = {ToleranceOptions: tolerance, SweepOptions: sweep, OptimiseOptions: optimise}
    with pytest.raises(SolenError, match=named) as refused:
        commands[ask.func](DESIGN, ask())  # type: ignore[operator,index]
    assert "\n" not in str(refused.value)


def test_motions_need_steps_and_names_differ() -> None:
    with pytest.raises(SolenError, match=r"network\.motion\[0\]\.steps = 1"):
        measure_of(DESIGN.set({"network.motion[0].steps": 1}))
    twins = DESIGN.set(
        {"network.receivers[0].name": "x-1", "network.receivers[1].name": "x_1", "network.reading[0].value": "b.x_1"}
    )
    with pytest.raises(SolenError, match="light_a_x_1"):
        measure_of(twins)
