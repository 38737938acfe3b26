"""The page in a browser: its values agree with the commands, and it can be used with the keyboard alone."""

import json
import shlex
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median, quantiles
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from solen.cli import run_command
from solen.cli.design.studio import printed
from solen.explore.live import COARSE_RAYS, coarse
from solen.explore.sliders import SlidersOptions, sliders
from solen.explore.tolerance_effects import tolerance_effects
from solen.report.design.player import html
from solen.sensor import Sensor, in_plane, picture
from solen.spec import load, loads, template
from solen.studio.document import Document
from solen.studio.server import server_at

WEB = Path(__file__).resolve().parents[2] / "web"
DRIVER = WEB / "tests" / "page.mjs"
BROWSER = next(
    (result for name in ("chromium", "chromium-browser", "google-chrome") if (result := shutil.which(name))), ""
)
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (BROWSER and shutil.which("node") and (WEB / "node_modules" / "playwright-core").is_dir()),
        reason="requires Chromium, Node, and `npm ci` in web/",
    ),
]
FLAT = """schema = 1  # mine
name = "flat"
[material]
index = 1.44
[emitter]
width_mm = 0.2
[motion]
step_deg = 1.0
"""
UNSAVED = FLAT.replace("1.44", "1.45")


@contextmanager
def served(file: Path) -> Iterator[str]:
    server, listening, page = server_at(Document(file), printed_lines=printed)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        yield page
    finally:
        server.should_exit = True
        thread.join(10)
        listening.close()


def drive_browser(file: Path, folder: Path, extent: str) -> dict[str, Any]:
    """Observations of a browser that uses the page according to `DRIVER`."""
    with served(file) as page:
        exported = folder / "page.html"
        exported_page = [exported.as_uri()] if exported.exists() else []
        command = [str(shutil.which("node")), str(DRIVER), page, str(folder), BROWSER, extent, *exported_page]
        process = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert process.returncode == 0, process.stderr
    observed: dict[str, Any] = json.loads(process.stdout)
    return observed


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def observed(folder: Path) -> dict[str, Any]:
    (folder / "sensor.toml").write_text(FLAT, encoding="utf-8")
    (folder / "sensor-unsaved.toml").write_text(UNSAVED, encoding="utf-8")
    result = sliders(load(folder / "sensor.toml"), SlidersOptions(over=("lens.focus_mm=18,22",), drawn_rays=20))
    (folder / "page.html").write_text(html(result), encoding="utf-8")
    return drive_browser(folder / "sensor.toml", folder, "quick")


def test_page_has_no_problems(observed: dict[str, Any]) -> None:
    assert observed["problems"] == []
    assert observed["foreign"] == [], "no request leaves the computer"
    assert observed["axe"] == [], "accessible"
    assert observed["overflow"] == [], "everything fits into 1024 x 700 pixels"
    assert observed["overlaid"] is False


def test_guide_has_three_sentences(observed: dict[str, Any]) -> None:
    assert len(observed["guide"]) == 3
    assert observed["guide_left"] == 0


def test_offers_earlier_unsaved_changes(observed: dict[str, Any], folder: Path) -> None:
    assert "sensor-unsaved.toml" in observed["offered"]
    assert observed["offers_left"] == 0
    assert (folder / "sensor-unsaved.toml").read_text(encoding="utf-8") == UNSAVED


def test_keyboard_turns_lens(observed: dict[str, Any]) -> None:
    assert observed["turned"] == "0.30°"
    assert observed["focus_outline"] == "solid"


def number(text: str) -> tuple[float, float]:
    """Value and uncertainty from a text on the page."""
    value, _, u = text.replace("−", "-").partition(" ± ")
    return float(value), float(u)


def test_warns_that_plane_is_misleading(observed: dict[str, Any], folder: Path) -> None:
    assert load(folder / "sensor.toml").lens.focus_mm == 25.0
    assert "plane" in observed["misleading"]
    assert "plane" in observed["quality"]


@pytest.fixture
def run_json(capsys: pytest.CaptureFixture[str]) -> Callable[[str], dict[str, Any]]:
    """Function that runs a command line and returns its JSON."""

    def run(line: str) -> dict[str, Any]:
        assert run_command([*shlex.split(line)[1:], "--json"]) == 0
        result: dict[str, Any] = json.loads(capsys.readouterr().out)
        return result

    return run


def test_search_agrees_with_command(observed: dict[str, Any], run_json: Callable[[str], dict[str, Any]]) -> None:
    assert "lens.focus_mm=18.8:31.2" in observed["suggested"]
    assert 0.0 <= observed["share"] < 1.0, "the front was shown as it grew"
    result = run_json(observed["search"])
    assert result["traced"] == 0, "nothing is traced twice"
    rows = [row.split("\t")[1:] for row in observed["designs"]]
    assert len(rows) == 1 + len(result["designs"])
    for printed_lines, item in zip(rows, [result["before"], *result["designs"]], strict=True):
        for cell, goal, u in zip(printed_lines, item["goals"], item["u_goals"], strict=True):
            value, shown_u = number(cell)
            assert value == pytest.approx(goal, abs=shown_u)
            assert shown_u == pytest.approx(u, rel=0.5)
    free = result["designs"][-1]["free"]
    assert [float(item) for item in observed["taken"]] == pytest.approx(
        [free["lens.focus_mm"], free["emitter.offset_mm"]]
    )


def test_merits_agree_with_commands(
    observed: dict[str, Any], folder: Path, run_json: Callable[[str], dict[str, Any]]
) -> None:
    """The contrasts and merits traced by the page agree with those integrated by commands."""
    file = folder / "sensor.toml"
    reference = run_json(observed["search"])["before"]["merits"]
    for column, exported_page in enumerate(("", " --no-lens")):
        for name, angle in (("from", -3), ("to", 3)):
            line = f"solen trace {file} --mode power --sampling adaptive --angle-deg {angle}{exported_page}"
            right, left = (run_json(line)["detectors"][side]["power"] for side in ("right", "left"))
            value, u = number(observed["merits"][name][column])
            assert value == pytest.approx((right - left) / (right + left), abs=4 * u + 1e-3)
            assert 0 < u < 0.005
    for name in ("slope_per_deg", "null_deg", "span", "linearity_percent", "light"):
        value, u = number(observed["merits"][name][0])
        assert u > 0
        assert value == pytest.approx(reference[name], abs=4 * u + 4 * reference[f"u_{name}"]), name


def test_shows_command_line_and_script(observed: dict[str, Any], folder: Path) -> None:
    assert "--set lens.focus_mm=25" in observed["unsaved"][0]
    assert observed["same"][0] == f"solen run {folder / 'sensor.toml'} --out sensor-run"
    assert "lens.focus_mm" in observed["unsaved"][1]


def test_tolerances_are_ranked(observed: dict[str, Any], folder: Path) -> None:
    reference = {item.key: item for item in tolerance_effects(Sensor.of(load(folder / "sensor.toml")))}
    first = max(reference.values(), key=lambda item: item.largest)
    label, change, _ = observed["matters"][0].split("\t")
    assert label.startswith(first.key.replace(".", " ").rsplit("_", 1)[0].replace("_", " "))
    value, u = number(change)
    assert value == pytest.approx(first.largest, abs=2 * u)


def test_saving_keeps_comments_and_invalid_value_changes_nothing(observed: dict[str, Any], folder: Path) -> None:
    assert float(observed["offset"]) > 0.01, "dragged"
    assert observed["coordinates"].startswith("emitter  x 0."), "coordinates of the dragged handle"
    assert "lens.focus_mm" in observed["refused"]
    assert float(observed["focus_shown"]) == float(observed["focus_kept"]) == 25.0
    assert "sensor.toml" in observed["saved"]
    text = (folder / "sensor.toml").read_text(encoding="utf-8")
    assert text.startswith("schema = 1  # mine\n")
    assert loads(text).emitter.offset_mm == 0.0, "the drag was undone"


def test_drawing_is_saved_as_svg(observed: dict[str, Any], folder: Path) -> None:
    root = ET.parse(folder / "drawing.svg").getroot()  # noqa: S314  own file
    assert observed["saved"]
    assert len(root.findall(".//{*}path")) > 5


def test_response_is_saved_as_svg_and_png(observed: dict[str, Any], folder: Path) -> None:
    """The ends of the curve, in the scale of the ticks, are the contrasts shown on the page."""
    root = ET.parse(folder / "response.svg").getroot()  # noqa: S314  own file
    ticks = {}
    for mark, label in pairwise(root):
        if label.tag.endswith("text") and label.get("text-anchor") == "end":
            ticks[float(mark.attrib["d"].split()[1].partition("h")[0])] = float(str(label.text).replace("−", "-"))
    (low, least), (high, largest) = min(ticks.items()), max(ticks.items())
    (curve,) = (item for item in root if item.get("stroke-width") == "2.5")
    y = [float(point.split()[1]) for point in curve.attrib["d"].removeprefix("M").split("L")]
    assert len(y) == 7, "one point per angle"
    for index, name in ((0, "from"), (-1, "to")):
        value, _ = number(observed["merits"][name][0])
        assert least + (y[index] - low) / (high - low) * (largest - least) == pytest.approx(value, abs=0.01)
    assert (folder / "response.png").read_bytes().startswith(b"\x89PNG")


def test_exported_page_shows_values_of_sliders(observed: dict[str, Any]) -> None:
    reference = Sensor.of(loads(FLAT).set(focus_mm=22.0)).power([-3.0, 3.0])
    assert observed["player"]["angle"] == "1°"
    for name, index in (("from", 0), ("to", 1)):
        value, u = number(observed["player"][name])
        assert value == pytest.approx(reference.contrast[index], abs=4 * u + 1e-3)


def test_resin_tab_agrees_with_command(
    observed: dict[str, Any], folder: Path, run_json: Callable[[str], dict[str, Any]]
) -> None:
    assert observed["tabs"] == ["Resin"]
    assert "--irradiance-mW-per-cm2" in observed["lacking"], "the error of the command"
    result, printed_lines = run_json(observed["resin"]["same"][0]), observed["resin"]
    rows = {name: value for name, value in printed_lines["rows"] if value}
    for name in ("Dp_um", "Ec_mJ_per_cm2", "discs", "sd_thickness_um"):
        value, _, u = rows[name].partition(" ± ")
        assert float(value) == result[name]
        assert not u or float(u) == result[f"u_{name}"]
    assert len(rows) > 10
    assert printed_lines["lines"][0].startswith(f"Dp {result['Dp_um']:.4g} µm")
    assert printed_lines["figure"] > 300
    assert run_json(f"solen resin show {folder / 'mine.toml'}")["cure"]["Dp_um"] == result["Dp_um"]
    assert "resin mine" in printed_lines["unusable"], "the resin has no index"


def test_print_tab_shows_part_and_layers(observed: dict[str, Any], run_json: Callable[[str], dict[str, Any]]) -> None:
    part = run_json(observed["part"]["same"][0])
    assert int(observed["part"]["triangles"]) == part["mesh"]["triangles"]
    assert float(dict(observed["part"]["rows"])["volume_mm3"]) == part["volume_mm3"]
    result = run_json(observed["layers"]["same"][0])
    assert observed["layers"]["of"] == f"1 of {result['layers']}"
    assert f"exposed for {result['settings']['burn_in_exposure_s']:g} s" in observed["layers"]["exposed"]
    assert float(dict(observed["layers"]["rows"])["volume_error"]) == result["volume_error"]


def test_microscope_tab_measures_between_two_marks(
    observed: dict[str, Any], run_json: Callable[[str], dict[str, Any]]
) -> None:
    """The marks are in pixels of the image, independently of its size on the page."""
    x0, z0, x1, z1, length_um = observed["bar"]
    assert [x0, z0, x1, z1] == pytest.approx([74.0, 324.0, 602.0, 324.0], abs=2.0), "of 740 x 360 pixels"
    assert length_um == 3100.0
    result, printed_lines = run_json(observed["microscope"]["same"][0]), observed["microscope"]
    rows = {name: value for name, value in printed_lines["rows"] if value}
    assert result["scale"]["um_per_px"] == pytest.approx(3100.0 / (x1 - x0))
    for name in ("scale.um_per_px", "deviation.rms_um", "deviation.max_um"):
        table, key = name.split(".")
        assert float(rows[name].partition(" ± ")[0]) == result[table][key]
    assert printed_lines["figure"] > 300
    assert observed["lens"] == "sensor-studio/inspect-2/lens.json"


def test_bench_tab_agrees_with_command(observed: dict[str, Any], run_json: Callable[[str], dict[str, Any]]) -> None:
    result, printed_lines = run_json(observed["bench"]["same"][0]), observed["bench"]
    rows = {name: value for name, value in printed_lines["rows"] if value}
    numbers = {name for name in rows if name.startswith("sensors.S1.receivers.left.") and name.endswith("_V")}
    assert numbers
    left = result["sensors"]["S1"]["receivers"]["left"]
    for name in numbers:
        assert float(rows[name].partition(" ± ")[0]) == left[name.rpartition(".")[2]]
    assert printed_lines["figure"] > 300


@pytest.mark.evidence
def test_duration_of_drag(tmp_path: Path) -> None:
    """Time from a request to the drawing in a browser on this computer, and the same without the compiled batch."""
    result = drive_browser(tmp_path / "sensor.toml", tmp_path, "whole")
    print(f"first paint {result['paint_ms']:.0f} ms; screenshots in {tmp_path}")
    for where in ("plane", "space"):
        times = result[f"{where}_ms"]
        print(f"{where}: median {median(times):.1f} ms, p95 {quantiles(times, n=20)[-1]:.1f} ms of {len(times)} drawn")
    flat = in_plane(Sensor.of(loads(template("solen-860"))))
    angles = flat.design.motion.angles_deg()[::2]

    def compiled(offset: float) -> None:
        moved = flat.set(offset_mm=offset)
        picture(moved)
        coarse(moved)

    def uncompiled(offset: float) -> None:
        moved = flat.set(offset_mm=offset)
        picture(moved)
        for angle in angles:
            moved.trace(angle, "power", COARSE_RAYS)

    timings = {}
    for name, method in (("batch", compiled), ("scene by scene", uncompiled)):
        method(0.001)
        times = []
        for n in range(20):
            start = time.perf_counter(), time.process_time()
            method(0.002 + 0.001 * n)
            times.append((1e3 * (time.perf_counter() - start[0]), 1e3 * (time.process_time() - start[1])))
        timings[name] = [median(column) for column in zip(*times, strict=True)]
        print(
            f"picture and response, {name}: median {timings[name][0]:.1f} ms, of a processor {timings[name][1]:.1f} ms"
        )
    ratios = [batch / other for batch, other in zip(*timings.values(), strict=True)]
    print(f"ratio {ratios[0]:.2f}, of a processor's time {ratios[1]:.2f}")
    assert result["problems"] == []
    assert result["axe"] == []
