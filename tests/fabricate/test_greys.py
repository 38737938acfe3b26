"""Grey pixels: their light, the coupon that measures it, the drawing and the prediction that use it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq

from solen.errors import DataError, SpecError
from solen.fabricate.coupons import printable_coupon, written_coupons
from solen.fabricate.grey import Greys
from solen.fabricate.layers import Job, Slicing
from solen.fabricate.process import (
    FlatImage,
    GreyOptions,
    Process,
    default_process,
    dose_map,
    measured_greys,
    process_text,
    read_process,
    straight_edge_um,
)
from solen.geometry.coupons import CouponOptions
from solen.recording import Recording, read
from tests.command_support import answered, refusal
from tests.fabricate.print_support import settings
from tests.fabricate.test_layers import printer

GREYS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 1.0)
POWER = 1.8
"""Of a screen whose light is the grey to this power."""
DP, U_DP, EC, DOSE = 110.0, 5.0, 5.0, 200.0


def known() -> Process:
    """A process whose Dp was measured."""
    process = default_process().with_settings(Dp_um=DP)
    more = {"source": process.source | {"Dp_um": "measured"}, "uncertainty": process.uncertainty | {"Dp_um": U_DP}}
    return process.model_copy(update=more)


def table(folder: Path, rng: np.random.Generator, *, noise_um: float = 1.5, Dp: float = DP, **change: Any) -> Recording:
    """Discs of a screen of that power in a resin of that depth, which Jacobs' law cures."""
    greys = np.array(change.get("greys", GREYS))
    depth = Dp * np.log(greys ** change.get("power", POWER) * DOSE / EC) + rng.normal(0.0, noise_um, len(greys))
    path = folder / "steps.csv"
    rows = [f"{grey:g},{one:.3f},{max(noise_um, 0.01):g}" for grey, one in zip(greys, depth, strict=True)]
    path.write_text("\n".join(["grey,thickness_um,u_thickness_um", *rows]) + "\n", encoding="utf-8")
    return read(path)


def test_a_pixel_drawn_by_the_measured_answer_gives_its_share_of_light() -> None:
    answer = tuple((grey, grey**2.2) for grey in np.linspace(0.1, 0.9, 9).tolist())
    corrected, plain = Greys(answer), Greys(answer, corrected=False)
    shares = np.arange(256) / 255.0
    assert np.abs(corrected.light - shares).max() < 2.2 * 0.5 / 255.0 + 1e-3, "half a grey value, at the steepest place"
    assert plain.light[64] == pytest.approx((64 / 255) ** 2.2, abs=2e-3)
    assert (plain.levels == np.arange(256)).all()
    assert [int(corrected.levels[share]) for share in (0, 255)] == [0, 255]
    assert (np.diff(corrected.levels.astype(int)) >= 0).all()


@pytest.mark.parametrize("power", [0.5, 1.0, 1.3, 2.2])
def test_an_edge_moves_by_the_mean_light_beyond_its_mean_share(power: float) -> None:
    """Of shares that are all as likely the mean light is the integral of s^p, 1/(p + 1)."""
    assert Greys(power=power).shift == pytest.approx(1.0 / (power + 1.0) - 0.5, abs=2e-4)


@pytest.mark.parametrize("power", [1.0, 1.8])
def test_a_straight_wall_stands_where_its_image_prints_it(power: float) -> None:
    """A wall at eight places between pixels, printed by its image, against the closed form, their mean to 0.9 µm.

    At a power of 1.8 it stands 4 µm farther in than in proportion; the closed form takes pixels for Gaussian.
    """
    one = settings(grey_power=power, halo_fraction=0.0, sigma_um=12.0, burn_in_layers=0)
    height, layers = 12.5, 40
    beyond = []
    for phase in np.arange(8) / 8.0:
        strip = np.array([(-5.0, -2.0), (0.0, -2.0), (0.0, 2.0), (-5.0, 2.0)])
        strip = strip + np.array((2e-3 * one.pixel_um, 0.0))
        image = FlatImage.of([strip], np.array([(-0.5, -0.1), (0.5, 0.1)]), one, layers, (float(phase), 0.0))
        dose = dose_map(image, one, height)
        wall = brentq(lambda x, dose=dose: float(dose.log_excess(np.array([[x, 0.0]]))[0]), -60.0, 120.0)
        beyond.append(wall - 2.0 * one.pixel_um)
    assert np.mean(beyond) == pytest.approx(straight_edge_um(one, layers, height), abs=0.9)


def test_the_coupon_is_one_image_of_several_greys(tmp_path: Path) -> None:
    files = written_coupons("grey-steps", CouponOptions(spacing_mm=1.0))[1]
    path = tmp_path / "grey-steps.json"
    path.write_bytes(files["grey-steps.json"])
    part, slicing = printable_coupon(path, Slicing())
    job = Job(part.solid, printer(50.0, 2000, 200), slicing)
    (layer,) = job.layers()
    assert (layer.exposure_s, job.count, job.burn_in_layers) == (6.0, 1, 0)
    middles = [round(float(x) * 8.0 / 0.05) + 1000 for x in np.arange(10) - 4.5]
    assert [int(layer.image[100, column]) for column in middles] == [round(255 * grey) for grey in GREYS]
    stated = json.loads(path.read_text())["stages"][0]["exposures"]
    assert [row["grey"] for row in stated] == list(GREYS)
    curved = read_greys(tmp_path)
    with pytest.raises(SpecError, match="--process"):
        Job(part.solid, printer(50.0, 2000, 200), slicing, curved.process.greys)


def read_greys(folder: Path) -> Process:
    return measured_greys(table(folder, np.random.default_rng(1)), known()).process


def test_the_light_of_greys_comes_back_from_their_discs(tmp_path: Path) -> None:
    """Without noise: the power exactly, at every disc; and an edge drawn in proportion would stand too far in."""
    found = measured_greys(table(tmp_path, np.random.default_rng(0), noise_um=0.0), known())
    assert found.light == pytest.approx(found.grey**POWER, abs=1e-4)
    assert found.discs == (1,) * 8 + (2,)
    assert found.u_power == pytest.approx(U_DP / DP, rel=1e-2), "that of Dp is an exponent's"
    assert found.edge_shift_px == pytest.approx(1.0 / (POWER + 1.0) - 0.5, abs=2e-3)
    assert abs(found.process.process.greys.shift) < 1e-3, "drawn by them, it stands where it should"


def test_the_uncertainty_covers_light_and_edges(tmp_path: Path) -> None:
    """300 tables, discs off by 1.5 µm, Dp by its stated 5 %: light at 0.5 and the edge's shift in their 95 %."""
    rng = np.random.default_rng(5)
    truth = 0.5**POWER
    inside = np.zeros(2)
    for _ in range(300):
        true_Dp = DP + rng.normal(0.0, U_DP)
        found = measured_greys(table(tmp_path, rng, Dp=true_Dp), known())
        greys = found.process.process.greys
        light = float(greys.light_of(np.array(0.5)))
        u_light = abs(np.log(light)) * light * found.u_power
        at = int(np.flatnonzero(found.grey == 0.5)[0])
        inside[0] += abs(light - truth) < 1.96 * np.hypot(u_light, found.u_light[at])
        more, less = (Greys(greys.answer, False, 1.0 + sign * found.u_power).shift for sign in (1.0, -1.0))
        inside[1] += abs(found.edge_shift_px - (1.0 / (POWER + 1.0) - 0.5)) < 1.96 * abs(more - less) / 2.0
    assert (inside / 300.0 > 0.92).all(), inside / 300.0


@pytest.mark.parametrize(
    ("greys", "line"),
    [
        ((0.2, 0.4, 0.6, 0.8), "no disc with the full grey level"),
        ((1.0, 0.5, 0.7), "at least 4 grey levels"),
        ((1.0, 0.5, 0.7, 1.4), "must be fractions up to 1"),
    ],
)
def test_a_table_that_gives_no_curve_is_refused(tmp_path: Path, greys: tuple[float, ...], line: str) -> None:
    if max(greys) > 1.0:
        path = tmp_path / "t.csv"
        path.write_text("grey (%),thickness_um\n10,20\n120,40\n", encoding="utf-8")
        recording = read(path)
    else:
        recording = table(tmp_path, np.random.default_rng(2), greys=greys)
    with pytest.raises(DataError, match=line):
        measured_greys(recording, known())


def test_swapped_discs_are_seen(tmp_path: Path) -> None:
    rows = "grey,thickness_um\n255,400\n200,350\n150,180\n100,290\n50,100\n"
    (tmp_path / "s.csv").write_text(rows, encoding="utf-8")
    with pytest.raises(DataError, match="thickness"):
        measured_greys(read(tmp_path / "s.csv"), known(), GreyOptions(u_thickness_um=2.0))


def test_the_command_writes_a_process_that_layers_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    table(tmp_path, np.random.default_rng(3))
    said = answered(capfd, "print", "grey", "steps.csv", "--out", "mine.toml")
    assert any("Dp is assumed" in line for line in said["warnings"])
    process = read_process(Path("mine.toml"))
    assert len(process.process.grey) == 9
    assert process.uncertainty["grey_power"] == pytest.approx(said["u_power"])
    assert "grey_power" not in process.assumptions
    trimesh.creation.box((2.0, 2.0, 0.1)).export("box.stl")
    made = answered(
        capfd, "print", "layers", "box.stl", "--out", "out", "--process", "mine.toml", "--phase-px", "0.25", "0.5"
    )
    assert not any(
        "the process was measured with" in line for line in made["warnings"]
    )  # 27 µm are assumed, 50 generic
    settings = json.loads(Path(made["files"]["settings"]).read_text(encoding="utf-8"))
    assert (settings["process"], settings["phase_px"]) == ("mine.toml", [0.25, 0.5])
    assert settings["greys"] == [list(pair) for pair in process.process.grey]
    sheet = Path(made["files"]["sheet"]).read_text(encoding="utf-8")
    assert "9 measured grey levels of `mine.toml`" in sheet
    assert "0.25, 0.5" in sheet


def test_a_process_warns_of_pixels_that_it_states_and_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((2.0, 2.0, 0.1)).export("box.stl")
    greys = read_greys(tmp_path)
    Path("mine.toml").write_text(process_text(greys.with_settings(pixel_um=50.0, pixel_y_um=50.0)), encoding="utf-8")
    command = ("print", "layers", "box.stl", "--out", "out")
    made = answered(capfd, *command, "--process", "mine.toml")
    assert not any("the process was measured with" in line for line in made["warnings"])
    Path("mine.toml").write_text(process_text(greys.with_settings(pixel_um=27.0)), encoding="utf-8")
    made = answered(capfd, *command, "--process", "mine.toml")
    assert any("27 µm" in line and "50 µm" in line for line in made["warnings"])
    for option in (("--format", "goo"), ("--no-anti-aliasing",)):
        assert "--sheet-only" in refusal(capfd, tmp_path, *command, "--sheet-only", *option)


def test_greys_under_a_lamp_are_read_by_its_lines(tmp_path: Path) -> None:
    """Each disc is as thick as where the sum over the lines reaches the critical dose, found by a root here."""
    lines = ((0.5, 1.6), (0.5, 0.4))
    process = known().with_settings(lamp=lines)
    s = process.process
    greys, light = np.array([0.4, 0.6, 0.8, 1.0]), np.array([0.25, 0.5, 0.75, 1.0])

    def excess(um: float, dose: float) -> float:
        return dose * sum(w * float(np.exp(-um * r / s.Dp_um)) for w, r in lines) - s.Ec_mJ_per_cm2

    um = [brentq(excess, 0.0, 5000.0, args=(40.0 * s.Ec_mJ_per_cm2 * share,)) for share in light]
    path = tmp_path / "lamp.csv"
    rows = [f"{grey},{thick}" for grey, thick in zip(greys, um, strict=True) for _ in range(2)]
    path.write_text("\n".join(["grey,thickness_um", *rows]) + "\n", encoding="utf-8")
    found = measured_greys(read(path), process, GreyOptions(u_thickness_um=1.0))
    assert np.allclose(found.light, light, rtol=1e-4)


def test_a_blank_cell_above_a_grey_that_set_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    table(tmp_path, np.random.default_rng(1))
    lines = path.read_text(encoding="utf-8").split("\n")
    grey, _, u = lines[4].split(",")
    path.write_text("\n".join([*lines[:4], f"{grey},,{u}", *lines[5:]]), encoding="utf-8")
    with pytest.raises(DataError, match=r"thickness.*row 4.*0\.7"):
        measured_greys(read(path), known())


@pytest.mark.parametrize(("u_disc_um", "u_scale_percent"), [(4.0, 0.0), (1.0, 4.0)])
def test_what_all_steps_share_does_not_average_out(u_disc_um: float, u_scale_percent: float, tmp_path: Path) -> None:
    """300 tables, Dp exact: one full grey that all others are compared with, or a gauge off by 4 %.

    The exponent that fits the light best, weighted as the steps' errors are, against what is stated of it.
    """
    rng = np.random.default_rng(11)
    exact = known()
    exact = exact.model_copy(update={"uncertainty": exact.uncertainty | {"Dp_um": 0.0}})
    over, logs = [], POWER * np.log(np.array(GREYS[1:]))
    for _ in range(300):
        gauge = 1.0 + 0.01 * u_scale_percent * rng.normal()
        depth = DP * np.log(np.array(GREYS) ** POWER * DOSE / EC) + rng.normal(0.0, u_disc_um, len(GREYS))
        rows = [f"{grey:g},{gauge * one:.4f},{u_disc_um}" for grey, one in zip(GREYS, depth, strict=True)]
        path = tmp_path / "gauge.csv"
        path.write_text("\n".join(["grey,thickness_um,u_thickness_um", *rows]), encoding="utf-8")
        found = measured_greys(read(path), exact, GreyOptions(u_scale_percent=u_scale_percent))
        measured = np.log(np.interp(GREYS[1:], found.grey, found.light))
        full = np.linalg.inv(np.eye(len(logs)) + 1.0)
        over.append((logs @ full @ measured / (logs @ full @ logs) - 1.0) / found.u_power)
    assert np.mean(np.abs(over) < 1.96) == pytest.approx(0.95, abs=0.03)
