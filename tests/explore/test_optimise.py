"""Inverse design: searches with known results, limits, deviations, interruption and resumption."""

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
CENTRING: dict[str, Any] = {
    "minimise": ("abs(null_deg)",),
    "free": ("emitter.offset_mm=-0.03:0.03",),
    "evaluations": 20,
    "tolerance": 1e-2,
}


def valley(point: FloatArray) -> float:
    """Return a function with a curved valley and the minimum at (0.8, 0.3, 0.05)."""
    a, b, c = point
    return float((a - 0.8) ** 2 + 10.0 * (b - 0.3 - 0.2 * (a - 0.8)) ** 2 + abs(c - 0.05))


def test_search_finds_minimum_reproducibly() -> None:
    runs = [Trials(valley, 400), Trials(valley, 400)]
    for trials in runs:
        search(trials, np.array([0.2, 0.9, 0.9]), seed=1)
    assert runs[0].best == pytest.approx([0.8, 0.3, 0.05], abs=0.01)
    assert runs[0].values == runs[1].values
    assert len(runs[0].values) <= 400


def test_search_over_single_insensitive_parameter() -> None:
    trials = Trials(lambda point: float(np.round(point[0])), 200)
    search(trials, np.array([0.9]), seed=0)
    assert min(trials.values) == 0.0


@pytest.fixture(scope="module")
def centred() -> tuple[Store, Optimum]:
    store = Store()
    return store, optimum(DESIGN, OptimiseOptions(**CENTRING), store)


def optimum(design: Design, options: OptimiseOptions, store: Store | None = None, **more: Any) -> Optimum:
    result = optimise(design, options, store, **more)
    assert isinstance(result, Optimum)
    return result


def test_centres_emitter(centred: tuple[Store, Optimum]) -> None:
    _, result = centred
    assert result.free[0].before == 0.02
    assert abs(result.free[0].after) < 0.003
    assert result.after.goal < 0.2 * result.before.goal
    assert result.sampled_difference is not None
    assert result.u_sampled_difference is not None
    assert result.sampled_difference < 4.0 * result.u_sampled_difference
    assert result.to_dataset()["contrast"].sel(design="after", case="worst").shape == result.angle_deg.shape
    assert np.nanmin(result.history) == result.history[-1]


def test_repeated_search_uses_stored_responses(centred: tuple[Store, Optimum]) -> None:
    store, result = centred
    repeated = optimum(DESIGN, OptimiseOptions(**CENTRING), store)
    assert repeated.traced == 0
    assert repeated.design == result.design


def test_warns_of_limits(centred: tuple[Store, Optimum]) -> None:
    free = ("emitter.offset_mm=0.005:0.015",)
    task = Task.of(DESIGN, OptimiseOptions(**CENTRING | {"free": free}))
    (outside_warning,) = outside_warnings(task)
    (limit_warning,) = limit_warnings(task, DESIGN.set({"emitter.offset_mm": 0.005}))
    assert "0.02" in outside_warning
    assert "0.005" in limit_warning
    assert not any("emitter.offset_mm" in text for text in centred[1].warnings)
    assert not centred[1].robust


PRINTS = {
    "vary": ("emitter.offset_mm=normal:0:0.02", "material.index=uniform:-0.005:0.005"),
    "require": ("abs(null_deg) < 0.3",),
    "prints": 32,
}


def test_prints_before_and_after_search(centred: tuple[Store, Optimum]) -> None:
    """The search removes the decentre of the design, which equals a standard deviation of the prints."""
    store, result = centred
    options = OptimiseOptions(**CENTRING | PRINTS)
    assert check_prints(DESIGN, options)
    compared = with_prints(result, DESIGN, options, store)
    before, after = compared.prints_before, compared.prints_after
    assert before is not None
    assert after is not None
    assert compared.traced >= result.traced + 64
    separate = tolerance(result.design, ToleranceOptions(**PRINTS, tolerance=CENTRING["tolerance"]), store)
    assert separate.traced == 0
    assert after.yields == separate.yields
    assert before.deviations["emitter.offset_mm"].tolist() == after.deviations["emitter.offset_mm"].tolist()
    nulls = [np.nanmean(prints.merits["null_deg"]) for prints in (before, after)]
    assert abs(nulls[1]) < 0.3 * abs(nulls[0])
    text = "\n".join(lines(compared))
    assert all(word in text for word in ("32 prints", "emitter.offset_mm", "yield for all requirements"))
    labels = {axes.get_xlabel() for axes in optimum_figure(compared).axes}
    assert {"null_deg of prints", "light of prints"} <= labels


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"prints": 8}, "at least 32"),
        ({"vary": ("emitter.ofset_mm=normal:0:1",)}, "ofset"),
        ({"require": ("ligt > 1",)}, "light"),
        ({"prints": 0, "require": ("light > 1",)}, "--prints"),
        ({"maximise": ("light",), "evaluations": 80, "require": ("light > 1",)}, "--require"),
    ],
)
def test_refuses_invalid_print_options(changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(SpecError) as error:
        check_prints(DESIGN, OptimiseOptions(**CENTRING | changed))
    assert reason in str(error.value)


def test_interrupted_prints_keep_result(centred: tuple[Store, Optimum]) -> None:
    options = OptimiseOptions(**CENTRING | PRINTS)
    interrupted = with_prints(centred[1], DESIGN, options, Store(), progress=interrupt_at_half)
    assert interrupted.interrupted
    assert interrupted.prints_after is None
    assert interrupted.design == centred[1].design


def interrupt_at_half(done: float) -> None:
    if done >= 0.5:
        raise KeyboardInterrupt


def test_interrupted_search_returns_best_design(centred: tuple[Store, Optimum]) -> None:
    store, result = centred
    kept: list[list[NondominatedDesign]] = []

    def keep(designs: Sequence[NondominatedDesign]) -> None:
        kept.append([*designs])

    interrupted = optimum(DESIGN, OptimiseOptions(**CENTRING), store, progress=interrupt_at_half, keep=keep)
    assert interrupted.interrupted
    assert interrupted.evaluations == 10
    assert [interrupted.design] == [best.design for best in kept[-1]]
    assert interrupted.after.goal >= result.after.goal
    assert any("interrupted" in line for line in interrupted.warnings)


def test_goal_is_worst_value_over_deviations(centred: tuple[Store, Optimum]) -> None:
    options = OptimiseOptions(**CENTRING, robust=("emitter.offset_mm=0.01",), subject_to=("light > 0.9*base",))
    result = optimum(DESIGN, options, centred[0])
    assert abs(result.free[0].after) < 0.006
    assert result.after.worst_off in ({"emitter.offset_mm": 0.01}, {"emitter.offset_mm": -0.01})
    assert result.after.goal == pytest.approx(abs(result.after.worst["null_deg"]))
    assert result.after.goal > abs(result.after.merits["null_deg"])
    assert result.after.meets == {"light > 0.9*base": True}


@pytest.mark.parametrize(
    ("changed", "reason"),
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
def test_refuses_invalid_search(changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(SpecError) as error:
        optimise(DESIGN, OptimiseOptions(**CENTRING | changed))
    assert reason in str(error.value)


def test_warns_of_exploited_coarse_angles() -> None:
    coarse = {"minimise": ("linearity_percent",), "free": ("lens.focus_mm=12:40",), "tolerance": 1e-3}
    wide = {"emitter.offset_mm": 0.0, "motion.from_deg": -3.0, "motion.to_deg": 3.0, "motion.step_deg": 1.5}
    result = optimum(DESIGN.set(wide), OptimiseOptions(**CENTRING | coarse))
    assert result.claimed < 0.2  # five angles of a symmetric sensor give two independent contrasts
    assert result.after.goal > 0.5
    assert any("step_deg" in line for line in result.warnings)


class QuarterCircle:
    """Evaluator of points (2,) whose best goals are on a quarter of a circle, concave towards the ideal (0, 0)."""

    class task:  # noqa: N801  an attribute of an evaluator
        signs = (1.0, 1.0)
        initial_point = np.array([0.5, 0.9])

        @staticmethod
        def design_at(point: FloatArray) -> FloatArray:
            return point

    @staticmethod
    def of(point: FloatArray) -> Any:
        class evaluation:  # noqa: N801
            goals = (1.0 + point[1]) * np.array([np.sin(0.5 * np.pi * point[0]), np.cos(0.5 * np.pi * point[0])])
            violation, by_goal = max(0.0, point[1] - 0.95), ()

        return evaluation


def test_search_reaches_concave_front() -> None:
    kept_numbers: list[list[int]] = []

    def keep(front: Sequence[NondominatedDesign]) -> None:
        kept_numbers.append([design.number for design in front])

    candidates = Candidates(QuarterCircle, np.ones(2), 800, keep=keep)  # type: ignore[arg-type]  # has all that is used
    search_front(candidates, 5, seed=0)
    goals = np.array([candidate.goals for candidate in candidates.feasible])
    for weights in weights_of(5):
        best = goals[np.argmin((goals * np.where(weights > 0.0, weights, 1e-3)).max(axis=1))]
        assert np.hypot(*best) == pytest.approx(1.0, abs=0.02)
    assert len(candidates.tried) <= 800
    tried = np.array([candidate.goals for candidate in candidates.tried])
    feasible = np.array([candidate.violation == 0.0 for candidate in candidates.tried])
    dominated = [(feasible & (tried <= row).all(axis=1) & (tried < row).any(axis=1)).any() for row in tried]
    front = np.unique(tried[feasible & ~np.array(dominated)], axis=0)
    assert np.array_equal(tried[np.array(kept_numbers[-1]) - 1], front), "keep receives the front of all candidates"


def test_straightness_options() -> None:
    options = straightness_options(DESIGN)
    task = Task.of(DESIGN, options)
    assert np.allclose(task.initial_point, 0.5, atol=0.02)
    knots = DESIGN.set({"lens.shape": "spline", "lens.knots_um": (0.0, 5.0)})
    assert straightness_options(knots).free[-1] == "lens.knots_um[1]=-35:45"
    assert not any("focus" in text for text in straightness_options(DESIGN.set({"lens.shape": "none"})).free)


FRONT = {"minimise": ("abs(null_deg)",), "maximise": ("light",), "free": ("emitter.offset_mm=0.01:0.03",)}


def test_front_is_written_as_designs(tmp_path: Path) -> None:
    design = save(tmp_path / "small.toml", DESIGN)
    options = OptimiseOptions(**CENTRING | FRONT | {"evaluations": 30, "front": 3})
    stale = tmp_path / "out" / "small-front-9.toml"
    runs = []
    for _ in range(2):
        outcome = optimise_files(design, out=tmp_path / "out", options=options)
        assert isinstance(outcome.result, Front)
        runs.append(outcome.result)
        assert not stale.exists()
        stale.write_text("of an earlier search")
    result = runs[1]
    assert [run.traced > 0 for run in runs] == [True, False]
    assert [row.design for row in runs[0].designs] == [row.design for row in result.designs]
    goals = np.array([row.goals for row in result.designs]) * [1.0, -1.0]
    assert not any((goals < row).all(axis=1).any() for row in goals)
    assert goals[0, 0] < result.before.goals[0]
    for row in result.designs:
        written = load(outcome.files[f"design {row.number}"])
        assert written == row.design
        assert written.emitter.offset_mm == row.free["emitter.offset_mm"]
    text = encoded(drawn_figure(lambda: front_figure(result), FigureOptions()), ".svg", "optimise", 100).decode()
    assert all(word in text for word in ("abs(null_deg) (minimise)", "light (maximise)", "simulated"))
    assert "tried" not in text
    containers = front_figure(result).axes[0].containers
    bars = [bar for bar in containers if isinstance(bar, ErrorbarContainer) and bar.has_xerr and bar.has_yerr]
    assert sorted(len(np.atleast_1d(bar.lines[0].get_xdata())) for bar in bars) == sorted([1, len(result.designs)])
    assert not any("worst" in line for line in lines(result))
    assert any("worst over the deviations" in line for line in lines(replace(result, robust=True)))
    assert result.evaluations <= result.max_evaluations == 30
    assert any("2 of 32" in line for line in lines(replace(result, evaluations=30, max_evaluations=32)))
    assert any("emitter.offset_mm" in text and "design" in text for text in result.warnings), result.warnings
    data = result.to_dataset()
    assert data["goals"].sel(design=1, goal="maximise light") == result.designs[0].goals[1]
    assert data["emitter.offset_mm"].sel(design=0) == 0.02
    with pytest.raises(OutputError, match="--seed"):
        optimise_files(design, out=tmp_path / "out", options=options.model_copy(update={"seed": 3}))
    interrupted = optimise(DESIGN, options, Store(tmp_path / "out"), progress=interrupt_at_half)
    assert isinstance(interrupted, Front)
    assert interrupted.interrupted
    assert interrupted.evaluations == 15
    assert interrupted.designs


@pytest.mark.parametrize(
    ("knots_um", "options", "met"),
    [
        ([0.0, 3.0] * 9, {}, False),
        ([0.0, 3.0] * 3, {"printer": "asiga-pico2-50"}, True),
        ([0.0, 3.0] * 6, {}, True),
        ([0.0, 3.0] * 6, {"printer": "asiga-pico2-50"}, False),
    ],
)
def test_lens_with_too_fine_features_violates_condition(
    knots_um: list[float], options: dict[str, Any], met: bool
) -> None:
    spline = DESIGN.set({"lens.shape": "spline", "lens.knots_um": knots_um})
    evaluation = Evaluator(Task.of(spline, OptimiseOptions(**CENTRING, **options)), Store(), 1e-2).of(spline)
    assert evaluation is not None
    assert list(evaluation.meets.values()) == [met]
    assert (evaluation.violation == 0.0) is met


def test_traces_predicted_print(tmp_path: Path) -> None:
    process = default_process().model_copy(update={"uncertainty": {}, "calibration": None})
    path = tmp_path / "process.toml"
    path.write_text(process_text(process))
    task = Task.of(DESIGN, OptimiseOptions(**CENTRING, as_printed=True, process=path))
    assert task.printed_by == process.name
    variant = Evaluator(task, Store(), 1e-2).variant(DESIGN)
    assert variant.name(Accuracy(1e-2)) != Variant(DESIGN).name(Accuracy(1e-2))
    sensor = Sensor.of(DESIGN)
    profile = print_design(sensor, PrintOptions(process=path), response=False).profile
    designed, printed = sensor.lens, variant.sensor().lens
    assert isinstance(designed, DesignedLens)
    assert isinstance(printed, MeasuredLens)
    x = np.linspace(-1.9, 1.9, 39)
    predicted = measured_lens(designed, profile).z_mm(x)
    assert printed.z_mm(x) == pytest.approx(predicted, abs=1e-9)
    assert np.abs(predicted - designed.z_mm(x)).max() > 0.01


@pytest.mark.parametrize("shape", ["layered", "line-focus", "none"])
def test_refuses_to_print_other_lens_shapes(shape: str) -> None:
    design = DESIGN.set({"lens.shape": shape, "trace.dimension": "extruded"})
    with pytest.raises(SpecError, match=shape):
        Task.of(design, OptimiseOptions(**CENTRING, as_printed=True))


@pytest.mark.evidence
@pytest.mark.parametrize("more", [(), ("--maximise", "abs(slope_per_deg)", "--front", "5")], ids=["one goal", "front"])
def test_interrupted_search_gives_same_result(tmp_path: Path, more: tuple[str, ...]) -> None:
    design = save(tmp_path / "small.toml", DESIGN)

    def command(out: str) -> list[str]:
        free = ("--free", "lens.focus_mm=10:40", "--free", "body.arm_width_mm=2.6:3.3")
        limits = ("--subject-to", "light > 0.9*base", "--robust", "emitter.offset_mm=0.03", "--evaluations", "60")
        solen = [sys.executable, "-m", "solen", "explore", "optimise", str(design), "--minimise", "linearity_percent"]
        return [*solen, *more, *free, *limits, "--out", str(tmp_path / out)]

    complete = json.loads(subprocess.run([*command("complete"), "--json"], check=True, capture_output=True).stdout)
    rng = np.random.default_rng(0)
    blocks = tmp_path / "interrupted" / "blocks"
    for _ in range(10):
        known = len(list(blocks.glob("*.npz")))
        running = subprocess.Popen(command("interrupted"), stdout=subprocess.DEVNULL)
        while len(list(blocks.glob("*.npz"))) < known + 3 and running.poll() is None:
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, 0.3))
        running.send_signal(signal.SIGKILL)
        assert running.wait() == -signal.SIGKILL
    resumed = json.loads(subprocess.run([*command("interrupted"), "--json"], check=True, capture_output=True).stdout)
    assert resumed["traced"] < complete["traced"]
    for result in (complete, resumed):
        del result["traced"], result["files"]
    assert resumed == complete
    folders = (tmp_path / "complete", tmp_path / "interrupted")
    designs = [{path.name: path.read_bytes() for path in folder.glob("*.toml")} for folder in folders]
    assert designs[0]
    assert designs[0] == designs[1]
