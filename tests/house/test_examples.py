"""Results of every example, compared with those of an independent method.

These methods share only the parameters of the examples with solen: the equation of the oval is solved by bracketing,
its normal is a finite difference, and the laws of Snell and Fresnel are written with angles. Some results are compared
with those of the reference tracer, with fewer rays.
"""

import contextlib
import io
import json
import math
import re
import runpy
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from scipy import ndimage
from scipy.integrate import quad
from scipy.optimize import brentq, minimize
from skimage import data, filters, segmentation

from solen.samples import sample
from solen.sensor import Sensor
from solen.sensor.loaded import force_of
from solen.spec import loads, template, with_values
from solen.trace import trace_reference
from tests.house.page_support import differences
from tools.gallery import DRAWINGS, RECORD, Example, file_of, values_of
from tools.micrograph import NAME, micrograph
from tools.samples import TABLES

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SLOW = {"fingertip"}
"""Examples that take half a minute, which only `make evidence` runs."""


def parameters(names: Iterable[str]) -> list[Any]:
    """Names of examples as parameters; slow ones are marked as evidence."""
    return [pytest.param(name, marks=[pytest.mark.evidence] if name in SLOW else []) for name in names]


DISTANCE_MM, FOCUS_MM, HALF_WIDTH_MM = 1.0, 20.0, 2.0


@cache
def run_example(name: str) -> tuple[Any, str, dict[str, Any]]:
    """Return value and output of the ``main`` of an example, and its global names; each example runs once."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        names = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
        returned = names["main"]()
    return returned, printed.getvalue(), names


def result(name: str) -> Any:
    """Return value of the ``main`` of an example."""
    return run_example(name)[0]


def oval_z(x: float, n: float) -> float:
    """Profile of the lens designed for n."""

    def excess(z: float) -> float:
        path = math.hypot(z + DISTANCE_MM, x) + n * math.hypot(FOCUS_MM - z, x)
        return path - (DISTANCE_MM + n * FOCUS_MM)

    return brentq(excess, 0.0, 5.0, xtol=1e-15)


def normal_angle(x: float, n: float) -> float:
    """Angle of the surface normal from the axis, from a central difference."""
    h = 1e-6
    return -math.atan((oval_z(x + h, n) - oval_z(x - h, n)) / (2 * h))


def edge_deg(n: float) -> float:
    """Angle from the axis of the ray from the emitter to the edge of the lens."""
    return math.degrees(math.atan2(HALF_WIDTH_MM, oval_z(HALF_WIDTH_MM, n) + DISTANCE_MM))


def refracted_angle(angle: float, normal: float, n: float) -> float:
    """Angle from the axis, positive towards +x, of a ray refracted from air into index n."""
    return normal + math.asin(math.sin(angle - normal) / n)


def focus(x: float, design_index: float, n: float) -> float:
    """The z at which the ray through the surface at x crosses the axis in a material of index n."""
    z = oval_z(x, design_index)
    inside = refracted_angle(math.atan2(x, z + DISTANCE_MM), normal_angle(x, design_index), n)
    return z - x / math.tan(inside)


def transmitted(x: float, n: float) -> float:
    """Unpolarised transmittance at x of the ray from the emitter, by Fresnel's sine and tangent formulas."""
    incident = math.atan2(x, oval_z(x, n) + DISTANCE_MM) - normal_angle(x, n)
    if abs(incident) < 1e-9:
        return 4 * n / (n + 1) ** 2
    refracted = math.asin(math.sin(incident) / n)
    s = (math.sin(incident - refracted) / math.sin(incident + refracted)) ** 2
    p = (math.tan(incident - refracted) / math.tan(incident + refracted)) ** 2
    return 1 - 0.5 * (s + p)


def entering(n: float) -> float:
    """Fraction of a uniform fan of ±60 degrees that enters the lens: the integral of T dφ/dx over its surface."""

    def density(x: float) -> float:
        h, height = 1e-6, oval_z(x, n) + DISTANCE_MM
        slope = (oval_z(x + h, n) - oval_z(x - h, n)) / (2 * h)
        return transmitted(x, n) * (height - x * slope) / (height**2 + x**2)

    return float(quad(density, 0.0, HALF_WIDTH_MM, epsabs=1e-7)[0]) / math.radians(60.0)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short_and_listed(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    assert text.endswith('\n\n\nif __name__ == "__main__":\n    main()\n')
    for page in ("examples/README.md", "docs/gallery.md"):
        assert path.name in (ROOT / page).read_text(encoding="utf-8"), f"{page} does not list {path.name}"


@pytest.mark.parametrize("name", parameters(path.stem for path in EXAMPLES))
def test_gallery_shows_output_of_example(name: str) -> None:
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    printed = re.findall(
        rf"examples/{name}\.py\n:language: python\n```\n\nIt prints\n\n```text\n(.*?)```", page, re.DOTALL
    )
    assert [differences(text.rstrip().splitlines(), run_example(name)[1].splitlines()) for text in printed] == [""]
    assert re.search(r"\d\.\d", printed[0])


@pytest.mark.parametrize("name", parameters(DRAWINGS))
def test_gallery_image_agrees_with_example(name: str) -> None:
    record = json.loads(RECORD.read_text(encoding="utf-8"))[name]
    returned, _, names = run_example(name)
    sums = values_of(DRAWINGS[name](Example(names, returned)))
    assert [len(sums), sum(sums)] == pytest.approx(record["values"], rel=1e-3)
    assert sha256(file_of(name).read_bytes()).hexdigest() == record["sha256"]
    assert f"images/gallery/{file_of(name).name}\n:alt: simulated: " in (ROOT / "docs" / "gallery.md").read_text(
        encoding="utf-8"
    )


def test_every_example_has_an_image() -> None:
    assert {*DRAWINGS, "four_motions", "index_of_a_layer", "coins"} == {path.stem for path in EXAMPLES}


def test_yield_of_tolerance_run_follows_from_slope_of_null() -> None:
    """The null is proportional to the decentre; the yield is that of a sample of 128 prints."""
    tolerances = result("tolerance_run")
    per_mm = result("sweep_a_parameter")[-0.01] / -0.01
    expected = math.erf(0.2 / (abs(per_mm) * 0.004) / math.sqrt(2.0))
    assert tolerances.yields[-1].share == pytest.approx(
        expected, abs=3.0 * math.sqrt(expected * (1.0 - expected) / 128)
    )


def test_two_spectra_give_true_index() -> None:
    layer = result("two_spectra")
    n, u = (np.interp(860.0, layer.wavelength_nm, values) for values in (layer.n, layer.u_n))
    assert n == pytest.approx(1.48 + 0.005 / 0.86**2, abs=2.0 * u)
    assert 0.001 < u < 0.006  # 0.1 % in R is 0.0039 in n


def test_decoded_angles_agree_with_known_angles() -> None:
    _, decoded, known = result("decode_angles")
    assert np.sqrt(np.mean((decoded - known) ** 2)) < 0.005
    assert np.abs(decoded - known).max() < 0.03


def test_network_agrees_with_reference_tracer() -> None:
    network = result("network_of_guides")
    scene = network.sensors[0].scene(0.0)
    reference = trace_reference(replace(scene, sources=(scene.sources[0].with_rays(400),)), "power")
    for name, power in zip(network.receivers, network.power[0, 0], strict=True):
        assert reference.detectors[name].power == pytest.approx(power, abs=0.02)


def test_pressed_body_balances_finger() -> None:
    """The finger exerts the given force, and the lens does not turn."""
    body = result("soft_body")
    assert body.turn_deg == pytest.approx(0.0, abs=1e-9)
    (finger,) = body.contacts
    assert finger.force_N == pytest.approx(0.3, rel=1e-3)
    assert 0.3 < finger.depth_mm < 0.45


def test_paper_sensor_receives_accepted_fraction() -> None:
    fractions = result("paper_sensor")
    accepted = edge_deg(1.44) / 60.0
    assert accepted == pytest.approx(0.5905, abs=1e-4)
    leak = 5e-4  # rays through the step of a few µm between the turned lens and the stem
    assert fractions[-3.0] == pytest.approx((accepted, 0.0), abs=leak)
    assert fractions[3.0] == pytest.approx((0.0, accepted), abs=leak)
    assert fractions[0.0] == pytest.approx((accepted / 2, accepted / 2), abs=1e-5)


def test_free_form_is_four_times_as_linear_as_paper_lens() -> None:
    paper, straight = result("straight_response").values()
    assert paper.linearity_percent - paper.u_linearity_percent > 4.0 * (
        straight.linearity_percent + straight.u_linearity_percent
    )
    assert straight.span > 1.29
    assert straight.light > 0.9 * paper.light


def test_three_wavelengths_agree_with_quadrature() -> None:
    rows = result("three_wavelengths")
    assert [row.refractive_index for row in rows] == [1.44, 1.49, 1.54]
    for row in rows:
        assert row.depth_mm == pytest.approx(oval_z(HALF_WIDTH_MM, row.refractive_index), abs=1e-12)
        assert row.acceptance_deg == pytest.approx(edge_deg(row.refractive_index), abs=1e-9)
        reentering = 1e-4  # light that leaves the body and enters it again
        assert row.received == pytest.approx(entering(row.refractive_index), abs=reentering)


def test_slab_agrees_with_geometric_series() -> None:
    n, tau = 1.5, math.exp(-0.05 * 4.0)
    face = ((n - 1) / (n + 1)) ** 2
    t = (1 - face) ** 2 * tau / (1 - face**2 * tau**2)
    r = face + face * tau * t
    assert result("slab") == pytest.approx((1 - r, t, 1 - r - t), abs=1e-10)


def test_solid_has_volume_of_lens_stem_and_arms() -> None:
    """Lens: a box minus the integral of the oval; stem: 2 ∫ (2 + 0.004 u²) du; arms: two polygons."""
    plain, with_pockets, meshes = result("solid")
    lens = 2 * HALF_WIDTH_MM * oval_z(HALF_WIDTH_MM, 1.44) - quad(oval_z, -2.0, 2.0, (1.44,), epsabs=1e-12)[0]
    stem = 2 * (HALF_WIDTH_MM * 16.2 + 0.004 * 16.2**3 / 3)
    fork, arm = HALF_WIDTH_MM + 0.004 * 16.2**2, math.atan(2 * 0.004 * 16.2)
    outer = (fork + 22.2 * math.sin(arm), 22.2 * math.cos(arm))
    inner = (outer[0] - 3.0 * math.cos(arm), outer[1] + 3.0 * math.sin(arm))
    corners = [(0.0, 0.0), (fork, 0.0), outer, inner, (0.0, inner[1] - inner[0] / math.tan(arm))]
    arms = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(corners, [*corners[1:], corners[0]], strict=True))
    assert plain == pytest.approx(4.0 * (lens + stem + arms), abs=1e-8)
    assert plain - with_pockets == pytest.approx(2 * 2.1 * 1.35 * 0.85, abs=1e-9)
    for tolerance_mm, volume in meshes.items():
        assert volume == pytest.approx(with_pockets, abs=560.0 * tolerance_mm), "the walls have an area of 555 mm²"


@pytest.mark.evidence
def test_fingertip_decodes_force_of_finite_elements() -> None:
    """The force is from the finite elements; the load cell used in the calibration has an error of 0.5 %."""
    contrasts, recording, calibrations, (force, low, high) = result("fingertip")
    along_arms, at_ends = contrasts.values()
    assert abs(along_arms) < 0.01
    assert at_ends == pytest.approx(0.415, abs=0.03)
    design = loads(template("press-860"))
    motion = {"drives": "finger.depth_mm", "depths_mm": (0.0, 0.3), "forces_N": None}
    pressed = Sensor.of(design.model_copy(update={"motion": design.motion.model_copy(update=motion)}))
    true = force_of(pressed, 0.3)
    assert low < true < high
    assert force == pytest.approx(true, rel=0.01)
    assert calibrations.checks[0].whole.rms_deg < 1e-3 * true
    assert recording.stimulus.name == "force"


def test_own_outline_agrees_with_reference_tracer() -> None:
    sobol, u, lattice = result("own_outline")
    assert abs(sobol - lattice) < 4 * u
    scene = runpy.run_path(str(ROOT / "examples" / "own_outline.py"))["drop"]()
    reference = trace_reference(replace(scene, sources=(scene.sources[0].with_rays(400),)), "power")
    assert lattice == pytest.approx(reference.detectors["screen"].power, abs=4e-3)


def test_ball_lens_spot_agrees_with_ray_angles() -> None:
    """A ball deflects a ray by 2 (i - r), and the ray leaves it at the angle of incidence i."""
    n, radius, focal, half = 1.44, 4.0, 10.0, 0.1
    angle = np.radians(90.0 - 36.87 + 28.0 * ((np.arange(200_000) + 0.5) / 200_000 - 0.5))
    height = 2 * focal * np.tan(angle / 2) - 10.0  # of the collimated ray above the axis of the ball
    incident = np.arcsin(height / radius)
    deflection = 2 * (incident - np.arcsin(np.sin(incident) / n))
    exit_angle = deflection - incident  # polar angle of the exit point, clockwise
    x, z = radius * np.cos(exit_angle), -radius * np.sin(exit_angle)
    at_receiver = z - (n * radius / (2 * (n - 1)) - x) * np.tan(deflection)
    spot = float(np.mean(np.abs(at_receiver) < half))
    assert result("own_curve_scene") == pytest.approx((spot, 1 - spot), abs=2e-5)


def test_wrong_index_focuses_according_to_snell() -> None:
    results = result("wrong_index")
    assert results[1.44].paraxial_mm == pytest.approx(20.0, abs=1e-9)
    assert results[1.44].marginal_mm == pytest.approx(20.0, abs=1e-9)
    assert results[1.484].paraxial_mm == pytest.approx(focus(1e-3, 1.44, 1.484), abs=1e-3)
    assert results[1.484].marginal_mm == pytest.approx(focus(2.0, 1.44, 1.484), abs=1e-5)


@pytest.mark.parametrize("index", [1.44, 1.484])
def test_wrong_index_agrees_with_reference_tracer(index: float) -> None:
    values = {"material.index": index, "lens.design_index": 1.44, "emitter.rays": 1000}
    sensor = Sensor.of(with_values(loads(template("paper-860")), values))
    for angle_deg, contrast in zip((-0.25, -1.0, -3.0), result("wrong_index")[index].contrast, strict=True):
        detectors = trace_reference(sensor.scene(angle_deg)).detectors
        right, left = detectors["right"].rays, detectors["left"].rays
        counting_error = 4.0 / (right + left)
        assert (right - left) / (right + left) == pytest.approx(contrast, abs=counting_error)


CROTCH_MM = 17.820492


def x_at_crotch(angle: float, turn_deg: float, offset: float = 0.0, crotch: float = CROTCH_MM) -> float | None:
    """The x of a ray at the height of the crotch, with lens and emitter turned; None if the ray misses the lens."""
    n, turn, base = 1.44, math.radians(turn_deg), oval_z(HALF_WIDTH_MM, 1.44)

    def excess(r: float) -> float:
        x, z = offset + r * math.sin(angle), r * math.cos(angle) - DISTANCE_MM
        return math.hypot(z + DISTANCE_MM, x) + n * math.hypot(FOCUS_MM - z, x) - DISTANCE_MM - n * FOCUS_MM

    bracket = next((0.1 * k for k in range(8, 60) if excess(0.1 * k) < 0), None)
    if bracket is None:
        return None
    r = brentq(excess, 0.5, bracket, xtol=1e-14)
    x, z = offset + r * math.sin(angle), r * math.cos(angle) - DISTANCE_MM
    if abs(x) > HALF_WIDTH_MM:
        return None
    inside = refracted_angle(angle, normal_angle(x, n), n) - turn
    x, z = x * math.cos(turn) - (z - base) * math.sin(turn), base + x * math.sin(turn) + (z - base) * math.cos(turn)
    return x + (crotch - z) * math.tan(inside)


def right_fraction(turn_deg: float, offset: float) -> float:
    """Fraction of the entering rays that are to the right of the axis at the crotch."""
    angles = np.radians(np.linspace(-44.95, 44.95, 900))
    crossings = [x_at_crotch(angle, turn_deg, offset) for angle in angles]
    return float(np.mean([x > 0 for x in crossings if x is not None]))


def test_sensitivity_to_arm_width_follows_from_ray_to_crotch() -> None:
    """Arms wider by d raise the crotch by d / sin(arm angle), which moves light from one arm to the other.

    The ray to the crotch is found by bracketing, and its change with the height of the crotch is a finite difference.
    All light that enters is received, so one arm gains what the other loses.
    """
    turn_deg, step_mm, n = 0.2, 0.01, 1.44

    def ray_to(crotch: float) -> float:
        def x_of(angle: float) -> float:
            x = x_at_crotch(angle, turn_deg, 0.0, crotch)
            assert x is not None
            return x

        return brentq(x_of, 0.1, 0.55, xtol=1e-13)

    low, high = ray_to(CROTCH_MM - step_mm), ray_to(CROTCH_MM + step_mm)
    ray = (low + high) / 2
    x = brentq(lambda x: math.atan2(x, oval_z(x, n) + DISTANCE_MM) - ray, 0.0, HALF_WIDTH_MM)
    per_mm_of_crotch = (high - low) / (2 * step_mm) * transmitted(x, n) / math.radians(120.0)
    arm = math.atan(2 * 0.004 * 16.2)
    contrast_per_mm = -2 * per_mm_of_crotch / math.sin(arm) / entering(n)
    assert result("sensitivity")["body.arm_width_mm"] == pytest.approx(contrast_per_mm, rel=1e-5)


@pytest.mark.parametrize("offset_mm", [-0.01, 0.0, 0.01, 0.02])
def test_null_has_half_of_the_rays_on_each_side_of_crotch(offset_mm: float) -> None:
    balance_deg = result("sweep_a_parameter")[offset_mm]
    turns_deg = (balance_deg - 0.03, balance_deg + 0.03)
    before, after = (right_fraction(turn_deg, offset_mm) for turn_deg in turns_deg)
    assert after < 0.5 < before


def lossy_layer(nm: float) -> tuple[float, float, float]:
    """Index, R and T of the simulated layer, from the series of its reflections."""
    n, k, h_nm = 1.482 + 5e3 / nm**2, 2e-6, 80e3
    face, tau = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), math.exp(-4 * math.pi * k * h_nm / nm)
    powers = [(face * tau) ** passes for passes in range(40)]
    r = face + (1 - face) ** 2 * face * tau**2 * sum(powers[::2])
    return n, r, (1 - face) ** 2 * tau * sum(powers[::2])


def stacked(n: float, k: float, pet: float) -> tuple[float, float]:
    """T relative to bare PET, and R, of 25 µm on lossless PET at 860 nm: the geometric series."""
    r1, r2, r3 = ((n - 1) / (n + 1)) ** 2, ((pet - n) / (pet + n)) ** 2, ((pet - 1) / (pet + 1)) ** 2
    tau = math.exp(-4 * math.pi * k * 25e3 / 860)
    t_film, r_film = (1 - r2) * (1 - r3) / (1 - r2 * r3), r2 + (1 - r2) ** 2 * r3 / (1 - r2 * r3)
    series = 1 / (1 - r1 * r_film * tau**2)
    return (1 - r1) * tau * t_film * series * (1 + r3) / (1 - r3), r1 + (1 - r1) ** 2 * tau**2 * r_film * series


def u_of_n(forward: Any, u_t: float, u_r: float, *further: tuple[float, float]) -> float:
    """Uncertainty of n from central differences of a forward model of n, k and further (value, uncertainty)."""
    point, step = [1.48, 1e-4, *(value for value, _ in further)], [1e-5, 1e-8, *(1e-5 for _ in further)]
    columns = []
    for i, h in enumerate(step):
        up, down = ([x + s * h * (j == i) for j, x in enumerate(point)] for s in (1, -1))
        columns.append((np.array(forward(*up)) - np.array(forward(*down))) / (2 * h))
    n_row = np.linalg.inv(np.array(columns[:2]).T)[0]
    others = [float(n_row @ column) * u for column, (_, u) in zip(columns[2:], further, strict=True)]
    return math.hypot(n_row[0] * u_t, n_row[1] * u_r, *others)


def free_layer(n: float, k: float) -> tuple[float, float]:
    """T and R of the layer alone."""
    return stacked(n, k, 1.0)


def test_uncertainties_of_index_agree_with_differences() -> None:
    u_n = result("which_route")
    for u_r in (0.001, 0.003):
        assert u_n[f"free layer, R to {u_r}"] == pytest.approx(u_of_n(free_layer, 1e-3, u_r), rel=1e-3)
    for u_pet in (0.01, 0.04):
        expected = u_of_n(stacked, 1e-3, 1e-3, (1.57, u_pet))
        assert u_n[f"on PET known to {u_pet}"] == pytest.approx(expected, rel=1e-3)
    by_n, by_pet = (
        (stacked(1.48 + a, 0, 1.57 + b)[0] - stacked(1.48 - a, 0, 1.57 - b)[0]) / 2e-5
        for a, b in ((1e-5, 0.0), (0.0, 1e-5))
    )
    assert u_n["on PET, T alone"] == pytest.approx(math.hypot(1e-3, by_pet * 0.01) / abs(by_n), rel=1e-3)
    # n falls by 0.0074 from 589 to 860 nm, with a relative uncertainty of 16/51
    assert u_n["refractometer, one wavelength"] == pytest.approx(math.hypot(5e-4, 0.0074 * 16 / 51), rel=0.1)
    assert u_n["refractometer, three"] < 5e-4


@pytest.mark.parametrize("route", ["R and T measured", "T and absorptance", "T alone, lossless", "as published"])
def test_index_of_layer_by_each_method(route: str) -> None:
    n, _, t = lossy_layer(860.0)
    published_r = 1 - t + math.log10(t)
    b = 2 + t**2 - (1 - published_r) ** 2
    face = (b - math.sqrt(b**2 - 4 * published_r * (2 - published_r))) / (2 * (2 - published_r))
    as_published = (1 + math.sqrt(face)) / (1 - math.sqrt(face))  # k changes it by less than 1e-6
    lossless = (1 + math.sqrt(1 - t**2)) / t
    expected = {"T alone, lossless": lossless, "as published": as_published}.get(route, n)
    n_found, u = result("index_of_a_layer")[route]
    # noise of 0.1 % in T and R, averaged over some 15 wavelengths of the LED: 0.0011 in n, or 0.0016 by absorptance
    assert n_found == pytest.approx(expected, abs=0.005)
    assert (u is None) is (route == "as published")
    assert u is None or 0.0035 < u < 0.0065


def test_working_curve_agrees_with_maximum_likelihood() -> None:
    """The scatter of the discs is a fraction of their thickness; the torn one is excluded by hand."""
    curve = result("working_curve")
    text = sample("discs-simulated.csv").decode().splitlines()[2:]
    rows = [tuple(float(cell) for cell in line.split(",")) for line in text]
    used = [(13.0 * s, um) for s, um, replicate in rows if um > 0.0 and (s, replicate) != (4.0, 2.0)]

    def minus_log_likelihood(p: NDArray[np.float64]) -> float:
        depths = [max(p[0] * (math.log(e) - p[1]), 1e-3) for e, _ in used]
        terms = [math.log(p[2] * d) + ((um - d) / (p[2] * d)) ** 2 / 2 for (_, um), d in zip(used, depths, strict=True)]
        return float(sum(terms))

    best = minimize(
        minus_log_likelihood, [100.0, 1.5, 0.1], method="Nelder-Mead", options={"xatol": 1e-6, "maxiter": 4000}
    ).x
    assert curve["Dp_um"] == pytest.approx(best[0], rel=0.02)  # the weights differ, by less than u
    assert curve["Ec_mJ_per_cm2"] == pytest.approx(math.exp(best[1]), rel=0.02)
    assert curve["Dp_um"] == pytest.approx(110.0, rel=0.04)  # the true value
    assert curve["Ec_mJ_per_cm2"] == pytest.approx(6.0, rel=0.03)
    dp = curve["Dp_um"]
    assert curve["at_3_s_um"] == pytest.approx(dp * math.log(39.0 / curve["Ec_mJ_per_cm2"]), rel=1e-9)
    depths = (np.arange(1000) + 0.5) / 1000 * 25.0
    inside = sum(np.mean(26.0 * np.exp(-(layer * 25.0 + depths) / dp)) for layer in range(50))
    assert curve["inside_mJ_per_cm2"] == pytest.approx(inside, rel=1e-6)
    assert curve["alone_mJ_per_cm2"] == pytest.approx(np.mean(26.0 * np.exp(-depths / dp)), rel=1e-6)
    bound = brentq(lambda ec: dp * math.log(39.0 / ec) - 200.0, 1e-6, 39.0)
    assert curve["largest_Ec_mJ_per_cm2"] == pytest.approx(bound, rel=1e-9)


def test_coin_diameters_agree_with_watershed_areas() -> None:
    """The areas are from a watershed of the gradient, seeded by clear background and clear coin."""
    diameters, grey = result("coins"), data.coins()
    assert len(diameters["original"]) == 24
    assert np.median(np.abs(diameters["rotated"] - diameters["original"])) < 0.05
    seeds = np.where(grey < 30, 1, np.where(grey > 150, 2, 0))
    labels, count = ndimage.label(ndimage.binary_fill_holes(segmentation.watershed(filters.sobel(grey), seeds) == 2))
    areas = np.sort(ndimage.sum_labels(np.ones(grey.shape), labels, np.arange(1, count + 1)))[-24:]
    expected = np.sqrt(4.0 * areas / np.pi)
    assert np.median(np.abs(np.sort(diameters["original"]) - expected)) < 1.0  # px; the rim is shaded over 1 to 2 px


def test_sample_micrograph_is_up_to_date() -> None:
    with tifffile.TiffFile(io.BytesIO(sample(NAME))) as file:
        levels, metadata = file.asarray().astype(int), file.ome_metadata or ""
    with tifffile.TiffFile(io.BytesIO(micrograph())) as file:
        deviation = np.abs(levels - file.asarray())
    assert deviation.max() <= 2  # the last bit kept: the rounding of the Fourier transform differs between systems
    assert np.mean(deviation > 0) < 1e-3
    assert "simulated" in metadata


def test_sample_tables_are_up_to_date() -> None:
    for name, table in TABLES.items():
        assert sample(name).decode() == table()


def test_characterised_resin_agrees_with_true_values() -> None:
    """Properties agree within three standard uncertainties; the contrast changes between n - u and n + u."""
    resin = result("characterise_resin")
    n, u = resin["n"], resin["u_n"]
    assert n == pytest.approx(1.48 + 0.005 / 0.86**2, abs=3 * u)
    assert 0.001 < u < 0.006  # 0.1 % in R is 0.0039 in n
    assert resin["loss"] == pytest.approx(
        0.02, abs=3 * 0.02 / math.sqrt(16 * 125)
    )  # noise over the spread of the lengths
    assert resin["Dp"] == pytest.approx(150.0, abs=3 * 4.0 / math.sqrt(15 * 0.132))  # likewise for ln(dose)
    assert resin["C10_MPa"] == pytest.approx(0.2, abs=0.002)
    angles = [-1.0, -0.875, -0.75, -0.625, -0.5, -0.375, -0.25]
    curves = {}
    for index in (n - u, n, n + u):
        values = {"material.index": index, "lens.design_index": n, "emitter.width_mm": 0.2}
        values["material.absorption_per_mm"] = resin["loss"]
        curves[index] = Sensor.of(with_values(loads(template("paper-860")), values)).power(angles).contrast
    largest = max(float(np.abs(curves[index] - curves[n]).max()) for index in (n - u, n + u))
    assert 0.85 * largest < resin["contrast_change"] < largest + 1e-3


def test_printed_lens_focuses_according_to_snell() -> None:
    """The reference uses the exact ripple, without points, noise or smoothing."""
    printed = result("as_printed")
    x = np.linspace(-HALF_WIDTH_MM, HALF_WIDTH_MM, 2001)
    oval = np.array([oval_z(float(position), 1.44) for position in x])
    arc_per_x = np.hypot(1.0, np.gradient(oval, x))
    ripple = np.sin(2.5 * x + 0.4)
    ripple *= 0.020 / math.sqrt(np.average(ripple**2, weights=arc_per_x))
    z = oval - ripple * arc_per_x
    normal, angle = -np.arctan(np.gradient(z, x)), np.arctan2(x, z + DISTANCE_MM)
    slope = np.tan(normal + np.arcsin(np.sin(angle - normal) / 1.44))
    intercept, weights = x - slope * z, np.gradient(angle)  # uniform in the angle of emission
    a, t = (values - np.average(values, weights=weights) for values in (intercept, slope))
    best = -float(np.average(a * t, weights=weights) / np.average(t * t, weights=weights))
    u = printed.lens.u_best_focus_mm(1.44)
    assert 0.0 < u < 0.2
    assert printed.lens.best_focus_mm(1.44) == pytest.approx(best, abs=2.0 * u)
    assert printed.lens.fit.deviation.rms_um == pytest.approx(20.0, abs=0.2)
    assert printed.response.null_shift_deg > 10.0 * printed.response.u_null_shift_deg


def test_every_second_step_of_half_a_layer_is_reproduced() -> None:
    """Heights are multiples of a layer of 50 µm, so every second step of 25 µm rises by a layer."""
    steps = result("coupon_steps")
    assert (steps["step_mm"], steps["next_mm"]) == (0.05, 0.025)
    assert steps["printed_mm"] == pytest.approx(0.05, abs=3e-4)  # 2 µm averaged over the 340 pixels of each of six tops
    assert steps["rises"] == 6


def test_rejection_of_ambient_light_agrees_with_phasors() -> None:
    """A reading is a difference between slots: of the phasors of the flicker, or of the values of the ramp."""
    rejections, slot_s = result("ambient_light"), 0.0025

    def phasor(hz: float, slots: float) -> complex:
        return complex(np.exp(2j * np.pi * hz * slots * slot_s))

    for name, hz in (("1 Hz", 1.0), ("50 Hz", 50.05), ("100 Hz", 100.1), ("120 Hz", 120.12)):
        one_sided, two_sided = 1.0 - phasor(hz, -1), 1.0 - 0.5 * (phasor(hz, -1) + phasor(hz, 1))
        averaged = two_sided * sum(phasor(hz, 2 * k) for k in range(4)) / 4
        expected = [-20 * math.log10(abs(residual)) for residual in (one_sided, two_sided, averaged)]
        assert rejections[name] == pytest.approx(expected, abs=0.1), "phases are uniform over 20 s, except at the ends"
    assert rejections["ramp"][0] == pytest.approx(20 * math.log10(20 / math.sqrt(12) / slot_s), abs=0.01)
    assert rejections["ramp"][1] > 120
    assert rejections["step"][:2] == pytest.approx([0.0, 20 * math.log10(2.0)], abs=1e-6)
