"""Sphinx configuration; built strictly by ``make docs``, offline."""

import copy
import functools
import gc
import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.builders.html import StandaloneHTMLBuilder
from sphinx.domains.python import PythonDomain

import solen
from solen.spec.strict import Strict

sys.path.insert(0, str(Path(__file__).parent))
from api_pages import write_pages
from command_pages import reference

write_pages(Path(__file__).parent / "api")

gc.set_threshold(200_000, 50, 1000)  # a build allocates millions of nodes; collecting less often saves a fifth of it

project = "solen"
author = "The solen maintainers"
project_copyright = f"2026, {author}"
version = release = solen.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
toc_object_entries = False  # some 10,000, which every page's navigation would be made from
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False

# Every cross-reference must resolve. Those to other projects cannot: their inventories would have to be downloaded.
nitpicky = True
OTHERS = "abc annotated_types collections enum matplotlib numpy np npt os pathlib pydantic pydantic_core shapely typing"
OTHERS += " ast datetime decimal functools importlib re tifffile types xarray xr"
nitpick_ignore_regex = [
    (r"py:.*", rf"({OTHERS.replace(' ', '|')})\..*"),
    (r"py:.*", r"(ArrayLike|Path|PathLike)"),
    (r"py:.*", r"(solen\..*\.)?[KLPRT]"),  # type variables
    (r"py:class", r"solen\.ranks\.Caution|Sampler"),  # names of types, which are documented as data
    (r"py:class", r"solen\.recording\.words\.Heading"),  # of a package whose inner modules have no page
    (r"py:.*", r"solen\..*\._\w+"),
    (r"py:.*", r"solen\.(trace\.kernel|scene\.rayoptics\.fields)\..*"),
    (
        r"py:.*",
        r"FieldInfo|NoneType|[GL][te]|(Min|Max)Len|AllowInfNan|PydanticUndefined|inf|-?[\d.]+(e[-+]?\d+)?",
    ),  # limits and defaults of a field
    (r"py:class", r"(list|dict|tuple)\[\w+(\[\w+)?|array"),  # types of fields with a factory, cut at their first comma
]

suppress_warnings = ["ref.python"]  # two classes of one name, in rooms apart

find_obj, local_toctree = PythonDomain.find_obj, StandaloneHTMLBuilder._get_local_toctree


@functools.cache
def by_last_word(domain: PythonDomain) -> dict[str, dict[str, Any]]:
    """Documented objects by the last word of their names."""
    words: dict[str, dict[str, Any]] = {}
    for name, entry in domain.objects.items():
        words.setdefault(name.rpartition(".")[2], {})[name] = entry
    return words


@functools.cache
def find_among_few(domain: PythonDomain, env: Any, module: str, inside: str, name: str, *kind: Any) -> list[Any]:
    """What a name refers to; Sphinx would read all names for each search by a name's end, a sixth of the build."""
    few = copy.copy(domain)
    few.data = {"objects": by_last_word(domain).get(name.removesuffix("()").rpartition(".")[2], {})}
    return find_obj(few, env, module, inside, name, *kind)


def tree_once(builder: StandaloneHTMLBuilder, page: str, **kwargs: Any) -> str:
    """Navigation of a page; of pages outside it one for each folder, as Sphinx would make it for each."""
    if "orphan" not in builder.env.metadata[page]:
        return local_toctree(builder, page, **kwargs)
    folder = page.rpartition("/")[0]
    if folder not in TREES:
        TREES[folder] = local_toctree(builder, page, **kwargs)
    return TREES[folder]


TREES: dict[str, str] = {}
PythonDomain.find_obj = find_among_few
StandaloneHTMLBuilder._get_local_toctree = tree_once


BAR = re.compile(r"(`+[^`]*`+)|\|")

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["cards.css"]
html_title = f"solen {release}"
html_search_scorer = str(Path(__file__).parent / "scorer.js")
html_use_index = False  # one page of 1 MB, which the search does better


def setup(app: Sphinx) -> None:
    """Pages of commands, and three readings of docstrings and signatures that autodoc and napoleon would get wrong."""
    whole: dict[str, list[str]] = {}

    def before_napoleon(_app: Sphinx, what: str, name: str, _obj: object, _options: object, lines: list[str]) -> None:
        """Keep an attribute's text from napoleon, which takes the words before a colon in it for a type."""
        if what in {"attribute", "data", "property"}:
            whole[name], lines[:] = lines[:], []

    def after_napoleon(_app: Sphinx, _what: str, name: str, _obj: object, _options: object, lines: list[str]) -> None:
        """Let bars outside code be bars: in these texts they mean an absolute value or a length."""
        lines[:] = [BAR.sub(lambda found: found[1] or r"\|", line) for line in whole.pop(name, lines)]

    def signature(_app: Sphinx, what: str, _name: str, obj: object, *_: object) -> tuple[str, str] | None:
        """Tables of the design file are told of on their own page; their signature would repeat them."""
        return ("(**values)", "") if what == "class" and isinstance(obj, type) and issubclass(obj, Strict) else None

    def with_reference(_app: Sphinx, page: str, source: list[str]) -> None:
        """Complete the page of a command; the list of commands links to it, so the navigation need not."""
        folder, _, command = page.rpartition("/")
        if folder == "commands":
            title, _, text = source[0].partition("\n")
            source[0] = f"---\norphan: true\n---\n{title}\n\n[Commands](../commands.md)\n{text}{reference(command)}"

    app.connect("source-read", with_reference)
    app.connect("autodoc-process-docstring", before_napoleon, priority=400)
    app.connect("autodoc-process-docstring", after_napoleon, priority=600)
    app.connect("autodoc-process-signature", signature)
