"""The command line starts quickly: its help loads no large package."""

import subprocess
import sys
import time

import pytest

from solen.cli.commands import COMMANDS, GROUPS
from tests.command_support import without_waiting

LARGE_PACKAGES = ["OCP", "ezdxf", "h5py", "manifold3d", "matplotlib", "numba", "pandas", "scipy", "shapely", "xarray"]
PROBE = f"""
import sys
from solen.cli import run_command
for group in sys.argv[1:]:
    assert run_command([*filter(None, [group]), "--help"]) == 0
    print(group, "loads:", *(name for name in {LARGE_PACKAGES} if name in sys.modules), file=sys.stderr)
"""


def test_help_loads_no_large_package() -> None:
    groups = ["", *GROUPS]
    command = [sys.executable, "-c", PROBE, *groups]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    for group in groups:
        for name, _, _ in COMMANDS[group]:
            assert f" {name} " in done.stdout
    assert done.stderr.splitlines() == [f"{group} loads:" for group in groups]


@pytest.mark.parametrize("arguments", [["resin", "cure", "--help"], ["schema"]])
def test_exits_without_error_if_reader_closes_pipe(arguments: list[str]) -> None:
    """As `solen --help | head -3`: nothing on stderr, exit code 0."""
    with subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.stdin.read(1); from solen.cli import main; main()", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        assert running.stderr is not None
        running.stdout.close()  # before anything is printed
        running.stdin.write(b"x")
        running.stdin.close()
        errors = running.stderr.read().decode("utf-8")
    assert (running.returncode, without_waiting(errors)) == (0, "")


SOBOL_TRACE = """
import sys
from solen.sensor import Sensor
from solen.spec import loads, template
Sensor.of(loads(template("paper-860"))).trace(0.5, "power", 64, sampling="sobol")
print("heavy:", *(name for name in ("scipy.stats", "pandas", "matplotlib") if name in sys.modules), file=sys.stderr)
"""


def test_sampling_does_not_load_scipy_stats() -> None:
    """Importing it takes longer than most traces."""
    done = subprocess.run(
        [sys.executable, "-c", SOBOL_TRACE], capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1] == "heavy:", done.stderr


@pytest.mark.evidence
def test_help_takes_less_than_half_a_second() -> None:
    times_s = []
    for _ in range(5):
        start_s = time.perf_counter()
        subprocess.run([sys.executable, "-m", "solen", "--help"], capture_output=True, check=True)
        times_s.append(time.perf_counter() - start_s)
    print(f"solen --help: best of {len(times_s)}: {min(times_s):.2f} s, worst {max(times_s):.2f} s")
    assert min(times_s) < 0.5
