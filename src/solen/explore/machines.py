"""Where responses are traced: here, or on the workers of a Dask cluster.

Points go in chunks, each a task of a second or more, so that what a task costs does not count. A worker that dies
loses its chunks alone, and they are traced by another. The compiled tracer is warmed up once on each worker.

The interface: `Here` and `Cluster` take variants and give responses by their names as they come; `machine_at` makes
one.
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
from solen.explore.store import Accuracy, Chip, Point, Variant, engine, no_response
from solen.extras import need
from solen.files import read_text
from solen.sensor import Response, Sensor, respond, why_not_batched
from solen.sensor.readings import readings_from
from solen.spec.strict import Strict, Text, error_context, parse_toml

ALLOWED_FAILURES = 10
"""Workers that may die under a task before it counts as the task's fault."""
CHUNK_POINTS, BATCH = 16, 256
"""Points of a task, and of a call of the compiled batch."""
WAIT_S = 30.0
"""Longest time in s that an address may take to answer."""


class Machine(Protocol):
    """What traces variants."""

    def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
        """Responses of variants by their names, some at a time, in the order in which they are ready."""


class Here:
    """The process itself."""

    def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
        """See `Machine`."""
        listed = list(variants.items())
        size = 1 if accuracy.rays is None else BATCH
        for first in range(0, len(listed), size):
            yield responses_of(listed[first : first + size], accuracy)


def responses_of(variants: Sequence[tuple[str, Variant]], accuracy: Accuracy) -> dict[str, Point]:
    """Responses of designs over their motions, and their resolutions, by name."""
    if accuracy.rays is None:
        return {name: _integrated(variant, accuracy) for name, variant in variants}
    found: dict[str, Point] = {}
    shared: dict[str, dict[str, tuple[Chip, Sensor]]] = {}
    chips: dict[str, Sequence[Chip]] = {}
    for name, variant in variants:
        try:
            sensor = variant.sensor()
        except (SpecError, DesignError) as bad:  # of the design; whatever else fails is not kept as its response
            found[name] = no_response(bad)
            continue
        if why_not_batched(sensor):
            found[name] = _integrated(variant, accuracy)
            continue
        chip = (sensor.light.width_mm, sensor.design.emitter.offset_mm)
        together = variant.shared_name(accuracy) if chip in variant.chips else name
        shared.setdefault(together, {})[name] = (chip, sensor)
        chips[together] = variant.chips if chip in variant.chips else (chip,)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for points in pool.map(partial(_batched, rays=accuracy.rays), shared.values(), chips.values()):
            found |= points
    return found


def _integrated(variant: Variant, accuracy: Accuracy) -> Point:
    try:
        if variant.design.body.kind == "network":
            return network_point(variant, accuracy)
        sensor = variant.sensor()
        response = sensor.power(tolerance=accuracy.tolerance)
    except (SpecError, DesignError) as bad:
        return no_response(bad)
    return _point(sensor, response, next((trace.why for trace in response.traces if not trace.reached), ""))


def _batched(named: Mapping[str, tuple[Chip, Sensor]], chips: Sequence[Chip], rays: int) -> dict[str, Point]:
    """Responses by the compiled batch of chips that share its rays, some of all; the others make no difference.

    Sensors that differ in more are traced one by one, as the lattices of a call are made for all its sensors.
    """
    sensor = next(sensor for _, sensor in named.values())
    angle_deg = np.array(sensor.design.motion.angles_deg())
    traced = respond([sensor], angle_deg.tolist(), *np.array(chips).T, rays=rays, threads=1)
    if traced.why[0]:
        return dict.fromkeys(named, no_response(SpecError(traced.why[0])))
    found = {}
    for name, (chip, own) in named.items():
        k = chips.index(chip)
        powers = (traced.right[0, k], traced.left[0, k], traced.u_power[0, k])
        found[name] = _point(own, Response("power", angle_deg, *powers, ()), "")
    return found


def _point(sensor: Sensor, response: Response, why: str) -> Point:
    power = np.column_stack([response.right, response.left])
    u_power = np.repeat(response.u_power[:, None], 2, axis=1)
    return Point(power, u_power, np.array([worst_resolution_deg(readings_from(sensor, response))]), why)


def _chunk(digest: str, variants: Sequence[tuple[str, Variant]], accuracy: Accuracy) -> dict[str, Point]:
    """Task of a worker, which must have the same solen."""
    if digest != engine():
        raise DataError("worker", limit="has another version of solen", remedy="install the same on all workers")
    return responses_of(variants, accuracy)


def _key(variants: Sequence[tuple[str, Variant]]) -> str:
    """Name of a task: the same for the same points."""
    return f"solen-{hashlib.sha256(''.join(name for name, _ in variants).encode()).hexdigest()}"


class Cluster:
    """Workers of a Dask cluster, by its client; files that designs name must lie at the same paths there."""

    def __init__(self, client: Any, chunk_points: int = CHUNK_POINTS) -> None:
        self.client, self.chunk_points = client, chunk_points

    def traced(self, variants: Mapping[str, Variant], accuracy: Accuracy) -> Iterator[dict[str, Point]]:
        """See `Machine`; `DataError` where the cluster gives a chunk up."""
        from distributed import as_completed

        listed = list(variants.items())
        chunks = [listed[first : first + self.chunk_points] for first in range(0, len(listed), self.chunk_points)]
        futures = [
            self.client.submit(_chunk, engine(), chunk, accuracy, key=_key(chunk), retries=1) for chunk in chunks
        ]
        try:
            for future in as_completed(futures):
                yield self._result(future)
        finally:
            self.client.cancel(futures)

    def _result(self, future: Any) -> dict[str, Point]:
        try:
            found: dict[str, Point] = future.result()
        except Exception as bad:  # whatever a worker or the network raises
            limit = f"gave a chunk of designs up: {type(bad).__name__}: {bad}"
            raise DataError("--cluster", limit=limit, remedy="look at the workers' logs, and call again") from None
        future.release()
        return found


class Slurm(Strict):
    """File of a SLURM cluster, as `dask_jobqueue.SLURMCluster` takes it."""

    error = DataError

    jobs: int = Field(1, ge=1, le=10_000, description="Number of jobs.")
    queue: Text | None = Field(None, description="Partition.")
    account: Text | None = Field(None, description="Account that is charged.")
    cores: int = Field(2, ge=1, description="Cores of a job.")
    processes: int | None = Field(None, ge=1, description="Workers of a job; default: one, with all its cores.")
    memory: Text = Field("4GB", description="Memory of a job.")
    walltime: Text = Field("01:00:00", description="Longest time of a job.")
    interface: Text | None = Field(None, description="Network interface, as in ib0.")
    log_directory: Text | None = Field(None, description="Folder of what jobs print; default: the working folder.")
    job_extra_directives: tuple[Text, ...] = Field((), description="Further lines of #SBATCH.")
    job_script_prologue: tuple[Text, ...] = Field((), description="Lines before the worker begins: modules, folders.")
    python: Text | None = Field(None, description="Python of the workers; default: this one.")

    @classmethod
    def read(cls, path: Path) -> "Slurm":
        """The file's content; `DataError` where it is malformed."""
        tables = parse_toml(read_text(path, DataError), str(path), DataError)
        with error_context(str(path)):
            return cls(**tables)

    def cluster(self) -> Any:
        """A `dask_jobqueue.SLURMCluster`, no job of which is submitted yet; `DataError` where it cannot be made."""
        import dask_jobqueue

        given = self.model_dump(exclude={"jobs", "processes"}, exclude_none=True)
        lists = {key: list(given.pop(key)) for key in ("job_extra_directives", "job_script_prologue")}
        made: Any = dask_jobqueue.SLURMCluster
        try:
            return made(**given, **lists, processes=self.processes or 1)
        except (ValueError, RuntimeError) as bad:  # of its memory or its interface
            raise DataError("--cluster", limit=str(bad), remedy="change the file of the cluster") from None


def check_job(script: str) -> None:
    """`DataError` where SLURM would refuse a job script, since Dask would wait for its workers forever."""
    submit = shutil.which("sbatch")
    if submit is None:
        limit, remedy = "sbatch is not installed here", "call from a machine that submits jobs"
        raise DataError("--cluster", limit=limit, remedy=remedy)
    test = [submit, "--test-only"]
    asked = subprocess.run(test, input=script, text=True, capture_output=True, check=False)  # noqa: S603  sbatch's own options
    if asked.returncode:
        limit = f"SLURM refuses its jobs: {'; '.join(asked.stderr.splitlines())}"
        raise DataError("--cluster", limit=limit, remedy="change the file of the cluster")


def machine_at(where: str | None) -> Machine:
    """The process itself, or the cluster at an address or of a file."""
    return Here() if where is None else cluster_at(where)


def cluster_at(where: str) -> Cluster:
    """Cluster at an address, ``tcp://10.0.0.7:8786``, or of a file, ``slurm.toml``, whose jobs are submitted.

    Raises
    ------
    OutputError
        Where Dask is not installed.
    SpecError, DataError
        Where nothing answers at the address, or the file is malformed.
    """
    need("distributed", "dask_jobqueue", what="--cluster", doing="tracing on a cluster")
    import dask
    import distributed

    connect: Any = distributed.Client
    dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_FAILURES})
    if where.endswith(".toml"):
        slurm = Slurm.read(Path(where))
        cluster = slurm.cluster()
        check_job(cluster.job_script())
        cluster.scale(jobs=slurm.jobs)
        return Cluster(connect(cluster))
    try:
        client = connect(where, timeout=WAIT_S)
    except (OSError, ValueError, TimeoutError) as bad:
        limit = f"no cluster answers there: {str(bad) or type(bad).__name__}"
        remedy = "start `dask scheduler`, and name its address"
        raise SpecError("--cluster", value=where, limit=limit, remedy=remedy) from None
    return Cluster(client)
