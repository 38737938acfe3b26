"""Layout of the report in a browser without a network."""

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
  document.querySelectorAll("details").forEach(each => each.open = true);
  const box = each => { const b = each.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; };
  const layout = {
    headings: [...document.querySelectorAll("h1, h2")].filter(h => h.offsetHeight > 0).map(h => h.textContent),
    figures: [...document.querySelectorAll("figure > svg")].map(box),
    alts: [...document.querySelectorAll("figure > svg")].map(svg => svg.getAttribute("aria-label")),
    pixels: [...document.querySelectorAll("figure > svg text")].map(text => {
      const svg = text.ownerSVGElement;
      const scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
      return scale * parseFloat(getComputedStyle(text).fontSize);
    }),
    scrolled: [...document.querySelectorAll("figure, .scroll")].every(each => each.clientWidth <= innerWidth),
    page: getComputedStyle(document.body).backgroundColor,
    ink: getComputedStyle(document.body).color,
    links: [...document.querySelectorAll("dd a")].map(link => link.getAttribute("href")),
    captions: [...document.querySelectorAll("figcaption")].map(box),
    findings: [...document.querySelectorAll("dd")].filter(dd => dd.offsetHeight > 0).length,
    rows: document.querySelectorAll("details tbody tr").length,
    loaded: performance.getEntriesByType("resource").map(each => each.name).filter(name => !name.startsWith("data:")),
    width: innerWidth,
    content_width: document.documentElement.scrollWidth,
  };
  const result = document.createElement("pre");
  result.id = "probe";
  result.textContent = JSON.stringify(layout);
  document.body.append(result);
});</script>"""

SOLID = SolidFiles({"sensor.stl": b"", "sensor.3mf": b""})

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")


def probe(text: str, folder: Path, width: int, *flags: str) -> Any:
    """Return the layout of the page in a window with a width."""
    page = folder / "the report.html"
    page.write_text(text.replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
    window = [f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900", "--dump-dom", page.as_uri()]
    assert CHROMIUM is not None
    run = subprocess.run([CHROMIUM, *FLAGS, *flags, *window], capture_output=True, timeout=50, check=True)
    result = re.search(r'<pre id="probe">(.*?)</pre>', run.stdout.decode("utf-8"), re.DOTALL)
    assert result, run.stderr.decode("utf-8", "replace")[-500:]
    return json.loads(unescape(result[1]))


@pytest.mark.parametrize("width", [1200, 520])
def test_renders_all_figures_and_headings(studied: Studies, drawn: Drawn, tmp_path: Path, width: int) -> None:
    figures = drawn("paper")
    layout = probe(html(studied("paper"), figures, SOLID), tmp_path, width)
    assert layout["headings"] == [
        *("Paper 860 nm", "What to expect", "What matters", "What to do", "Response", "Background", "Rays"),
        "Lens and body",
    ]
    assert len(layout["figures"]) == len(layout["captions"]) == len(figures) == 7
    for (left, top, figure_width, height), caption in zip(layout["figures"], layout["captions"], strict=True):
        assert figure_width > 300
        assert height > 80
        assert left >= 0
        assert caption[1] >= top + height - 1
    assert layout["scrolled"], "a figure or a table is wider than the window, and does not scroll by itself"
    assert min(layout["pixels"]) >= (6.0 if width < 600 else 8.0)
    assert [len(alt) > 20 for alt in layout["alts"]] == [True] * 7
    assert layout["links"] == ["sensor.stl", "sensor.3mf"]
    assert layout["findings"] == 11
    assert layout["rows"] == 3
    assert layout["loaded"] == []
    assert layout["content_width"] <= layout["width"], "the page scrolls horizontally"


def test_dark_mode(studied: Studies, drawn: Drawn, tmp_path: Path) -> None:
    layout = probe(html(studied("paper"), drawn("paper")), tmp_path, 1200, "--blink-settings=preferredColorScheme=0")
    page, ink = ([int(part) for part in re.findall(r"\d+", layout[name])[:3]] for name in ("page", "ink"))
    assert max(page) < 64
    assert min(ink) > 190
