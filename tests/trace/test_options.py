"""Options of a trace: ranges, combinations, and the resulting trace."""

import pytest

from solen.curve import Segment
from solen.errors import SpecError
from solen.scene import Fan, Interface, Monitor, Region, Scene
from solen.trace import TraceOptions, integrate, trace, trace_with
from solen.trace.options import MAX_PATHS, check_paths

AIR = Region("air", 1.0)
EYE = Interface("eye", Segment((1.0, 1.0), (-0.5, 1.0)), "air", "air", "receiver", "eye")


def scene(rays: int = 101, monitors: tuple[Monitor, ...] = ()) -> Scene:
    return Scene((AIR,), (EYE,), (Fan((0.0, 0.0), 0.0, 120.0, rays),), monitors)


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"seed": -1}, ("seed", "-1")),
        ({"seed": 2**63}, ("seed",)),
        ({"histogram": 0}, ("histogram", "0")),
        ({"histogram": 10_001}, ("histogram", "10001")),
        ({"tolerance": 0.5, "sampling": "adaptive"}, ("tolerance", "0.5", "0.1")),
        ({"tolerance": 1e-6}, ("tolerance", "adaptive")),
        ({"sampling": "adaptive", "seed": 1}, ("seed", "adaptive")),
        ({"sampling": "adaptive", "precision": "single"}, ("precision", "adaptive")),
        ({"sampling": "adaptive", "histogram": 4}, ("histogram", "adaptive")),
        ({"mode": "waves"}, ("mode", "waves")),
    ],
)
def test_refuses_invalid_options(values: dict[str, object], names: tuple[str, ...]) -> None:
    with pytest.raises(SpecError) as error:
        TraceOptions(**values)
    assert all(name in str(error.value) for name in names)


def test_options_determine_the_trace() -> None:
    counted = trace_with(scene(), TraceOptions(mode="count", histogram=4))
    assert (counted.mode, counted.method, counted.simulated) == ("count", "fan", True)
    assert counted.detectors["eye"].power_by_angle.shape == (4,)
    assert trace_with(scene(), TraceOptions(sampling="sobol", seed=3)).detectors["eye"].power == (
        trace(scene(), "power", sampling="sobol", seed=3).detectors["eye"].power
    )
    adaptive = trace_with(scene(), TraceOptions(sampling="adaptive"))
    assert adaptive.detectors["eye"].power == integrate(scene(), "power", 1e-6).detectors["eye"].power
    assert trace_with(scene(), TraceOptions(), "count").mode == "count"


def test_refuses_options_without_effect() -> None:
    with pytest.raises(SpecError, match="seed"):
        trace_with(scene(), TraceOptions(seed=1))
    with pytest.raises(SpecError, match="paths"):
        trace_with(scene(), TraceOptions(sampling="adaptive"), paths=True)
    with pytest.raises(SpecError, match="monitors"):
        trace_with(scene(monitors=(Monitor("m", (1.0, 0.5), (-1.0, 0.5)),)), TraceOptions(sampling="adaptive"))
    with pytest.raises(SpecError, match=str(MAX_PATHS)):
        check_paths(scene(MAX_PATHS + 1))


def test_conversion_to_dict_omits_segments() -> None:
    result = trace_with(scene(), TraceOptions(), paths=True)
    converted = result.to_dict()
    assert converted["simulated"] is True
    assert {"u_power", "undefined_at_mm", "truncated_at_mm"} < converted.keys()
    assert "segments" not in converted
    assert converted["detectors"]["eye"]["power"] == result.detectors["eye"].power
    assert result.paths()[0].to_dict()["points_mm"] == result.paths()[0].points_mm.tolist()
