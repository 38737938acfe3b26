"""Scenes, curves and bodies compare and hash by value; traces, which contain arrays, by identity."""

from dataclasses import replace

from solen.curve import Segment, Spline
from solen.geometry import Body, Face, Pose
from solen.scene import Fan, Interface, Monitor, Region, Scene, Surface
from solen.trace import Trace, trace

FACE = Interface("eye", Segment((1.0, 1.0), (-1.0, 1.0)), "air", "air", "receiver", "eye", Surface())


def scene() -> Scene:
    fan = Fan((0.0, 0.0), 0.0, 60.0, 5)
    return Scene((Region("air", 1.0),), (FACE,), (fan,), (Monitor("m", (1.0, 0.5), (-1.0, 0.5)),))


def test_scenes_and_curves_compare_by_value() -> None:
    assert scene() == scene()
    assert len({scene(), scene(), replace(scene(), name="other")}) == 2
    curve = Spline.through([(0.0, 0.0), (1.0, 1.0), (2.0, 0.0)])
    assert len({curve, Spline(curve.control_points)}) == 1


def test_bodies_compare_by_value() -> None:
    def body() -> Body:
        return Body((Face("a", FACE.curve),), Pose((0.0, 0.0), 0.0), {"pivot": (0.0, 1.0)})

    assert body() == body()
    assert len({body(), body()}) == 1


def test_traces_compare_by_identity() -> None:
    first, second = trace(scene()), trace(scene())
    assert first == first
    assert first != second
    assert len({first, second}) == 2
    assert isinstance(first, Trace)
    assert len(repr(first).splitlines()) < 30
