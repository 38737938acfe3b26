"""The report as a self-contained HTML file: content, escaping, and unique ids of its figures."""

import re
from collections import Counter
from html import escape
from html.parser import HTMLParser

import pytest

from solen.report.design.html import html, number_text
from solen.report.design.summary import advice, effect_rows, expected
from tests.report.conftest import Drawn, Studies

LOADS = {"src", "href", "xlink:href", "srcset", "data", "poster", "action", "background", "formaction"}
PAPER_FIGURES = ["lens-profile", "response", "matters", "focus", "rays", "rays-at-the-lens", "rays-without-lens"]


class Page(HTMLParser):
    """Parsed page: counts of elements and ids, loaded addresses, and texts, keyed by element."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.ids: Counter[str] = Counter()
        self.loads: list[tuple[str, str]] = []
        self.texts: dict[str, list[str]] = {}
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        self.open.append(tag)
        self.texts.setdefault(tag, []).append("")
        for name, value in attrs:
            if name == "id":
                self.ids[value or ""] += 1
            if name in LOADS:
                self.loads.append((tag, value or ""))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.open:
            self.texts[self.open[-1]][-1] += data


PLACEHOLDERS = dict.fromkeys(("response", "matters", "rays", "rays-at-the-lens"), "<svg></svg>")


@pytest.fixture(scope="module")
def text(studied: Studies, drawn: Drawn) -> str:
    return html(studied("paper"), drawn("paper"))


def test_contains_all_figures_with_captions(text: str) -> None:
    page = Page(text)
    assert page.tags["svg"] == page.tags["figure"] == page.tags["figcaption"] == len(PAPER_FIGURES)
    headings = [
        "What to expect",
        "What matters",
        "What to do",
        "Response",
        "Background",
        "Rays",
        "Lens and body",
    ]
    assert page.texts["h2"] == headings
    assert page.texts["h1"] == ["Paper 860 nm"]


def test_loads_nothing(text: str) -> None:
    page = Page(text)
    assert page.loads
    for tag, target in page.loads:
        assert target.startswith("#") or (tag, target) == ("link", "data:,"), (tag, target)
    for tag in ("script", "img", "iframe", "object", "embed", "base"):
        assert page.tags[tag] == 0
    assert all(target.startswith("#") for target in re.findall(r"url\(['\"]?([^)]*)", text))
    assert "@import" not in text
    without_names = re.sub(r'(?:xmlns(?::\w+)?|rdf:resource)="[^"]*"', "", text)
    assert re.findall(r"https?://", without_names) == []


def test_references_are_unambiguous(text: str) -> None:
    page = Page(text)
    targets = {target[1:] for _, target in page.loads if target.startswith("#")}
    targets |= set(re.findall(r"url\(#([^)]*)\)", text))
    assert len(targets) > 10
    assert {name: page.ids[name] for name in targets if page.ids[name] != 1} == {}


def test_ids_are_unique(text: str) -> None:
    ids = Page(text).ids
    assert [name for name, count in ids.items() if count > 1] == []
    svgs = [part.partition("</svg>")[0] for part in text.split("<svg")[1:]]
    order = ["matters", "response", "focus", "rays", "rays-at-the-lens", "rays-without-lens", "lens-profile"]
    for name, svg in zip(order, svgs, strict=True):
        svg_ids = re.findall(r' id="([^"]*)"', svg)
        assert len(svg_ids) > 10
        assert all(re.match(rf"{name}-(?!at-the-lens|without-lens)", each) for each in svg_ids)


def test_warnings_are_at_top_of_page(studied: Studies, text: str) -> None:
    page = Page(html(studied("as published"), PLACEHOLDERS))
    assert [item[:35] for item in page.texts["li"][:2]] == [
        "Index: as published, and perhaps no",
        "Index: as published, n falls by 0.1",
    ]
    assert Page(text).texts["li"][0].startswith("The body is treated as rigid")
    assert 'class="warnings"' not in html(studied("odd name"), PLACEHOLDERS)


def test_summary_precedes_response(studied: Studies, text: str) -> None:
    study = studied("paper")
    summary = text.partition("<h2>Response</h2>")[0]
    for heading, sentence in expected(study):
        assert f"<dt>{heading[0].upper()}{heading[1:]}</dt><dd>{escape(sentence)}</dd>" in summary
    for row in effect_rows(study.practice)[1]:
        assert f"<td>{row.name}</td><td>{row.by}</td>" in summary
        assert all(f"<td>{escape(change)}</td>" in summary for change in row.contrast)
    assert advice(study)
    assert all(f"<li>{sentence}</li>" in summary for sentence in advice(study))


def test_escapes_name(studied: Studies, drawn: Drawn) -> None:
    text = html(studied("odd name"), drawn("odd name"))
    page = Page(text)
    name = '<b>&" Ω </title><script>x</script>'
    assert page.texts["h1"] == [name]
    assert page.texts["title"][0].startswith(name)
    assert page.tags["script"] == page.tags["b"] == 0
    assert "&lt;script&gt;" in text


def test_figures_of_design_without_lens(studied: Studies, drawn: Drawn) -> None:
    figures = drawn("no lens")
    assert set(figures) == {"response", "matters", "rays", "rays-at-the-lens"}
    page = Page(html(studied("no lens"), figures))
    assert page.tags["svg"] == 4
    assert "with lens" not in "".join(page.texts["th"])


def test_states_why_comparison_is_missing(studied: Studies, drawn: Drawn, text: str) -> None:
    study, figures = studied("no comparison"), drawn("no comparison")
    assert study.no_lens_refused is not None
    assert set(figures) == set(PAPER_FIGURES) - {"matters", "focus", "rays-without-lens"}
    page = Page(html(study, figures))
    (paragraph,) = [each for each in page.texts["p"] if "no comparison" in each]
    assert study.no_lens_refused in paragraph
    assert page.tags["svg"] == 4
    assert "no lens" not in "".join(page.texts["th"])
    assert "no comparison" not in text


def test_table_has_row_for_each_angle(text: str, studied: Studies) -> None:
    rows = text.split("All angles", 1)[1].split("</details>", 1)[0]
    first = [row.strip() for row in re.findall(r"<tr><td>([^<]*)</td>", rows)]
    assert first == ["-3", "0", "3"]
    power = studied("paper").to_dict()["response"]["lens"]["power"]
    assert f"<td>{number_text(power['right'][0])}</td>" in rows
    assert f"<td>{number_text(power['contrast'][-1])}</td>" in rows


@pytest.mark.parametrize("name", ["dark", "one-sided", "one angle", "mismatched", "half way", "no comparison"])
def test_missing_numbers_are_dashes(studied: Studies, name: str) -> None:
    text = html(studied(name), PLACEHOLDERS)
    assert "None" not in text
    assert not re.search(r">\s*-?(?:nan|inf)\s*<", text)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (True, "yes"),
        (3, "3"),
        ("cartesian-oval", "cartesian-oval"),
        (0.0, "0"),
        (1e-17, "0"),
        (-2.5e-5, "-2.5e-05"),
        (1.23456, "1.2346"),
        (20.0, "20"),
        (100.0, "100"),
    ],
)
def test_number_formats(value: object, text: str) -> None:
    assert number_text(value) == text


def test_last_view_is_at_last_angle(studied: Studies, drawn: Drawn) -> None:
    assert studied("half way").case.power.angle_deg[-1] == 1.0
    for name in ("rays", "rays-at-the-lens", "rays-without-lens"):
        text = drawn("half way")[name].replace("−", "-")
        assert "+3°" not in text
        for title in ("-3°", "0°", "+1°"):
            assert title in text
