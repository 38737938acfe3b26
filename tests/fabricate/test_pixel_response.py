"""A measured response of one pixel in place of a Gaussian: dose, walls, files, and what is refused."""

import hashlib
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.special import ndtr

from solen.errors import DataError
from solen.fabricate.process import (
    FlatImage,
    FlatPrint,
    MeasuredCoupon,
    MeasuredFeature,
    PrintOptions,
    Process,
    Settings,
    SharedScale,
    SidePrint,
    calibrated,
    default_process,
    dose_map,
    files_read,
    parsed_process,
    printed_mm,
    process_of,
    process_text,
    read_process,
    straight_edge_um,
)
from solen.fabricate.process.growth import growth_um, uneven_um
from solen.fabricate.process.side_print import Side
from solen.fabricate.process.source import with_printer
from tests.fabricate.direct_dose import dose_at
from tests.fabricate.print_support import ring, round_target, settings

PITCH = 3.0
HALO = {"halo_um": 40.0, "halo_per_depth": 0.1}


def places(count: int) -> NDArray[np.float64]:
    return PITCH * np.asarray(np.arange(count) - count // 2, float)


def gaussian_pixel(pixel: float = 27.0, sigma: float = 15.0, count: int = 61) -> NDArray[np.float64]:
    """Samples of a square blurred by a Gaussian: what `sigma_um` stands for."""
    x = places(count)
    line = ndtr((x + pixel / 2) / sigma) - ndtr((x - pixel / 2) / sigma)
    return np.asarray(np.outer(line, line))


def lopsided(count: int = 71) -> NDArray[np.float64]:
    """A sharp peak with a tail towards +x."""
    x, y = np.meshgrid(places(count), places(count))
    tail = np.exp(-0.5 * (((x - 24.0) / 18.0) ** 2 + (y / 14.0) ** 2))
    return np.asarray(np.exp(-0.5 * (x**2 + y**2) / 12.0**2) + 0.35 * tail)


def measured(light: NDArray[np.float64], **values: Any) -> Settings:
    table = {"light": light.tolist(), "pitch_um": PITCH} | values.pop("table", {})
    return settings(sigma_um=None, response=table, **values)


def test_a_table_of_the_gaussian_prints_as_the_gaussian_does() -> None:
    target, rings = round_target(0.6), [ring(0.6)]
    for phase in ((0.0, 0.0), (0.3, 0.6)):
        plain, table = (
            FlatPrint.of(rings, target, one, 0.5, phase).offsets_um(230.0)
            for one in (settings(**HALO), measured(gaussian_pixel(), **HALO))
        )
        assert np.allclose(table, plain, atol=0.02)  # µm
    one = measured(gaussian_pixel())
    assert one.blur_um == pytest.approx(15.0, abs=0.02)
    assert one.edge_um == pytest.approx(settings().edge_um, abs=0.02)
    # walls by the mean over directions: of the Gaussian's squares that is itself taken for a Gaussian
    assert growth_um(one) == pytest.approx(growth_um(settings()), abs=0.15)
    assert straight_edge_um(one, 20, 110.0) == pytest.approx(straight_edge_um(settings(), 20, 110.0), abs=0.15)


@pytest.mark.parametrize("more", [{}, {"table": {"centre_um": [99.0, 111.0]}}, {"response_scale": 1.15}])
@pytest.mark.parametrize("sides", [{}, {"pixel_um": 24.0, "pixel_y_um": 19.0}])
def test_the_fast_dose_of_a_response_is_that_of_direct_sums(more: dict[str, Any], sides: dict[str, float]) -> None:
    one = measured(lopsided(), **HALO, **sides, **more)
    rng = np.random.default_rng(7)
    image = np.zeros((40, 36))
    image[15:22, 15:21] = rng.random((7, 6))
    found = dose_map(FlatImage(image, 3), one, 30.0)
    rows, columns = rng.integers(14 * one.pixel_light.fine, 23 * one.pixel_light.fine, (2, 25))
    at = np.column_stack([columns, rows]) * found.step_um + found.first_um
    wanted = dose_at(np.repeat(image[None], 3, axis=0), one, at, 30.0)
    assert np.allclose(found.dose[rows, columns], wanted, rtol=1e-5)
    between = rng.uniform(14.0, 23.0, (25, 2)) * one.pixels_um
    wanted = np.log(dose_at(np.repeat(image[None], 3, axis=0), one, between, 30.0))
    assert np.allclose(found.log_excess(between) + math.log(one.Ec_mJ_per_cm2), wanted, atol=5e-3)


def test_an_asymmetric_response_moves_the_edges_apart() -> None:
    """The peak stays where the pixel is; the tail lets the walls that face it grow by more."""
    centre = {"table": {"centre_um": [35 * PITCH, 35 * PITCH]}}
    right, left = (measured(light, **HALO, **centre) for light in (lopsided(), lopsided()[:, ::-1]))
    x = np.linspace(300.0, 1300.0, 20001)

    def grown(one: Settings, more: float) -> tuple[float, float]:
        """Growth to the left and to the right of a strip, whose edges cover so much of their pixels."""
        image = np.zeros((8, 60))
        image[:, 20:40], image[:, [19, 40]] = 1.0, more
        excess = dose_map(FlatImage(image, 80), one, 500.0 * (1.0 - 1e-9)).log_excess
        over = np.flatnonzero(excess(np.column_stack([x, np.full_like(x, 100.0)])) > 0.0)
        return (20 - more) * 27.0 - x[over[0]], x[over[-1]] - (40 + more) * 27.0

    here = np.mean([grown(right, more) for more in (0.0, 0.25, 0.5, 0.75)], axis=0)
    assert here[1] - here[0] > 20.0
    assert grown(left, 0.0)[::-1] == pytest.approx(grown(right, 0.0), abs=0.1)
    # walls by sums that take the mean over places in the pixel of the light, and not of the edge
    assert uneven_um(right) == pytest.approx(tuple(here), abs=1.5)
    least, most = uneven_um(right)
    assert least < growth_um(right) < most
    assert uneven_um(settings()) == (growth_um(settings()),) * 2


def test_a_part_on_edge_or_upright_takes_the_response_along_its_pixels() -> None:
    target, rings = round_target(1.0), [ring(1.0)]
    sides: tuple[Side, ...] = ("upright", "on-edge")
    for side in sides:
        plain, table = (
            SidePrint.of(rings, target, one, side).profile_um()
            for one in (settings(**HALO), measured(gaussian_pixel(), **HALO))
        )
        assert np.sqrt(np.mean((table - plain) ** 2)) < 0.15  # µm; its rows are straight lines between fine points
    shapes = [
        SidePrint.of(rings, target, measured(light), "upright").profile_um()
        for light in (lopsided(), lopsided()[:, ::-1])
    ]
    right = target.points_mm[:, 0] > 0.98
    assert shapes[0][right].mean() - shapes[1][right].mean() > 2.0


FILE = """schema = 1
name = "ours"

[process.response]
file = "{}"
pitch_um = 3.0
"""


def written(folder: Path, light: NDArray[np.float64], name: str = "pixel.csv") -> Path:
    if name.endswith(".csv"):
        np.savetxt(folder / name, light, delimiter=",", header="dark subtracted")
    else:
        Image.fromarray(np.rint(60_000 * light[::-1] / light.max()).astype(np.uint16)).save(folder / name)
    (folder / "ours.toml").write_text(FILE.format(name), encoding="utf-8")
    return folder / "ours.toml"


@pytest.mark.parametrize("name", ["pixel.csv", "pixel.png", "pixel.tif"])
def test_a_process_file_takes_its_response_from_a_table_or_an_image(tmp_path: Path, name: str) -> None:
    found = read_process(written(tmp_path, lopsided(), name))
    assert found.process.sigma_um is None
    assert found.process.response is not None
    light = np.array(found.process.response.light)
    assert np.allclose(light / light.max(), lopsided() / lopsided().max(), atol=1e-5)
    assert found.source["response"] == f"measured: {name}"
    # what is not stated is assumed, and said to be
    assert found.uncertainty["response_scale"] == 0.05
    assert "response_scale" in found.assumptions
    assert "sigma_um" not in {*found.uncertainty, *found.assumptions}
    again = parsed_process(process_text(found), "again")
    assert again.process == found.process


def test_a_response_and_a_gaussian_are_one_statement(tmp_path: Path) -> None:
    path = written(tmp_path, lopsided())
    both = path.read_text(encoding="utf-8").replace("[process.resp", "[process]\nsigma_um = 12.0\n\n[process.resp")
    with pytest.raises(DataError, match=r"process\.sigma_um = 12\.0; cannot be combined with process\.response"):
        parsed_process(both, "both", tmp_path)
    text = path.read_text(encoding="utf-8")
    with pytest.raises(DataError, match=r"uncertainty\.sigma_um = 3\.0"):
        parsed_process(text + "[uncertainty]\nsigma_um = 3.0\n", "both", tmp_path)
    for stated in ("[process]\nresponse_scale = 1.1\n", "[uncertainty]\nresponse_scale = 0.1\n"):
        with pytest.raises(DataError, match="response"):
            parsed_process('schema = 1\nname = "ours"\n' + stated, "none")
    with pytest.raises(DataError, match="scattered light is wider"):
        measured(lopsided(), halo_um=5.0)
    with pytest.raises(DataError, match="response of a 27 µm pixel"):
        with_printer(read_process(path), "asiga-max-x43")


BAD = {
    "a missing file": ("", "no such file"),
    "text": ("1 2 3\n4 five 6\n", "must contain rows of numbers"),
    "a line": ("1 2 3 4 5 6\n", "at least 5 rows"),
    "rows of two lengths": ("1 2 3 4 5\n" * 5 + "1 2\n", "same length"),
    "dark": ("0 0 0 0 0\n" * 6, "must be light"),
    "a light below 0": ("0 0 0 0 0\n" * 3 + "0 0 9 -5 0\n" + "0 0 0 0 0\n" * 3, "dark image"),
    "a background": ("3 3 3 3 3\n" * 3 + "3 3 9 3 3\n" + "3 3 3 3 3\n" * 3, "subtract the background"),
    "a background at one side": ("3 0 0 0 0\n" * 3 + "3 0 90 0 0\n" + "3 0 0 0 0\n" * 3, "subtract the background"),
    "two marks": ("0;0;0,5;0.5;0\n" * 6, "decimal mark"),
    "two separators": (
        "0 0 1 0 0\n" * 5 + "0;0;1;0;0\n",
        "line 6, column 1 = '0;0;1;0;0'; must contain rows of numbers",
    ),
    "a gap": ("0;0;1;0;0\n" * 5 + "0;;1;0;0\n", "line 6, column 2; must be a finite number"),
    "no number": ("0 0 0 0 0\n" * 3 + "0 0 nan 0 0\n" + "0 0 0 0 0\n" * 3, "finite"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_table_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    text, named = BAD[case]
    path = written(tmp_path, lopsided())
    (tmp_path / "pixel.csv").write_text(text, encoding="utf-8")
    if not text:
        (tmp_path / "pixel.csv").unlink()
    with pytest.raises(DataError, match=named) as refusal:
        read_process(path)
    assert "\n" not in str(refusal.value)


def test_a_hot_sample_is_warned_of_and_a_sharp_pixel_is_not() -> None:
    def told(light: NDArray[np.float64]) -> list[str]:
        process = Process(name="p", process=measured(light))
        return [line for line in process.warnings() if line.startswith("do not use: process.response")]

    light = gaussian_pixel(pixel=8.0, sigma=4.0)
    assert told(light) == told(gaussian_pixel()) == []
    light[10, 12] = 60.0 * light.max()
    (line,) = told(light)
    assert "sample 13 of row 11" in line


def test_samples_that_cannot_be_those_of_the_pixel_are_refused(tmp_path: Path) -> None:
    for table, named in (
        ({"centre_um": [600.0, 60.0]}, r"centre_um.*within the table"),
        ({"pitch_um": 8.0}, "at least 4 samples"),
        ({"pitch_um": 0.05}, "check pitch_um"),
        ({"pitch_um": 3.0, "file": "pixel.csv"}, r"response\.file"),
    ):
        with pytest.raises(DataError, match=named):
            _ = measured(lopsided(), table=table).blur_um
    flat = np.minimum(lopsided(), 0.5) / 0.5 * 255
    Image.fromarray(flat.astype(np.uint8)).save(tmp_path / "pixel.png")
    (tmp_path / "ours.toml").write_text(FILE.format("pixel.png"), encoding="utf-8")
    with pytest.raises(DataError, match="overexposed"):
        read_process(tmp_path / "ours.toml")
    Image.fromarray(np.zeros((9, 9, 3), np.uint8)).save(tmp_path / "pixel.png")
    with pytest.raises(DataError, match="single-channel"):
        read_process(tmp_path / "ours.toml")
    grey = Image.fromarray(np.rint(200 * lopsided() / lopsided().max()).astype(np.uint8))
    grey.convert("P").save(tmp_path / "pixel.png")
    with pytest.raises(DataError, match="a palette"):
        read_process(tmp_path / "ours.toml")
    (tmp_path / "ours.toml").write_text(FILE.format("pixel.tif"), encoding="utf-8")
    grey.save(tmp_path / "pixel.tif", save_all=True, append_images=[grey])
    with pytest.raises(DataError, match=r"2 pages.; must contain a single image"):
        read_process(tmp_path / "ours.toml")


@pytest.mark.parametrize(
    ("separator", "mark"), [(";", ","), ("\t", ","), (" ", ","), (", ", "."), (";", "."), (",", ".")]
)
def test_a_table_has_one_separator_and_one_decimal_mark(tmp_path: Path, separator: str, mark: str) -> None:
    path, wanted = written(tmp_path, lopsided()), np.round(lopsided(), 5)
    lines = [separator.join(f"{one:.5f}".replace(".", mark) for one in row) for row in wanted.tolist()]
    (tmp_path / "pixel.csv").write_text("\n".join(["# dark subtracted", *lines, ""]), encoding="utf-8")
    response = read_process(path).process.response
    assert response is not None
    assert np.array_equal(response.light, wanted)


def test_the_file_of_a_response_is_a_source_with_its_checksum(tmp_path: Path) -> None:
    path = written(tmp_path, lopsided())
    found = process_of(PrintOptions(process=path))[1]
    assert [one.file for one in found] == ["ours.toml", "pixel.csv"]
    assert found[1].sha256 == hashlib.sha256((tmp_path / "pixel.csv").read_bytes()).hexdigest()
    assert files_read(path, None) == [path, tmp_path / "pixel.csv", None]


def test_coupons_find_the_scale_of_a_response_in_place_of_a_blur() -> None:
    true = measured(lopsided(), response_scale=1.12, Ec_mJ_per_cm2=3.2)
    drawn = [*(("pillar", one) for one in (0.06, 0.1, 0.5)), ("hole", 0.15), ("hole", 0.4), ("gap", 0.15)]
    features = [MeasuredFeature(kind, mm, mm, 0.002, True) for kind, mm in drawn]  # type: ignore[arg-type]  # its kinds
    sizes = printed_mm(true, features)
    seen = [replace(one, measured_mm=float(size)) for one, size in zip(features, sizes, strict=True) if size > 0.0]
    before = default_process()
    keys = {key: u for key, u in before.uncertainty.items() if key != "sigma_um"} | {"response_scale": 0.05}
    process = Process(name="test", process=measured(lopsided()), uncertainty=keys)
    found = calibrated(process, [MeasuredCoupon(tuple(seen), SharedScale(2.0, 1e-4))], "test")
    scale = found.numbers[0]
    assert scale.key == "response_scale"
    assert scale.value == pytest.approx(1.12, abs=2.0 * scale.u)
    assert scale.u < 0.12
    assert found.settings.sigma_um is None
    again = parsed_process(process_text(found.process), "again")
    assert again.process.response == process.process.response
    assert again.covariance()[0][0] == "response_scale"


def test_compensation_follows_an_asymmetric_response() -> None:
    target, rings = round_target(0.8), [ring(0.8)]
    one = measured(lopsided(), **HALO)
    off = FlatPrint.of(rings, target, one, 0.5).offsets_um(230.0)
    x = target.outward[:, 0]
    assert off[x < -0.9].mean() - off[x > 0.9].mean() > 5.0  # the peak is left of the centroid
    drawn = np.zeros_like(off)
    for _ in range(8):
        moved = [target.moved_um(drawn)]
        drawn -= FlatPrint.of(moved, target, one, 0.5).offsets_um(230.0)
    left = FlatPrint.of([target.moved_um(drawn)], target, one, 0.5).offsets_um(230.0)
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(off**2))
