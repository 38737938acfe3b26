"""The report as a browser lays it out, with no network."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from solen.fabricate import SolidFiles
from solen.report.design.html import html
from tests.report.conftest import Drawn, Studies

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
PROBE = """<script>addEventListener("load", () => {
  document.querySelectorAll("details").forEach(one => one.open = true);
  const box = one => { const b = one.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; };
  const found = {
    headings: [...document.querySelectorAll("h1, h2")].filter(one => one.offsetHeight > 0).map(one => one.textContent),
    figures: [...document.querySelectorAll("figure > svg")].map(box),
    alts: [...document.querySelectorAll("figure > svg")].map(one => one.getAttribute("aria-label")),
    pixels: [...document.querySelectorAll("figure > svg text")].map(one => {
      const own = one.ownerSVGElement;
      const shown = own.getBoundingClientRect().width / own.viewBox.baseVal.width;
      return shown * parseFloat(getComputedStyle(one).fontSize);
    }),
    scrolled: [...document.querySelectorAll("figure, .scroll")].every(one => one.clientWidth <= innerWidth),
    page: getComputedStyle(document.body).backgroundColor,
    ink: getComputedStyle(document.body).color,
    links: [...document.querySelectorAll("dd a")].map(one => one.getAttribute("href")),
    captions: [...document.querySelectorAll("figcaption")].map(box),
    findings: [...document.querySelectorAll("dd")].filter(one => one.offsetHeight > 0).length,
    rows: document.querySelectorAll("details tbody tr").length,
    loaded: performance.getEntriesByType("resource").map(one => one.name).filter(name => !name.startsWith("data:")),
    width: innerWidth,
    wide: document.documentElement.scrollWidth,
  };
  const place = document.createElement("pre");
  place.id = "probe";
  place.textContent = JSON.stringify(found);
  document.body.append(place);
});</script>"""

SOLID = SolidFiles({"sensor.stl": b"", "sensor.3mf": b""})

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")


def laid_out(text: str, folder: Path, width: int, *flags: str) -> Any:
    """What the probe finds in the page, laid out in a window of that width."""
    page = folder / "the report.html"
    page.write_text(text.replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
    own = [f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900", "--dump-dom", page.as_uri()]
    assert CHROMIUM is not None
    done = subprocess.run([CHROMIUM, *FLAGS, *flags, *own], capture_output=True, timeout=50, check=True)
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout.decode("utf-8"), re.DOTALL)
    assert found, done.stderr.decode("utf-8", "replace")[-500:]
    return json.loads(unescape(found[1]))


@pytest.mark.parametrize("width", [1200, 520])
def test_the_report_renders_with_all_figures_and_headings(
    studied: Studies, drawn: Drawn, tmp_path: Path, width: int
) -> None:
    texts = drawn("paper")
    found = laid_out(html(studied("paper"), texts, SOLID), tmp_path, width)
    assert found["headings"] == [
        *("Paper 860 nm", "What to expect", "What matters", "What to do", "Response", "Background", "Rays"),
        "Lens and body",
    ]
    assert len(found["figures"]) == len(found["captions"]) == len(texts) == 7
    for (left, top, wide, high), caption in zip(found["figures"], found["captions"], strict=True):
        assert wide > 300
        assert high > 80
        assert left >= 0
        assert caption[1] >= top + high - 1
    assert found["scrolled"], "a figure or a table is wider than the window, and does not scroll by itself"
    assert min(found["pixels"]) >= (6.0 if width < 600 else 8.0)
    assert [len(alt) > 20 for alt in found["alts"]] == [True] * 7
    assert found["links"] == ["sensor.stl", "sensor.3mf"]
    assert found["findings"] == 11
    assert found["rows"] == 3
    assert found["loaded"] == []
    assert found["wide"] <= found["width"], "the page scrolls sideways"


def test_the_report_is_dark_where_the_reader_wants_it(studied: Studies, drawn: Drawn, tmp_path: Path) -> None:
    found = laid_out(html(studied("paper"), drawn("paper")), tmp_path, 1200, "--blink-settings=preferredColorScheme=0")
    page, ink = ([int(part) for part in re.findall(r"\d+", found[name])[:3]] for name in ("page", "ink"))
    assert max(page) < 64
    assert min(ink) > 190
