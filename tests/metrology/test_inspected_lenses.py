"""`solen print inspect` on rendered micrographs: recognition of the design, pose and deviations.

The tests of CI use a few images; ``make evidence`` uses as many as the documentation states.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from solen.arrays import FloatArray
from tests.command_support import answered
from tests.metrology.edge_support import along, signed_distances_px
from tests.metrology.inspect_support import INDICES, Shot, design_file, inspected, lens, rotation_error_deg, true_pose
from tests.metrology.render.camera import Camera, png
from tests.metrology.render.optics import airy, defocus, gaussian, sharp
from tests.metrology.render.scenery import Scenery, dust, fibres, gradient, texture, vignetting
from tests.metrology.render.shape import bump, front_mm, outline_mm, shipped

LENSES = {name: lens(name) for name in INDICES}
PLAIN = Shot(LENSES["solen-860"])
CONDITIONS = ("gaussian", "airy", "defocus", "dark", "dusty", "rough")


def random_shot(name: str, seed: int, um_per_px: float) -> Shot:
    """Return a micrograph of a shipped lens whose pose, illumination, blur and dirt depend on the seed."""
    rng = np.random.default_rng([seed, 77])
    size = 5.0 / um_per_px
    scenery: list[Scenery] = [gradient(rng.uniform(0, 0.4), rng.uniform(0, 360)), vignetting(rng.uniform(0, 0.2))]
    condition = CONDITIONS[seed % len(CONDITIONS)]
    if condition == "dusty":
        scenery += [dust(30, 4.0 * size, -0.8), fibres(2, 120.0 * size, 3.0 * size, -0.6)]
    if condition == "rough":
        scenery += [texture(0.03, 1.5)]
    optics = {"airy": airy(4.0), "defocus": defocus(3.0)}.get(condition, gaussian(2.0))
    return Shot(
        LENSES[name],
        um_per_px=um_per_px,
        angle_deg=rng.uniform(-12, 12),
        optics=optics,
        scenery=scenery,
        vertex_um=(2200.0 + rng.uniform(-60, 60), 2250.0 + rng.uniform(-60, 60)),
        size_um=(4400.0, 2500.0),
        step=-0.2 if condition == "dark" else 0.55,
    )


@pytest.mark.parametrize(("name", "seed"), [("solen-500", 3), ("solen-450", 4)])
def test_distinguishes_design_from_other_two(name: str, seed: int, tmp_path: Path) -> None:
    result = inspected(tmp_path, random_shot(name, seed, 5.0), seed, design=name)
    assert result["nearest"] == INDICES[name]
    assert result["designs"][INDICES[name]]["probability"] > 0.95
    assert result["deviation"]["rms_beyond_noise_um"] < 3.0 * result["deviation"]["u_rms_um"]


@pytest.mark.evidence
def test_distinguishes_three_designs_in_many_images(tmp_path: Path) -> None:
    """At 2 µm per pixel, 34 images of each lens, all registered to the first design."""
    correct, min_probability, rms = 0, 1.0, []
    for name in INDICES:
        for seed in range(34):
            result = inspected(tmp_path, random_shot(name, seed, 2.0), seed, design="solen-860")
            correct += result["nearest"] == INDICES[name]
            min_probability = min(min_probability, result["designs"][INDICES[name]]["probability"])
            rms.append(result["designs"][INDICES[name]]["rms_um"])
    print(
        f"{correct} of 102 recognised, minimum probability {min_probability:.4f}, RMS deviation {np.median(rms):.3f} µm"
    )
    assert correct == 102


def pose_errors(result: dict[str, Any], shot: Shot) -> tuple[float, FloatArray]:
    """Return the errors of rotation and vertex, divided by their stated standard uncertainties."""
    angle_deg, vertex_px = true_pose(shot)
    off_um = (np.array(result["vertex_px"]) - vertex_px) * shot.um_per_px
    angle = np.radians(shot.angle_deg)
    x, z = off_um[0] * np.cos(angle) - off_um[1] * np.sin(angle), -off_um[0] * np.sin(angle) - off_um[1] * np.cos(angle)
    rotation = rotation_error_deg(result["rotation_deg"], angle_deg) / result["u_rotation_deg"]
    return rotation, np.array([x, z]) / np.array(result["u_shift_um"])


def test_rotation_and_position_within_uncertainties(tmp_path: Path) -> None:
    shot = replace(PLAIN, angle_deg=-161.0, size_um=(5200.0, 5200.0), vertex_um=(2600.0, 2600.0))
    result = inspected(tmp_path, shot, 5)
    rotation, shift = pose_errors(result, shot)
    assert abs(rotation) < 3.0
    assert np.abs(shift).max() < 3.0
    assert result["u_rotation_deg"] < 0.02
    assert max(result["u_shift_um"]) < 0.15 * shot.um_per_px


@pytest.mark.evidence
def test_coverage_of_uncertainties_in_many_images(tmp_path: Path) -> None:
    """Errors of points, pose and RMS deviation over their uncertainties, in 60 images of perfect prints."""
    z: list[FloatArray] = []
    rotations, shifts, rms, covered = [], [], [], 0
    for seed in range(60):
        shot = random_shot("solen-860", seed, 5.0)
        result = inspected(tmp_path, shot, seed)
        z.append(np.array(result["outline_deviation_um"]) / np.array(result["u_outline_deviation_um"]))
        rotation, shift = pose_errors(result, shot)
        rotations.append(rotation)
        shifts.append(shift)
        deviation = result["deviation"]
        rms.append(deviation["rms_um"] / deviation["u_rms_um"])
        covered += deviation["interval95_max_um"][0] <= 0.0 <= deviation["interval95_max_um"][1]
    point_ratios = np.abs(np.concatenate(z))
    pose = np.abs(np.concatenate([rotations, np.ravel(shifts)]))
    ratios = {
        "outline": point_ratios,
        "pose": pose,
        "rms": np.array(rms),
    }
    for name, ratio in ratios.items():
        print(f"{name}: within u {np.mean(ratio < 1):.3f}, within 1.96 u {np.mean(ratio < 1.96):.3f} of {ratio.size}")
    print(f"the interval of the largest deviation contains 0 in {covered} of 60")
    assert 0.60 < np.mean(point_ratios < 1) < 0.80
    assert np.mean(point_ratios < 1.96) > 0.92
    assert np.mean(pose < 1.96) > 0.9
    assert np.mean(np.array(rms) < 2) > 0.9
    assert covered > 50


def registered_um(points_mm: FloatArray) -> FloatArray:
    """Return the deviations of points from the design after an independent registration, positive outwards."""
    front = along(front_mm(shipped()), 1e-3)

    def deviations_mm(motion: FloatArray) -> FloatArray:
        turn = np.exp(1j * motion[2]) * (points_mm[:, 0] + 1j * points_mm[:, 1])
        return signed_distances_px(np.column_stack([turn.real + motion[0], turn.imag + motion[1]]), front)

    return np.asarray(-1e3 * deviations_mm(least_squares(deviations_mm, np.zeros(3), x_scale=[1e-3, 1e-3, 1e-3]).x))


def test_sign_position_and_height_of_bump_and_hollow(tmp_path: Path) -> None:
    """Compared with the true outline, registered by plain least squares; solen gives large deviations less weight."""

    def changed(points: FloatArray) -> FloatArray:
        return bump(-0.8, -25.0, 0.1)(bump(0.7, 25.0, 0.1)(points))

    result = inspected(tmp_path, replace(PLAIN, outline=outline_mm(shipped(), changed)), 6)
    x, off_um = np.array(result["outline_mm"])[:, 0], np.array(result["outline_deviation_um"])
    printed = along(changed(front_mm(shipped())), 5e-3)[8:-8]
    expected_um = np.interp(x, printed[:, 0], registered_um(printed))
    assert np.sqrt(np.mean((off_um - expected_um) ** 2)) < 2.0  # µm; in both fits, the pose absorbs up to 5 µm
    assert off_um.max() == pytest.approx(expected_um.max(), abs=3.0)
    assert off_um.min() == pytest.approx(expected_um.min(), abs=3.0)
    assert x[off_um.argmax()] == pytest.approx(0.7, abs=0.04)
    assert x[off_um.argmin()] == pytest.approx(-0.8, abs=0.04)


def test_size_factor_of_larger_print(tmp_path: Path) -> None:
    result = inspected(tmp_path, replace(PLAIN, magnification=1.02), 7)
    size = result["size"]
    assert size["size_factor"] == pytest.approx(1.02, abs=4.0 * size["u_size_factor"])
    assert any("% larger" in warning for warning in result["warnings"])


def test_deviation_of_lens_of_another_focus(tmp_path: Path) -> None:
    design = shipped(lens__focus_mm=16.0)
    result = inspected(tmp_path, Shot(outline_mm(design)), 8)
    rms_um = np.sqrt(np.mean(registered_um(along(front_mm(design), 5e-3)[8:-8]) ** 2))
    assert result["deviation"]["rms_um"] == pytest.approx(rms_um, rel=0.04)  # the robust fit gives the ends less weight


@pytest.mark.parametrize(("light", "taper_um"), [("transmitted", 50.0), ("dark-field", -60.0)])
def test_names_both_edges(light: str, taper_um: float, tmp_path: Path) -> None:
    result = inspected(tmp_path, replace(PLAIN, light=light, taper_um=taper_um), 9)
    edges = {edge["name"]: edge for edge in result["edges"]}
    assert set(edges) == {"outer", "inner"}
    assert result["edge"]["name"] == ("inner" if taper_um > 0 else "outer")  # the edge in focus
    other = edges["outer" if taper_um > 0 else "inner"]
    assert other["outside_chosen_um"] == pytest.approx(taper_um, abs=1.5)  # a third of a pixel
    assert result["deviation"]["rms_beyond_noise_um"] < 3.0 * result["deviation"]["u_rms_um"]


def test_json_has_documented_keys(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    image = tmp_path / "image.png"
    image.write_bytes(png(PLAIN.taken(1)))
    design = design_file(tmp_path)
    result = answered(capfd, "print", "inspect", str(image), "--design", str(design), "--um-per-px", "5")
    assert result["scale"]["um_per_px"] == 5.0
    assert {"rms_um", "max_um"} <= result["deviation"].keys()
    assert result["nearest"] == "n = 1.44"
    outline = np.array(result["outline_mm"])
    assert outline.shape[1] == 2
    assert len(outline) > 100
    assert np.abs(outline[:, 0]).max() < 2.01
    assert result["sources"][0]["file"] == "image.png"
    assert isinstance(result["warnings"], list)


@pytest.mark.evidence
def test_measures_sharp_noisy_image_of_16_bits(tmp_path: Path) -> None:
    shot = replace(PLAIN, optics=sharp(), camera=Camera(noise=0.08, bits=16))
    deviation = inspected(tmp_path, shot, 10)["deviation"]
    assert deviation["rms_um"] < 3.0 * deviation["u_rms_um"]
    assert deviation["interval95_max_um"][0] <= 0.0 <= deviation["interval95_max_um"][1]
