"""Directives ``shell`` and ``file``: commands that the build runs, with what they print, and files
that it writes.

The commands of a page run one after the other in a folder of its own that has the examples, as the
unpacked project has. With ``-D shell_execute=0`` they are shown and not run.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from session import CommandError, Session, block, part_of, screen
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

logger = logging.getLogger(__name__)
_SESSION = "shell_session"
_HOME = "/home/you"
"""Stands for the folder in which the project would have been unpacked."""


class Shell(SphinxDirective):
    """Commands, one a line."""

    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {
        "status": directives.nonnegative_int,
        "lines": directives.unchanged_required,
        "hidden": directives.flag,
        "setup": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """Run them and show what they print."""
        options = {key: str(value) for key, value in self.options.items()}
        this = block("shell", "", options, "\n".join(self.content) + "\n", self.lineno)
        shown = "".join(f"{screen(command)}\n" for command in this.commands)
        if self.config.shell_execute and not this.setup:
            try:
                session = _session_of(self)
                # Where it happened to run is nothing to show.
                shown = session.do(this).replace(str(session.folder.parent), _HOME)
                if "lines" in self.options:
                    shown = part_of(shown, self.options["lines"])
            except (CommandError, ValueError) as error:
                logger.warning("%s", error, location=self.get_location())
        return [] if "hidden" in self.options else [_literal(self, shown, "text")]


class File(SphinxDirective):
    """A file that the reader writes."""

    has_content = True
    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"language": directives.unchanged_required}

    def run(self) -> list[nodes.Node]:
        """Write it and show it."""
        this = block("file", self.arguments[0], {}, "\n".join(self.content) + "\n", self.lineno)
        if self.config.shell_execute:
            _session_of(self).do(this)
        literal = _literal(self, this.text, self.options.get("language", "yaml"))
        whole = nodes.container("", literal_block=True, classes=["literal-block-wrapper"])
        whole += nodes.caption(this.name, "", nodes.literal(this.name, this.name))
        whole += literal
        return [whole]


def _literal(directive: SphinxDirective, text: str, language: str) -> nodes.literal_block:
    node = nodes.literal_block(text, text, language=language)
    directive.set_source_info(node)
    return node


def _session_of(directive: SphinxDirective) -> Session:
    """The shell of a page; its folder has the name that the unpacked project has."""
    page = directive.env.temp_data
    if _SESSION not in page:
        folder = Path(tempfile.mkdtemp(prefix="steelyard-docs-"))
        root = folder / "steelyard"
        shutil.copytree(Path(directive.env.srcdir).parent / "examples", root / "examples")
        page[_SESSION] = Session(root, first=[Path(sys.executable).parent])
    found = page[_SESSION]
    assert isinstance(found, Session)
    return found


def _close(app: Sphinx, _: nodes.document) -> None:
    session = app.env.temp_data.get(_SESSION)
    if isinstance(session, Session):
        session.close()
        shutil.rmtree(session.folder.parent)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_config_value("shell_execute", True, "env", bool)
    app.add_directive("shell", Shell)
    app.add_directive("file", File)
    app.connect("doctree-read", _close)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
