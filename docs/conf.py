"""Sphinx configuration; built strictly by ``make docs``, offline."""

import solen

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
napoleon_google_docstring = False

# Every cross-reference must resolve. Those to other projects cannot: their inventories would have to be downloaded.
nitpicky = True
nitpick_ignore_regex = [
    (r"py:.*", r"(annotated_types|collections|enum|numpy|np|npt|os|pathlib|pydantic|pydantic_core|shapely|typing)\..*"),
    (r"py:.*", r"(ArrayLike|Path|PathLike)"),
]

html_theme = "furo"
html_title = f"solen {release}"
