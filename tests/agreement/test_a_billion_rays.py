"""Adaptive integration against a fan of a thousand million rays, whose memory does not grow with their number."""

import sys

import pytest

from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import integrate, trace

PAPER = Design(name="paper", material=Material(index=1.44))


def held_mib() -> float:
    """Most memory that this process has held so far."""
    resource = pytest.importorskip("resource", reason="the system does not tell how much memory was held")
    held: int = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(held) / (2**20 if sys.platform == "darwin" else 2**10)


@pytest.mark.parametrize(
    ("rays", "within"),
    [(10**6, 1e-5), pytest.param(10**9, 1e-6, marks=pytest.mark.evidence)],
)
def test_a_fan_of_many_rays_agrees_with_adaptive_integration(rays: int, within: float) -> None:
    sensor = Sensor.of(PAPER)
    found = integrate(sensor.scene(-3.0), "power", 1e-9)
    assert found.reached
    trace(sensor.scene(-3.0, 10**5), "power")
    before = held_mib()
    dense = trace(sensor.scene(-3.0, rays), "power")
    grown = held_mib() - before
    apart = max(abs(found.detectors[name].power - dense.detectors[name].power) for name in found.detectors)
    print(f"{rays} rays and {found.rays} rays: {apart:.1e} apart, fan u {dense.u_power:.1e}, {grown:.0f} MiB more held")
    assert apart < within
    assert abs(dense.ledger.total - 1.0) < 1e-9
    assert grown < 64.0
