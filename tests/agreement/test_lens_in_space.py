"""Light through lenses whose walls are not upright: against closed cases, the cylinder, and a plain tracer."""

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
from solen.trace.nets import by_nets
from solen.trace.options import TraceOptions, trace_with
from solen.trace.reference_front import FrontInSpace
from solen.trace.reference_space import Reading, trace_space_reference
from tests.agreement.lens_support import LAYERED, LINE, PAPER, RAYS, contrast, light, sampled, sensor, u_contrast


def behind_front(scene: Scene, lens: LensInSpace, angle_deg: float) -> Scene:
    """A scene of the cylinder with another lens before it, turned about the stem's base."""
    return replace(scene, front=Front("lens", lens, Rigid.about((0.0, lens.depth_mm), angle_deg)))


def given(edges_mm: list[float], bend_per_mm: float) -> LayeredLensFromFile:
    """Layers whose profiles are parabolas, from 4 mm of body."""
    edges = np.array(edges_mm)
    middles, x = 0.5 * (edges[1:] + edges[:-1]), np.linspace(0.0, 2.0, 81)
    z = 0.3 + 0.1 * middles[:, None] ** 2 + bend_per_mm * x**2
    return LayeredLensFromFile(**PAPER, layer_mm=0.1, file=LayerProfiles("parabolas", 2.0, edges, z, simulated=True))


@pytest.mark.parametrize("values", [{}, {"absorption_per_mm": 0.01}, {"motion.kind": "bend"}, {"emitter.y_mm": 0.7}])
def test_slabs_thicker_than_the_body_are_the_cylinder(values: dict[str, object]) -> None:
    """The very rays of the cylinder: another way to the same numbers."""
    cylinder = sensor(**values).scene(-2.0, 2**12)
    slab = sensor({"lens.shape": "layered", "lens.layer_mm": 9.0}, **values).scene(-2.0, 2**12)
    one, other = sampled(cylinder), sampled(slab)
    for name, reading in one.detectors.items():
        assert other.detectors[name].power == pytest.approx(reading.power, abs=1e-9)
        assert other.detectors[name].optical_path_mm == pytest.approx(reading.optical_path_mm, abs=1e-6)
    for part in ("detected", "escaped", "absorbed"):
        assert getattr(other.ledger, part) == pytest.approx(getattr(one.ledger, part), abs=1e-9)
    assert (other.missed, other.leaked) == pytest.approx((one.missed, one.leaked), abs=1e-9)
    assert other.reflected > 0.02


@pytest.mark.parametrize("focus", [2.0, "collimated"])
def test_in_a_thin_body_every_lens_is_the_cylinder(focus: object) -> None:
    thin = {"body.thickness_mm": 0.02, "emitter.height_mm": 0.0}
    cylinder, smooth = sampled(sensor(**thin)), sampled(sensor(LINE | {"lens.y_focus_mm": focus}, **thin))
    assert contrast(smooth) == pytest.approx(contrast(cylinder), abs=1e-3 + 3.0 * u_contrast(cylinder))


def same(found: Trace, reading: Reading, errors: float = 3.0) -> None:
    """Whether both tracers agree within so many standard errors."""
    stated = {name: (part.power, part.u_power) for name, part in found.detectors.items()}
    stated["escaped"] = (found.ledger.escaped, found.u_ledger.escaped)
    stated |= {"missed": (found.missed, found.u_missed), "leaked": (found.leaked, found.u_leaked)}
    for name, (value, u) in stated.items():
        apart = math.hypot(reading.error(name), u)
        assert abs(reading.mean(name) - value) < errors * apart + 3.0 / reading.rays, name
    assert reading.mean("truncated") < 1e-3


@pytest.mark.parametrize(
    ("lens", "values"),
    [
        (LINE | {"lens.y_focus_mm": "collimated"}, {}),
        (LAYERED | {"lens.layer_mm": 0.5}, {"emitter.y_mm": 0.5}),
        (LAYERED | {"lens.layer_mm": 0.25}, {"motion.kind": "bend", "absorption_per_mm": 0.01}),
    ],
    ids=["collimated", "slabs off in y", "layers, bent, lossy"],
)
def test_the_plain_tracer_agrees(lens: dict[str, object], values: dict[str, object]) -> None:
    made = sensor(lens, **values)
    same(sampled(made, -2.0), trace_space_reference(made.scene(-2.0, 1500), seed=5), errors=3.5)


def grown() -> LayeredLensFromFile:
    """Slabs of 0.5 mm that stand out towards the emitter, more so on top, with the ripple of pixels."""
    plain = LayeredLens(**PAPER, layer_mm=0.5)
    x, out = np.linspace(0.0, 2.0, 257), 0.04 + 0.01 * plain.middles_mm[:, None]
    z = plain.profiles[0] - out - 3e-4 * np.cos(2.0 * np.pi * x / 0.05)
    given = LayerProfiles("grown", 2.0, plain.edges_mm, z, simulated=True)
    return LayeredLensFromFile(**PAPER, layer_mm=0.5, file=given)


def test_the_plain_tracer_agrees_on_a_printed_lens() -> None:
    """Its vertex stands before that of the design."""
    assert grown().nearest_mm < -0.05
    sampler, plain = (behind_front(sensor().scene(-2.0, rays), grown(), -2.0) for rays in (RAYS, 1000))
    same(sampled(sampler), trace_space_reference(plain, seed=5), errors=3.5)


def test_the_plain_tracer_takes_one_slab_for_the_cylinder() -> None:
    """Ray by ray, with the same draws."""
    scene = sensor().scene(-1.0, 400)
    slab = behind_front(scene, LayeredLens(**PAPER, layer_mm=9.0), -1.0)
    one, other = (trace_space_reference(each, seed=3) for each in (scene, slab))
    for name in ("right", "left", "escaped", "missed"):
        assert other.mean(name) == pytest.approx(one.mean(name), abs=1e-9)


def test_the_ledger_is_whole_and_symmetric() -> None:
    for lens in (LINE, LAYERED):
        made = sensor(lens, absorption_per_mm=0.005)
        found = sampled(made, 0.0)
        assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
        right, left = (found.detectors[side] for side in ("right", "left"))
        assert right.power == pytest.approx(left.power, abs=4.0 * found.u_power)


def test_a_count_divides_no_ray() -> None:
    found = trace(sensor(LINE).scene(-1.0, 2**13), "count")
    assert found.reflected == 0.0
    assert found.ledger.detected > light(sampled(sensor(LINE)))


def test_what_the_budget_holds() -> None:
    parts = budget(sensor(LAYERED))
    shares = [value for name, value in vars(parts).items() if name != "u"]
    assert sum(shares) == pytest.approx(1.0, abs=2.0 * parts.u)
    assert parts.reflected == pytest.approx(0.0785, abs=3.0 * parts.u)
    assert parts.leaked == pytest.approx(0.067, abs=3.0 * parts.u)


def differences(made: Sensor, key: str, step: float, rays: int = 2**16) -> dict[str, tuple[float, float]]:
    """Central differences of both powers, with their standard errors: other nets than those of `derivative`."""
    ends = [made.set({key: number(made, key) + sign * step}).scene(-1.0, rays) for sign in (-1.0, 1.0)]
    found = np.array(
        [
            [
                [part.power for part in trace(end, "power", sampling="sobol", seed=seed).detectors.values()]
                for end in ends
            ]
            for seed in range(50, 56)
        ]
    )
    each = (found[:, 1] - found[:, 0]) / (2.0 * step)
    error = each.std(axis=0, ddof=1) / math.sqrt(len(each))
    return dict(zip(ends[0].receivers, zip(each.mean(axis=0).tolist(), error.tolist(), strict=True), strict=True))


def agree_with_differences(slope: Derivative, made: Sensor, key: str, step: float, *, rays: int, share: float) -> None:
    largest = max(abs(part.value) for part in slope.detectors.values())
    for name, (value, u) in differences(made, key, step, rays).items():
        found = slope.detectors[name]
        print(f"{key:18} {name:6} {found.value:+.4f} ± {found.u_value:.4f}, differences {value:+.4f} ± {u:.4f}")
        assert found.value == pytest.approx(value, abs=3.0 * math.hypot(u, found.u_value)), name
        assert found.u_value < share * largest, name


def test_a_derivative_is_that_of_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of scenes by any number: here how far the chip lies out of the plane."""
    monkeypatch.setattr(import_module("solen.trace.derivative"), "SAMPLES", 2**13)
    made = sensor(LINE, **{"emitter.y_mm": 0.15})
    slope = derivative(lambda y_mm: made.set({"emitter.y_mm": y_mm}).scene(-1.0, 100), 0.15)
    agree_with_differences(slope, made, "emitter.y_mm", 0.01, rays=2**13, share=0.3)


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
def test_derivatives_are_those_of_samples(lens: dict[str, object], key: str, step: float) -> None:
    if lens is LINE or key != "lens.y_focus_mm":
        made = sensor(lens, **{"emitter.y_mm": 0.15})
        agree_with_differences(made.derivative(key, -1.0), made, key, step, rays=2**17, share=0.25)


LENS_KEYS: dict[str, float] = {
    "lens.focus_mm": 18.0,
    "lens.half_width_mm": 1.8,
    "lens.design_index": 1.46,
    "emitter.distance_mm": 1.1,
    "body.thickness_mm": 3.0,
}


@pytest.mark.parametrize(
    ("lens", "own"),
    [(LINE, {"lens.y_focus_mm": 3.0}), (LAYERED, {"lens.layer_mm": 0.1})],
    ids=["line-focus", "layered"],
)
def test_every_number_of_the_lens_is_a_key(lens: dict[str, object], own: dict[str, float]) -> None:
    """By which a design is varied, and its light differentiated."""
    base = sensor(lens | {"lens.design_index": 1.44})
    for key, value in (LENS_KEYS | own).items():
        faces = [each.lens.face for each in (base, base.set({key: value})) if isinstance(each.lens, LensInSpace)]
        one, other = ((*face[:9], len(face.edges)) for face in faces)  # its numbers, up to its deepest place
        assert one != other, key
        assert (why_inert(base, key) == "") == (key != "lens.layer_mm")
    assert why_inert(base, "emitter.y_mm") == ""
    assert base.set({"emitter.y_mm": 0.2}).scene().sources[0].y_mm == 0.2  # type: ignore[attr-defined]  # a chip


def test_a_number_of_layers_has_no_derivative_and_says_so() -> None:
    with pytest.raises(SpecError, match=r"lens\.layer_mm.*number of layers is an integer"):
        sensor(LAYERED | {"lens.layer_mm": 0.5}).sensitivity(["lens.layer_mm"], -1.0)
    with pytest.raises(SpecError, match=r"lens\.y_focus_mm.*specifies no value"):
        sensor({"lens.shape": "line-focus"}).sensitivity(["lens.y_focus_mm"], -1.0)


def test_it_is_integrated_by_nets_to_a_standard_error() -> None:
    made = sensor(LINE)
    rough = made.integrate(-1.0, tolerance=1e-3)
    assert rough.reached
    assert 0.0 < rough.u_power <= 1e-3
    fine = trace_with(made.scene(-1.0), TraceOptions(sampling="adaptive", tolerance=2e-4))
    assert fine.reached
    assert fine.u_power <= 2e-4
    assert fine.rays > rough.rays
    for name, reading in rough.detectors.items():
        assert reading.power == pytest.approx(fine.detectors[name].power, abs=4.0 * rough.u_power)
    again, cylinder = integrate_many([made.scene(-1.0), sensor().scene(-1.0)], tolerance=1e-3)
    assert (again.method, cylinder.method) == ("sobol", "adaptive")
    assert again.detectors["right"].power == pytest.approx(rough.detectors["right"].power, abs=1e-12)
    few = integrate(made.scene(-1.0), tolerance=1e-5, most_legs=400_000)
    assert (few.reached, few.rays) == (False, 2**15)
    short = by_nets(made.scene(-1.0), 1e-6, most_rays=2**15)
    assert not short.reached
    assert "1e-06" in short.why


@pytest.mark.evidence
@pytest.mark.parametrize("lens", [LINE, LAYERED], ids=["line-focus", "layered"])
def test_the_stated_error_of_nets_covers(lens: dict[str, object]) -> None:
    """Errors of 60 samples of 2¹⁵ rays beside one of 2²¹, over their standard errors."""
    made, ratios = sensor(lens), []
    for angle_deg in (-0.5, -1.0, -3.0):
        best = sampled(made, angle_deg, 2**21)
        for seed in range(20):
            found = trace(made.scene(angle_deg, 2**15), "power", sampling="sobol", seed=seed + 1)
            for name, part in found.detectors.items():
                off = part.power - best.detectors[name].power
                ratios.append(off / math.hypot(part.u_power, best.detectors[name].u_power))
    rms, most = float(np.sqrt(np.mean(np.square(ratios)))), float(np.max(np.abs(ratios)))
    print(f"{len(ratios)} powers: error over standard error {rms:.2f} in the root mean square, {most:.1f} at most")
    assert 0.8 < rms < 1.25
    assert most < 4.5


def test_what_such_a_lens_cannot_do_is_refused() -> None:
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


def test_comparisons_leave_out_keys_of_the_lens() -> None:
    """Without its lens, and as a cylinder in the plane."""
    made = sensor(LINE)
    assert not made.without_lens.has_lens
    oval = made.set({"lens.shape": "cartesian-oval", "lens.y_focus_mm": None, "trace.dimension": "2d"})
    assert oval.scene().front is None


@pytest.mark.parametrize(
    ("lens", "size"),
    [
        (LineFocusLens(**PAPER), 2.2),
        (LineFocusLens(**PAPER, y_focus_mm=2.0), 2.2),
        (LayeredLens(**PAPER, layer_mm=0.1), 2.2),
        (LayeredLens(**PAPER, layer_mm=0.37), 0.5),
        (given([-2.0, *np.linspace(-1.996, 2.0, 41).tolist()], 0.3), 2.2),
        (given([-2.0, *np.linspace(-1.999, 2.0, 31).tolist()], 0.3), 2.2),
        (given([-2.0, -1.9, -0.6, -0.55, 0.4, 2.0], 0.3), 2.2),
        (given(np.linspace(-2.0, 2.0, 41).tolist(), -0.1), 2.2),
    ],
    ids=["collimated", "diverging", "layers", "slabs", "thin last layer", "thinner last layer", "uneven", "concave"],
)
def test_every_ray_meets_the_face_where_a_plain_search_does(lens: LensInSpace, size: float) -> None:
    """From all around, also from behind the aperture's edge: the first place, or none."""
    draw, plain = np.random.default_rng(4), FrontInSpace(Front("lens", lens, Rigid()))
    met = 0
    for _ in range(400):
        at = (*draw.uniform(-1.0, 1.0, 2) * (size, 0.8 * size), draw.uniform(-1.0, 0.2))
        d = draw.normal((0.0, 0.0, 1.0))
        d /= np.linalg.norm(d)
        if abs(at[0]) > 2.0 or abs(at[1]) > 2.0 or at[2] > lens.z_at(np.array(at[0]), np.array(at[1])) - 1e-3:
            continue
        place, way = Vector(*map(float, at)), Vector(*map(float, d))
        step = entry.to_face(lens.face, entry.layer_of(lens.face, place.y), place, way)
        hit = next(plain.on_face(place, way), None)
        assert step.met == (hit is not None)
        if hit is not None:
            assert step.way == pytest.approx(hit.way, abs=1e-9)
            met += 1
    assert met > 100
