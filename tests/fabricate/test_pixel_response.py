"""A measured pixel response instead of a Gaussian: doses, walls, files, calibration and errors."""

import hashlib
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
from solen.fabricate.process.growth import growth_range_um, growth_um
from solen.fabricate.process.side_print import Side
from solen.fabricate.process.source import with_printer
from tests.fabricate.direct_dose import dose_at
from tests.fabricate.print_support import ring, round_target, settings

PITCH = 3.0
HALO = {"halo_um": 40.0, "halo_per_depth": 0.1}


def sample_positions(count: int) -> NDArray[np.float64]:
    return PITCH * np.asarray(np.arange(count) - count // 2, float)


def gaussian_pixel(pixel: float = 27.0, sigma: float = 15.0, count: int = 61) -> NDArray[np.float64]:
    """Return samples of a square blurred by a Gaussian, the response with `sigma_um`."""
    x = sample_positions(count)
    profile = ndtr((x + pixel / 2) / sigma) - ndtr((x - pixel / 2) / sigma)
    return np.asarray(np.outer(profile, profile))


def asymmetric(count: int = 71) -> NDArray[np.float64]:
    """Return samples of a narrow peak with a tail towards +x."""
    x, y = np.meshgrid(sample_positions(count), sample_positions(count))
    tail = np.exp(-0.5 * (((x - 24.0) / 18.0) ** 2 + (y / 14.0) ** 2))
    return np.asarray(np.exp(-0.5 * (x**2 + y**2) / 12.0**2) + 0.35 * tail)


def settings_with(light: NDArray[np.float64], **values: Any) -> Settings:
    table = {"light": light.tolist(), "pitch_um": PITCH} | values.pop("table", {})
    return settings(sigma_um=None, response=table, **values)


def test_a_table_of_a_gaussian_prints_like_the_gaussian() -> None:
    target, rings = round_target(0.6), [ring(0.6)]
    for phase in ((0.0, 0.0), (0.3, 0.6)):
        gaussian_um, table_um = (
            FlatPrint.of(rings, target, process, 0.5, phase).offsets_um(230.0)
            for process in (settings(**HALO), settings_with(gaussian_pixel(), **HALO))
        )
        assert np.allclose(table_um, gaussian_um, atol=0.02)
    process = settings_with(gaussian_pixel())
    assert process.blur_um == pytest.approx(15.0, abs=0.02)
    assert process.edge_um == pytest.approx(settings().edge_um, abs=0.02)
    # for a Gaussian, the closed form of walls approximates the square of a pixel by a Gaussian
    assert growth_um(process) == pytest.approx(growth_um(settings()), abs=0.15)
    assert straight_edge_um(process, 20, 110.0) == pytest.approx(straight_edge_um(settings(), 20, 110.0), abs=0.15)


@pytest.mark.parametrize("changes", [{}, {"table": {"centre_um": [99.0, 111.0]}}, {"response_scale": 1.15}])
@pytest.mark.parametrize("pixels", [{}, {"pixel_um": 24.0, "pixel_y_um": 19.0}])
def test_the_dose_of_a_response_agrees_with_direct_sums(changes: dict[str, Any], pixels: dict[str, float]) -> None:
    process = settings_with(asymmetric(), **HALO, **pixels, **changes)
    rng = np.random.default_rng(7)
    image = np.zeros((40, 36))
    image[15:22, 15:21] = rng.random((7, 6))
    images = np.repeat(image[None], 3, axis=0)
    dose = dose_map(FlatImage(image, 3), process, 30.0)
    rows, columns = rng.integers(14 * process.pixel_light.fine, 23 * process.pixel_light.fine, (2, 25))
    nodes = np.column_stack([columns, rows]) * dose.step_um + dose.first_um
    assert np.allclose(dose.dose[rows, columns], dose_at(images, process, nodes, 30.0), rtol=1e-5)
    points = rng.uniform(14.0, 23.0, (25, 2)) * process.pixels_um
    expected = np.log(dose_at(images, process, points, 30.0) / process.Ec_mJ_per_cm2)
    assert np.allclose(dose.log_excess(points), expected, atol=5e-3)


def test_walls_that_face_the_tail_of_a_response_grow_more() -> None:
    centre = {"table": {"centre_um": [35 * PITCH, 35 * PITCH]}}
    right, left = (settings_with(light, **HALO, **centre) for light in (asymmetric(), asymmetric()[:, ::-1]))
    x = np.linspace(300.0, 1300.0, 20001)

    def strip_growth_um(process: Settings, covered: float) -> tuple[float, float]:
        """Return the growth of a strip to the left and to the right; its edges cover a fraction of their pixels."""
        image = np.zeros((8, 60))
        image[:, 20:40], image[:, [19, 40]] = 1.0, covered
        excess = dose_map(FlatImage(image, 80), process, 500.0 * (1.0 - 1e-9)).log_excess
        cured = np.flatnonzero(excess(np.column_stack([x, np.full_like(x, 100.0)])) > 0.0)
        return (20 - covered) * 27.0 - x[cured[0]], x[cured[-1]] - (40 + covered) * 27.0

    mean = np.mean([strip_growth_um(right, covered) for covered in (0.0, 0.25, 0.5, 0.75)], axis=0)
    assert mean[1] - mean[0] > 20.0
    assert strip_growth_um(left, 0.0)[::-1] == pytest.approx(strip_growth_um(right, 0.0), abs=0.1)
    # the closed form averages the light over positions in the pixel, instead of the edge
    assert growth_range_um(right) == pytest.approx(tuple(mean), abs=1.5)
    low, high = growth_range_um(right)
    assert low < growth_um(right) < high
    assert growth_range_um(settings()) == (growth_um(settings()),) * 2


def test_parts_on_edge_and_upright_use_the_response() -> None:
    target, rings = round_target(1.0), [ring(1.0)]
    sides: tuple[Side, ...] = ("upright", "on-edge")
    for side in sides:
        gaussian_um, table_um = (
            SidePrint.of(rings, target, process, side).profile_um()
            for process in (settings(**HALO), settings_with(gaussian_pixel(), **HALO))
        )
        assert np.sqrt(np.mean((table_um - gaussian_um) ** 2)) < 0.15  # rows are interpolated linearly
    right_um, left_um = (
        SidePrint.of(rings, target, settings_with(light), "upright").profile_um()
        for light in (asymmetric(), asymmetric()[:, ::-1])
    )
    right_side = target.points_mm[:, 0] > 0.98
    assert right_um[right_side].mean() - left_um[right_side].mean() > 2.0


FILE = """schema = 1
name = "ours"

[process.response]
file = "{}"
pitch_um = 3.0
"""


def process_file(folder: Path, light: NDArray[np.float64], name: str = "pixel.csv") -> Path:
    if name.endswith(".csv"):
        np.savetxt(folder / name, light, delimiter=",", header="dark subtracted")
    else:
        Image.fromarray(np.rint(60_000 * light[::-1] / light.max()).astype(np.uint16)).save(folder / name)
    (folder / "ours.toml").write_text(FILE.format(name), encoding="utf-8")
    return folder / "ours.toml"


@pytest.mark.parametrize("name", ["pixel.csv", "pixel.png", "pixel.tif"])
def test_reads_a_response_from_a_table_or_an_image(tmp_path: Path, name: str) -> None:
    process = read_process(process_file(tmp_path, asymmetric(), name))
    assert process.process.sigma_um is None
    assert process.process.response is not None
    light = np.array(process.process.response.light)
    assert np.allclose(light / light.max(), asymmetric() / asymmetric().max(), atol=1e-5)
    assert process.source["response"] == f"measured: {name}"
    assert process.uncertainty["response_scale"] == 0.05, "the default"
    assert "response_scale" in process.assumptions
    assert "sigma_um" not in {*process.uncertainty, *process.assumptions}
    assert parsed_process(process_text(process), "copy").process == process.process


def test_refuses_a_response_with_conflicting_keys(tmp_path: Path) -> None:
    path = process_file(tmp_path, asymmetric())
    both = path.read_text(encoding="utf-8").replace("[process.resp", "[process]\nsigma_um = 12.0\n\n[process.resp")
    with pytest.raises(DataError, match=r"process\.sigma_um = 12\.0; .*process\.response"):
        parsed_process(both, "both", tmp_path)
    text = path.read_text(encoding="utf-8")
    with pytest.raises(DataError, match=r"uncertainty\.sigma_um = 3\.0"):
        parsed_process(text + "[uncertainty]\nsigma_um = 3.0\n", "both", tmp_path)
    with pytest.raises(DataError, match=r"process\.response\.file = 'pixel\.csv'; cannot be combined with .*light"):
        parsed_process(text + "light = [[1.0]]\n", "both", tmp_path)
    with pytest.raises(DataError, match=r"process\.response\.file = 3; must be the name of a file"):
        parsed_process(text.replace('"pixel.csv"', "3"), "both", tmp_path)
    for table in ("[process]\nresponse_scale = 1.1\n", "[uncertainty]\nresponse_scale = 0.1\n"):
        with pytest.raises(DataError, match="response"):
            parsed_process('schema = 1\nname = "ours"\n' + table, "none")
    with pytest.raises(DataError, match="halo_um = 5"):
        settings_with(asymmetric(), halo_um=5.0)
    with pytest.raises(DataError, match=r"asiga-max-x43.*27 µm"):
        with_printer(read_process(path), "asiga-max-x43")


INVALID_TABLES = {
    "no file": ("", "no such file"),
    "text": ("1 2 3\n4 five 6\n", "line 2, column 2 = 'five'"),
    "single row": ("1 2 3 4 5 6\n", "at least 5 rows"),
    "rows of two lengths": ("1 2 3 4 5\n" * 5 + "1 2\n", "same length"),
    "no light": ("0 0 0 0 0\n" * 6, "no sample above 0"),
    "negative light": ("0 0 0 0 0\n" * 3 + "0 0 9 -5 0\n" + "0 0 0 0 0\n" * 3, "dark image"),
    "background": ("3 3 3 3 3\n" * 3 + "3 3 9 3 3\n" + "3 3 3 3 3\n" * 3, "subtract the background"),
    "background at one side": ("3 0 0 0 0\n" * 3 + "3 0 90 0 0\n" + "3 0 0 0 0\n" * 3, "subtract the background"),
    "two decimal marks": ("0;0;0,5;0.5;0\n" * 6, "decimal mark"),
    "two separators": ("0 0 1 0 0\n" * 5 + "0;0;1;0;0\n", "line 6, column 1 = '0;0;1;0;0'"),
    "empty cell": ("0;0;1;0;0\n" * 5 + "0;;1;0;0\n", "line 6, column 2; .*finite"),
    "not a number": ("0 0 0 0 0\n" * 3 + "0 0 nan 0 0\n" + "0 0 0 0 0\n" * 3, "finite"),
}


@pytest.mark.parametrize("case", INVALID_TABLES)
def test_refuses_invalid_tables(tmp_path: Path, case: str) -> None:
    text, message = INVALID_TABLES[case]
    path = process_file(tmp_path, asymmetric())
    (tmp_path / "pixel.csv").write_text(text, encoding="utf-8")
    if not text:
        (tmp_path / "pixel.csv").unlink()
    with pytest.raises(DataError, match=message) as error:
        read_process(path)
    assert "\n" not in str(error.value)


def test_warns_of_a_hot_pixel_of_the_camera_and_not_of_a_narrow_response() -> None:
    def hot_pixel_warnings(light: NDArray[np.float64]) -> list[str]:
        process = Process(name="p", process=settings_with(light))
        return [line for line in process.warnings() if line.startswith("do not use: process.response")]

    light = gaussian_pixel(pixel=8.0, sigma=4.0)
    assert hot_pixel_warnings(light) == hot_pixel_warnings(gaussian_pixel()) == []
    light[10, 12] = 60.0 * light.max()
    (warning,) = hot_pixel_warnings(light)
    assert "row 11" in warning
    assert "13" in warning


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"centre_um": [600.0, 60.0]}, r"centre_um.*within the table"),
        ({"pitch_um": 8.0}, "pitch_um = 8.0; .*4 samples per pixel"),
        ({"pitch_um": 0.05}, "check pitch_um"),
        ({"pitch_um": 3.0, "file": "pixel.csv"}, r"response\.file"),
    ],
)
def test_refuses_samples_that_contradict_the_pixel(table: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        _ = settings_with(asymmetric(), table=table).blur_um


def test_refuses_unsuitable_images(tmp_path: Path) -> None:
    grey = Image.fromarray(np.rint(200 * asymmetric() / asymmetric().max()).astype(np.uint8))
    overexposed = Image.fromarray((np.minimum(asymmetric(), 0.5) / 0.5 * 255).astype(np.uint8))
    colour = Image.fromarray(np.zeros((9, 9, 3), np.uint8))
    (tmp_path / "ours.toml").write_text(FILE.format("pixel.png"), encoding="utf-8")
    for image, message in ((overexposed, "overexposed"), (colour, "single-channel"), (grey.convert("P"), "palette")):
        image.save(tmp_path / "pixel.png")
        with pytest.raises(DataError, match=message):
            read_process(tmp_path / "ours.toml")
    (tmp_path / "ours.toml").write_text(FILE.format("pixel.tif"), encoding="utf-8")
    grey.save(tmp_path / "pixel.tif", save_all=True, append_images=[grey])
    with pytest.raises(DataError, match=r"single image.* 2 pages"):
        read_process(tmp_path / "ours.toml")


@pytest.mark.parametrize(
    ("separator", "mark"), [(";", ","), ("\t", ","), (" ", ","), (", ", "."), (";", "."), (",", ".")]
)
def test_reads_tables_with_other_separators_and_decimal_marks(tmp_path: Path, separator: str, mark: str) -> None:
    path, light = process_file(tmp_path, asymmetric()), np.round(asymmetric(), 5)
    lines = [separator.join(f"{value:.5f}".replace(".", mark) for value in row) for row in light.tolist()]
    (tmp_path / "pixel.csv").write_text("\n".join(["# dark subtracted", *lines, ""]), encoding="utf-8")
    response = read_process(path).process.response
    assert response is not None
    assert np.array_equal(response.light, light)


def test_sources_contain_the_file_of_a_response(tmp_path: Path) -> None:
    path = process_file(tmp_path, asymmetric())
    sources = process_of(PrintOptions(process=path))[1]
    assert [source.file for source in sources] == ["ours.toml", "pixel.csv"]
    assert sources[1].sha256 == hashlib.sha256((tmp_path / "pixel.csv").read_bytes()).hexdigest()
    assert files_read(path, None) == [path, tmp_path / "pixel.csv", None]


def test_coupons_calibrate_the_scale_of_a_response() -> None:
    true = settings_with(asymmetric(), response_scale=1.12, Ec_mJ_per_cm2=3.2)
    features = [MeasuredFeature("pillar", mm, mm, 0.002, True) for mm in (0.06, 0.1, 0.5)]
    features += [MeasuredFeature("hole", mm, mm, 0.002, True) for mm in (0.15, 0.4)]
    features += [MeasuredFeature("gap", 0.15, 0.15, 0.002, True)]
    sizes = printed_mm(true, features)
    printed = [replace(each, measured_mm=float(mm)) for each, mm in zip(features, sizes, strict=True) if mm > 0.0]
    uncertainty = {key: u for key, u in default_process().uncertainty.items() if key != "sigma_um"}
    uncertainty["response_scale"] = 0.05
    process = Process(name="test", process=settings_with(asymmetric()), uncertainty=uncertainty)
    result = calibrated(process, [MeasuredCoupon(tuple(printed), SharedScale(2.0, 1e-4))], "test")
    scale = result.numbers[0]
    assert scale.key == "response_scale"
    assert scale.value == pytest.approx(1.12, abs=2.0 * scale.u)
    assert scale.u < 0.12
    assert result.settings.sigma_um is None
    copy = parsed_process(process_text(result.process), "copy")
    assert copy.process.response == process.process.response
    assert copy.covariance()[0][0] == "response_scale"


def test_compensates_an_asymmetric_response() -> None:
    target, rings = round_target(0.8), [ring(0.8)]
    process = settings_with(asymmetric(), **HALO)
    before = FlatPrint.of(rings, target, process, 0.5).offsets_um(230.0)
    x = target.outward[:, 0]
    assert before[x < -0.9].mean() - before[x > 0.9].mean() > 5.0  # the peak is left of the centroid
    correction = np.zeros_like(before)
    for _ in range(8):
        correction -= FlatPrint.of([target.displaced(correction)], target, process, 0.5).offsets_um(230.0)
    after = FlatPrint.of([target.displaced(correction)], target, process, 0.5).offsets_um(230.0)
    assert np.sqrt(np.mean(after**2)) < 0.1 * np.sqrt(np.mean(before**2))
