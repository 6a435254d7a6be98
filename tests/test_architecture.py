"""A module imports only from layers left of its own, and no modules import each other in a
circle."""

import ast
from graphlib import TopologicalSorter

import pytest
from places import PACKAGE, ROOT

LAYERS = [
    {"arrays", "errors", "units", "digits", "display"},
    {"batch", "tables"},
    {"rotations", "inertia"},
    {"dynamics", "smoothing"},
    {"yaml_file", "json_file", "output"},
    {"logs"},
    {"robot"},
    {"imports"},
    {"motion"},
    {"instruments"},
    {"experiment"},
    {"drafts"},
    {"clocks"},
    {"simulation"},
    {"bodies", "estimates"},
    {"identification"},
    {"excitation"},
    {"inspection"},
    {"exports"},
    {"report"},
    {"cli"},
    {"__init__", "__main__"},
]


def layer(room):
    return next(i for i, rooms in enumerate(LAYERS) if room in rooms)


def modules():
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield path, parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts


def imported(path):
    """Modules of the package that a file imports, wherever in it the import stands."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            if (node.module or "").split(".")[0] != "steelyard":
                continue
            base = node.module.split(".")[1:]
            for alias in node.names:
                inner = PACKAGE.joinpath(*base, alias.name)
                yield (
                    (*base, alias.name)
                    if inner.with_suffix(".py").exists() or inner.is_dir()
                    else tuple(base)
                )
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "steelyard":
                    yield tuple(alias.name.split(".")[1:])


@pytest.mark.parametrize(
    ("path", "module"),
    list(modules()),
    ids=lambda value: str(value) if isinstance(value, tuple) else "",
)
def test_imports_come_from_the_left(path, module):
    for target in imported(path):
        if not target:
            continue
        if target[0] == module[0]:
            continue
        assert layer(target[0]) < layer(module[0]), f"{'.'.join(module)} imports {'.'.join(target)}"


def test_no_import_cycles():
    graph = {
        module: {target for target in imported(path) if target and target != module}
        for path, module in modules()
    }
    list(TopologicalSorter(graph).static_order())


def test_every_room_is_described():
    text = (ROOT / "docs" / "architecture.md").read_text()
    for path in PACKAGE.iterdir():
        if path.is_dir() and path.name != "__pycache__":
            assert f"{path.name}/" in text
