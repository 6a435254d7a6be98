"""Where what has been designed goes: into a folder with its pages, and to the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from steelyard.cli.inputs import named_files
from steelyard.output import results_folder
from steelyard.provenance.record import write_provenance
from steelyard.report.blocks.document import Document
from steelyard.report.write import write_document


class Shown(NamedTuple):
    """Where a result goes."""

    out: Path | None
    force: bool
    as_json: bool
    quiet: bool

    def write(self, result: Callable[[Path], object], document: Document, name: str) -> None:
        """Write a result, its pages and its provenance, all or nothing, where a folder is asked
        for.

        Args:
            result: Writes it into a folder.
            document: Of the pages.
            name: Of the pages, without their endings.
        """
        if self.out is None:
            return
        with results_folder(self.out, force=self.force) as folder:
            result(folder)
            write_document(document, folder, name)
            write_provenance(folder, self.out, named_files(sys.argv[1:], self.out), sys.argv[1:])
