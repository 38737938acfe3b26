"""The engine on a graphics card, as far as this goes without one.

numba imitates a card if it is told so before it is imported, hence in a process of its own; there the kernel runs as
plain Python, thread by thread. That shows what is computed, not that a card's compiler takes it: it compiles the kernel
in another process, which needs no card either. On a machine with a card the last test runs there.
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
    """A trace; ``kernel`` and ``chunk`` make small what is large for a card."""

    scene: Callable[[], Scene]
    mode: Mode
    limits: Limits = FEW
    options: Mapping[str, Any] = field(default_factory=dict)
    kernel: Mapping[str, int] = field(default_factory=dict)
    chunk: int = 2**18


def one_source(scene: Scene, number: int, rays: int) -> Scene:
    return replace(scene, sources=(scene.sources[number].with_rays(rays),))


def open_scene() -> Scene:
    """Rays that go round the end of a medium, and rays that are shut in."""
    shut = Interface("ring", Arc.circle((0.0, 0.0), 1.0), "air", "air", "mirror")
    face = Interface("face", Segment((2.0, 3.0), (4.0, 3.0)), "glass", "air")
    eye = Interface("eye", Segment((5.0, 4.0), (1.0, 4.0)), "air", "air", "receiver", "eye")
    sources = (Fan((0.5, 0.0), 0.0, 360.0, 10), Beam((1.5, 2.0), (4.5, 2.0), 0.0, 20))
    return Scene((Region("air", 1.0), Region("glass", 1.5)), (shut, face, eye), sources, open_media=True)


BINS = {"position_bins": 7, "angle_bins": 5}
CASES = {
    "counting": Case(lambda: motley_scene(0, 12), "count", options=BINS),
    "power": Case(lambda: motley_scene(1, 8), "power", options=BINS),
    "power through a grid": Case(lambda: random_scene(0, 8), "power", Limits(min_weight=1e-4, max_hits=20)),
    "power, many rays a thread": Case(
        lambda: motley_scene(1, 8), "power", options=BINS, kernel={"MAX_THREADS": 4, "ADDED": 2}, chunk=5
    ),
    "single precision": Case(lambda: one_source(motley_scene(2, 8), 0, 16), "power", options={"precision": "single"}),
    "roulette": Case(lambda: one_source(motley_scene(2, 8), 1, 64), "roulette", options={"seed": 3}),
    "samples": Case(lambda: one_source(motley_scene(1, 8), 4, 64), "count", options={"sampling": "sobol", "seed": 5}),
    "undefined and cut off": Case(open_scene, "count"),
}


def counts(found: Trace) -> Numbers:
    return {
        "rays, hits, undefined, truncated": [found.rays, found.hits, found.undefined, found.truncated],
        "detected": [reading.rays for reading in found.detectors.values()],
        "crossed": [reading.rays for reading in found.monitors.values()],
        "places": [len(found.undefined_at_mm), len(found.truncated_at_mm)],
    }


def powers(found: Trace) -> Numbers:
    """All that is not a whole number."""
    numbers = {"ledger": list(astuple(found.ledger))}
    for name, reading in found.detectors.items():
        numbers[f"{name}, power, u and by source"] = [reading.power, reading.u_power, *reading.power_by_source]
        numbers[f"{name}, optical path"] = [reading.optical_path_mm]
        numbers[f"{name}, bins"] = [*reading.power_by_position.ravel().tolist(), *reading.power_by_angle.tolist()]
    for name, crossed in found.monitors.items():
        numbers[f"{name}, power, u and map"] = [crossed.power, crossed.u_power, *crossed.power_by_bin.tolist()]
    return numbers


def places(found: Trace) -> list[list[tuple[float, float]]]:
    """In an order of their own: theirs is up to the tracer."""
    both = (found.undefined_at_mm, found.truncated_at_mm)
    return [sorted((round(x, 9), round(z, 9)) for x, z in at) for at in both]


def traced(case: Case, device: Device) -> Trace:
    return trace(case.scene(), case.mode, case.limits, device=device, **case.options)


def simulate() -> dict[str, Any]:
    """All cases on the card that numba imitates; the first of them twice."""
    from solen.trace.kernel import cuda, hits  # for the process that simulates

    vars(hits)["math"] = SimpleNamespace(**vars(math) | {"sqrt": np.sqrt})  # compiled, a root may be NaN
    np.seterr(all="ignore")
    found = {}
    for name, case in (*CASES.items(), ("again", CASES["power"])):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(engine, "CARD_CHUNK", case.chunk)
            for constant, value in case.kernel.items():
                patch.setattr(cuda, constant, value)
            result = traced(case, "cuda")
        found[name] = {"counts": counts(result), "powers": powers(result), "places": places(result)}
    return found


def compiled(precision: str) -> str:
    """The kernel as a card of compute capability 8.0 would get it; what asks for a card is answered in its place."""
    import numba  # for the process that compiles
    from numba import cuda
    from numba.cuda import dispatcher

    from solen.trace.kernel import cuda as card

    job = Job.of(motley_scene(1, 8), "power", Limits(), DTYPES[precision], position_bins=7, angle_bins=5)
    chunk = next(chunks(job, 8))()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(8, 0)))
        patch.setattr(card, "SIMULATED", True)  # its memory is then the processor's
        patch.setattr(card.Card, "_added", lambda _, columns: columns)
        made = card.Card(job.constants, job.tables, empty(job), SPLITTING[job.mode], 1e-6, 8)
        arguments = (*made.arguments(), rows_of(job, chunk), rules_of(job, chunk), 8)
        typeof: Callable[[object], Any] = numba.typeof
        types = tuple(typeof(argument) for argument in arguments)
        return str(cuda.compile_ptx(card.follow_rays.py_func, types, cc=(8, 0))[0])


def elsewhere(call: str, **environment: str) -> Any:
    """What a function of this module returns in a process of its own."""
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
    return elsewhere("simulate()", NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")


@needs_numba_cuda
@pytest.mark.evidence
@pytest.mark.parametrize("name", CASES)
def test_a_simulated_card_counts_what_the_processor_counts(name: str) -> None:
    here, there = traced(CASES[name], "cpu"), simulated()[name]
    assert there["counts"] == counts(here)
    power_atol, length_atol = (1e-6, 1e-2) if name == "single precision" else (1e-12, 1e-9)
    for what, numbers in powers(here).items():
        atol = length_atol if "path" in what else power_atol
        np.testing.assert_allclose(there["powers"][what], numbers, rtol=0.0, atol=atol, err_msg=what)


@needs_numba_cuda
@pytest.mark.evidence
def test_the_places_of_rays_that_ended_early_are_kept() -> None:
    here, there = traced(CASES["undefined and cut off"], "cpu"), simulated()["undefined and cut off"]["places"]
    assert here.undefined > 0
    assert here.truncated > 0
    for known, found in zip(places(here), there, strict=True):
        np.testing.assert_allclose(found, known, rtol=0.0, atol=2e-9)


@needs_numba_cuda
@pytest.mark.evidence
def test_a_simulated_card_gives_the_same_bits_again() -> None:
    assert json.dumps(simulated()["again"]) == json.dumps(simulated()["power"])


def test_the_cases_have_every_curve_and_every_behaviour() -> None:
    tables = [compile_scene(case.scene()) for case in CASES.values()]
    assert set(np.concatenate([table.kind for table in tables])) == {SEGMENT, ARC, CONIC, OVAL, CUBIC}
    assert set(np.concatenate([table.behaviour for table in tables])) == {0, 1, 2, 3}
    assert {len(table.grid_item) > 0 for table in tables} == {True, False}


@needs_numba_cuda
@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.evidence)])
def test_the_kernel_compiles_for_a_card(precision: str) -> None:
    """Without a stack frame, with IEEE 754 division and roots, and single precision nearly without double."""
    ptx = elsewhere(f"compiled({precision!r})")
    assert ".visible .entry" in ptx
    assert not re.search(r"\bcall\b|\.local \.align|\bdiv\.(approx|full)|\bsqrt\.approx", ptx)
    digits = "f64" if precision == "double" else "f32"
    assert f"mul.rn.{digits}" in ptx  # the products that must not be fused with a sum
    if precision == "single":
        assert ptx.count(".f64") < 0.2 * ptx.count(".f32")  # sums and monitors are in double precision


def test_the_library_does_not_load_numba_cuda() -> None:
    command = "import sys, solen.trace; print(*(name for name in sys.modules if name.startswith('numba.cuda')))"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, encoding="utf-8", check=True)
    assert done.stdout.split() == []


def test_a_missing_package_is_named_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba_cuda", None)
    with pytest.raises(DesignError, match=r'^device = .cuda.; .*numba-cuda.*; pip install "numba-cuda\[cu12\]\S+"$'):
        trace(open_scene(), device="cuda")


@needs_numba_cuda
def test_a_missing_card_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    from solen.trace.kernel import cuda  # it needs numba-cuda

    monkeypatch.setattr(cuda, "available", lambda: False)
    with pytest.raises(DesignError, match=r"^device = .cuda.; no CUDA GPU .*device=.cpu.$"):
        trace(open_scene(), device="cuda")


def test_what_a_card_cannot_do_is_refused() -> None:
    with pytest.raises(DesignError, match=r"^legs = True; .*device=.cpu.$"):
        trace(open_scene(), device="cuda", legs=True)
    with pytest.raises(DesignError, match=r"^device = .gpu.; must be one of cpu, cuda$"):
        trace(open_scene(), device="gpu")  # type: ignore[arg-type]


@needs_numba_cuda
def test_a_card_counts_what_the_processor_counts() -> None:
    from solen.trace.kernel import cuda  # it needs numba-cuda

    if not cuda.available():
        pytest.skip("no graphics card here")
    for name, case in CASES.items():
        here, there, again = traced(case, "cpu"), traced(case, "cuda"), traced(case, "cuda")
        assert counts(there) == counts(here), name
        for what, numbers in powers(here).items():
            atol = 1e-2 if name == "single precision" else 1e-9
            np.testing.assert_allclose(powers(there)[what], numbers, rtol=0.0, atol=atol, err_msg=f"{name}, {what}")
        assert json.dumps(powers(again)) == json.dumps(powers(there)), name
