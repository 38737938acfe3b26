"""Where responses are traced: here, or on the workers of a Dask cluster.

Points go in chunks, each a task of a second or more, so that what a task costs does not count. A worker that dies
loses its chunks alone, and they are traced by another. The compiled tracer is warmed up once on each worker.

The interface: `Here` and `Cluster` take variants and give responses by their names as they come; `machine_at` makes
one.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from pydantic import Field

from solen.errors import DataError, SolenError, SpecError
from solen.explore.merits import worst_resolution_deg
from solen.explore.store import Point, Variant, no_response
from solen.extras import need
from solen.files import read_text
from solen.sensor.readings import readings_from
from solen.spec.strict import Strict, Text, error_context, parse_toml

ALLOWED_FAILURES = 10
"""Workers that may die under a task before it counts as the task's fault."""
CHUNK_POINTS = 16
WAIT_S = 30.0
"""How long an address may take to answer, in s."""


class Machine(Protocol):
    """What traces variants."""

    def traced(self, variants: Mapping[str, Variant], tolerance: float | None) -> Iterator[dict[str, Point]]:
        """Responses of variants by their names, some at a time, in the order in which they are ready."""


class Here:
    """The process itself."""

    def traced(self, variants: Mapping[str, Variant], tolerance: float | None) -> Iterator[dict[str, Point]]:
        """See `Machine`."""
        for name, variant in variants.items():
            yield {name: response_of(variant, tolerance)}


def response_of(variant: Variant, tolerance: float | None) -> Point:
    """Response of a design over its motion, and its resolution."""
    try:
        sensor = variant.sensor()
        response = sensor.power(tolerance=tolerance)
        resolution_deg = worst_resolution_deg(readings_from(sensor, response))
    except SolenError as bad:
        return no_response(bad)
    why = next((trace.why for trace in response.traces if not trace.reached), "")
    return Point(response.right, response.left, response.u_power, resolution_deg, why)


def _chunk(variants: Sequence[tuple[str, Variant]], tolerance: float | None) -> dict[str, Point]:
    """Task of a worker."""
    return {name: response_of(variant, tolerance) for name, variant in variants}


class Cluster:
    """Workers of a Dask cluster, by its client; files that designs name must lie at the same paths there."""

    def __init__(self, client: Any, chunk_points: int = CHUNK_POINTS) -> None:
        self.client, self.chunk_points = client, chunk_points

    def traced(self, variants: Mapping[str, Variant], tolerance: float | None) -> Iterator[dict[str, Point]]:
        """See `Machine`; `DataError` where the cluster gives a chunk up."""
        from distributed import as_completed

        listed = list(variants.items())
        chunks = [listed[first : first + self.chunk_points] for first in range(0, len(listed), self.chunk_points)]
        futures = [
            self.client.submit(_chunk, chunk, tolerance, key=f"solen-{chunk[0][0]}", retries=1) for chunk in chunks
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
        """A `dask_jobqueue.SLURMCluster`, no job of which is submitted yet."""
        import dask_jobqueue

        given = self.model_dump(exclude={"jobs", "processes"}, exclude_none=True)
        lists = {key: list(given.pop(key)) for key in ("job_extra_directives", "job_script_prologue")}
        made: Any = dask_jobqueue.SLURMCluster
        return made(**given, **lists, processes=self.processes or 1)


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
        cluster.scale(jobs=slurm.jobs)
        return Cluster(connect(cluster))
    try:
        client = connect(where, timeout=WAIT_S)
    except (OSError, ValueError, TimeoutError) as bad:
        limit = f"no cluster answers there: {str(bad) or type(bad).__name__}"
        remedy = "start `dask scheduler`, and name its address"
        raise SpecError("--cluster", value=where, limit=limit, remedy=remedy) from None
    return Cluster(client)
