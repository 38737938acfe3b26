"""Machines that trace responses: this process, or the workers of a Dask cluster.

Points are sent in chunks, each of which takes a second or more, so that the overhead of a task is negligible. If a
worker dies, only its chunks are lost, and another worker traces them. Each worker compiles the tracer once.

Public names: `LocalMachine`, `Cluster` and `machine_at`.
"""

import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import Field

from solen.errors import DataError, DesignError, SpecError
from solen.explore.merits import worst_resolution_deg
from solen.explore.network_merits import network_point
from solen.explore.store import Accuracy, Chip, Point, Variant, code_digest, no_response
from solen.extras import need
from solen.files import read_text
from solen.sensor import Response, Sensor, respond, why_not_batched
from solen.sensor.readings import readings_from
from solen.spec.strict import Strict, Text, error_context, parse_toml

ALLOWED_FAILURES = 10
"""Number of workers that may die during a task before the task is considered the cause."""
CHUNK_POINTS, BATCH_POINTS = 16, 256
"""Number of points in a task, and in a call of the compiled batch."""
CONNECTION_TIMEOUT_S = 30.0


class Machine(Protocol):
    """A process or a cluster that traces variants."""

    def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
        """Yield responses of variants, several at a time and keyed by name, in the order of completion."""


class LocalMachine:
    """The calling process."""

    def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
        """See `Machine`."""
        named = list(variants.items())
        size = 1 if accuracy.rays is None else BATCH_POINTS
        for first in range(0, len(named), size):
            yield responses_of(named[first : first + size], accuracy)


def responses_of(variants: Sequence[tuple[str, Variant]], accuracy: Accuracy) -> dict[str, Point]:
    """Return the responses of variants, keyed by name; chips that share their rays are traced together."""
    if accuracy.rays is None:
        return {name: _integrated(variant, accuracy) for name, variant in variants}
    traced: dict[str, Point] = {}
    groups: dict[str, dict[str, tuple[Chip, Sensor]]] = {}
    chips: dict[str, Sequence[Chip]] = {}
    for name, variant in variants:
        try:
            sensor = variant.sensor()
        except (SpecError, DesignError) as error:  # due to the design; other failures are not stored as its response
            traced[name] = no_response(error)
            continue
        if why_not_batched(sensor):
            traced[name] = _integrated(variant, accuracy)
            continue
        chip = (sensor.light.width_mm, sensor.design.emitter.offset_mm)
        group = variant.shared_name(accuracy) if chip in variant.chips else name
        groups.setdefault(group, {})[name] = (chip, sensor)
        chips[group] = variant.chips if chip in variant.chips else (chip,)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for points in pool.map(partial(_batched, rays=accuracy.rays), groups.values(), chips.values()):
            traced |= points
    return traced


def _integrated(variant: Variant, accuracy: Accuracy) -> Point:
    try:
        if variant.design.body.kind == "network":
            return network_point(variant, accuracy)
        sensor = variant.sensor()
        response = sensor.power(tolerance=accuracy.tolerance)
    except (SpecError, DesignError) as error:
        return no_response(error)
    return _point(sensor, response, next((trace.why for trace in response.traces if not trace.reached), ""))


def _batched(named: Mapping[str, tuple[Chip, Sensor]], chips: Sequence[Chip], rays: int) -> dict[str, Point]:
    """Return responses from the compiled batch for chips that share its rays; the result does not depend on grouping.

    Sensors that differ in other parameters are traced one by one, since all sensors of a call share one lattice.
    """
    sensor = next(sensor for _, sensor in named.values())
    angle_deg = np.array(sensor.design.motion.angles_deg())
    traced = respond([sensor], angle_deg.tolist(), *np.array(chips).T, rays=rays, threads=1)
    if traced.why[0]:
        return dict.fromkeys(named, no_response(SpecError(traced.why[0])))
    points = {}
    for name, (chip, variant) in named.items():
        k = chips.index(chip)
        powers = (traced.right[0, k], traced.left[0, k], traced.u_power[0, k])
        points[name] = _point(variant, Response("power", angle_deg, *powers, ()), "")
    return points


def _point(sensor: Sensor, response: Response, why: str) -> Point:
    power = np.column_stack([response.right, response.left])
    u_power = np.repeat(response.u_power[:, None], 2, axis=1)
    return Point(power, u_power, np.array([worst_resolution_deg(readings_from(sensor, response))]), why)


def _chunk(digest: str, variants: Sequence[tuple[str, Variant]], accuracy: Accuracy) -> dict[str, Point]:
    """Return the responses of a chunk on a worker, which must have the same version of solen."""
    if digest != code_digest():
        raise DataError(
            "worker", limit="runs a different version of solen", remedy="install the same version on all workers"
        )
    return responses_of(variants, accuracy)


def _key(variants: Sequence[tuple[str, Variant]]) -> str:
    """Return the name of a task, equal for equal points."""
    return f"solen-{hashlib.sha256(''.join(name for name, _ in variants).encode()).hexdigest()}"


class Cluster:
    """Workers of a Dask cluster, given its client. Files named by designs must have the same paths on all workers."""

    def __init__(self, client: Any, chunk_points: int = CHUNK_POINTS) -> None:
        self.client, self.chunk_points = client, chunk_points

    def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
        """See `Machine`; raise `DataError` if a chunk fails."""
        from distributed import as_completed

        named = list(variants.items())
        chunks = [named[first : first + self.chunk_points] for first in range(0, len(named), self.chunk_points)]
        futures = [
            self.client.submit(_chunk, code_digest(), chunk, accuracy, key=_key(chunk), retries=1) for chunk in chunks
        ]
        try:
            for future in as_completed(futures):
                yield self._result(future)
        finally:
            self.client.cancel(futures)

    def _result(self, future: Any) -> dict[str, Point]:
        try:
            points: dict[str, Point] = future.result()
        except Exception as error:  # any error of a worker or the network
            limit = f"failed on a chunk of designs: {type(error).__name__}: {error}"
            raise DataError(
                "--cluster", limit=limit, remedy="read the workers' logs and run the command again"
            ) from None
        future.release()
        return points


class Slurm(Strict):
    """File that describes a SLURM cluster; the keys are arguments of `dask_jobqueue.SLURMCluster`."""

    error = DataError

    jobs: int = Field(1, ge=1, le=10_000, description="Number of jobs.")
    queue: Text | None = Field(None, description="Partition.")
    account: Text | None = Field(None, description="Account to charge.")
    cores: int = Field(2, ge=1, description="Number of cores per job.")
    processes: int | None = Field(
        None, ge=1, description="Number of workers per job; default: one worker with all cores."
    )
    memory: Text = Field("4GB", description="Memory per job.")
    walltime: Text = Field("01:00:00", description="Longest run time of a job.")
    interface: Text | None = Field(None, description="Network interface, for example ib0.")
    log_directory: Text | None = Field(None, description="Folder for the output of jobs; default: the working folder.")
    job_extra_directives: tuple[Text, ...] = Field((), description="Further #SBATCH lines.")
    job_script_prologue: tuple[Text, ...] = Field(
        (), description="Commands to run before the worker starts, for example to load modules or change the folder."
    )
    python: Text | None = Field(None, description="Python interpreter of the workers; default: this one.")

    @classmethod
    def read(cls, path: Path) -> "Slurm":
        """Read the file; raise `DataError` if it is malformed."""
        tables = parse_toml(read_text(path, DataError), str(path), DataError)
        with error_context(str(path)):
            return cls(**tables)

    def cluster(self) -> Any:
        """Create a `dask_jobqueue.SLURMCluster` without submitting a job; raise `DataError` if that fails."""
        import dask_jobqueue

        given = self.model_dump(exclude={"jobs", "processes"}, exclude_none=True)
        lists = {key: list(given.pop(key)) for key in ("job_extra_directives", "job_script_prologue")}
        new_cluster: Any = dask_jobqueue.SLURMCluster
        try:
            return new_cluster(**given, **lists, processes=self.processes or 1)
        except (ValueError, RuntimeError) as error:  # due to its memory or its interface
            raise DataError("--cluster", limit=str(error), remedy="correct the cluster file") from None


def check_job(script: str) -> None:
    """Raise `DataError` if SLURM rejects a job script, since Dask would wait for its workers forever."""
    submit = shutil.which("sbatch")
    if submit is None:
        limit, remedy = "sbatch is not installed on this machine", "run the command on a machine that can submit jobs"
        raise DataError("--cluster", limit=limit, remedy=remedy)
    test = [submit, "--test-only"]
    reply = subprocess.run(test, input=script, text=True, capture_output=True, check=False)  # noqa: S603  sbatch's own options
    if reply.returncode:
        limit = f"SLURM rejects its jobs: {'; '.join(reply.stderr.splitlines())}"
        raise DataError("--cluster", limit=limit, remedy="correct the cluster file")


def machine_at(cluster: str | None) -> Machine:
    """Return this process, or the cluster at an address or described by a file."""
    return LocalMachine() if cluster is None else cluster_at(cluster)


def cluster_at(address: str) -> Cluster:
    """Connect to a cluster at an address, ``tcp://10.0.0.7:8786``, or submit the jobs of a file, ``slurm.toml``.

    Raises
    ------
    OutputError
        If Dask is not installed.
    SpecError, DataError
        If no cluster responds at the address, or the file is malformed.
    """
    need("distributed", "dask_jobqueue", what="--cluster", doing="tracing on a cluster")
    import dask
    import distributed

    connect: Any = distributed.Client
    dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_FAILURES})
    if address.endswith(".toml"):
        slurm = Slurm.read(Path(address))
        cluster = slurm.cluster()
        check_job(cluster.job_script())
        cluster.scale(jobs=slurm.jobs)
        return Cluster(connect(cluster))
    try:
        client = connect(address, timeout=CONNECTION_TIMEOUT_S)
    except (OSError, ValueError, TimeoutError) as error:
        limit = f"no cluster responds at this address: {str(error) or type(error).__name__}"
        remedy = "start `dask scheduler` and specify its address"
        raise SpecError("--cluster", value=address, limit=limit, remedy=remedy) from None
    return Cluster(client)
