"""Sweeps: points on the axes, storage of points after an interruption, and the table."""

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


def test_last_axis_of_grid_varies_fastest() -> None:
    axes = [axis("lens.focus_mm=15:25:3", DESIGN), axis("lens.shape=cartesian-oval,none", DESIGN)]
    points = list(grid(axes))
    assert [point["lens.focus_mm"] for point in points] == [15.0, 15.0, 20.0, 20.0, 25.0, 25.0]
    assert [point["lens.shape"] for point in points] == ["cartesian-oval", "none"] * 3


def test_samples_cover_ranges_and_lists_evenly() -> None:
    axes = [axis("lens.focus_mm=15:25", DESIGN), axis("emitter.width_mm=0.1,0.2", DESIGN)]
    points = list(sampled(axes, range(64), seed=3))
    focus = np.array([point["lens.focus_mm"] for point in points])
    assert 15.0 <= focus.min() < 15.5 < 24.5 < focus.max() <= 25.0
    assert sum(point["emitter.width_mm"] == 0.1 for point in points) == 32
    assert points == list(sampled(axes, range(64), seed=3))


@pytest.mark.parametrize(
    ("over", "samples", "reason"),
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
def test_refuses_invalid_axes(over: list[str], samples: int | None, reason: str) -> None:
    with pytest.raises(SpecError) as error:
        check_axes([axis(text, DESIGN) for text in over], samples)
    assert reason in str(error.value)


@pytest.mark.parametrize("samples", [None, 11])
def test_parts_contain_all_points(samples: int | None) -> None:
    ends = ":12" if samples is None else ""
    axes = [axis(f"lens.focus_mm=15:25{ends}", DESIGN), axis("emitter.width_mm=0.1,0.2", DESIGN)]

    def points(part: str | None) -> list[dict[str, Any]]:
        indices = check_axes(axes, samples, part)
        return list(grid(axes, indices) if samples is None else sampled(axes, indices, seed=3))

    assert [point for part in ("1/3", "2/3", "3/3") for point in points(part)] == points(None)
    for invalid in ("0/3", "4/3", "3", "a/3", "1/100"):
        with pytest.raises(SpecError, match="--part"):
            points(invalid)


def test_part_is_stored_separately_in_small_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only a few designs are in memory at a time, and each part has its own folder."""
    monkeypatch.setattr(import_module("solen.explore.responses"), "MAX_LOADED", 2)
    counts = []

    class CountingMachine(LocalMachine):
        def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
            counts.append(len(variants))
            return super().traced(variants, accuracy)

    options = SweepOptions(over=("lens.focus_mm=15:25:7",), part="2/2")
    result = sweep(DESIGN, options, Store(options.folder(tmp_path)), machine=CountingMachine())
    assert counts[:2] == [2, 2]
    assert max(counts) == 2
    data = result.to_dataset()
    assert data["sample"].values.tolist() == [3, 4, 5, 6]
    assert data["lens.focus_mm"].values.tolist() == np.linspace(15.0, 25.0, 7)[3:].tolist()
    assert (tmp_path / "sweep-2-of-2" / "blocks").is_dir()


def test_refuses_ignored_options() -> None:
    with pytest.raises(SpecError, match="--seed"):
        sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,22",), seed=3))
    for option, text in (
        ("--over", "lens.focus_mm=18,22"),
        ("--vary", "emitter.offset_mm+0.5*lens.focus_mm=normal:0:1"),
    ):
        with pytest.raises(SpecError, match=rf"{option} lens\.focus_mm"):
            check_not_set(option, [text], ["lens.focus_mm=25"])
    check_not_set("--over", ["lens.focus_mm=18,22"], ["lens.half_width_mm=2"])


def test_refuses_motion_as_axis(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"motion\.step_deg"):
        sweep(DESIGN, SweepOptions(over=("motion.step_deg=0.1,0.2",)), Store(tmp_path))


def test_sweep_equals_responses_of_designs(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    options = SweepOptions(over=("lens.focus_mm=18,22", "emitter.offset_mm=0,0.01,0.02"))
    data = sweep(DESIGN, options, Store(tmp_path)).to_dataset()
    assert data["contrast"].dims == ("lens.focus_mm", "emitter.offset_mm", "angle_deg")
    response = Sensor.of(DESIGN.set({"lens.focus_mm": 22.0, "emitter.offset_mm": 0.01})).power()
    point = data.sel({"lens.focus_mm": 22.0, "emitter.offset_mm": 0.01})
    assert np.array_equal(point["right"], response.right)
    assert float(point["null_deg"]) == pytest.approx(response.null_deg(), abs=0.02)
    assert data.attrs["simulated"] == 1


def test_worst_merits_are_those_of_deviations(tmp_path: Path) -> None:
    over, store = "lens.focus_mm=18,22", Store(tmp_path)
    robust = sweep(DESIGN, SweepOptions(over=(over,), robust=("emitter.offset_mm=0.02",)), store)
    shifted = sweep(DESIGN, SweepOptions(over=(over, "emitter.offset_mm=0.02")), store)
    assert abs(robust.merits["worst_null_deg"]) == pytest.approx(abs(shifted.merits["null_deg"]))
    assert robust.merits["u_worst_null_deg"] == pytest.approx(shifted.merits["u_null_deg"])
    assert (np.abs(robust.merits["null_deg"]) < 0.01).all()
    assert robust.merits["worst_light"] == pytest.approx(np.minimum(robust.merits["light"], shifted.merits["light"]))
    assert robust.points == 2


def test_traces_each_point_once(tmp_path: Path) -> None:
    first = sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,20,22",)), Store(tmp_path))
    second = sweep(DESIGN, SweepOptions(over=("lens.focus_mm=20,24",)), Store(tmp_path))
    assert (first.traced, second.traced) == (3, 1)
    assert np.array_equal(first.power[1], second.power[0])


def test_impossible_design_has_no_response(tmp_path: Path) -> None:
    result = sweep(DESIGN, SweepOptions(over=("lens.half_width_mm=2,2000,-2,3000",)), Store(tmp_path))
    assert np.isnan(result.merits["light"]).tolist() == [False, True, True, True]
    assert list(result.failures.values()) == [2, 1]  # reasons that differ only in numbers are counted together
    assert "3 of 4:" in result.warnings[0]
    with pytest.raises(SpecError, match="no point has a response"):
        sweep(DESIGN, SweepOptions(over=("lens.half_width_mm=1000,2000",)), Store(tmp_path / "refused"))
    assert not (tmp_path / "refused").exists()


@pytest.mark.parametrize(("samples", "values"), [(None, "0.1,0.2"), (2, "0.1:0.2")])
def test_warns_of_key_without_effect(samples: int | None, values: str) -> None:
    over = (f"emitter.y_mm={values}", f"emitter.offset_mm={values}")
    result = sweep(DESIGN.set({"motion.step_deg": 1.0}), SweepOptions(over=over, samples=samples))
    (warning,) = (text for text in result.warnings if "motion.step_deg" not in text)
    assert "emitter.y_mm" in warning
    assert "in the plane" in warning


def test_name_of_point_depends_on_all_inputs(tmp_path: Path) -> None:
    base = Variant(DESIGN)
    assert base.name(Accuracy()) == Variant(DESIGN.set(name="other")).name(Accuracy())
    names = [
        Variant(DESIGN.set(focus_mm=21)).name(Accuracy()),
        Variant(DESIGN, {"emitter.offset_mm": 0.01}).name(Accuracy()),
        base.name(Accuracy(1e-3)),
        base.name(Accuracy(None, 4096)),
    ]
    profile = tmp_path / "a.txt"
    for content in ("1", "2"):
        profile.write_text(content, encoding="utf-8")
        in_folder = DESIGN.set({"emitter.ray_file": "a.txt"}).in_folder(tmp_path)
        names.append(Variant(in_folder).name(Accuracy()))
    assert len({base.name(Accuracy()), *names}) == 7


def test_name_of_point_depends_on_extensions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry_point = EntryPoint("lab-bar", "lab_bar:BAR", BODY_KINDS)
    monkeypatch.syspath_prepend(tmp_path)
    offered = {BODY_KINDS: {"lab-bar": entry_point}}
    monkeypatch.setattr("solen.explore.store.plugin_entries", lambda group: offered.get(group, {}))
    names = set()
    for width in (3, 4):
        (tmp_path / "lab_bar.py").write_text(f"BAR = {width}", encoding="utf-8")
        code_digest.cache_clear()
        names.add(code_digest())
    code_digest.cache_clear()
    assert len(names) == 2


def test_batch_agrees_with_integration(tmp_path: Path) -> None:
    chip = DESIGN.set({"emitter.width_mm": 0.2, "emitter.pattern": "lambertian", "emitter.cone_deg": 120.0})
    over = ("lens.focus_mm=18,22", "emitter.offset_mm=0,0.02,0.3")
    batch = sweep(chip, SweepOptions(over=over, rays=4096), Store(tmp_path))
    integrated = sweep(chip, SweepOptions(over=over, tolerance=1e-3))
    assert batch.traced == integrated.traced == 6
    difference = np.abs(batch.power - integrated.power) / np.hypot(batch.u_power, integrated.u_power)
    assert np.sqrt(np.mean(difference**2)) < 1.5
    assert 0 < batch.u_power.max() < 5e-3


def test_batch_point_does_not_depend_on_other_points() -> None:
    chip = DESIGN.set({"emitter.width_mm": 0.2})
    first = sweep(chip, SweepOptions(over=("lens.focus_mm=20,21",), rays=1024))
    second = sweep(chip, SweepOptions(over=("lens.focus_mm=20,30",), rays=1024))
    assert np.array_equal(first.power[0], second.power[0])


def test_chips_share_rays_of_their_design(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chip = DESIGN.set({"emitter.pattern": "lambertian", "emitter.cone_deg": 120.0, "motion.step_deg": 0.5})
    axes = ("emitter.offset_mm=0,0.02,0.05", "lens.focus_mm=18,22", "emitter.width_mm=0.2,0.25")
    calls: list[int] = []
    machines = import_module("solen.explore.machines")
    respond = machines.respond

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(1)
        return respond(*args, **kwargs)

    monkeypatch.setattr(machines, "respond", counted)
    shared = sweep(chip, SweepOptions(over=axes, rays=4096), Store(tmp_path))
    assert len(calls) == 2
    separate = sweep(chip, SweepOptions(over=axes, rays=4096, robust=("emitter.distance_mm=0.01",)))
    assert shared.shape == (3, 2, 2)
    assert list(shared.values["emitter.offset_mm"][:5]) == [0.0] * 4 + [0.02]
    difference = (shared.power - separate.power) / np.hypot(shared.u_power, separate.u_power)
    assert np.sqrt(np.mean(difference**2)) < 1.5
    assert np.abs(difference).max() < 5.0
    assert shared.u_power.max() < 3.0 * separate.u_power.max()
    (block,) = (tmp_path / "blocks").iterdir()
    interrupted = Store(tmp_path)
    for name in list(interrupted.points)[::2]:  # as if killed between two points of one trace
        del interrupted.points[name]
    block.unlink()
    resumed = sweep(chip, SweepOptions(over=axes, rays=4096), interrupted)
    assert resumed.traced == 6
    assert np.array_equal(resumed.power, shared.power)


@pytest.mark.parametrize("over", ["emitter.offset_mm=0,3", "emitter.width_mm=0,0.2", "lens.focus_mm=18,20"])
def test_distant_or_point_chips_do_not_share_rays(over: str) -> None:
    assert chips_of(DESIGN.set({"emitter.width_mm": 0.2}), [axis(over, DESIGN)]) == ()


def test_failure_of_machine_is_not_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Variant) -> Sensor:
        raise OutputError("extra", limit="is not installed")

    monkeypatch.setattr(Variant, "sensor", fail)
    with pytest.raises(OutputError):
        sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,20",)), Store(tmp_path))
    assert Store(tmp_path).points == {}


def test_refuses_damaged_block(tmp_path: Path) -> None:
    sweep(DESIGN, SweepOptions(over=("lens.focus_mm=18,20",)), Store(tmp_path))
    block = next((tmp_path / "blocks").glob("*.npz"))
    block.write_bytes(block.read_bytes()[:-200])
    with pytest.raises(DataError, match=block.name):
        Store(tmp_path)


def test_small_blocks_are_merged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.explore.store.MAX_BLOCKS", 8)
    point = Point(np.ones((3, 2)), np.zeros((3, 2)), np.zeros((1, 2)))
    store = Store(tmp_path)
    for number in range(9):
        store.add({f"point {number}": point})
    assert len(Store(tmp_path).points) == 9
    merged = list((tmp_path / "blocks").iterdir())
    assert len(merged) == 1
    for number in range(9):  # as if the program had been killed before it removed the small blocks
        other = Store(tmp_path / "other")
        other.add({f"point {number}": point})
    for block in (tmp_path / "other" / "blocks").iterdir():
        block.rename(tmp_path / "blocks" / block.name)
    assert len(Store(tmp_path).points) == 9
    assert list((tmp_path / "blocks").iterdir()) == merged


def _command(design: Path, out: Path) -> list[str]:
    over = ("--over", "lens.focus_mm=15:25:12", "--over", "emitter.offset_mm=0,0.01,0.02")
    return [sys.executable, "-m", "solen", "explore", "sweep", str(design), *over, "--out", str(out)]


def test_cluster_gives_same_sweep(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    options = SweepOptions(over=("lens.focus_mm=18,20,22,2000000",))
    local = sweep(DESIGN, options)
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        remote = sweep(DESIGN, options, Store(tmp_path), machine=Cluster(client, chunk_points=2))
    assert remote.traced == local.traced
    assert all(np.array_equal(remote.merits[name], local.merits[name], equal_nan=True) for name in local.merits)
    assert len(Store(tmp_path).points) == 3


def test_slurm_file_determines_job_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    ("content", "key"), [("jobs = 0", "jobs"), ("cores = 2\nqueu = 'a'", "queu"), ("walltime = 3", "walltime")]
)
def test_refuses_malformed_slurm_file(tmp_path: Path, content: str, key: str) -> None:
    path = tmp_path / "slurm.toml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(DataError) as error:
        Slurm.read(path)
    assert key in str(error.value)


@pytest.mark.evidence
def test_sweep_survives_killed_worker(tmp_path: Path) -> None:
    from distributed import Client

    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    file = tmp_path / "scheduler.json"
    scheduler = subprocess.Popen([*command, "--scheduler-file", str(file)], stderr=subprocess.DEVNULL)
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    workers = [subprocess.Popen([*worker, "--no-dashboard"], stderr=subprocess.DEVNULL) for _ in range(2)]
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

            remote = sweep(DESIGN, options, Store(tmp_path), progress=kill, machine=Cluster(client, chunk_points=4))
        assert not nannies
        local = sweep(DESIGN, options)
        assert remote.traced == local.traced == 96
        assert all(np.array_equal(remote.merits[name], local.merits[name], equal_nan=True) for name in local.merits)
    finally:
        for process in (*workers, scheduler):
            process.terminate()
            process.wait()


@pytest.mark.evidence
def test_interrupted_sweep_gives_same_table(tmp_path: Path) -> None:
    import xarray

    design = save(tmp_path / "small.toml", DESIGN)
    subprocess.run(_command(design, tmp_path / "complete"), check=True, capture_output=True)
    rng = np.random.default_rng(0)
    for _ in range(10):
        running = subprocess.Popen(_command(design, tmp_path / "interrupted"), stdout=subprocess.DEVNULL)
        time.sleep(rng.uniform(2.0, 8.0))
        running.send_signal(signal.SIGKILL)
        running.wait()
    subprocess.run(_command(design, tmp_path / "interrupted"), check=True, capture_output=True)
    tables = [xarray.load_dataset(tmp_path / name / "small-sweep.nc") for name in ("complete", "interrupted")]
    assert tables[0].identical(tables[1])
    assert not list((tmp_path / "interrupted").rglob("*.tmp"))
