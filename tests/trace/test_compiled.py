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


def test_an_index_of_another_version_is_left_alone(tmp_path: Path) -> None:
    """It may name classes that are no more: what numba reads then raised."""
    path = tmp_path / "one.py"
    path.write_text(ONE)
    assert twice(path)(2.0) == 4.0
    again = twice(path)
    assert again(2.0) == 4.0
    assert sum(again.stats.cache_hits.values()) == 1
    (index,) = path.parent.rglob("*.nbi")
    for version in (numba.__version__, f"{numba.__version__} of other files"):
        index.write_bytes(pickle.dumps(version) + b"csolen.trace.kernel.nearest\nNoMore\n.")
        anew = twice(path)
        assert anew(2.0) == 4.0
        assert sum(anew.stats.cache_misses.values()) == 1


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
