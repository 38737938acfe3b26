"""The cache of the compiled kernel is renewed if files change, and never causes an error."""

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
MODULE = """
from solen.trace.kernel.compiled import called
@called
def twice(x: float) -> float:
    return 2.0 * x
"""


def load_twice(path: Path) -> Any:
    """Return the compiled function of a module in a file."""
    spec = spec_from_file_location("one", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.twice


def test_stamp_depends_on_contents_and_imports(tmp_path: Path) -> None:
    names = {path.name for path in sources(FOLDER / "paths.py")}
    assert {"paths.py", "prism.py", "hits.py", "tables.py", "result.py"} <= names
    assert "cuda.py" not in names
    file, copy, other = (tmp_path / f"{name}.py" for name in ("file", "copy", "other"))
    for path, text in ((file, MODULE), (copy, MODULE), (other, MODULE.replace("2.0", "3.0"))):
        path.write_text(text)
    os.utime(copy, (1e9, 1e9))
    assert stamp(file) == stamp(copy) != stamp(other)


def test_invalid_cache_file_is_compiled_again(tmp_path: Path) -> None:
    """A file from another version may contain classes that no longer exist, which once caused an error."""
    path = tmp_path / "one.py"
    path.write_text(MODULE)
    assert load_twice(path)(2.0) == 4.0
    cached = load_twice(path)
    assert cached(2.0) == 4.0
    assert sum(cached.stats.cache_hits.values()) == 1
    (file,) = path.parent.rglob("*.nbc")
    data = file.read_bytes()
    other = pickle.dumps(numba.__version__) + b"csolen.trace.kernel.nearest\nNoMore\n."
    for content in (other, pickle.dumps(f"{numba.__version__} of other files") + other, data[:40], data[:-40], b""):
        file.write_bytes(content)
        compiled = load_twice(path)
        assert compiled(2.0) == 4.0
        assert sum(compiled.stats.cache_misses.values()) == 1


def test_cache_file_of_other_argument_types_is_not_used(tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(MODULE)
    first = load_twice(path)
    assert first(2.0) == first(2) == 4.0
    file, other = path.parent.rglob("*.nbc")
    other.write_bytes(file.read_bytes())  # as if another process had written it
    second = load_twice(path)
    assert second(2.0) == second(2) == 4.0
    assert sum(second.stats.cache_hits.values()) == 1
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
PROGRAM = """
import sys, types
import solen
for name in ("trace", "trace/kernel"):  # without the other modules of these packages, to save time
    package = types.ModuleType("solen." + name.replace("/", "."))
    package.__path__ = [solen.__path__[0] + "/" + name]
    sys.modules[package.__name__] = package
sys.path.insert(0, {folder!r})
{commands}
"""
CALL_OUTER = """
import three
print(three.outer(9.0), three.more(9.0), sum(sum(f.stats.cache_misses.values()) for f in (three.root, three.outer)))
"""


def run(folder: Path, commands: str) -> list[float]:
    """Return the numbers that commands print in a new process, which can import modules from a folder."""
    program = PROGRAM.format(folder=str(folder), commands=commands)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, f"the process ended with {done.returncode}: {done.stderr[-500:]}"
    return [float(word) for word in done.stdout.split()]


def test_standalone_function_is_loaded_before_its_callers(tmp_path: Path) -> None:
    """If its cached code is lost, it is compiled again for callers that are still cached."""
    (tmp_path / "three.py").write_text(CALLS)
    assert run(tmp_path, CALL_OUTER) == [8.0, 4.0, 2.0]
    assert run(tmp_path, CALL_OUTER) == [8.0, 4.0, 0.0]
    for path in tmp_path.rglob("three.root*"):
        path.unlink()
    assert run(tmp_path, CALL_OUTER) == [8.0, 4.0, 1.0]


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
CALL_AGAIN = "import four; print(four.again(9.0))"
OTHER_SYMBOLS = """
from solen.trace.kernel.compiled import compiled
for number in range(9):  # further functions change the symbols of those that follow
    compiled(lambda x: x)
import three
print(three.root(9.0))
"""


def test_symbols_from_another_process(tmp_path: Path) -> None:
    """`more` calls `root` by the symbol of an earlier compilation, and so does `again`, which is compiled from it."""
    for name, text in LAYERS.items():
        (tmp_path / name).write_text(text)
    assert run(tmp_path, "import three; print(three.outer(9.0))") == [8.0]
    for path in tmp_path.rglob("three.root*"):
        path.unlink()
    assert run(tmp_path, OTHER_SYMBOLS) == [3.0]
    assert run(tmp_path, CALL_AGAIN) == [12.0]
    assert run(tmp_path, CALL_AGAIN) == [12.0]
