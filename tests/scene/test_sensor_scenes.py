"""The scene of a sensor: regions, faces and receivers, matched or behind a gap."""

import math
from typing import Any

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.geometry import y_body
from solen.lens import lens_of
from solen.material import optical
from solen.plane import dot, minus
from solen.scene import Fan, Rays, Region, Scene, sensor_scene
from solen.spec import Design
from solen.trace import trace


def scene_of(rays: int | None = None, angle_deg: float = 0.0, **tables: Any) -> Scene:
    design = Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables)
    return sensor_scene(design, y_body(design, lens_of(design, 1.44), angle_deg), optical(design), rays)


GAP = {"coupling": "air-gap", "gap_mm": 0.5}


def test_scene_has_body_in_air_and_emitter_of_design() -> None:
    scene = scene_of(material={"index": 1.44, "absorption_per_mm": 0.02}, angle_deg=2.0)
    assert scene.regions == (Region("air", 1.0), Region("body", 1.44, 0.02))
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    assert (fan.axis_deg, fan.cone_deg, fan.rays, fan.power, fan.s_share) == (2.0, 120.0, 100, 1.0, 0.5)
    assert scene.name == "test"
    assert scene.receivers == ("right", "left")


def test_rays_override_number_in_design() -> None:
    assert scene_of(7).rays == 7
    assert scene_of(None).rays == 100


def test_zero_rays_are_refused() -> None:
    with pytest.raises(DesignError, match="source rays = 0"):
        scene_of(0)


def test_matched_receivers_are_ends_of_arms() -> None:
    scene = scene_of()
    for interface in scene.interfaces:
        is_end = interface.name.startswith("receiver-")
        assert (interface.behaviour, interface.receiver) == (
            ("receiver", interface.name.removeprefix("receiver-")) if is_end else ("refracting", None)
        )
        assert (interface.left, interface.right) == ("body", "air")


def test_receivers_behind_gap_face_bare_ends_of_arms() -> None:
    scene = scene_of(receivers=GAP)
    faces = {interface.name: interface for interface in scene.interfaces}
    for side in ("right", "left"):
        end, receiver = faces[f"end-{side}"], faces[f"receiver-{side}"]
        assert (end.behaviour, end.left, end.right) == ("refracting", "body", "air")
        assert (receiver.behaviour, receiver.left, receiver.right) == ("receiver", "air", "air")
        assert isinstance(receiver.curve, Segment)
        outside = minus(receiver.curve.start, end.curve.start)
        assert math.hypot(*outside) == pytest.approx(0.5, abs=1e-12)
        assert dot(outside, end.curve.normal_at(end.curve.start)) == pytest.approx(-0.5, abs=1e-12)
        assert receiver.curve.length_mm == pytest.approx(3.0, abs=1e-12)


@pytest.mark.parametrize(("above_mm", "detected"), [(0.25, 1.0), (5.0, 0.0)])
def test_receiver_face_detects_and_back_absorbs(above_mm: float, detected: float) -> None:
    scene = scene_of(receivers=GAP)
    curve = next(i.curve for i in scene.interfaces if i.name == "receiver-right")
    end = next(i.curve for i in scene.interfaces if i.name == "end-right")
    nx, nz = end.normal_at(end.start)
    x, z = end.points(np.array([0.5]))[0]
    start = (float(x) - above_mm * nx, float(z) - above_mm * nz)
    towards = (-nx, -nz) if above_mm < 0.5 else (nx, nz)
    ray = Rays((start,), (towards,))
    result = trace(Scene(scene.regions, scene.interfaces, (ray,)))
    assert result.detectors["right"].power == detected
    assert result.ledger.absorbed == 1.0 - detected
    assert curve.normal_at(curve.start) == pytest.approx((nx, nz), abs=1e-12)


def test_signs_agree_with_paper() -> None:
    """−3° brightens the right receiver, which receives 0.5905 of the rays."""
    right = trace(scene_of(20_000, -3.0))
    assert right.detectors["right"].power == pytest.approx(0.5905, abs=0.003)
    assert right.detectors["left"].power == 0.0
    rest = trace(scene_of(20_000))
    assert rest.detectors["right"].power == pytest.approx(0.5905 / 2, abs=0.003)
    assert rest.detectors["left"].power == pytest.approx(rest.detectors["right"].power, abs=1e-3)
