"""Inverse design: searches with known answers, limits, deviations, interruption and resumption."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.optimise import OptimiseOptions, Optimum, optimise
from solen.explore.search import Tried, search
from solen.explore.store import Store
from solen.spec import Design, save

pytest.importorskip("cma")

DESIGN = Design(
    name="small",
    material={"index": 1.44},
    motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 1.0},
    emitter={"width_mm": 0.2, "offset_mm": 0.02, "pattern": "lambertian", "cone_deg": 120.0},
)
CENTRE: dict[str, Any] = {
    "minimise": "abs(null_deg)",
    "free": ("emitter.offset_mm=-0.03:0.03",),
    "evaluations": 20,
    "tolerance": 1e-2,
}


def bowl(point: FloatArray) -> float:
    """Least at (0.8, 0.3, 0.05), with a ridge."""
    a, b, c = point
    return float((a - 0.8) ** 2 + 10.0 * (b - 0.3 - 0.2 * (a - 0.8)) ** 2 + abs(c - 0.05))


def test_a_search_finds_the_least_value_and_goes_the_same_way_again() -> None:
    runs = [Tried(bowl, 400), Tried(bowl, 400)]
    for tried in runs:
        search(tried, np.array([0.2, 0.9, 0.9]), seed=1)
    assert runs[0].best == pytest.approx([0.8, 0.3, 0.05], abs=0.01)
    assert runs[0].values == runs[1].values
    assert len(runs[0].values) <= 400


@pytest.fixture(scope="module")
def centred() -> tuple[Store, Optimum]:
    store = Store()
    return store, optimise(DESIGN, OptimiseOptions(**CENTRE), store)


def test_the_emitter_is_moved_to_where_the_null_is_at_0(centred: tuple[Store, Optimum]) -> None:
    _, found = centred
    assert found.free[0].before == 0.02
    assert abs(found.free[0].after) < 0.003
    assert found.after.goal < 0.2 * found.before.goal
    assert found.sampled_difference < 4.0 * found.u_sampled_difference
    assert np.nanmin(found.history) == found.history[-1]


def test_the_same_search_goes_on_from_what_is_known(centred: tuple[Store, Optimum]) -> None:
    store, found = centred
    again = optimise(DESIGN, OptimiseOptions(**CENTRE), store)
    assert again.traced == 0
    assert again.design == found.design


def test_an_interrupted_search_has_its_best_so_far(centred: tuple[Store, Optimum]) -> None:
    store, found = centred
    kept: list[Design] = []

    def stop(done: float) -> None:
        if done >= 0.5:
            raise KeyboardInterrupt

    cut = optimise(DESIGN, OptimiseOptions(**CENTRE), store, progress=stop, keep=kept.append)
    assert cut.interrupted
    assert cut.evaluations == 10
    assert cut.design == kept[-1]
    assert cut.after.goal >= found.after.goal
    assert any("interrupted" in line for line in cut.warnings)


def test_the_worst_deviation_counts_and_conditions_hold() -> None:
    options = OptimiseOptions(
        **CENTRE | {"evaluations": 24}, robust=("emitter.offset_mm=0.01",), subject_to=("light > 0.9*base",)
    )
    found = optimise(DESIGN, options)
    assert abs(found.free[0].after) < 0.006
    assert found.after.goal == pytest.approx(abs(found.after.worst["null_deg"]))
    assert found.after.goal > abs(found.after.merits["null_deg"])
    assert found.after.meets == {"light > 0.9*base": True}


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"minimise": None}, "--minimise"),
        ({"maximise": "span"}, "--minimise"),
        ({"minimise": "span < 1"}, "condition"),
        ({"free": ()}, "--free"),
        ({"free": ("emitter.offset_mm=1,2",)}, "range"),
        ({"free": ("emitter.offset_mm=1:1",)}, "empty range"),
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


@pytest.mark.evidence
def test_ten_kills_leave_the_same_result(tmp_path: Path) -> None:
    design = save(tmp_path / "small.toml", DESIGN)

    def command(out: str) -> list[str]:
        free = ("--free", "lens.focus_mm=10:40", "--free", "body.arm_width_mm=2.6:3.3")
        within = ("--subject-to", "light > 0.9*base", "--robust", "emitter.offset_mm=0.03", "--evaluations", "60")
        solen = [sys.executable, "-m", "solen", "explore", "optimise", str(design), "--minimise", "linearity_percent"]
        return [*solen, *free, *within, "--out", str(tmp_path / out)]

    whole = json.loads(subprocess.run([*command("whole"), "--json"], check=True, capture_output=True).stdout)
    rng = np.random.default_rng(0)
    for _ in range(10):
        running = subprocess.Popen(command("cut"), stdout=subprocess.DEVNULL)
        time.sleep(rng.uniform(8.0, 16.0))
        running.send_signal(signal.SIGKILL)
        running.wait()
    cut = json.loads(subprocess.run([*command("cut"), "--json"], check=True, capture_output=True).stdout)
    assert cut["traced"] < whole["traced"]
    for answer in (whole, cut):
        del answer["traced"], answer["files"]
    assert cut == whole
    best = [(tmp_path / out / "small-best.toml").read_bytes() for out in ("whole", "cut")]
    assert best[0] == best[1]
