"""Adaptive integration agrees with a fan of up to a billion rays, whose memory does not grow with their number."""

import sys

import pytest

from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import integrate, trace

PAPER = Design(name="paper", material=Material(index=1.44))


def peak_memory_mib() -> float:
    """Return the peak memory of this process."""
    resource = pytest.importorskip("resource", reason="the system does not report the peak memory")
    peak: int = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak) / (2**20 if sys.platform == "darwin" else 2**10)


@pytest.mark.parametrize(
    ("rays", "tolerance"),
    [(10**6, 1e-5), pytest.param(10**9, 1e-6, marks=pytest.mark.evidence)],
)
def test_dense_fan_agrees_with_adaptive_integration(rays: int, tolerance: float) -> None:
    sensor = Sensor.of(PAPER)
    integral = integrate(sensor.scene(-3.0), "power", 1e-9)
    assert integral.reached
    trace(sensor.scene(-3.0, 10**5), "power")
    before = peak_memory_mib()
    dense = trace(sensor.scene(-3.0, rays), "power")
    growth = peak_memory_mib() - before
    difference = max(abs(integral.detectors[name].power - dense.detectors[name].power) for name in dense.detectors)
    print(f"{rays} and {integral.rays} rays: difference {difference:.1e}, fan u {dense.u_power:.1e}, {growth:.0f} MiB")
    assert difference < tolerance
    assert abs(dense.ledger.total - 1.0) < 1e-9
    assert growth < 64.0
