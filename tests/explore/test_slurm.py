"""Sweeps on the workers of a real SLURM cluster with one node, if its daemons are installed."""

import getpass
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from solen.spec import Design, save
from tests.command_support import without_waiting

FOLDERS = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin"))
DAEMONS = ("slurmctld", "slurmd")
MISSING = [name for name in (*DAEMONS, "sbatch", "sinfo") if shutil.which(name, path=FOLDERS) is None]
DESIGN = Design(name="small", material={"index": 1.44}, motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 0.25})
CONF = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={daemon}
AuthType=auth/none
CredType=cred/none
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
NodeName=node NodeAddr=127.0.0.1 CPUs=2 RealMemory=8000
PartitionName=all Nodes=node Default=YES
"""

pytestmark = [
    pytest.mark.evidence,
    pytest.mark.skipif(bool(MISSING), reason=f"SLURM is not installed (slurm-wlm in Debian): no {', '.join(MISSING)}"),
]


def _free_ports(count: int) -> list[int]:
    servers = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [server.getsockname()[1] for server in servers]
    for server in servers:
        server.close()
    return ports


@pytest.fixture(scope="module")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Environment of commands for a cluster with one node, whose daemons run until the tests end."""
    pytest.importorskip("dask_jobqueue")
    folder = tmp_path_factory.mktemp("slurm")
    (folder / "spool").mkdir()
    controller, daemon = _free_ports(2)
    host, user = socket.gethostname().partition(".")[0], getpass.getuser()
    conf = folder / "slurm.conf"
    text = CONF.format(host=host, user=user, folder=folder, controller=controller, daemon=daemon)
    conf.write_text(text, encoding="utf-8")
    environment = {**os.environ, "SLURM_CONF": str(conf), "PATH": FOLDERS}
    running = []
    try:
        for name, options in zip(DAEMONS, ([], ["-N", "node"]), strict=True):
            command = [str(shutil.which(name, path=FOLDERS)), "-D", "-f", str(conf), *options]
            with (folder / f"{name}.log").open("w", encoding="utf-8") as log:
                running.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log))
        _wait_for_node(environment, folder)
        yield environment
    finally:
        for process in reversed(running):
            process.terminate()
            process.wait(timeout=30)


def _wait_for_node(environment: dict[str, str], folder: Path) -> None:
    for _ in range(60):
        state = subprocess.run(
            [str(shutil.which("sinfo", path=FOLDERS)), "-h", "-o", "%T"],
            env=environment,
            capture_output=True,
            text=True,
        )
        if state.stdout.strip() == "idle":
            return
        time.sleep(0.5)
    logs = "\n".join(path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.log")))
    pytest.fail(f"the cluster did not start: {state.stdout}{state.stderr}\n{logs}")


def _cluster_file(folder: Path, **changed: str) -> Path:
    keys = {"jobs": "2", "cores": "1", "memory": '"1GB"', "walltime": '"00:10:00"', "interface": '"lo"'} | changed
    path = folder / "slurm.toml"
    lines = [f"{key} = {value}" for key, value in (keys | {"log_directory": f'"{folder}"'}).items()]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def _swept(folder: Path, name: str, environment: dict[str, str], *options: str) -> subprocess.CompletedProcess[str]:
    design = save(folder / "small.toml", DESIGN)
    over = ("--over", "lens.focus_mm=15:25:24", "--over", "emitter.offset_mm=0,0.01,0.02,0.03")
    command = [sys.executable, "-m", "solen", "explore", "sweep", str(design), *over, "--out", str(folder / name)]
    return subprocess.run([*command, *options], env=environment, capture_output=True, text=True, timeout=300)


def test_slurm_jobs_give_same_table(slurm: dict[str, str], tmp_path: Path) -> None:
    import xarray

    cluster = _cluster_file(tmp_path)
    _swept(tmp_path, "local", slurm).check_returncode()
    _swept(tmp_path, "remote", slurm, "--cluster", str(cluster)).check_returncode()
    local, remote = (xarray.load_dataset(tmp_path / name / "small-sweep.nc") for name in ("local", "remote"))
    assert local.identical(remote)
    logs = [path.read_text(encoding="utf-8") for path in tmp_path.glob("*.err")]
    workers = sum("Start worker at" in log for log in logs)
    print(f"\n{local['light'].size} points by {len(logs)} SLURM jobs, of which {workers} started a worker: same table")
    assert len(logs) == 2
    assert workers


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("queue", "nosuch", "nosuch"),
        ("memory", "lots", "lots"),
        ("interface", "ib7", "ib7"),
        ("walltime", "noon", "--time"),
    ],
)
def test_reports_jobs_rejected_by_slurm(
    slurm: dict[str, str], tmp_path: Path, key: str, value: str, reason: str
) -> None:
    run = _swept(tmp_path, "refused", slurm, "--cluster", str(_cluster_file(tmp_path, **{key: f'"{value}"'})))
    assert run.returncode == 2
    assert reason in run.stderr
    assert without_waiting(run.stderr).count("\n") == 1
