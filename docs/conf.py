"""Sphinx configuration; ``make docs`` builds the pages offline and treats warnings as errors."""

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

gc.set_threshold(200_000, 50, 1000)  # a build allocates millions of nodes; this saves a fifth of its time

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
toc_object_entries = False  # otherwise the navigation of every page is built from some 10,000 entries
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False

# Every cross-reference must resolve, except those to other projects, whose inventories would have to be downloaded.
nitpicky = True
OTHER_PROJECTS = (
    "abc annotated_types collections enum matplotlib numpy np npt os pathlib pydantic pydantic_core shapely typing"
)
OTHER_PROJECTS += " ast datetime decimal functools importlib re tifffile types xarray xr"
nitpick_ignore_regex = [
    (r"py:.*", rf"({OTHER_PROJECTS.replace(' ', '|')})\..*"),
    (r"py:.*", r"(ArrayLike|Path|PathLike)"),
    (r"py:.*", r"(solen\..*\.)?[CLPRT]"),  # type variables
    (r"py:class", r"solen\.ranks\.Caution|Sampler"),  # type aliases, which are documented as data
    (r"py:.*", r"solen\..*\._\w+"),
    (r"py:.*", r"solen\.(trace\.kernel|scene\.rayoptics\.fields)\..*"),
    (
        r"py:.*",
        r"FieldInfo|NoneType|[GL][te]|(Min|Max)Len|AllowInfNan|PydanticUndefined|inf|-?[\d.]+(e[-+]?\d+)?",
    ),  # limits and defaults of fields
    (
        r"py:class",
        r"(list|dict|tuple)\[\w+(\[\w+)?|array",
    ),  # types of fields with a factory, truncated at the first comma
]

suppress_warnings = ["ref.python"]  # classes of the same name in different packages

find_obj, local_toctree = PythonDomain.find_obj, StandaloneHTMLBuilder._get_local_toctree


@functools.cache
def by_last_word(domain: PythonDomain) -> dict[str, dict[str, Any]]:
    """Return the documented objects, keyed by the last part of their names."""
    by_word: dict[str, dict[str, Any]] = {}
    for name, entry in domain.objects.items():
        by_word.setdefault(name.rpartition(".")[2], {})[name] = entry
    return by_word


@functools.cache
def find_by_last_word(domain: PythonDomain, env: Any, module: str, inside: str, name: str, *kind: Any) -> list[Any]:
    """Find an object among those with the same last part; searching all names takes a sixth of the build time."""
    candidates = copy.copy(domain)
    candidates.data = {"objects": by_last_word(domain).get(name.removesuffix("()").rpartition(".")[2], {})}
    return find_obj(candidates, env, module, inside, name, *kind)


def cached_toctree(builder: StandaloneHTMLBuilder, page: str, **kwargs: Any) -> str:
    """Return the navigation of a page; pages outside the navigation share one per folder."""
    if "orphan" not in builder.env.metadata[page]:
        return local_toctree(builder, page, **kwargs)
    folder = page.rpartition("/")[0]
    if folder not in TREES:
        TREES[folder] = local_toctree(builder, page, **kwargs)
    return TREES[folder]


TREES: dict[str, str] = {}
PythonDomain.find_obj = find_by_last_word
StandaloneHTMLBuilder._get_local_toctree = cached_toctree


BAR = re.compile(r"(`+[^`]*`+)|\|")

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["cards.css"]
html_title = f"solen {release}"
html_search_scorer = str(Path(__file__).parent / "scorer.js")
html_use_index = False  # a page of 1 MB; the search replaces it


def setup(app: Sphinx) -> None:
    """Complete the pages of commands, and correct effects of autodoc and napoleon on docstrings and signatures."""
    originals: dict[str, list[str]] = {}

    def before_napoleon(_app: Sphinx, what: str, name: str, _obj: object, _options: object, lines: list[str]) -> None:
        """Hide the docstring of an attribute from napoleon, which would read the words before a colon as a type."""
        if what in {"attribute", "data", "property"}:
            originals[name], lines[:] = lines[:], []

    def after_napoleon(_app: Sphinx, _what: str, name: str, _obj: object, _options: object, lines: list[str]) -> None:
        """Escape bars outside code, which mean an absolute value or a norm."""
        lines[:] = [BAR.sub(lambda match: match[1] or r"\|", line) for line in originals.pop(name, lines)]

    def signature(_app: Sphinx, what: str, _name: str, obj: object, *_: object) -> tuple[str, str] | None:
        """Shorten the signatures of tables of the design file, which have a page of their own."""
        return ("(**values)", "") if what == "class" and isinstance(obj, type) and issubclass(obj, Strict) else None

    def with_reference(_app: Sphinx, page: str, source: list[str]) -> None:
        """Complete the page of a command, which is outside the navigation: the list of commands links to it."""
        folder, _, command = page.rpartition("/")
        if folder == "commands":
            title, _, text = source[0].partition("\n")
            source[0] = f"---\norphan: true\n---\n{title}\n\n[Commands](../commands.md)\n{text}{reference(command)}"

    app.connect("source-read", with_reference)
    app.connect("autodoc-process-docstring", before_napoleon, priority=400)
    app.connect("autodoc-process-docstring", after_napoleon, priority=600)
    app.connect("autodoc-process-signature", signature)
