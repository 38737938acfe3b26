"""`solen print inspect` on rendered micrographs: the design is recognised, pose and deviations come back.

Each assertion here holds on a few images in CI; ``make evidence`` takes the whole number that is stated in the
documentation.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from solen.arrays import FloatArray
from tests.command_support import answered
from tests.metrology.edge_support import along, off_px
from tests.metrology.inspect_support import INDICES, Shot, design_file, inspected, lens, true_pose, turned
from tests.metrology.render.camera import Camera, png
from tests.metrology.render.optics import airy, defocus, gaussian, sharp
from tests.metrology.render.scenery import Scenery, dust, fibres, gradient, texture, vignetting
from tests.metrology.render.shape import bump, front_mm, outline_mm, shipped

LENSES = {name: lens(name) for name in INDICES}
PLAIN = Shot(LENSES["solen-860"])
LOOKS = ("gaussian", "airy", "defocus", "dark", "dusty", "rough")


def random_shot(name: str, seed: int, um_per_px: float) -> Shot:
    """A micrograph of a shipped lens with another place, rotation, light, blur and dirt for each seed."""
    rng = np.random.default_rng([seed, 77])
    size = 5.0 / um_per_px
    scenery: list[Scenery] = [gradient(rng.uniform(0, 0.4), rng.uniform(0, 360)), vignetting(rng.uniform(0, 0.2))]
    look = LOOKS[seed % len(LOOKS)]
    if look == "dusty":
        scenery += [dust(30, 4.0 * size, -0.8), fibres(2, 120.0 * size, 3.0 * size, -0.6)]
    if look == "rough":
        scenery += [texture(0.03, 1.5)]
    optics = {"airy": airy(4.0), "defocus": defocus(3.0)}.get(look, gaussian(2.0))
    return Shot(
        LENSES[name],
        um_per_px=um_per_px,
        angle_deg=rng.uniform(-12, 12),
        optics=optics,
        scenery=scenery,
        vertex_um=(2200.0 + rng.uniform(-60, 60), 2250.0 + rng.uniform(-60, 60)),
        size_um=(4400.0, 2500.0),
        step=-0.2 if look == "dark" else 0.55,
    )


@pytest.mark.parametrize(("name", "seed"), [("solen-500", 3), ("solen-450", 4)])
def test_the_design_is_distinguished_from_the_other_two(name: str, seed: int, tmp_path: Path) -> None:
    found = inspected(tmp_path, random_shot(name, seed, 5.0), seed, design=name)
    assert found["nearest"] == INDICES[name]
    assert found["designs"][INDICES[name]]["probability"] > 0.95
    assert found["deviation"]["rms_beyond_noise_um"] < 3.0 * found["deviation"]["u_rms_um"]


@pytest.mark.evidence
def test_the_three_designs_are_distinguished_in_every_image(tmp_path: Path) -> None:
    """At 2 µm to a pixel, 34 images of each lens, all laid on the first design."""
    told, least, rms = 0, 1.0, []
    for name in INDICES:
        for seed in range(34):
            found = inspected(tmp_path, random_shot(name, seed, 2.0), seed, design="solen-860")
            told += found["nearest"] == INDICES[name]
            least = min(least, found["designs"][INDICES[name]]["probability"])
            rms.append(found["designs"][INDICES[name]]["rms_um"])
    print(f"{told} of 102 told, least probability {least:.4f}, rms from the own design {np.median(rms):.3f} µm")
    assert told == 102


def pose_errors(found: dict[str, Any], shot: Shot) -> tuple[float, FloatArray]:
    """Errors of rotation and of the vertex, over their stated standard uncertainties."""
    angle_deg, vertex_px = true_pose(shot)
    off_um = (np.array(found["vertex_px"]) - vertex_px) * shot.um_per_px
    turn = np.radians(shot.angle_deg)
    x, z = off_um[0] * np.cos(turn) - off_um[1] * np.sin(turn), -off_um[0] * np.sin(turn) - off_um[1] * np.cos(turn)
    rotation = turned(found["rotation_deg"], angle_deg) / found["u_rotation_deg"]
    return rotation, np.array([x, z]) / np.array(found["u_shift_um"])


def test_rotation_and_place_come_back_within_their_uncertainties(tmp_path: Path) -> None:
    shot = replace(PLAIN, angle_deg=-161.0, size_um=(5200.0, 5200.0), vertex_um=(2600.0, 2600.0))
    found = inspected(tmp_path, shot, 5)
    rotation, shift = pose_errors(found, shot)
    assert abs(rotation) < 3.0
    assert np.abs(shift).max() < 3.0
    assert found["u_rotation_deg"] < 0.02
    assert max(found["u_shift_um"]) < 0.15 * shot.um_per_px


@pytest.mark.evidence
def test_stated_uncertainties_hold_over_many_images(tmp_path: Path) -> None:
    """Of 60 images of perfect prints: errors of places, pose and numbers over what is stated."""
    z: list[FloatArray] = []
    rotations, shifts, rms, inside = [], [], [], 0
    for seed in range(60):
        shot = random_shot("solen-860", seed, 5.0)
        found = inspected(tmp_path, shot, seed)
        z.append(np.array(found["outline_deviation_um"]) / np.array(found["u_outline_deviation_um"]))
        rotation, shift = pose_errors(found, shot)
        rotations.append(rotation)
        shifts.append(shift)
        off = found["deviation"]
        rms.append(off["rms_um"] / off["u_rms_um"])
        inside += off["interval95_max_um"][0] <= 0.0 <= off["interval95_max_um"][1]
    over = np.abs(np.concatenate(z))
    pose = np.abs(np.concatenate([rotations, np.ravel(shifts)]))
    shares = {
        "outline": over,
        "pose": pose,
        "rms": np.array(rms),
    }
    for what, ratio in shares.items():
        print(f"{what}: within u {np.mean(ratio < 1):.3f}, within 1.96 u {np.mean(ratio < 1.96):.3f} of {ratio.size}")
    print(f"the interval of the largest deviation holds the truth in {inside} of 60")
    assert 0.60 < np.mean(over < 1) < 0.80
    assert np.mean(over < 1.96) > 0.92
    assert np.mean(pose < 1.96) > 0.9
    assert np.mean(np.array(rms) < 2) > 0.9
    assert inside > 50


def laid_off_um(points_mm: FloatArray) -> FloatArray:
    """Distances of points from the design after a rotation and a shift that solen has no part in; outwards positive."""
    front = along(front_mm(shipped()), 1e-3)

    def off_mm(motion: FloatArray) -> FloatArray:
        turn = np.exp(1j * motion[2]) * (points_mm[:, 0] + 1j * points_mm[:, 1])
        return off_px(np.column_stack([turn.real + motion[0], turn.imag + motion[1]]), front)

    return np.asarray(-1e3 * off_mm(least_squares(off_mm, np.zeros(3), x_scale=[1e-3, 1e-3, 1e-3]).x))


def test_a_bump_and_a_hollow_come_back_with_sign_place_and_height(tmp_path: Path) -> None:
    """Against the true outline, laid on the design by plain least squares: solen weighs what is far off less."""

    def changed(points: FloatArray) -> FloatArray:
        return bump(-0.8, -25.0, 0.1)(bump(0.7, 25.0, 0.1)(points))

    found = inspected(tmp_path, replace(PLAIN, outline=outline_mm(shipped(), changed)), 6)
    x, off_um = np.array(found["outline_mm"])[:, 0], np.array(found["outline_deviation_um"])
    printed = along(changed(front_mm(shipped())), 5e-3)[8:-8]
    expected_um = np.interp(x, printed[:, 0], laid_off_um(printed))
    assert np.sqrt(np.mean((off_um - expected_um) ** 2)) < 2.0  # µm; the pose takes up to 5 µm of either by both ways
    assert off_um.max() == pytest.approx(expected_um.max(), abs=3.0)
    assert off_um.min() == pytest.approx(expected_um.min(), abs=3.0)
    assert x[off_um.argmax()] == pytest.approx(0.7, abs=0.04)
    assert x[off_um.argmin()] == pytest.approx(-0.8, abs=0.04)


def test_a_print_that_is_larger_is_recognised_by_its_factor(tmp_path: Path) -> None:
    found = inspected(tmp_path, replace(PLAIN, magnification=1.02), 7)
    size = found["size"]
    assert size["size_factor"] == pytest.approx(1.02, abs=4.0 * size["u_size_factor"])
    assert any("% larger" in warning for warning in found["warnings"])


def test_a_lens_of_another_focus_lies_off_its_design_as_their_curves_do(tmp_path: Path) -> None:
    design = shipped(lens__focus_mm=16.0)
    found = inspected(tmp_path, Shot(outline_mm(design)), 8)
    rms_um = np.sqrt(np.mean(laid_off_um(along(front_mm(design), 5e-3)[8:-8]) ** 2))
    assert found["deviation"]["rms_um"] == pytest.approx(rms_um, rel=0.04)  # the robust fit weighs the ends less


@pytest.mark.parametrize(("light", "taper_um"), [("transmitted", 50.0), ("dark-field", -60.0)])
def test_both_edges_are_found_and_named(light: str, taper_um: float, tmp_path: Path) -> None:
    found = inspected(tmp_path, replace(PLAIN, light=light, taper_um=taper_um), 9)
    edges = {edge["name"]: edge for edge in found["edges"]}
    assert set(edges) == {"outer", "inner"}
    assert found["edge"]["name"] == ("inner" if taper_um > 0 else "outer")  # the one in focus
    other = edges["outer" if taper_um > 0 else "inner"]
    assert other["outside_chosen_um"] == pytest.approx(taper_um, abs=1.5)  # a third of a pixel
    assert found["deviation"]["rms_beyond_noise_um"] < 3.0 * found["deviation"]["u_rms_um"]


def test_the_printed_object_has_the_keys_that_others_read(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    image = tmp_path / "image.png"
    image.write_bytes(png(PLAIN.taken(1)))
    design = design_file(tmp_path)
    found = answered(capfd, "print", "inspect", str(image), "--design", str(design), "--um-per-px", "5")
    assert found["scale"]["um_per_px"] == 5.0
    assert {"rms_um", "max_um"} <= found["deviation"].keys()
    assert found["nearest"] == "n = 1.44"
    outline = np.array(found["outline_mm"])
    assert outline.shape[1] == 2
    assert len(outline) > 100
    assert np.abs(outline[:, 0]).max() < 2.01
    assert found["sources"][0]["file"] == "image.png"
    assert isinstance(found["warnings"], list)


@pytest.mark.evidence
def test_a_sharp_image_of_much_noise_and_many_bits_is_measured_as_well(tmp_path: Path) -> None:
    shot = replace(PLAIN, optics=sharp(), camera=Camera(noise=0.08, bits=16))
    off = inspected(tmp_path, shot, 10)["deviation"]
    assert off["rms_um"] < 3.0 * off["u_rms_um"]
    assert off["interval95_max_um"][0] <= 0.0 <= off["interval95_max_um"][1]
