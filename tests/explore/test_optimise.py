"""Inverse design: searches with known answers, limits, deviations, interruption and resumption."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

from solen.arrays import FloatArray
from solen.cli.app import lines
from solen.cli.explore.optimise import optimise as optimise_files
from solen.errors import OutputError, SpecError
from solen.explore.optimise import (
    Front,
    NondominatedDesign,
    OptimiseOptions,
    Optimum,
    check_prints,
    optimise,
    straightness_options,
    with_prints,
)
from solen.explore.optimise.candidates import Candidates
from solen.explore.optimise.evaluation import Evaluator
from solen.explore.optimise.front import search_front, weights_of
from solen.explore.optimise.optimum import limit_warnings, outside_warnings
from solen.explore.optimise.search import Trials, search
from solen.explore.optimise.task import Task
from solen.explore.store import Accuracy, Store, Variant
from solen.explore.tolerance import ToleranceOptions, tolerance
from solen.fabricate.process import PrintOptions, default_process, print_design, process_text
from solen.lens import DesignedLens, MeasuredLens
from solen.lens.build import measured_lens
from solen.report.canvas import drawn as drawn_figure
from solen.report.canvas import encoded
from solen.report.explore.optimise import front_figure, optimum_figure
from solen.report.options import FigureOptions
from solen.sensor import Sensor
from solen.spec import Design, load, save

pytest.importorskip("cma")

DESIGN = Design(
    name="small",
    material={"index": 1.44},
    motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 1.0},
    emitter={"width_mm": 0.2, "offset_mm": 0.02, "pattern": "lambertian", "cone_deg": 120.0},
)
CENTRE: dict[str, Any] = {
    "minimise": ("abs(null_deg)",),
    "free": ("emitter.offset_mm=-0.03:0.03",),
    "evaluations": 20,
    "tolerance": 1e-2,
}


def bowl(point: FloatArray) -> float:
    """Least at (0.8, 0.3, 0.05), with a ridge."""
    a, b, c = point
    return float((a - 0.8) ** 2 + 10.0 * (b - 0.3 - 0.2 * (a - 0.8)) ** 2 + abs(c - 0.05))


def test_a_search_finds_the_least_value_and_goes_the_same_way_again() -> None:
    runs = [Trials(bowl, 400), Trials(bowl, 400)]
    for tried in runs:
        search(tried, np.array([0.2, 0.9, 0.9]), seed=1)
    assert runs[0].best == pytest.approx([0.8, 0.3, 0.05], abs=0.01)
    assert runs[0].values == runs[1].values
    assert len(runs[0].values) <= 400


def test_one_number_alone_that_hardly_matters_is_sought_all_the_same() -> None:
    tried = Trials(lambda point: float(np.round(point[0])), 200)
    search(tried, np.array([0.9]), seed=0)
    assert tried.values[int(np.argmin(tried.values))] == 0.0


@pytest.fixture(scope="module")
def centred() -> tuple[Store, Optimum]:
    store = Store()
    return store, optimum(DESIGN, OptimiseOptions(**CENTRE), store)


def optimum(design: Design, options: OptimiseOptions, store: Store | None = None, **more: Any) -> Optimum:
    found = optimise(design, options, store, **more)
    assert isinstance(found, Optimum)
    return found


def test_the_emitter_is_moved_to_where_the_null_is_at_0(centred: tuple[Store, Optimum]) -> None:
    _, found = centred
    assert found.free[0].before == 0.02
    assert abs(found.free[0].after) < 0.003
    assert found.after.goal < 0.2 * found.before.goal
    assert found.sampled_difference is not None
    assert found.u_sampled_difference is not None
    assert found.sampled_difference < 4.0 * found.u_sampled_difference
    assert found.to_dataset()["contrast"].sel(design="after", case="worst").shape == found.angle_deg.shape
    assert np.nanmin(found.history) == found.history[-1]


def test_the_same_search_goes_on_from_what_is_known(centred: tuple[Store, Optimum]) -> None:
    store, found = centred
    again = optimum(DESIGN, OptimiseOptions(**CENTRE), store)
    assert again.traced == 0
    assert again.design == found.design


def test_an_optimum_at_a_limit_and_a_design_beyond_it_are_said(centred: tuple[Store, Optimum]) -> None:
    free = ("emitter.offset_mm=0.005:0.015",)
    task = Task.of(DESIGN, OptimiseOptions(**CENTRE | {"free": free}))
    (beyond,) = outside_warnings(task)
    (limit,) = limit_warnings(task, DESIGN.set({"emitter.offset_mm": 0.005}))
    assert "0.02" in beyond
    assert "0.005" in limit
    assert not any("emitter.offset_mm" in text for text in centred[1].warnings)
    assert not centred[1].robust


PRINTS = {
    "vary": ("emitter.offset_mm=normal:0:0.02", "material.index=uniform:-0.005:0.005"),
    "require": ("abs(null_deg) < 0.3",),
    "prints": 32,
}


def test_prints_before_and_after_are_those_of_both_designs(centred: tuple[Store, Optimum]) -> None:
    """The decentre of the design, a standard deviation of the prints, is what the search removes."""
    store, found = centred
    options = OptimiseOptions(**CENTRE | PRINTS)
    assert check_prints(DESIGN, options)
    both = with_prints(found, DESIGN, options, store)
    before, after = both.prints_before, both.prints_after
    assert before is not None
    assert after is not None
    assert both.traced >= found.traced + 64
    alone = tolerance(found.design, ToleranceOptions(**PRINTS, tolerance=CENTRE["tolerance"]), store)
    assert alone.traced == 0
    assert after.yields == alone.yields
    assert before.deviations["emitter.offset_mm"].tolist() == after.deviations["emitter.offset_mm"].tolist()
    nulls = [np.nanmean(prints.merits["null_deg"]) for prints in (before, after)]
    assert abs(nulls[1]) < 0.3 * abs(nulls[0])
    printed = "\n".join(lines(both))
    assert all(word in printed for word in ("32 prints", "emitter.offset_mm", "yield of all"))
    texts = {axes.get_xlabel() for axes in optimum_figure(both).axes}
    assert {"null_deg of prints", "light of prints"} <= texts


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"prints": 8}, "at least 32"),
        ({"vary": ("emitter.ofset_mm=normal:0:1",)}, "ofset"),
        ({"require": ("ligt > 1",)}, "light"),
        ({"prints": 0, "require": ("light > 1",)}, "--prints"),
        ({"maximise": ("light",), "evaluations": 80, "require": ("light > 1",)}, "--require"),
    ],
)
def test_prints_that_cannot_be_compared_are_refused_before_the_search(changed: dict[str, Any], named: str) -> None:
    with pytest.raises(SpecError) as refused:
        check_prints(DESIGN, OptimiseOptions(**CENTRE | changed))
    assert named in str(refused.value)


def test_prints_that_are_interrupted_leave_the_result(centred: tuple[Store, Optimum]) -> None:
    options = OptimiseOptions(**CENTRE | PRINTS)
    cut = with_prints(centred[1], DESIGN, options, Store(), progress=at_half)
    assert cut.interrupted
    assert cut.prints_after is None
    assert cut.design == centred[1].design


def at_half(done: float) -> None:
    if done >= 0.5:
        raise KeyboardInterrupt


def test_an_interrupted_search_has_its_best_so_far(centred: tuple[Store, Optimum]) -> None:
    store, found = centred
    kept: list[list[NondominatedDesign]] = []

    cut = optimum(
        DESIGN, OptimiseOptions(**CENTRE), store, progress=at_half, keep=lambda designs: kept.append([*designs])
    )
    assert cut.interrupted
    assert cut.evaluations == 10
    assert [cut.design] == [one.design for one in kept[-1]]
    assert cut.after.goal >= found.after.goal
    assert any("interrupted" in line for line in cut.warnings)


def test_the_worst_deviation_counts_and_conditions_hold(centred: tuple[Store, Optimum]) -> None:
    options = OptimiseOptions(**CENTRE, robust=("emitter.offset_mm=0.01",), subject_to=("light > 0.9*base",))
    found = optimum(DESIGN, options, centred[0])
    assert abs(found.free[0].after) < 0.006
    assert found.after.worst_off in ({"emitter.offset_mm": 0.01}, {"emitter.offset_mm": -0.01})
    assert found.after.goal == pytest.approx(abs(found.after.worst["null_deg"]))
    assert found.after.goal > abs(found.after.merits["null_deg"])
    assert found.after.meets == {"light > 0.9*base": True}


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"minimise": ()}, "--minimise"),
        ({"maximise": ("span", "light")}, "3 goals"),
        ({"maximise": ("abs(null_deg)",), "evaluations": 100}, "twice"),
        ({"maximise": ("span",)}, "at least 70"),
        ({"minimise": ("span < 1",)}, "condition"),
        ({"subject_to": ("worst(light) > 0.1",)}, "--robust"),
        ({"process": "absent.toml"}, "--as-printed"),
        ({"free": ()}, "--free"),
        ({"front": 3}, "--front"),
        ({"free": ("emitter.offset_mm=0.03:-0.03",)}, "0.03:-0.03"),
        ({"free": ("emitter.offset_mm=1,2",)}, "range"),
        ({"free": ("emitter.offset_mm=1:1",)}, "empty range"),
        ({"free": ("emitter.offset_mm=a:1",)}, "KEY=LOW:HIGH"),
        ({"free": ("lens.knots_um[0]=0:1",)}, "the list is empty"),
        ({"free": ("motion.step_deg=1:2",)}, "motion.step_deg"),
        ({"free": ("emitter.height_mm=0:1",)}, "emitter.height_mm"),
        ({"robust": ("emitter.offset_mm=-1",)}, "-1"),
        ({"robust": ("body.thickness_mm=1",)}, "body.thickness_mm"),
        ({"free": ("fabricate.film_mm=0.1:1",)}, "fabricate.film_mm"),
        ({"subject_to": ("light > 2",)}, "light > 2"),
    ],
)
def test_what_cannot_be_sought_is_refused_by_name(changed: dict[str, Any], named: str) -> None:
    with pytest.raises(SpecError) as refused:
        optimise(DESIGN, OptimiseOptions(**CENTRE | changed))
    assert named in str(refused.value)


def test_a_search_that_exploits_coarse_angles_is_caught() -> None:
    coarse = {"minimise": ("linearity_percent",), "free": ("lens.focus_mm=12:40",), "tolerance": 1e-3}
    wide = {"emitter.offset_mm": 0.0, "motion.from_deg": -3.0, "motion.to_deg": 3.0, "motion.step_deg": 1.5}
    found = optimum(DESIGN.set(wide), OptimiseOptions(**CENTRE | coarse))
    assert found.claimed < 0.2  # five angles of a symmetric sensor are two numbers
    assert found.after.goal > 0.5
    assert any("step_deg" in line for line in found.warnings)


class Circle:
    """Evaluator of points (2,) whose best goals are on a quarter of a circle, concave towards the ideal (0, 0)."""

    class task:  # noqa: N801  an attribute of a evaluator
        signs = (1.0, 1.0)
        begin = np.array([0.5, 0.9])

        @staticmethod
        def at(point: FloatArray) -> FloatArray:
            return point

    @staticmethod
    def of(point: FloatArray) -> Any:
        class evaluation:  # noqa: N801
            goals = (1.0 + point[1]) * np.array([np.sin(0.5 * np.pi * point[0]), np.cos(0.5 * np.pi * point[0])])
            violation, by_goal = max(0.0, point[1] - 0.95), ()

        return evaluation


def test_a_front_is_reached_where_it_is_hollow() -> None:
    best_numbers: list[list[int]] = []

    def keep(front: Sequence[NondominatedDesign]) -> None:
        best_numbers.append([one.number for one in front])

    candidates = Candidates(Circle, np.ones(2), 800, keep=keep)  # type: ignore[arg-type]  # has all that is used
    search_front(candidates, 5, seed=0)
    goals = np.array([one.goals for one in candidates.feasible])
    for weights in weights_of(5):
        best = goals[np.argmin((goals * np.where(weights > 0.0, weights, 1e-3)).max(axis=1))]
        assert np.hypot(*best) == pytest.approx(1.0, abs=0.02)
    assert len(candidates.tried) <= 800
    known = np.array([one.goals for one in candidates.tried])
    met = np.array([one.violation == 0.0 for one in candidates.tried])
    beaten = [(met & (known <= own).all(axis=1) & (known < own).any(axis=1)).any() for own in known]
    unbeaten = np.unique(known[met & ~np.array(beaten)], axis=0)
    assert np.array_equal(known[np.array(best_numbers[-1]) - 1], unbeaten), (
        "what is shown as it grows is the front of all that was tried"
    )


def test_a_straighter_response_is_sought_around_the_design() -> None:
    options = straightness_options(DESIGN)
    task = Task.of(DESIGN, options)
    assert np.allclose(task.initial_point, 0.5, atol=0.02)
    knots = DESIGN.set({"lens.shape": "spline", "lens.knots_um": (0.0, 5.0)})
    assert straightness_options(knots).free[-1] == "lens.knots_um[1]=-35:45"
    assert not any("focus" in text for text in straightness_options(DESIGN.set({"lens.shape": "none"})).free)


FRONT = {"minimise": ("abs(null_deg)",), "maximise": ("light",), "free": ("emitter.offset_mm=0.01:0.03",)}


def test_the_designs_of_a_front_are_files_and_none_is_worse_in_both(tmp_path: Path) -> None:
    design = save(tmp_path / "small.toml", DESIGN)
    options = OptimiseOptions(**CENTRE | FRONT | {"evaluations": 30, "front": 3})
    stale = tmp_path / "out" / "small-front-9.toml"
    runs = []
    for _ in range(2):
        outcome = optimise_files(design, out=tmp_path / "out", options=options)
        assert isinstance(outcome.result, Front)
        runs.append(outcome.result)
        assert not stale.exists()
        stale.write_text("of an earlier search")
    found = runs[1]
    assert [run.traced > 0 for run in runs] == [True, False]
    assert [one.design for one in runs[0].designs] == [one.design for one in found.designs]
    goals = np.array([one.goals for one in found.designs]) * [1.0, -1.0]
    assert not any((goals < own).all(axis=1).any() for own in goals)
    assert goals[0, 0] < found.before.goals[0]
    for one in found.designs:
        again = load(outcome.files[f"design {one.number}"])
        assert again == one.design
        assert again.emitter.offset_mm == one.free["emitter.offset_mm"]
    text = encoded(drawn_figure(lambda: front_figure(found), FigureOptions()), ".svg", "optimise", 100).decode()
    assert all(word in text for word in ("abs(null_deg) (minimise)", "light (maximise)", "simulated"))
    assert "tried" not in text
    errors = [one for one in front_figure(found).axes[0].containers if isinstance(one, ErrorbarContainer)]
    bars = [one for one in errors if one.has_xerr and one.has_yerr]
    assert sorted(len(np.atleast_1d(bar.lines[0].get_xdata())) for bar in bars) == sorted([1, len(found.designs)])
    printed = list(lines(found))
    assert not any("worst" in line for line in printed)
    assert any("worst over the deviations" in line for line in lines(replace(found, robust=True)))
    assert found.evaluations <= found.max_evaluations == 30
    assert any("2 of 32" in line for line in lines(replace(found, evaluations=30, max_evaluations=32)))
    assert any("emitter.offset_mm" in text and "design" in text for text in found.warnings), found.warnings
    data = found.to_dataset()
    assert data["goals"].sel(design=1, goal="maximise light") == found.designs[0].goals[1]
    assert data["emitter.offset_mm"].sel(design=0) == 0.02
    with pytest.raises(OutputError, match="--seed"):
        optimise_files(design, out=tmp_path / "out", options=options.model_copy(update={"seed": 3}))
    cut = optimise(DESIGN, options, Store(tmp_path / "out"), progress=at_half)
    assert isinstance(cut, Front)
    assert cut.interrupted
    assert cut.evaluations == 15
    assert cut.designs


@pytest.mark.parametrize(
    ("knots_um", "options", "met"),
    [
        ([0.0, 3.0] * 9, {}, False),
        ([0.0, 3.0] * 3, {"printer": "asiga-pico2-50"}, True),
        ([0.0, 3.0] * 6, {}, True),
        ([0.0, 3.0] * 6, {"printer": "asiga-pico2-50"}, False),
    ],
)
def test_a_lens_too_fine_for_the_printer_misses_a_condition(
    knots_um: list[float], options: dict[str, Any], met: bool
) -> None:
    spline = DESIGN.set({"lens.shape": "spline", "lens.knots_um": knots_um})
    evaluation = Evaluator(Task.of(spline, OptimiseOptions(**CENTRE, **options)), Store(), 1e-2).of(spline)
    assert evaluation is not None
    assert list(evaluation.meets.values()) == [met]
    assert (evaluation.violation == 0.0) is met


def test_as_printed_the_lens_is_that_of_the_predicted_print(tmp_path: Path) -> None:
    exact = default_process().model_copy(update={"uncertainty": {}, "calibration": None})
    path = tmp_path / "process.toml"
    path.write_text(process_text(exact))
    task = Task.of(DESIGN, OptimiseOptions(**CENTRE, as_printed=True, process=path))
    assert task.printed_by == exact.name
    variant = Evaluator(task, Store(), 1e-2).variant(DESIGN)
    assert variant.name(Accuracy(1e-2)) != Variant(DESIGN).name(Accuracy(1e-2))
    sensor = Sensor.of(DESIGN)
    profile = print_design(sensor, PrintOptions(process=path), response=False).profile
    lens, made = sensor.lens, variant.sensor().lens
    assert isinstance(lens, DesignedLens)
    assert isinstance(made, MeasuredLens)
    x = np.linspace(-1.9, 1.9, 39)
    printed = measured_lens(lens, profile).z_mm(x)
    assert made.z_mm(x) == pytest.approx(printed, abs=1e-9)
    assert np.abs(printed - lens.z_mm(x)).max() > 0.01


@pytest.mark.parametrize("shape", ["layered", "line-focus", "none"])
def test_a_lens_of_another_kind_is_not_traced_as_if_it_were_one_profile(shape: str) -> None:
    design = DESIGN.set({"lens.shape": shape, "trace.dimension": "extruded"})
    with pytest.raises(SpecError, match=shape):
        Task.of(design, OptimiseOptions(**CENTRE, as_printed=True))


@pytest.mark.evidence
@pytest.mark.parametrize("more", [(), ("--maximise", "abs(slope_per_deg)", "--front", "5")], ids=["one goal", "front"])
def test_ten_kills_leave_the_same_result(tmp_path: Path, more: tuple[str, ...]) -> None:
    design = save(tmp_path / "small.toml", DESIGN)

    def command(out: str) -> list[str]:
        free = ("--free", "lens.focus_mm=10:40", "--free", "body.arm_width_mm=2.6:3.3")
        within = ("--subject-to", "light > 0.9*base", "--robust", "emitter.offset_mm=0.03", "--evaluations", "60")
        solen = [sys.executable, "-m", "solen", "explore", "optimise", str(design), "--minimise", "linearity_percent"]
        return [*solen, *more, *free, *within, "--out", str(tmp_path / out)]

    whole = json.loads(subprocess.run([*command("whole"), "--json"], check=True, capture_output=True).stdout)
    rng = np.random.default_rng(0)
    blocks = tmp_path / "cut" / "blocks"
    for _ in range(10):
        known = len(list(blocks.glob("*.npz")))
        running = subprocess.Popen(command("cut"), stdout=subprocess.DEVNULL)
        while len(list(blocks.glob("*.npz"))) < known + 3 and running.poll() is None:
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, 0.3))
        running.send_signal(signal.SIGKILL)
        assert running.wait() == -signal.SIGKILL
    cut = json.loads(subprocess.run([*command("cut"), "--json"], check=True, capture_output=True).stdout)
    assert cut["traced"] < whole["traced"]
    for answer in (whole, cut):
        del answer["traced"], answer["files"]
    assert cut == whole
    made = [{path.name: path.read_bytes() for path in (tmp_path / out).glob("*.toml")} for out in ("whole", "cut")]
    assert made[0]
    assert made[0] == made[1]
