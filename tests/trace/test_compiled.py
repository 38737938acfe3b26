"""The cache of the compiled kernel: renewed by contents, and never in the way."""

import os
import pickle
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numba

from solen.trace import kernel
from solen.trace.kernel.compiled import sources, stamp

FOLDER = Path(kernel.__file__).parent
ONE = """
from solen.trace.kernel.compiled import called
@called
def twice(x: float) -> float:
    return 2.0 * x
"""


def twice(path: Path) -> Any:
    """Compiled function of a module in a file."""
    spec = spec_from_file_location("one", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.twice


def test_a_stamp_is_of_contents_and_of_all_that_is_taken_over(tmp_path: Path) -> None:
    names = {path.name for path in sources(FOLDER / "paths.py")}
    assert {"paths.py", "prism.py", "hits.py", "tables.py", "result.py"} <= names
    assert "cuda.py" not in names
    one, two, other = (tmp_path / f"{name}.py" for name in ("one", "two", "other"))
    for path, text in ((one, ONE), (two, ONE), (other, ONE.replace("2.0", "3.0"))):
        path.write_text(text)
    os.utime(two, (1e9, 1e9))
    assert stamp(one) == stamp(two) != stamp(other)


def test_a_form_of_another_version_is_compiled_again(tmp_path: Path) -> None:
    """It may name classes that are no more: reading it then raised."""
    path = tmp_path / "one.py"
    path.write_text(ONE)
    assert twice(path)(2.0) == 4.0
    again = twice(path)
    assert again(2.0) == 4.0
    assert sum(again.stats.cache_hits.values()) == 1
    (form,) = path.parent.rglob("*.nbc")
    whole = form.read_bytes()
    other = pickle.dumps(numba.__version__) + b"csolen.trace.kernel.nearest\nNoMore\n."
    for content in (other, pickle.dumps(f"{numba.__version__} of other files") + other, whole[:40], whole[:-40], b""):
        form.write_bytes(content)
        anew = twice(path)
        assert anew(2.0) == 4.0
        assert sum(anew.stats.cache_misses.values()) == 1


def test_each_form_has_a_file_that_no_other_argument_types_can_take(tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(ONE)
    both = twice(path)
    assert both(2.0) == both(2) == 4.0
    first, second = path.parent.rglob("*.nbc")
    contents = first.read_bytes()
    second.write_bytes(contents)  # as if another process had written it
    anew = twice(path)
    assert anew(2.0) == anew(2) == 4.0
    assert sum(anew.stats.cache_hits.values()) == 1
    assert not list(path.parent.rglob("*.nbi"))


CALLS = """
from solen.trace.kernel.compiled import called, compiled
@called
def root(x: float) -> float:
    return x ** 0.5
@compiled
def more(x: float) -> float:
    return root(x) + 1.0
@called
def outer(x: float) -> float:
    return 2.0 * more(x)
"""
ASKED = """
import sys
sys.path.insert(0, {folder!r})
import three
print(three.outer(9.0), three.more(9.0), sum(sum(f.stats.cache_misses.values()) for f in (three.root, three.outer)))
"""


def asked(folder: Path) -> list[float]:
    """What a process of its own says of the functions in a folder."""
    program = ASKED.format(folder=str(folder))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=300)
    return [float(word) for word in done.stdout.split()]


def test_a_function_that_stands_on_its_own_is_there_before_its_callers(tmp_path: Path) -> None:
    """Its code is kept once: where it was lost it is compiled again, for callers that were kept."""
    (tmp_path / "three.py").write_text(CALLS)
    assert asked(tmp_path) == [8.0, 4.0, 2.0]
    assert asked(tmp_path) == [8.0, 4.0, 0.0]
    for path in tmp_path.rglob("three.root*"):
        path.unlink()
    assert asked(tmp_path) == [8.0, 4.0, 1.0]


LAYERS = {
    "three.py": CALLS,
    "four.py": """
from solen.trace.kernel.compiled import called
from three import more
@called
def again(x: float) -> float:
    return 3.0 * more(x)
""",
}
LATER = """
import sys
sys.path.insert(0, {folder!r})
from solen.trace.kernel.compiled import compiled
{before}
import {module}
print({module}.{function}(9.0))
"""


def later(folder: Path, module: str, function: str, before: str = "") -> float:
    """Result of one function at 9 in a process of its own, which may define others before."""
    program = LATER.format(folder=str(folder), module=module, function=function, before=before)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, f"process ended with {done.returncode}: {done.stderr[-500:]}"
    return float(done.stdout)


def test_a_symbol_of_another_process_reaches_functions_compiled_from_cached_ones(tmp_path: Path) -> None:
    """`more` calls `root` by the symbol of an earlier compilation, and so does `again`, compiled from it."""
    for name, text in LAYERS.items():
        (tmp_path / name).write_text(text)
    assert later(tmp_path, "three", "outer") == 8.0
    for path in tmp_path.rglob("three.root*"):
        path.unlink()
    shifted = "for number in range(9):\n    compiled(lambda x: x)"
    assert later(tmp_path, "three", "root", shifted) == 3.0
    assert later(tmp_path, "four", "again") == 12.0
    assert later(tmp_path, "four", "again") == 12.0
