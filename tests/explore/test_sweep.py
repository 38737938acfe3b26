"""Sweeps: the points of their axes, the folder that keeps them through a kill, and the table."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, OutputError, SpecError
from solen.explore.axes import axis, check_axes, check_not_set, grid, sampled
from solen.explore.chips import chips_of
from solen.explore.machines import Cluster, LocalMachine, Slurm, check_job
from solen.explore.store import Accuracy, Point, Store, Variant, code_digest
from solen.explore.sweep import SweepOptions, sweep
from solen.registry import BODY_KINDS
from solen.sensor import Sensor
from solen.spec import Design, save

DESIGN = Design(name="small", material={"index": 1.44}, motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 0.25})


def test_a_grid_has_all_combinations_and_the_last_axis_runs_fastest() -> None:
    axes = [axis("lens.focus_mm=15:25:3", DESIGN), axis("lens.shape=cartesian-oval,none", DESIGN)]
    points = list(grid(axes))
    assert [point["lens.focus_mm"] for point in points] == [15.0, 15.0, 20.0, 20.0, 25.0, 25.0]
    assert [point["lens.shape"] for point in points] == ["cartesian-oval", "none"] * 3


def test_samples_fill_ranges_and_lists_evenly() -> None:
    axes = [axis("lens.focus_mm=15:25", DESIGN), axis("emitter.width_mm=0.1,0.2", DESIGN)]
    points = list(sampled(axes, range(64), seed=3))
    focus = np.array([point["lens.focus_mm"] for point in points])
    assert 15.0 <= focus.min() < 15.5 < 24.5 < focus.max() <= 25.0
    assert sum(point["emitter.width_mm"] == 0.1 for point in points) == 32
    assert points == list(sampled(axes, range(64), seed=3))


@pytest.mark.parametrize(
    ("over", "samples", "named"),
    [
        (["lens.focus_mm"], None, "lens.focus_mm"),
        (["lens.focus_mm=15:15:3"], None, "empty range"),
        (["lens.focus_mm=15:25:1"], None, "at least 2"),
        (["lens.focus_mm=15:25:2.5"], None, "integer of at least 2"),
        (["lens.focus_mm=15:x:3"], None, "numbers"),
        (["lens.focus_mm=15:25:inf"], None, "integer of at least 2"),
        (["lens.focus_mm=15:25:nan"], None, "integer of at least 2"),
        (["lens.focus_mm=15:25:1000000000000"], None, "1,000,000,000,000"),
        (["lens.focus_mm=15:25:2000", "emitter.offset_mm=0:1:2000"], None, "4,000,000"),
        (["lens.focus_mm=15:25"], None, "--samples"),
        (["lens.focus_mm=15:25:3"], 8, "15:25"),
        (["lens.focus_mm=15,15"], None, "twice"),
        (["lens.focus_mm=15,a"], None, "not a number"),
        (["lens.focus_mm=15,20", "lens.focus_mm=25,30"], None, "twice"),
        (["lens.fokus_mm=15,20"], None, "fokus"),
        ([], None, "axis"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_by_name(over: list[str], samples: int | None, named: str) -> None:
    with pytest.raises(SpecError) as refused:
        check_axes([axis(text, DESIGN) for text in over], samples)
    assert named in str(refused.value)


@pytest.mark.parametrize("samples", [None, 11])
def test_parts_of_a_sweep_are_its_points(samples: int | None) -> None:
    ends = ":12" if samples is None else ""
    axes = [axis(f"lens.focus_mm=15:25{ends}", DESIGN), axis("emitter.width_mm=0.1,0.2", DESIGN)]

    def points(part: str | None) -> list[dict[str, Any]]:
        numbers = check_axes(axes, samples, part)
        return list(grid(axes, numbers) if samples is None else sampled(axes, numbers, seed=3))

    assert [point for part in ("1/3", "2/3", "3/3") for point in points(part)] == points(None)
    for wrong in ("0/3", "4/3", "3", "a/3", "1/100"):
        with pytest.raises(SpecError, match="--part"):
            points(wrong)


def test_a_part_of_a_sweep_has_its_own_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Designs are in memory by lots, and each part keeps its points apart."""
    monkeypatch.setattr(import_module("solen.explore.responses"), "LOT", 2)
    seen = []

    class Watched(LocalMachine):
        def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
            seen.append(len(variants))
            return super().traced(variants, accuracy)

    options = {"over": ("lens.focus_mm=15:25:7",), "part": "2/2"}
    chosen = SweepOptions(**options)
    found = sweep(DESIGN, chosen, Store(chosen.folder(tmp_path)), machine=Watched())
    assert seen[:2] == [2, 2]
    assert max(seen) == 2
    data = found.to_dataset()
    assert data["sample"].values.tolist() == [3, 4, 5, 6]
    assert data["lens.focus_mm"].values.tolist() == np.linspace(15.0, 25.0, 7)[3:].tolist()
    assert (tmp_path / "sweep-2-of-2" / "blocks").is_dir()


def test_options_that_would_be_ignored_are_refused() -> None:
    with pytest.raises(SpecError, match="--seed"):
        sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,22",), seed=3))
    for option, text in (
        ("--over", "lens.focus_mm=18,22"),
        ("--vary", "emitter.offset_mm+0.5*lens.focus_mm=normal:0:1"),
    ):
        with pytest.raises(SpecError, match=rf"{option} lens\.focus_mm"):
            check_not_set(option, [text], ["lens.focus_mm=25"])
    check_not_set("--over", ["lens.focus_mm=18,22"], ["lens.half_width_mm=2"])


def test_angles_are_no_axis(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"motion\.step_deg"):
        sweep(DESIGN, SweepOptions(over=("motion.step_deg=0.1,0.2",)), Store(tmp_path))


def test_a_sweep_is_the_responses_of_its_designs(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    options = SweepOptions(over=("lens.focus_mm=18,22", "emitter.offset_mm=0,0.01,0.02"))
    found = sweep(DESIGN, options, Store(tmp_path))
    data = found.to_dataset()
    assert data["contrast"].dims == ("lens.focus_mm", "emitter.offset_mm", "angle_deg")
    own = Sensor.of(DESIGN.set({"lens.focus_mm": 22.0, "emitter.offset_mm": 0.01})).power()
    chosen = data.sel({"lens.focus_mm": 22.0, "emitter.offset_mm": 0.01})
    assert np.array_equal(chosen["right"], own.right)
    assert float(chosen["null_deg"]) == pytest.approx(own.null_deg(), abs=0.02)
    assert data.attrs["simulated"] == 1


def test_the_worst_of_each_merit_is_that_of_the_deviations(tmp_path: Path) -> None:
    over, store = "lens.focus_mm=18,22", Store(tmp_path)
    found = sweep(DESIGN, SweepOptions(over=(over,), robust=("emitter.offset_mm=0.02",)), store)
    own = sweep(DESIGN, SweepOptions(over=(over, "emitter.offset_mm=0.02")), store)
    assert abs(found.merits["worst_null_deg"]) == pytest.approx(abs(own.merits["null_deg"]))
    assert found.merits["u_worst_null_deg"] == pytest.approx(own.merits["u_null_deg"])
    assert (np.abs(found.merits["null_deg"]) < 0.01).all()
    assert found.merits["worst_light"] == pytest.approx(np.minimum(found.merits["light"], own.merits["light"]))
    assert found.points == 2


def test_a_point_is_traced_once_whichever_sweep_asks_for_it(tmp_path: Path) -> None:
    first = sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,20,22",)), Store(tmp_path))
    second = sweep(DESIGN, SweepOptions(over=("lens.focus_mm=20,24",)), Store(tmp_path))
    assert (first.traced, second.traced) == (3, 1)
    assert np.array_equal(first.power[1], second.power[0])


def test_a_design_that_cannot_be_built_is_a_point_without_a_response(tmp_path: Path) -> None:
    found = sweep(DESIGN, SweepOptions(over=("lens.half_width_mm=2,2000,-2,3000",)), Store(tmp_path))
    assert np.isnan(found.merits["light"]).tolist() == [False, True, True, True]
    assert list(found.failures.values()) == [2, 1]  # by kind, whatever the numbers
    assert "3 of 4 points" in found.warnings[0]
    with pytest.raises(SpecError, match="no point has a response"):
        sweep(DESIGN, SweepOptions(over=("lens.half_width_mm=1000,2000",)), Store(tmp_path / "refused"))
    assert not (tmp_path / "refused").exists()


@pytest.mark.parametrize(("samples", "values"), [(None, "0.1,0.2"), (2, "0.1:0.2")])
def test_a_key_that_changes_nothing_is_said(samples: int | None, values: str) -> None:
    over = (f"emitter.y_mm={values}", f"emitter.offset_mm={values}")
    found = sweep(DESIGN.set({"motion.step_deg": 1.0}), SweepOptions(over=over, samples=samples))
    (warning,) = (text for text in found.warnings if "motion.step_deg" not in text)
    assert "emitter.y_mm" in warning
    assert "in the plane" in warning


def test_a_point_is_named_by_all_that_it_depends_on(tmp_path: Path) -> None:
    base = Variant(DESIGN)
    assert base.name(Accuracy()) == Variant(DESIGN.set(name="other")).name(Accuracy())
    others = [
        Variant(DESIGN.set(focus_mm=21)).name(Accuracy()),
        Variant(DESIGN, {"emitter.offset_mm": 0.01}).name(Accuracy()),
        base.name(Accuracy(1e-3)),
        base.name(Accuracy(None, 4096)),
    ]
    profile = tmp_path / "a.txt"
    for content in ("1", "2"):
        profile.write_text(content, encoding="utf-8")
        in_folder = DESIGN.set({"emitter.ray_file": "a.txt"}).in_folder(tmp_path)
        others.append(Variant(in_folder).name(Accuracy()))
    assert len({base.name(Accuracy()), *others}) == 7


def test_code_that_extends_solen_names_points_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bar = EntryPoint("lab-bar", "lab_bar:BAR", BODY_KINDS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("solen.explore.store.offered", lambda group: {"lab-bar": bar} if group == BODY_KINDS else {})
    names = set()
    for width in (3, 4):
        (tmp_path / "lab_bar.py").write_text(f"BAR = {width}", encoding="utf-8")
        code_digest.cache_clear()
        names.add(code_digest())
    code_digest.cache_clear()
    assert len(names) == 2


def test_the_compiled_batch_gives_the_same_table_within_its_uncertainty(tmp_path: Path) -> None:
    chip = DESIGN.set({"emitter.width_mm": 0.2, "emitter.pattern": "lambertian", "emitter.cone_deg": 120.0})
    over = ("lens.focus_mm=18,22", "emitter.offset_mm=0,0.02,30")
    rough = sweep(chip, SweepOptions(over=over, rays=4096), Store(tmp_path))
    sure = sweep(chip, SweepOptions(over=over, tolerance=1e-3))
    assert rough.traced == sure.traced == 6
    u = np.hypot(rough.u_power, sure.u_power)
    off = np.abs(rough.power - sure.power) / u
    assert np.sqrt(np.nanmean(off**2)) < 1.5
    assert 0 < np.nanmax(rough.u_power) < 5e-3


def test_a_point_of_the_batch_does_not_depend_on_its_neighbours() -> None:
    chip = DESIGN.set({"emitter.width_mm": 0.2})
    alone = sweep(chip, SweepOptions(over=("lens.focus_mm=20,21",), rays=1024))
    others = sweep(chip, SweepOptions(over=("lens.focus_mm=20,30",), rays=1024))
    assert np.array_equal(alone.power[0], others.power[0])


def test_chips_of_a_design_share_its_rays_and_have_the_same_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chip = DESIGN.set({"emitter.pattern": "lambertian", "emitter.cone_deg": 120.0, "motion.step_deg": 0.5})
    axes = ("emitter.offset_mm=0,0.02,0.05", "lens.focus_mm=18,22", "emitter.width_mm=0.2,0.25")
    calls: list[int] = []
    machines = import_module("solen.explore.machines")
    respond = machines.respond

    def counted(*a: Any, **more: Any) -> Any:
        calls.append(1)
        return respond(*a, **more)

    monkeypatch.setattr(machines, "respond", counted)
    shared = sweep(chip, SweepOptions(over=axes, rays=4096), Store(tmp_path))
    assert len(calls) == 2
    apart = sweep(chip, SweepOptions(over=axes, rays=4096, robust=("emitter.distance_mm=0.01",)))
    assert shared.shape == (3, 2, 2)
    assert list(shared.values["emitter.offset_mm"][:5]) == [0.0] * 4 + [0.02]
    off = (shared.power - apart.power) / np.hypot(shared.u_power, apart.u_power)
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert np.abs(off).max() < 5.0
    assert shared.u_power.max() < 3.0 * apart.u_power.max()
    (block,) = (tmp_path / "blocks").iterdir()
    known = Store(tmp_path)
    for name in list(known.points)[::2]:  # as if it had been killed between two points of one trace
        del known.points[name]
    block.unlink()
    again = sweep(chip, SweepOptions(over=axes, rays=4096), known)
    assert again.traced == 6
    assert np.array_equal(again.power, shared.power)


@pytest.mark.parametrize("over", ["emitter.offset_mm=0,3", "emitter.width_mm=0,0.2", "lens.focus_mm=18,20"])
def test_chips_that_are_far_apart_or_points_do_not_share_rays(over: str) -> None:
    assert chips_of(DESIGN.set({"emitter.width_mm": 0.2}), [axis(over, DESIGN)]) == ()


def test_a_failure_of_the_machine_is_not_kept_as_a_response(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: Variant) -> Sensor:
        raise OutputError("extra", limit="is not installed")

    monkeypatch.setattr(Variant, "sensor", missing)
    with pytest.raises(OutputError):
        sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,20",)), Store(tmp_path))
    assert Store(tmp_path).points == {}


def test_a_damaged_block_is_refused_by_name(tmp_path: Path) -> None:
    sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,20",)), Store(tmp_path))
    block = next((tmp_path / "blocks").glob("*.npz"))
    block.write_bytes(block.read_bytes()[:-200])
    with pytest.raises(DataError, match=block.name):
        Store(tmp_path)


def test_many_small_blocks_become_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.explore.store.MAX_BLOCKS", 8)
    point = Point(np.ones((3, 2)), np.zeros((3, 2)), np.zeros((1, 2)))
    store = Store(tmp_path)
    for number in range(9):
        store.add({f"point {number}": point})
    assert len(Store(tmp_path).points) == 9
    whole = list((tmp_path / "blocks").iterdir())
    assert len(whole) == 1
    for number in range(9):  # as if the program had been killed before it removed them
        other = Store(tmp_path / "other")
        other.add({f"point {number}": point})
    for block in (tmp_path / "other" / "blocks").iterdir():
        block.rename(tmp_path / "blocks" / block.name)
    assert len(Store(tmp_path).points) == 9
    assert list((tmp_path / "blocks").iterdir()) == whole


def _command(design: Path, out: Path) -> list[str]:
    over = ("--over", "lens.focus_mm=15:25:12", "--over", "emitter.offset_mm=0,0.01,0.02")
    return [sys.executable, "-m", "solen", "explore", "sweep", str(design), *over, "--out", str(out)]


def test_workers_of_a_cluster_give_the_same_table(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    options = SweepOptions(over=("lens.focus_mm=18,20,22,2000000",))
    here = sweep(DESIGN, options)
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        there = sweep(DESIGN, options, Store(tmp_path), machine=Cluster(client, chunk_points=2))
    assert there.traced == here.traced
    assert all(np.array_equal(there.merits[name], here.merits[name], equal_nan=True) for name in here.merits)
    assert len(Store(tmp_path).points) == 3


def test_a_file_of_a_slurm_cluster_makes_its_job_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    path = tmp_path / "slurm.toml"
    path.write_text(
        'jobs = 4\nqueue = "short"\ncores = 8\nprocesses = 2\nmemory = "8GB"\nwalltime = "00:10:00"\n'
        'job_script_prologue = ["module load python"]\n',
        encoding="utf-8",
    )
    slurm = Slurm.read(path)
    with slurm.cluster() as cluster:
        script = cluster.job_script()
    assert "#SBATCH -p short" in script
    assert "#SBATCH --cpus-per-task=8" in script
    assert "--nworkers 2" in script
    assert "--nthreads 4" in script
    assert "module load python" in script
    assert slurm.jobs == 4
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(DataError, match="sbatch"):
        check_job(script)


@pytest.mark.parametrize(
    ("content", "named"), [("jobs = 0", "jobs"), ("cores = 2\nqueu = 'a'", "queu"), ("walltime = 3", "walltime")]
)
def test_a_malformed_file_of_a_cluster_is_refused_by_name(tmp_path: Path, content: str, named: str) -> None:
    path = tmp_path / "slurm.toml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(DataError) as refused:
        Slurm.read(path)
    assert named in str(refused.value)


@pytest.mark.evidence
def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    from distributed import Client

    started = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    file = tmp_path / "scheduler.json"
    scheduler = subprocess.Popen([*started, "--scheduler-file", str(file)], stderr=subprocess.DEVNULL)
    one = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    workers = [subprocess.Popen([*one, "--no-dashboard"], stderr=subprocess.DEVNULL) for _ in range(2)]
    nannies: list[int] = []
    try:
        with Client(scheduler_file=str(file)) as client:
            client.wait_for_workers(2, timeout=120)
            nannies = list(client.run(os.getpid).values())
            options = SweepOptions(over=("lens.focus_mm=15:25:24", "emitter.offset_mm=0,0.01,0.02,0.03"))

            def kill(done: float) -> None:
                if done > 0.2 and nannies:
                    os.kill(nannies.pop(), signal.SIGKILL)
                    nannies.clear()

            there = sweep(DESIGN, options, Store(tmp_path), progress=kill, machine=Cluster(client, chunk_points=4))
        assert not nannies
        here = sweep(DESIGN, options)
        assert there.traced == here.traced == 96
        assert all(np.array_equal(there.merits[name], here.merits[name], equal_nan=True) for name in here.merits)
    finally:
        for process in (*workers, scheduler):
            process.terminate()
            process.wait()


@pytest.mark.evidence
def test_ten_kills_leave_the_same_table(tmp_path: Path) -> None:
    import xarray

    design = save(tmp_path / "small.toml", DESIGN)
    subprocess.run(_command(design, tmp_path / "integer of at least 2"), check=True, capture_output=True)
    rng = np.random.default_rng(0)
    killed = 0
    while killed < 10:
        running = subprocess.Popen(_command(design, tmp_path / "cut"), stdout=subprocess.DEVNULL)
        time.sleep(rng.uniform(2.0, 8.0))
        running.send_signal(signal.SIGKILL)
        killed += 1
        running.wait()
    subprocess.run(_command(design, tmp_path / "cut"), check=True, capture_output=True)
    tables = [xarray.load_dataset(tmp_path / name / "small-sweep.nc") for name in ("whole", "cut")]
    assert tables[0].identical(tables[1])
    assert not list((tmp_path / "cut").rglob("*.tmp"))
