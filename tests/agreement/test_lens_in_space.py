"""Lenses for skew rays: agreement with special cases, with the cylinder, and with the reference tracer in space."""

import math
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from solen.errors import DesignError, SpecError
from solen.geometry import Front
from solen.lens import LayeredLens, LayeredLensFromFile, LayerProfiles, LensInSpace, LineFocusLens
from solen.plane import Rigid
from solen.scene import Monitor, Scene, dumps
from solen.sensor import Sensor, why_inert
from solen.sensor.budget import budget
from solen.sensor.numbers import number
from solen.trace import Derivative, Trace, derivative, integrate, integrate_many, trace
from solen.trace.kernel import entry
from solen.trace.kernel.space import Vector
from solen.trace.nets import integrate_by_nets
from solen.trace.options import TraceOptions, trace_with
from solen.trace.reference_front import FrontInSpace
from solen.trace.reference_space import Reading, trace_space_reference
from tests.agreement.lens_support import LAYERED, LINE, PAPER, RAYS, contrast, light, sampled, sensor, u_contrast


def behind_front(scene: Scene, lens: LensInSpace, angle_deg: float) -> Scene:
    """Return a scene whose cylindrical lens is replaced by another, rotated about the base of the stem."""
    return replace(scene, front=Front("lens", lens, Rigid.about((0.0, lens.depth_mm), angle_deg)))


def parabolic_layers(edges_mm: list[float], curvature_per_mm: float) -> LayeredLensFromFile:
    """Return layers whose profiles are parabolas, for a body of 4 mm."""
    edges = np.array(edges_mm)
    middles, x = 0.5 * (edges[1:] + edges[:-1]), np.linspace(0.0, 2.0, 81)
    z = 0.3 + 0.1 * middles[:, None] ** 2 + curvature_per_mm * x**2
    return LayeredLensFromFile(**PAPER, layer_mm=0.1, file=LayerProfiles("parabolas", 2.0, edges, z, simulated=True))


@pytest.mark.parametrize("values", [{}, {"absorption_per_mm": 0.01}, {"motion.kind": "bend"}, {"emitter.y_mm": 0.7}])
def test_one_layer_thicker_than_the_body_is_the_cylinder(values: dict[str, object]) -> None:
    """The rays are the same, but computed by other code."""
    cylinder = sampled(sensor(**values).scene(-2.0, 2**12))
    slab = sampled(sensor({"lens.shape": "layered", "lens.layer_mm": 9.0}, **values).scene(-2.0, 2**12))
    for name, reading in cylinder.detectors.items():
        assert slab.detectors[name].power == pytest.approx(reading.power, abs=1e-9)
        assert slab.detectors[name].optical_path_mm == pytest.approx(reading.optical_path_mm, abs=1e-6)
    for fate in ("detected", "escaped", "absorbed"):
        assert getattr(slab.ledger, fate) == pytest.approx(getattr(cylinder.ledger, fate), abs=1e-9)
    assert (slab.missed, slab.leaked) == pytest.approx((cylinder.missed, cylinder.leaked), abs=1e-9)
    assert slab.reflected > 0.02


@pytest.mark.parametrize("focus", [2.0, "collimated"])
def test_thin_lens_for_skew_rays_is_the_cylinder(focus: object) -> None:
    thin = {"body.thickness_mm": 0.02, "emitter.height_mm": 0.0}
    cylinder, smooth = sampled(sensor(**thin)), sampled(sensor(LINE | {"lens.y_focus_mm": focus}, **thin))
    assert contrast(smooth) == pytest.approx(contrast(cylinder), abs=1e-3 + 3.0 * u_contrast(cylinder))


def check_reference(result: Trace, reference: Reading, factor: float = 3.0) -> None:
    """Check that both tracers agree within ``factor`` standard errors."""
    powers = {name: (detected.power, detected.u_power) for name, detected in result.detectors.items()}
    powers["escaped"] = (result.ledger.escaped, result.u_ledger.escaped)
    powers |= {"missed": (result.missed, result.u_missed), "leaked": (result.leaked, result.u_leaked)}
    for name, (value, u) in powers.items():
        error = math.hypot(reference.error(name), u)
        assert abs(reference.mean(name) - value) < factor * error + 3.0 / reference.rays, name
    assert reference.mean("truncated") < 1e-3


@pytest.mark.parametrize(
    ("lens", "values"),
    [
        (LINE | {"lens.y_focus_mm": "collimated"}, {}),
        (LAYERED | {"lens.layer_mm": 0.5}, {"emitter.y_mm": 0.5}),
        (LAYERED | {"lens.layer_mm": 0.25}, {"motion.kind": "bend", "absorption_per_mm": 0.01}),
    ],
    ids=["collimated", "thick layers, decentred along y", "layers, bent, absorbing"],
)
def test_reference_tracer(lens: dict[str, object], values: dict[str, object]) -> None:
    lens_sensor = sensor(lens, **values)
    reference = trace_space_reference(lens_sensor.scene(-2.0, 1000), seed=5)
    check_reference(sampled(lens_sensor, -2.0), reference, factor=3.5)


def printed_lens() -> LayeredLensFromFile:
    """Return layers of 0.5 mm that are displaced towards the emitter, more at the top, with a ripple from pixels."""
    designed = LayeredLens(**PAPER, layer_mm=0.5)
    x, excess = np.linspace(0.0, 2.0, 257), 0.04 + 0.01 * designed.middles_mm[:, None]
    z = designed.profiles[0] - excess - 3e-4 * np.cos(2.0 * np.pi * x / 0.05)
    profiles = LayerProfiles("printed", 2.0, designed.edges_mm, z, simulated=True)
    return LayeredLensFromFile(**PAPER, layer_mm=0.5, file=profiles)


def test_reference_tracer_for_printed_lens() -> None:
    """The vertex of the printed lens is in front of that of the design."""
    assert printed_lens().nearest_mm < -0.05
    many, few = (behind_front(sensor().scene(-2.0, rays), printed_lens(), -2.0) for rays in (RAYS, 1000))
    check_reference(sampled(many), trace_space_reference(few, seed=5), factor=3.5)


def test_reference_tracer_for_one_layer_is_that_for_the_cylinder() -> None:
    """The same random numbers are drawn, so that the results are the same ray by ray."""
    scene = sensor().scene(-1.0, 300)
    slab = behind_front(scene, LayeredLens(**PAPER, layer_mm=9.0), -1.0)
    cylinder, layer = (trace_space_reference(s, seed=3) for s in (scene, slab))
    for name in ("right", "left", "escaped", "missed"):
        assert layer.mean(name) == pytest.approx(cylinder.mean(name), abs=1e-9)


@pytest.mark.parametrize("lens", [LINE, LAYERED], ids=["line-focus", "layered"])
def test_light_at_zero_is_symmetric_and_complete(lens: dict[str, object]) -> None:
    result = sampled(sensor(lens, absorption_per_mm=0.005), 0.0, 2**14)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    right, left = (result.detectors[side] for side in ("right", "left"))
    assert right.power == pytest.approx(left.power, abs=4.0 * result.u_power)


def test_counting_mode_reflects_no_light_at_the_lens() -> None:
    result = trace(sensor(LINE).scene(-1.0, 2**13), "count")
    assert result.reflected == 0.0
    assert result.ledger.detected > light(sampled(sensor(LINE), rays=2**13))


def test_budget() -> None:
    light_budget = budget(sensor(LAYERED))
    fractions = [value for name, value in vars(light_budget).items() if name != "u"]
    assert sum(fractions) == pytest.approx(1.0, abs=2.0 * light_budget.u)
    assert light_budget.reflected == pytest.approx(0.0785, abs=3.0 * light_budget.u)
    assert light_budget.leaked == pytest.approx(0.067, abs=3.0 * light_budget.u)


def differences(lens_sensor: Sensor, key: str, step: float, rays: int) -> dict[str, tuple[float, float]]:
    """Return central differences of both powers with their standard errors, from other nets than `derivative`."""
    value = number(lens_sensor, key)
    ends = [lens_sensor.set({key: value + sign * step}).scene(-1.0, rays) for sign in (-1.0, 1.0)]

    def powers(scene: Scene, seed: int) -> list[float]:
        traced = trace(scene, "power", sampling="sobol", seed=seed)
        return [detected.power for detected in traced.detectors.values()]

    low, high = (np.array([powers(end, seed) for seed in range(50, 56)]) for end in ends)
    samples = (high - low) / (2.0 * step)
    error = samples.std(axis=0, ddof=1) / math.sqrt(len(samples))
    return dict(zip(ends[0].receivers, zip(samples.mean(axis=0).tolist(), error.tolist(), strict=True), strict=True))


def check_differences(
    slope: Derivative, lens_sensor: Sensor, key: str, step: float, *, rays: int, max_error: float
) -> None:
    """Check that a derivative agrees with differences, and that its error is below a fraction of the largest slope."""
    largest = max(abs(detected.value) for detected in slope.detectors.values())
    for name, (value, u) in differences(lens_sensor, key, step, rays).items():
        actual = slope.detectors[name]
        print(f"{key:18} {name:6} {actual.value:+.4f} ± {actual.u_value:.4f}, differences {value:+.4f} ± {u:.4f}")
        assert actual.value == pytest.approx(value, abs=3.0 * math.hypot(u, actual.u_value)), name
        assert actual.u_value < max_error * largest, name


def test_derivative(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene depends on the position of the chip along y."""
    monkeypatch.setattr(import_module("solen.trace.derivative"), "SAMPLES", 2**13)
    lens_sensor = sensor(LINE, **{"emitter.y_mm": 0.15})
    slope = derivative(lambda y_mm: lens_sensor.set({"emitter.y_mm": y_mm}).scene(-1.0, 100), 0.15)
    check_differences(slope, lens_sensor, "emitter.y_mm", 0.01, rays=2**13, max_error=0.3)


@pytest.mark.evidence
@pytest.mark.parametrize("lens", [LINE, LAYERED], ids=["line-focus", "layered"])
@pytest.mark.parametrize(
    ("key", "step"),
    [
        ("emitter.y_mm", 0.01),
        ("emitter.offset_mm", 0.01),
        ("emitter.distance_mm", 0.03),
        ("lens.focus_mm", 0.6),
        ("lens.y_focus_mm", 0.06),
        ("lens.half_width_mm", 0.02),
        ("body.thickness_mm", 0.1),
    ],
)
def test_derivatives(lens: dict[str, object], key: str, step: float) -> None:
    if lens is LINE or key != "lens.y_focus_mm":
        lens_sensor = sensor(lens, **{"emitter.y_mm": 0.15})
        slope = lens_sensor.derivative(key, -1.0)
        check_differences(slope, lens_sensor, key, step, rays=2**17, max_error=0.25)


LENS_KEYS: dict[str, float] = {
    "lens.focus_mm": 18.0,
    "lens.half_width_mm": 1.8,
    "lens.design_index": 1.46,
    "emitter.distance_mm": 1.1,
    "body.thickness_mm": 3.0,
}


@pytest.mark.parametrize(
    ("lens", "keys"),
    [(LINE, {"lens.y_focus_mm": 3.0}), (LAYERED, {"lens.layer_mm": 0.1})],
    ids=["line-focus", "layered"],
)
def test_keys_of_the_lens_change_its_face(lens: dict[str, object], keys: dict[str, float]) -> None:
    """All of them except the layer thickness can be used for derivatives."""
    base = sensor(lens | {"lens.design_index": 1.44})
    for key, value in (LENS_KEYS | keys).items():
        faces = [s.lens.face for s in (base, base.set({key: value})) if isinstance(s.lens, LensInSpace)]
        before, after = ((*face[:9], len(face.edges)) for face in faces)  # all numbers except tables
        assert before != after, key
        assert (why_inert(base, key) == "") == (key != "lens.layer_mm")
    assert why_inert(base, "emitter.y_mm") == ""
    assert base.set({"emitter.y_mm": 0.2}).scene().sources[0].y_mm == 0.2  # type: ignore[attr-defined]  # a chip


def test_refuses_derivatives_for_layers_and_missing_values() -> None:
    with pytest.raises(SpecError, match=r"lens\.layer_mm.*number of layers is an integer"):
        sensor(LAYERED | {"lens.layer_mm": 0.5}).sensitivity(["lens.layer_mm"], -1.0)
    with pytest.raises(SpecError, match=r"lens\.y_focus_mm"):
        sensor({"lens.shape": "line-focus"}).sensitivity(["lens.y_focus_mm"], -1.0)


def test_integration_by_nets_reaches_its_tolerance() -> None:
    scene = sensor(LINE).scene(-1.0)
    coarse = integrate(scene, tolerance=1e-3)
    assert coarse.reached
    assert 0.0 < coarse.u_power <= 1e-3
    fine = trace_with(scene, TraceOptions(sampling="adaptive", tolerance=5e-4))
    assert fine.reached
    assert fine.u_power <= 5e-4
    assert fine.rays > coarse.rays
    for name, reading in coarse.detectors.items():
        assert reading.power == pytest.approx(fine.detectors[name].power, abs=4.0 * coarse.u_power)


def test_integrate_many_uses_nets_only_for_lenses_for_skew_rays() -> None:
    scene = sensor(LINE).scene(-1.0)
    nets, cylinder = integrate_many([scene, sensor().scene(-1.0)], tolerance=3e-3)
    assert (nets.method, cylinder.method) == ("sobol", "adaptive")
    single = integrate(scene, tolerance=3e-3)
    assert nets.detectors["right"].power == pytest.approx(single.detectors["right"].power, abs=1e-12)


def test_integration_by_nets_stops_at_its_limits() -> None:
    scene = sensor(LINE).scene(-1.0)
    few_segments = integrate(scene, tolerance=1e-5, max_segments=400_000)
    assert (few_segments.reached, few_segments.rays) == (False, 2**15)
    few_rays = integrate_by_nets(scene, 1e-6, max_rays=2**15)
    assert not few_rays.reached
    assert "1e-06" in few_rays.why


@pytest.mark.evidence
@pytest.mark.parametrize("lens", [LINE, LAYERED], ids=["line-focus", "layered"])
def test_standard_errors_of_nets(lens: dict[str, object]) -> None:
    """Compare 60 samples of 2¹⁵ rays with one of 2²¹ rays."""
    lens_sensor, ratios = sensor(lens), []
    for angle_deg in (-0.5, -1.0, -3.0):
        best = sampled(lens_sensor, angle_deg, 2**21)
        for seed in range(20):
            result = trace(lens_sensor.scene(angle_deg, 2**15), "power", sampling="sobol", seed=seed + 1)
            for name, detected in result.detectors.items():
                error = detected.power - best.detectors[name].power
                ratios.append(error / math.hypot(detected.u_power, best.detectors[name].u_power))
    rms, largest = float(np.sqrt(np.mean(np.square(ratios)))), float(np.max(np.abs(ratios)))
    print(f"{len(ratios)} powers: error over standard error {rms:.2f} RMS, {largest:.1f} at most")
    assert 0.8 < rms < 1.25
    assert largest < 4.5


def test_refuses_unsupported_uses_of_such_a_lens() -> None:
    scene = sensor(LINE).scene(-1.0, 100)
    with pytest.raises(DesignError, match=r"line-focus.*cartesian-oval"):
        sensor(LINE).body().prism()
    with pytest.raises(DesignError, match="cannot be written as JSON"):
        dumps(scene)
    with pytest.raises(DesignError, match="monitors"):
        replace(scene, monitors=(Monitor("m", (-1.0, 5.0), (1.0, 5.0)),))
    with pytest.raises(DesignError, match="4 mm"):
        replace(scene, extrusion=replace(scene.extrusion, thickness_mm=3.0))  # type: ignore[type-var]
    with pytest.raises(DesignError, match="specify an extrusion"):
        replace(scene, extrusion=None)
    with pytest.raises(DesignError, match="smooth and bare"):
        replace(scene, front=Front("nothing", LineFocusLens(**PAPER), Rigid()))


def test_sensor_without_the_lens_and_as_a_cylinder() -> None:
    lens_sensor = sensor(LINE)
    assert not lens_sensor.without_lens.has_lens
    oval = lens_sensor.set({"lens.shape": "cartesian-oval", "lens.y_focus_mm": None, "trace.dimension": "2d"})
    assert oval.scene().front is None


@pytest.mark.parametrize(
    ("lens", "size"),
    [
        (LineFocusLens(**PAPER), 2.2),
        (LineFocusLens(**PAPER, y_focus_mm=2.0), 2.2),
        (LayeredLens(**PAPER, layer_mm=0.1), 2.2),
        (LayeredLens(**PAPER, layer_mm=0.37), 0.5),
        (parabolic_layers([-2.0, *np.linspace(-1.996, 2.0, 41).tolist()], 0.3), 2.2),
        (parabolic_layers([-2.0, *np.linspace(-1.999, 2.0, 31).tolist()], 0.3), 2.2),
        (parabolic_layers([-2.0, -1.9, -0.6, -0.55, 0.4, 2.0], 0.3), 2.2),
        (parabolic_layers(np.linspace(-2.0, 2.0, 41).tolist(), -0.1), 2.2),
    ],
    ids=[
        "collimated",
        "diverging",
        "layers",
        "thick layers",
        "thin last layer",
        "thinner last layer",
        "uneven",
        "concave",
    ],
)
def test_face_hits_agree_with_a_search(lens: LensInSpace, size: float) -> None:
    """Rays start in front of the face and beside it; the first hit must be found, or none."""
    draw, reference = np.random.default_rng(4), FrontInSpace(Front("lens", lens, Rigid()))
    hits = 0
    for _ in range(400):
        at = (*draw.uniform(-1.0, 1.0, 2) * (size, 0.8 * size), draw.uniform(-1.0, 0.2))
        d = draw.normal((0.0, 0.0, 1.0))
        d /= np.linalg.norm(d)
        if abs(at[0]) > 2.0 or abs(at[1]) > 2.0 or at[2] > lens.z_at(np.array(at[0]), np.array(at[1])) - 1e-3:
            continue
        position, direction = Vector(*map(float, at)), Vector(*map(float, d))
        hit = entry.next_face_hit(lens.face, entry.layer_of(lens.face, position.y), position, direction)
        expected = next(reference.on_face(position, direction), None)
        assert hit.is_hit == (expected is not None)
        if expected is not None:
            assert hit.distance == pytest.approx(expected.distance, abs=1e-9)
            hits += 1
    assert hits > 100
