"""Options of a trace: ranges, what goes together, and the trace that follows from them."""

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
def test_a_wrong_option_is_named_with_its_value(values: dict[str, object], names: tuple[str, ...]) -> None:
    with pytest.raises(SpecError) as refused:
        TraceOptions(**values)
    assert all(name in str(refused.value) for name in names)


def test_the_options_choose_the_trace() -> None:
    found = trace_with(scene(), TraceOptions(mode="count", histogram=4))
    assert (found.mode, found.method, found.simulated) == ("count", "fan", True)
    assert found.detectors["eye"].power_by_angle.shape == (4,)
    assert trace_with(scene(), TraceOptions(sampling="sobol", seed=3)).detectors["eye"].power == (
        trace(scene(), "power", sampling="sobol", seed=3).detectors["eye"].power
    )
    adaptive = trace_with(scene(), TraceOptions(sampling="adaptive"))
    assert adaptive.detectors["eye"].power == integrate(scene(), "power", 1e-6).detectors["eye"].power
    assert trace_with(scene(), TraceOptions(), "count").mode == "count"


def test_what_has_no_effect_on_a_scene_is_refused() -> None:
    with pytest.raises(SpecError, match="seed"):
        trace_with(scene(), TraceOptions(seed=1))
    with pytest.raises(SpecError, match="paths"):
        trace_with(scene(), TraceOptions(sampling="adaptive"), paths=True)
    with pytest.raises(SpecError, match="monitors"):
        trace_with(scene(monitors=(Monitor("m", (1.0, 0.5), (-1.0, 0.5)),)), TraceOptions(sampling="adaptive"))
    with pytest.raises(SpecError, match=str(MAX_PATHS)):
        check_paths(scene(MAX_PATHS + 1))


def test_a_trace_is_plain_data_without_its_legs() -> None:
    found = trace_with(scene(), TraceOptions(), paths=True)
    told = found.to_dict()
    assert told["simulated"] is True
    assert {"u_power", "undefined_at_mm", "truncated_at_mm"} < told.keys()
    assert "legs" not in told
    assert told["detectors"]["eye"]["power"] == found.detectors["eye"].power
    assert found.paths()[0].to_dict()["points_mm"] == found.paths()[0].points_mm.tolist()
