"""The command answers quickly: nothing heavy is loaded to print its help."""

import subprocess
import sys
import time

import pytest

HEAVY = ["OCP", "ezdxf", "h5py", "manifold3d", "matplotlib", "numba", "pandas", "scipy", "shapely", "xarray"]
PROBE = f"""
import sys
from solen.cli import main
sys.argv = ["solen", "--help"]
try:
    main()
except SystemExit:
    pass
print("heavy:", *(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)
"""


def test_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    assert "run" in done.stdout
    assert done.stderr.splitlines()[-1] == "heavy:", done.stderr


SAMPLED = """
import sys
from solen.sensor import Sensor
from solen.spec import loads, template
Sensor.of(loads(template())).trace(0.5, "power", 64, sampling="sobol")
print("heavy:", *(name for name in ("scipy.stats", "pandas", "matplotlib") if name in sys.modules), file=sys.stderr)
"""


def test_samples_are_drawn_without_the_statistics_of_scipy() -> None:
    """To import them takes longer than most traces."""
    done = subprocess.run(
        [sys.executable, "-c", SAMPLED], capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1] == "heavy:", done.stderr


@pytest.mark.evidence
def test_help_takes_less_than_half_a_second() -> None:
    times_s = []
    for _ in range(5):
        begun_s = time.perf_counter()
        subprocess.run([sys.executable, "-m", "solen", "--help"], capture_output=True, check=True)
        times_s.append(time.perf_counter() - begun_s)
    print(f"solen --help: best of {len(times_s)}: {min(times_s):.2f} s, worst {max(times_s):.2f} s")
    assert min(times_s) < 0.5
