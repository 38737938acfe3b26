"""The report: one file that needs nothing else, safe for any name, with figures that do not disturb each other."""

import re
from collections import Counter
from html import escape
from html.parser import HTMLParser

import pytest

from solen.report.design.html import html, shown
from solen.report.design.summary import advice, expected, matters
from tests.report.conftest import Drawn, Studies

LOADS = {"src", "href", "xlink:href", "srcset", "data", "poster", "action", "background", "formaction"}
PAPER_FIGURES = ["lens-profile", "response", "matters", "focus", "rays", "rays-at-the-lens", "rays-without-lens"]


class Page(HTMLParser):
    """What a page is made of: its elements, ids, what it loads, its text by element."""

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


@pytest.fixture(scope="module")
def text(studied: Studies, drawn: Drawn) -> str:
    return html(studied("paper"), drawn("paper"))


def test_all_figures_are_inside_with_a_caption_each(text: str) -> None:
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


def test_nothing_is_loaded_from_anywhere(text: str) -> None:
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


def test_every_reference_finds_the_one_thing_it_means(text: str) -> None:
    page = Page(text)
    wanted = {target[1:] for _, target in page.loads if target.startswith("#")}
    wanted |= set(re.findall(r"url\(#([^)]*)\)", text))
    assert len(wanted) > 10
    assert {name: page.ids[name] for name in wanted if page.ids[name] != 1} == {}


def test_no_two_things_of_the_page_share_an_id(text: str) -> None:
    ids = Page(text).ids
    assert [name for name, times in ids.items() if times > 1] == []
    svgs = [part.partition("</svg>")[0] for part in text.split("<svg")[1:]]
    order = ["matters", "response", "focus", "rays", "rays-at-the-lens", "rays-without-lens", "lens-profile"]
    for name, svg in zip(order, svgs, strict=True):
        inside = re.findall(r' id="([^"]*)"', svg)
        assert len(inside) > 10
        assert {one for one in inside if not re.match(rf"{name}-(?!at-the-lens|without-lens)", one)} == set()


def test_warnings_stand_at_the_top_of_the_page(studied: Studies, drawn: Drawn, text: str) -> None:
    page = Page(html(studied("as published"), drawn("as published")))
    assert [one[:35] for one in page.texts["li"][:2]] == [
        "Index: as published, and perhaps no",
        "Index: as published, n falls by 0.1",
    ]
    assert Page(text).texts["li"][0].startswith("The body is treated as rigid")
    assert 'class="warnings"' not in html(studied("odd name"), drawn("odd name"))


def test_what_matters_stands_before_the_response(studied: Studies, text: str) -> None:
    study = studied("paper")
    first = text.partition("<h2>Response</h2>")[0]
    for heading, words in expected(study):
        assert f"<dt>{heading[0].upper()}{heading[1:]}</dt><dd>{escape(words)}</dd>" in first
    for row in matters(study.practice)[1]:
        assert f"<td>{row.name}</td><td>{row.by}</td>" in first
        assert all(f"<td>{escape(change)}</td>" in first for change in row.contrast)
    assert [f"<li>{one}</li>" in first for one in advice(study)] == [True] * len(advice(study)) != []


def test_a_name_is_text_and_never_markup(studied: Studies, drawn: Drawn) -> None:
    text = html(studied("odd name"), drawn("odd name"))
    page = Page(text)
    name = '<b>&" Ω </title><script>x</script>'
    assert page.texts["h1"] == [name]
    assert page.texts["title"][0].startswith(name)
    assert page.tags["script"] == page.tags["b"] == 0
    assert "&lt;script&gt;" in text


def test_a_design_without_lens_has_only_its_own_figures(studied: Studies, drawn: Drawn) -> None:
    texts = drawn("no lens")
    assert set(texts) == {"response", "matters", "rays", "rays-at-the-lens"}
    page = Page(html(studied("no lens"), texts))
    assert page.tags["svg"] == 4
    assert "with lens" not in "".join(page.texts["th"])


def test_where_there_is_no_comparison_the_page_says_why(studied: Studies, drawn: Drawn, text: str) -> None:
    study, texts = studied("no comparison"), drawn("no comparison")
    assert study.no_lens_refused is not None
    assert set(texts) == set(PAPER_FIGURES) - {"matters", "focus", "rays-without-lens"}
    page = Page(html(study, texts))
    (told,) = [one for one in page.texts["p"] if "no comparison" in one]
    assert study.no_lens_refused in told
    assert page.tags["svg"] == 4
    assert "no lens" not in "".join(page.texts["th"])
    assert "no comparison" not in text


def test_the_table_of_all_angles_has_a_row_for_each(text: str, studied: Studies) -> None:
    rows = text.split("All angles", 1)[1].split("</details>", 1)[0]
    first = [row.strip() for row in re.findall(r"<tr><td>([^<]*)</td>", rows)]
    assert first == ["-3", "0", "3"]
    power = studied("paper").to_dict()["response"]["lens"]["power"]
    assert f"<td>{shown(power['right'][0])}</td>" in rows
    assert f"<td>{shown(power['contrast'][-1])}</td>" in rows


@pytest.mark.parametrize(
    "name",
    [
        *("dark", "one-sided", "one angle", "mismatched", "half way", "no comparison"),
    ],
)
def test_missing_numbers_are_dashes(studied: Studies, name: str) -> None:
    study = studied(name)
    text = html(
        study,
        {"response": "<svg></svg>", "matters": "<svg></svg>", "rays": "<svg></svg>", "rays-at-the-lens": "<svg></svg>"},
    )
    assert "None" not in text
    assert not re.search(r">\s*-?(?:nan|inf)\s*<", text), "a number that is none is shown"


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
def test_numbers_as_one_reads_them(value: object, text: str) -> None:
    assert shown(value) == text


def test_the_last_picture_is_at_the_last_angle(studied: Studies, drawn: Drawn) -> None:
    assert studied("half way").case.power.angle_deg[-1] == 1.0
    for name in ("rays", "rays-at-the-lens", "rays-without-lens"):
        text = drawn("half way")[name].replace("−", "-")
        assert "+3°" not in text
        for title in ("-3°", "0°", "+1°"):
            assert title in text
