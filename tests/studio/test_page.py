"""The page in a browser: what it shows is what solen computes, and it can be used by keyboard alone."""

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
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
)
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (BROWSER and shutil.which("node") and (WEB / "node_modules" / "playwright-core").is_dir()),
        reason="needs Chromium, Node, and `npm ci` in web/",
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
LEFT = FLAT.replace("1.44", "1.45")


@contextmanager
def served(file: Path) -> Iterator[str]:
    server, listening, page = server_at(Document(file), shown=printed)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        yield page
    finally:
        server.should_exit = True
        thread.join(10)
        listening.close()


def driven(file: Path, folder: Path, extent: str) -> dict[str, Any]:
    """What a browser saw that used the page as `DRIVER` says."""
    with served(file) as page:
        exported = folder / "page.html"
        further = [exported.as_uri()] if exported.exists() else []
        command = [str(shutil.which("node")), str(DRIVER), page, str(folder), BROWSER, extent, *further]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    seen: dict[str, Any] = json.loads(done.stdout)
    return seen


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def seen(folder: Path) -> dict[str, Any]:
    (folder / "sensor.toml").write_text(FLAT, encoding="utf-8")
    (folder / "sensor-unsaved.toml").write_text(LEFT, encoding="utf-8")
    found = sliders(load(folder / "sensor.toml"), SlidersOptions(over=("lens.focus_mm=18,22",), drawn_rays=20))
    (folder / "page.html").write_text(html(found), encoding="utf-8")
    return driven(folder / "sensor.toml", folder, "quick")


def test_nothing_is_wrong_with_the_page(seen: dict[str, Any]) -> None:
    assert seen["problems"] == []
    assert seen["foreign"] == [], "no request leaves the computer"
    assert seen["axe"] == [], "usable without sight"
    assert seen["overflow"] == [], "all of it fits 1024 x 700"
    assert seen["overlaid"] is False


def test_the_first_visit_takes_three_sentences(seen: dict[str, Any]) -> None:
    assert len(seen["guide"]) == 3
    assert seen["guide_left"] == 0


def test_what_was_left_unsaved_is_offered(seen: dict[str, Any], folder: Path) -> None:
    assert "sensor-unsaved.toml" in seen["offered"]
    assert seen["offers_left"] == 0
    assert (folder / "sensor-unsaved.toml").read_text(encoding="utf-8") == LEFT


def test_the_keyboard_turns_the_lens(seen: dict[str, Any]) -> None:
    assert seen["turned"] == "0.30°"
    assert seen["focus_outline"] == "solid"


def number(text: str) -> tuple[float, float]:
    """Value and uncertainty as the page writes them."""
    value, _, u = text.replace("−", "-").partition(" ± ")
    return float(value), float(u)


def test_the_plane_is_said_to_mislead(seen: dict[str, Any], folder: Path) -> None:
    assert load(folder / "sensor.toml").lens.focus_mm == 25.0
    assert "plane" in seen["misleading"]
    assert "plane" in seen["quality"]


@pytest.fixture
def commanded(capsys: pytest.CaptureFixture[str]) -> Callable[[str], dict[str, Any]]:
    """What a command line answers as JSON."""

    def run(line: str) -> dict[str, Any]:
        assert run_command([*shlex.split(line)[1:], "--json"]) == 0
        found: dict[str, Any] = json.loads(capsys.readouterr().out)
        return found

    return run


def test_a_search_shows_what_its_command_prints(
    seen: dict[str, Any], commanded: Callable[[str], dict[str, Any]]
) -> None:
    assert "lens.focus_mm=18.8:31.2" in seen["suggested"]
    assert 0.0 <= seen["share"] < 1.0, "it was shown as it grew"
    found = commanded(seen["search"])
    assert found["traced"] == 0, "nothing is traced twice"
    rows = [row.split("\t")[1:] for row in seen["designs"]]
    assert len(rows) == 1 + len(found["designs"])
    for shown, one in zip(rows, [found["before"], *found["designs"]], strict=True):
        for cell, goal, u in zip(shown, one["goals"], one["u_goals"], strict=True):
            value, shown_u = number(cell)
            assert value == pytest.approx(goal, abs=shown_u)
            assert shown_u == pytest.approx(u, rel=0.5)
    free = found["designs"][-1]["free"]
    assert [float(one) for one in seen["taken"]] == pytest.approx([free["lens.focus_mm"], free["emitter.offset_mm"]])


def test_merits_shown_are_those_of_commands(
    seen: dict[str, Any], folder: Path, commanded: Callable[[str], dict[str, Any]]
) -> None:
    """What the page traced by samples, from the same design integrated by commands: contrast, and each merit."""
    file = folder / "sensor.toml"
    exact = commanded(seen["search"])["before"]["merits"]
    for column, further in enumerate(("", " --no-lens")):
        for name, angle in (("from", -3), ("to", 3)):
            line = f"solen trace {file} --mode power --sampling adaptive --angle-deg {angle}{further}"
            right, left = (commanded(line)["detectors"][side]["power"] for side in ("right", "left"))
            value, u = number(seen["merits"][name][column])
            assert value == pytest.approx((right - left) / (right + left), abs=4 * u + 1e-3)
            assert 0 < u < 0.005
    for name in ("slope_per_deg", "null_deg", "span", "linearity_percent", "light"):
        value, u = number(seen["merits"][name][0])
        assert u > 0
        assert value == pytest.approx(exact[name], abs=4 * u + 4 * exact[f"u_{name}"]), name


def test_the_same_is_offered_elsewhere(seen: dict[str, Any], folder: Path) -> None:
    assert "--set lens.focus_mm=25" in seen["unsaved"][0]
    assert seen["same"][0] == f"solen run {folder / 'sensor.toml'} --out sensor-run"
    assert "lens.focus_mm" in seen["unsaved"][1]


def test_what_matters_is_ranked(seen: dict[str, Any], folder: Path) -> None:
    exact = {one.key: one for one in tolerance_effects(Sensor.of(load(folder / "sensor.toml")))}
    first = max(exact.values(), key=lambda one: one.largest)
    words, change, _ = seen["matters"][0].split("\t")
    assert words.startswith(first.key.replace(".", " ").rsplit("_", 1)[0].replace("_", " "))
    value, u = number(change)
    assert value == pytest.approx(first.largest, abs=2 * u)


def test_a_file_keeps_its_comments_and_a_refused_number_changes_nothing(seen: dict[str, Any], folder: Path) -> None:
    assert float(seen["offset"]) > 0.01, "dragged"
    assert seen["coordinates"].startswith("emitter  x 0."), "of what is in use"
    assert "lens.focus_mm" in seen["refused"]
    assert float(seen["focus_shown"]) == float(seen["focus_kept"]) == 25.0
    assert "sensor.toml" in seen["saved"]
    text = (folder / "sensor.toml").read_text(encoding="utf-8")
    assert text.startswith("schema = 1  # mine\n")
    assert loads(text).emitter.offset_mm == 0.0, "the drag was undone"


def test_the_drawing_is_kept_as_svg(seen: dict[str, Any], folder: Path) -> None:
    drawn = ET.parse(folder / "drawing.svg").getroot()  # noqa: S314  its own
    assert seen["saved"]
    assert len(drawn.findall(".//{*}path")) > 5


def test_the_response_is_kept_as_svg_and_png(seen: dict[str, Any], folder: Path) -> None:
    """A curve drawn in the scale of its own ticks ends at the contrasts that the page states."""
    drawn = ET.parse(folder / "response.svg").getroot()  # noqa: S314  its own
    ticks = {}
    for mark, label in pairwise(drawn):
        if label.tag.endswith("text") and label.get("text-anchor") == "end":
            ticks[float(mark.attrib["d"].split()[1].partition("h")[0])] = float(str(label.text).replace("−", "-"))
    (low, least), (high, largest) = min(ticks.items()), max(ticks.items())
    (curve,) = (one for one in drawn if one.get("stroke-width") == "2.5")
    y = [float(point.split()[1]) for point in curve.attrib["d"].removeprefix("M").split("L")]
    assert len(y) == 7, "an angle each"
    for place, name in ((0, "from"), (-1, "to")):
        value, _ = number(seen["merits"][name][0])
        assert least + (y[place] - low) / (high - low) * (largest - least) == pytest.approx(value, abs=0.01)
    assert (folder / "response.png").read_bytes().startswith(b"\x89PNG")


def test_a_page_without_a_server_shows_the_numbers_of_its_sliders(seen: dict[str, Any]) -> None:
    exact = Sensor.of(loads(FLAT).set(focus_mm=22.0)).power([-3.0, 3.0])
    assert seen["player"]["angle"] == "1°"
    for name, place in (("from", 0), ("to", 1)):
        value, u = number(seen["player"][name])
        assert value == pytest.approx(exact.contrast[place], abs=4 * u + 1e-3)


def test_the_tab_of_the_resin_shows_what_its_command_answers(
    seen: dict[str, Any], folder: Path, commanded: Callable[[str], dict[str, Any]]
) -> None:
    assert seen["tabs"] == ["Resin"]
    assert "--irradiance-mW-per-cm2" in seen["lacking"], "the command's line"
    found, shown = commanded(seen["resin"]["same"][0]), seen["resin"]
    rows = {name: value for name, value in shown["rows"] if value}
    for name in ("Dp_um", "Ec_mJ_per_cm2", "discs", "sd_thickness_um"):
        value, _, u = rows[name].partition(" ± ")
        assert float(value) == found[name]
        assert not u or float(u) == found[f"u_{name}"]
    assert len(rows) > 10
    assert shown["lines"][0].startswith(f"Dp {found['Dp_um']:.4g} µm")
    assert shown["figure"] > 300
    assert commanded(f"solen resin show {folder / 'mine.toml'}")["cure"]["Dp_um"] == found["Dp_um"]
    assert "resin mine" in shown["unusable"], "it has no index"


def test_the_tab_of_the_print_shows_the_part_and_its_layers(
    seen: dict[str, Any], commanded: Callable[[str], dict[str, Any]]
) -> None:
    part = commanded(seen["part"]["same"][0])
    assert int(seen["part"]["triangles"]) == part["mesh"]["triangles"]
    assert float(dict(seen["part"]["rows"])["volume_mm3"]) == part["volume_mm3"]
    found = commanded(seen["layers"]["same"][0])
    assert seen["layers"]["of"] == f"1 of {found['layers']}"
    assert f"exposed for {found['settings']['burn_in_exposure_s']:g} s" in seen["layers"]["exposed"]
    assert float(dict(seen["layers"]["rows"])["volume_error"]) == found["volume_error"]


def test_the_tab_of_the_microscope_measures_between_two_marks(
    seen: dict[str, Any], commanded: Callable[[str], dict[str, Any]]
) -> None:
    """The marks are set in pixels of the micrograph, whatever size it is shown at."""
    x0, z0, x1, z1, length_um = seen["bar"]
    assert [x0, z0, x1, z1] == pytest.approx([74.0, 324.0, 602.0, 324.0], abs=2.0), "of 740 x 360 pixels"
    assert length_um == 3100.0
    found, shown = commanded(seen["microscope"]["same"][0]), seen["microscope"]
    rows = {name: value for name, value in shown["rows"] if value}
    assert found["scale"]["um_per_px"] == pytest.approx(3100.0 / (x1 - x0))
    for name in ("scale.um_per_px", "deviation.rms_um", "deviation.max_um"):
        table, key = name.split(".")
        assert float(rows[name].partition(" ± ")[0]) == found[table][key]
    assert shown["figure"] > 300
    assert seen["lens"] == "sensor-studio/inspect-2/lens.json"


def test_the_tab_of_the_bench_shows_what_its_command_answers(
    seen: dict[str, Any], commanded: Callable[[str], dict[str, Any]]
) -> None:
    found, shown = commanded(seen["bench"]["same"][0]), seen["bench"]
    rows = {name: value for name, value in shown["rows"] if value}
    numbers = {name for name in rows if name.startswith("sensors.S1.receivers.left.") and name.endswith("_V")}
    assert numbers
    left = found["sensors"]["S1"]["receivers"]["left"]
    for name in numbers:
        assert float(rows[name].partition(" ± ")[0]) == left[name.rpartition(".")[2]]
    assert shown["figure"] > 300


@pytest.mark.evidence
def test_how_long_a_drag_takes(tmp_path: Path) -> None:
    """From a request to what is drawn, in a browser on this computer, and the same without the compiled batch."""
    found = driven(tmp_path / "sensor.toml", tmp_path, "whole")
    print(f"first paint {found['paint_ms']:.0f} ms; screenshots in {tmp_path}")
    for where in ("plane", "space"):
        times = found[f"{where}_ms"]
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

    ways = {}
    for name, way in (("batch", compiled), ("scene by scene", uncompiled)):
        way(0.001)
        taken = []
        for n in range(20):
            begun = time.perf_counter(), time.process_time()
            way(0.002 + 0.001 * n)
            taken.append((1e3 * (time.perf_counter() - begun[0]), 1e3 * (time.process_time() - begun[1])))
        ways[name] = [median(column) for column in zip(*taken, strict=True)]
        print(f"picture and response, {name}: median {ways[name][0]:.1f} ms, of a processor {ways[name][1]:.1f} ms")
    ratios = [batch / other for batch, other in zip(*ways.values(), strict=True)]
    print(f"ratio {ratios[0]:.2f}, of a processor's time {ratios[1]:.2f}")
    assert found["problems"] == []
    assert found["axe"] == []
