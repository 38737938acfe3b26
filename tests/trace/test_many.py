"""Many scenes in one call give the same results as separate calls."""

import dataclasses

import numpy as np
import pytest

from solen.curve import Arc, Spline
from solen.errors import DesignError
from solen.scene import Chip, Interface, Monitor, Region, Scene
from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import Mode, integrate, integrate_many, trace, trace_many
from solen.trace.result import MODES
from tests.agreement.bits_support import bits

SENSOR = Sensor.of(Design(name="paper", material=Material(index=1.44, absorption_per_mm=0.01)))


def ball() -> Scene:
    """Return a scene with other numbers of curves, regions, sources and monitors than a sensor."""
    curves = (
        Arc.circle((0.0, 10.0), 3.0),
        Spline.through([(1.0, 20.0), (3.0, 21.0), (0.0, 24.0), (-2.0, 21.0)], closed=True),
    )
    return Scene(
        (Region("air", 1.0), Region("glass", 1.5), Region("dark", 1.7, 0.2)),
        (Interface("ball", curves[0], "glass", "air"), Interface("drop", curves[1], "dark", "air")),
        (Chip((0.0, 0.0), 0.5, 0.0, 40.0, 333), Chip((0.0, 40.0), 0.5, 180.0, 40.0, 100, power=2.0)),
        (Monitor("line", (-5.0, 15.0), (5.0, 15.0), 8),),
    )


def mixed_scenes() -> list[Scene]:
    scenes = [SENSOR.scene(float(angle), 60 + i) for i, angle in enumerate(np.linspace(-3.0, 3.0, 7))]
    return [*scenes[:3], ball(), *scenes[3:], ball()]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("threads", [1, 3])
def test_trace_many_agrees_with_trace(mode: Mode, threads: int) -> None:
    scenes = mixed_scenes()
    for scene, result in zip(scenes, trace_many(scenes, mode, seed=5, threads=threads), strict=True):
        assert bits(result) == bits(trace(scene, mode, seed=5))


def test_trace_many_in_single_precision() -> None:
    scenes = mixed_scenes()
    for scene, result in zip(scenes, trace_many(scenes, "power", precision="single"), strict=True):
        expected = dataclasses.replace(trace(scene, "power", precision="single"), single_error=None)
        assert bits(result) == bits(expected)


def test_no_scenes_give_no_results() -> None:
    assert trace_many([]) == []
    assert integrate_many([]) == []


def test_one_ray_has_no_uncertainty() -> None:
    """One of the two groups of rays is empty."""
    (result,) = trace_many([SENSOR.scene(0.5, 1)])
    assert result.rays == 1
    assert np.isnan(result.detectors["right"].u_power)


def test_integrate_many_agrees_with_integrate() -> None:
    scenes = [SENSOR.scene(float(angle)) for angle in np.linspace(-1.0, 1.0, 5)]
    for scene, result in zip(scenes, integrate_many(scenes, tolerance=1e-4), strict=True):
        assert bits(result) == bits(integrate(scene, tolerance=1e-4))


@pytest.mark.parametrize("option", [{"mode": "some"}, {"precision": "half"}, {"threads": 0}, {"seed": -1}], ids=str)
def test_refuses_invalid_options(option: dict[str, object]) -> None:
    with pytest.raises(DesignError, match=str(next(iter(option)))):
        trace_many(mixed_scenes(), **option)  # type: ignore[arg-type]
