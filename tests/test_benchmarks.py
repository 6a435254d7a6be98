"""Benchmarks stay in step with the package: what they import is there."""

import ast
import importlib

import pytest
from places import ROOT


def imported(path):
    """Modules and names that a file has of the package."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("steelyard"):
            yield from ((node.module, each.name) for each in node.names)


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").rglob("*.py")), ids=lambda p: p.stem)
def test_what_a_benchmark_imports_is_there(path):
    for module, name in imported(path):
        home = importlib.import_module(module)
        if not hasattr(home, name):
            importlib.import_module(f"{module}.{name}")
