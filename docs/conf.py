"""How Sphinx builds the documentation: `make docs`. Needs no network, and the pages need none
either.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "steelyard"
author = "The steelyard developers"
copyright = author  # noqa: A001 - the name that Sphinx wants

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "citations",
    "gallery",
    "generated",
    "mathml",
    "shell",
]
exclude_patterns = ["_build"]
nitpicky = True
suppress_warnings = [
    "ref.citation",  # what only private modules cite is cited on no page
    "toc.empty_glob",
]

myst_enable_extensions = ["deflist", "dollarmath", "tasklist"]
myst_heading_anchors = 3

# What is copied of a session are its commands, without prompts and what they print.
copybutton_prompt_text = r"\$ |> "
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = True

html_theme = "furo"
html_title = "steelyard"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_math_renderer = "mathml"
math_number_all = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = True
napoleon_numpy_docstring = False


def _known_without_a_page(
    app: Sphinx, env: Any, node: pending_xref, text: nodes.Element
) -> nodes.Element | None:
    """What a docstring names stays a name where it has no page, provided that the code has it."""
    if node.get("refdomain") != "py":
        return None
    # Whose docstring it is stands in the source of the node; what it names may be known where that
    # is, or where that was written.
    place: nodes.Node | None = node
    while place is not None and not place.source:
        place = place.parent
    written = ((place and place.source) or "").rpartition("docstring of ")[2].split(".")
    scopes = [".".join(written[:i]) for i in range(len(written) + 1)]
    scopes += [
        module for scope in scopes[2:] if (module := getattr(_object(scope), "__module__", None))
    ]
    name = node["reftarget"].removesuffix("()").lstrip(".")
    return (
        text if any(_object(f"{scope}.{name}".strip(".")) is not None for scope in scopes) else None
    )


def _object(path: str) -> Any:
    """What a dotted name stands for; None: nothing."""
    parts = path.split(".")
    for i in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:i]))
        except (ImportError, ValueError):
            continue
        for part in parts[i:]:
            fields = getattr(found, "__dataclass_fields__", {})
            found = fields.get(part) or getattr(found, part, None)
            if found is None:
                return None
        return found
    return None


def _whole_sentence(
    app: Sphinx, what: str, name: str, what_it_is: Any, options: Any, lines: list[str]
) -> None:
    """Keep napoleon from taking the beginning of an attribute's sentence, up to its colon, for a
    type.
    """
    if what in {"attribute", "data", "property"}:
        lines[:0] = ["..", ""]


def setup(app: Sphinx) -> None:
    """Connect what this file adds."""
    app.connect("autodoc-process-docstring", _whole_sentence, priority=100)
    app.connect("missing-reference", _known_without_a_page)
