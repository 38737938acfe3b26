"""The engine on a GPU, as far as it can be tested without one.

numba simulates a GPU if this is requested before it is imported, and therefore in a separate process; the kernel then
runs as plain Python, thread by thread. This shows what is computed, but not that the kernel can be compiled. Another
process compiles it, which requires no GPU either. The last test requires a GPU.
"""

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.scene import Beam, Fan, Interface, Region, Scene
from solen.trace import Limits, Mode, Trace, engine, trace
from solen.trace.chunks import DTYPES, Device, Job, chunks, rows_of, rules_of
from solen.trace.kernel.rows import ARC, CONIC, CUBIC, OVAL, SEGMENT
from solen.trace.kernel.surface import SPLITTING
from solen.trace.sums import empty
from solen.trace.tables import compile_scene
from tests.agreement.random_scene_support import motley_scene, random_scene

ROOT = Path(__file__).resolve().parents[2]
Numbers = dict[str, list[float]]
needs_numba_cuda = pytest.mark.skipif(find_spec("numba_cuda") is None, reason="numba-cuda is not installed")


FEW = Limits(min_weight=1e-2, max_hits=30)


@dataclass(frozen=True)
class Case:
    """A trace; ``kernel`` (constants of the kernel) and ``chunk`` replace sizes that are too large for a simulation."""

    scene: Callable[[], Scene]
    mode: Mode
    limits: Limits = FEW
    options: Mapping[str, Any] = field(default_factory=dict)
    kernel: Mapping[str, int] = field(default_factory=dict)
    chunk: int = 2**18


def one_source(scene: Scene, number: int, rays: int) -> Scene:
    return replace(scene, sources=(scene.sources[number].with_rays(rays),))


def open_scene() -> Scene:
    """Return a scene with rays that pass beside the end of a medium, and rays that are trapped."""
    ring = Interface("ring", Arc.circle((0.0, 0.0), 1.0), "air", "air", "mirror")
    face = Interface("face", Segment((2.0, 3.0), (4.0, 3.0)), "glass", "air")
    eye = Interface("eye", Segment((5.0, 4.0), (1.0, 4.0)), "air", "air", "receiver", "eye")
    sources = (Fan((0.5, 0.0), 0.0, 360.0, 10), Beam((1.5, 2.0), (4.5, 2.0), 0.0, 20))
    return Scene((Region("air", 1.0), Region("glass", 1.5)), (ring, face, eye), sources, open_media=True)


BINS = {"position_bins": 7, "angle_bins": 5}
CASES = {
    "counting": Case(lambda: motley_scene(0, 12), "count", options=BINS),
    "power": Case(lambda: motley_scene(1, 8), "power", options=BINS),
    "power through a grid": Case(lambda: random_scene(0, 8), "power", Limits(min_weight=1e-4, max_hits=20)),
    "power, many rays per thread": Case(
        lambda: motley_scene(1, 8), "power", options=BINS, kernel={"MAX_THREADS": 4, "COLUMNS_PER_SUM": 2}, chunk=5
    ),
    "single precision": Case(lambda: one_source(motley_scene(2, 8), 0, 16), "power", options={"precision": "single"}),
    "roulette": Case(lambda: one_source(motley_scene(2, 8), 1, 64), "roulette", options={"seed": 3}),
    "samples": Case(lambda: one_source(motley_scene(1, 8), 4, 64), "count", options={"sampling": "sobol", "seed": 5}),
    "undefined and truncated": Case(open_scene, "count"),
}


def counts(result: Trace) -> Numbers:
    return {
        "rays, hits, undefined, truncated": [result.rays, result.hits, result.undefined, result.truncated],
        "detected": [reading.rays for reading in result.detectors.values()],
        "crossed": [reading.rays for reading in result.monitors.values()],
        "locations": [len(result.undefined_at_mm), len(result.truncated_at_mm)],
    }


def powers(result: Trace) -> Numbers:
    """Return all results that are not integers."""
    numbers = {"ledger": list(astuple(result.ledger))}
    for name, reading in result.detectors.items():
        numbers[f"{name}, power, u and by source"] = [reading.power, reading.u_power, *reading.power_by_source]
        numbers[f"{name}, optical path"] = [reading.optical_path_mm]
        numbers[f"{name}, bins"] = [*reading.power_by_position.ravel().tolist(), *reading.power_by_angle.tolist()]
    for name, crossed in result.monitors.items():
        numbers[f"{name}, power, u and map"] = [crossed.power, crossed.u_power, *crossed.power_by_bin.tolist()]
    return numbers


def locations(result: Trace) -> list[list[tuple[float, float]]]:
    """Return the locations of undefined and of truncated rays, sorted, because their order depends on the tracer."""
    kinds = (result.undefined_at_mm, result.truncated_at_mm)
    return [sorted((round(x, 9), round(z, 9)) for x, z in points) for points in kinds]


def trace_case(case: Case, device: Device) -> Trace:
    return trace(case.scene(), case.mode, case.limits, device=device, **case.options)


def simulate() -> dict[str, Any]:
    """Return the results of all cases on the simulated GPU, and those of a case that is repeated."""
    from solen.trace.kernel import cuda, hits  # in the simulating process only

    vars(hits)["math"] = SimpleNamespace(**vars(math) | {"sqrt": np.sqrt})  # in compiled code, a root may be NaN
    np.seterr(all="ignore")
    results = {}
    for name, case in (*CASES.items(), ("repeated", CASES["power"])):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(engine, "GPU_CHUNK", case.chunk)
            for constant, value in case.kernel.items():
                patch.setattr(cuda, constant, value)
            result = trace_case(case, "cuda")
        results[name] = {"counts": counts(result), "powers": powers(result), "locations": locations(result)}
    return results


def compiled_kernel(precision: str) -> str:
    """Return the kernel compiled for compute capability 8.0; calls that require a GPU are replaced."""
    import numba  # in the compiling process only
    from numba import cuda
    from numba.cuda import dispatcher

    from solen.trace.kernel import cuda as gpu

    job = Job.of(motley_scene(1, 8), "power", Limits(), DTYPES[precision], position_bins=7, angle_bins=5)
    chunk = next(chunks(job, 8))()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(8, 0)))
        patch.setattr(gpu, "SIMULATED", True)  # arrays are then in the memory of the CPU
        patch.setattr(gpu.GpuScene, "_column_sums", lambda _, columns: columns)
        scene = gpu.GpuScene(job.constants, job.tables, empty(job), SPLITTING[job.mode], 1e-6, 8)
        arguments = (*scene.arguments(), rows_of(job, chunk), rules_of(job, chunk), 8)
        typeof: Callable[[object], Any] = numba.typeof
        types = tuple(typeof(argument) for argument in arguments)
        return str(cuda.compile_ptx(gpu.follow_rays.py_func, types, cc=(8, 0))[0])


def in_new_process(call: str, **environment: str) -> Any:
    """Return the result of a function of this module from a new process."""
    command = f"import json, sys; from tests.trace import test_cuda; json.dump(test_cuda.{call}, sys.stdout)"
    done = subprocess.run(
        [sys.executable, "-c", command],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@cache
def simulated() -> Any:
    return in_new_process("simulate()", NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")


@needs_numba_cuda
@pytest.mark.evidence
@pytest.mark.parametrize("name", CASES)
def test_simulated_gpu_agrees_with_cpu(name: str) -> None:
    cpu, gpu = trace_case(CASES[name], "cpu"), simulated()[name]
    assert gpu["counts"] == counts(cpu)
    power_atol, length_atol = (1e-6, 1e-2) if name == "single precision" else (1e-12, 1e-9)
    for quantity, numbers in powers(cpu).items():
        atol = length_atol if "path" in quantity else power_atol
        np.testing.assert_allclose(gpu["powers"][quantity], numbers, rtol=0.0, atol=atol, err_msg=quantity)


@needs_numba_cuda
@pytest.mark.evidence
def test_simulated_gpu_stores_locations() -> None:
    cpu = trace_case(CASES["undefined and truncated"], "cpu")
    gpu = simulated()["undefined and truncated"]["locations"]
    assert cpu.undefined > 0
    assert cpu.truncated > 0
    for expected, actual in zip(locations(cpu), gpu, strict=True):
        np.testing.assert_allclose(actual, expected, rtol=0.0, atol=2e-9)


@needs_numba_cuda
@pytest.mark.evidence
def test_simulated_gpu_is_repeatable() -> None:
    assert json.dumps(simulated()["repeated"]) == json.dumps(simulated()["power"])


def test_cases_have_every_curve_and_behaviour() -> None:
    tables = [compile_scene(case.scene()) for case in CASES.values()]
    assert set(np.concatenate([table.kind for table in tables])) == {SEGMENT, ARC, CONIC, OVAL, CUBIC}
    assert set(np.concatenate([table.behaviour for table in tables])) == {0, 1, 2, 3}
    assert {len(table.grid_item) > 0 for table in tables} == {True, False}


@needs_numba_cuda
@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.evidence)])
def test_kernel_compiles_for_a_gpu(precision: str) -> None:
    """Check for no stack frame, IEEE 754 division and roots, and little double precision in single precision."""
    ptx = in_new_process(f"compiled_kernel({precision!r})")
    assert ".visible .entry" in ptx
    assert not re.search(r"\bcall\b|\.local \.align|\bdiv\.(approx|full)|\bsqrt\.approx", ptx)
    number_type = "f64" if precision == "double" else "f32"
    assert f"mul.rn.{number_type}" in ptx  # products that must not be fused with a sum
    if precision == "single":
        assert ptx.count(".f64") < 0.2 * ptx.count(".f32")  # sums and monitors are in double precision


def test_import_does_not_load_numba_cuda() -> None:
    command = "import sys, solen.trace; print(*(name for name in sys.modules if name.startswith('numba.cuda')))"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, encoding="utf-8", check=True)
    assert done.stdout.split() == []


def test_missing_package_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba_cuda", None)
    with pytest.raises(DesignError, match=r'^device = .cuda.; .*numba-cuda.*; pip install "numba-cuda\[cu12\]\S+"$'):
        trace(open_scene(), device="cuda")


@needs_numba_cuda
def test_missing_gpu_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    from solen.trace.kernel import cuda  # requires numba-cuda

    monkeypatch.setattr(cuda, "available", lambda: False)
    with pytest.raises(DesignError, match=r"^device = .cuda.; no CUDA GPU .*device=.cpu.$"):
        trace(open_scene(), device="cuda")


def test_refuses_unsupported_options_on_a_gpu() -> None:
    with pytest.raises(DesignError, match=r"^segments = True; .*device=.cpu.$"):
        trace(open_scene(), device="cuda", segments=True)
    with pytest.raises(DesignError, match=r"^device = .gpu.; must be one of cpu, cuda$"):
        trace(open_scene(), device="gpu")  # type: ignore[arg-type]


@needs_numba_cuda
def test_gpu_agrees_with_cpu() -> None:
    from solen.trace.kernel import cuda  # requires numba-cuda

    if not cuda.available():
        pytest.skip("this machine has no GPU")
    for name, case in CASES.items():
        cpu, gpu, repeated = trace_case(case, "cpu"), trace_case(case, "cuda"), trace_case(case, "cuda")
        assert counts(gpu) == counts(cpu), name
        for quantity, numbers in powers(cpu).items():
            atol, title = 1e-2 if name == "single precision" else 1e-9, f"{name}, {quantity}"
            np.testing.assert_allclose(powers(gpu)[quantity], numbers, rtol=0.0, atol=atol, err_msg=title)
        assert json.dumps(powers(repeated)) == json.dumps(powers(gpu)), name
