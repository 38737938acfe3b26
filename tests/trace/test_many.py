"""Many scenes in one call give what each gives on its own."""

import dataclasses

import numpy as np
import pytest

from solen.curve import Arc, Spline
from solen.errors import DesignError
from solen.scene import Chip, Interface, Monitor, Region, Scene
from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import Mode, Trace, integrate, integrate_many, trace, trace_many
from solen.trace.result import MODES

SENSOR = Sensor.of(Design(name="paper", material=Material(index=1.44, absorption_per_mm=0.01)))


def ball() -> Scene:
    """Another number of curves, regions, sources and monitors than a sensor has."""
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


def mixed() -> list[Scene]:
    scenes = [SENSOR.scene(float(angle), 60 + i) for i, angle in enumerate(np.linspace(-3.0, 3.0, 7))]
    return [*scenes[:3], ball(), *scenes[3:], ball()]


def assert_the_same(one: Trace, other: Trace) -> None:
    assert repr(one) == repr(other)  # every number to its last digit, NaN too
    for name, monitor in one.monitors.items():
        assert np.array_equal(monitor.power_by_bin, other.monitors[name].power_by_bin)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("threads", [1, 3])
def test_many_scenes_are_traced_as_each_alone(mode: Mode, threads: int) -> None:
    scenes = mixed()
    for scene, found in zip(scenes, trace_many(scenes, mode, seed=5, threads=threads), strict=True):
        assert_the_same(found, trace(scene, mode, seed=5))


def test_many_scenes_in_single_precision() -> None:
    scenes = mixed()
    for scene, found in zip(scenes, trace_many(scenes, "power", precision="single"), strict=True):
        assert_the_same(found, dataclasses.replace(trace(scene, "power", precision="single"), single_error=None))


def test_no_scenes_give_no_results() -> None:
    assert trace_many([]) == []
    assert integrate_many([]) == []


def test_a_source_of_one_ray_leaves_a_group_empty() -> None:
    scene = SENSOR.scene(0.5, 1)
    (found,) = trace_many([scene])
    assert found.rays == 1
    assert np.isnan(found.detectors["right"].u_power)


def test_many_integrals_are_those_of_each_alone() -> None:
    scenes = [SENSOR.scene(float(angle)) for angle in np.linspace(-1.0, 1.0, 5)]
    for scene, found in zip(scenes, integrate_many(scenes, tolerance=1e-4), strict=True):
        assert repr(found) == repr(integrate(scene, tolerance=1e-4))


@pytest.mark.parametrize("wrong", [{"mode": "some"}, {"precision": "half"}, {"threads": 0}, {"seed": -1}])
def test_what_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(DesignError):
        trace_many(mixed(), **wrong)  # type: ignore[arg-type]
