"""A module imports only from layers left of its own, no modules import each other in a circle, and
what a reader has to hold in mind at once stays small."""

import ast
import importlib
from collections import defaultdict
from functools import cache
from graphlib import TopologicalSorter

import pytest
from places import PACKAGE, ROOT

LAYERS = [
    {"errors"},
    {"arrays", "units", "digits", "display", "plugins"},
    {"machine"},
    {"operations"},
    {"batch", "processes"},
    {"tables"},
    {"rotations", "inertia"},
    {"dynamics", "smoothing", "spectra"},
    {"files"},
    {"output"},
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
    {"natural_frequencies"},
    {"identification"},
    {"calibration"},
    {"excitation"},
    {"inspection"},
    {"provenance"},
    {"exports"},
    {"live"},
    {"report"},
    {"campaigns"},
    {"formats"},
    {"cli"},
    {"__init__", "__main__"},
]

INNER = {
    "identification": [
        {"model"},
        {"samples"},
        {"solve"},
        {"recursive"},
        {"residuals"},
        {"verdict"},
        {"methods"},
        {
            "settings",
            "force_clock",
            "identification",
            "chosen_methods",
            "side_by_side",
            "synchronisation",
        },
        {"identify"},
    ],
    "inspection": [
        {"agreements", "remarks", "streams"},
        {"mistakes"},
        {"contact", "delays", "excitation", "part"},
        {"inspect"},
    ],
    "report": [
        {"evidence"},
        {"blocks"},
        {"documents"},
        {"forms"},
        {"figures", "write", "write_calibration"},
    ],
    "cli": [
        {
            "designs",
            "inputs",
            "interruption",
            "lazy_group",
            "options",
            "printing",
            "process",
            "truth",
        },
        {"verbs"},
    ],
}
"""Within a room, from left to right; what is not named may be anywhere."""
MOST_FILES = 16
"""In one folder; a room that is read in one go has about fifteen."""


def layer(room):
    return next(i for i, rooms in enumerate(LAYERS) if room in rooms)


def modules():
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield path, parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts


@cache
def nodes(path):
    """All statements of a file, however deep."""
    return list(statements(ast.parse(path.read_text()).body))


def statements(body):
    for each in body:
        yield each
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(each, part, ()))


@cache
def imported(path):
    """Modules of the package that a file imports, wherever in it the import stands."""
    return tuple(each_import(path))


def each_import(path):
    for node in nodes(path):
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


def test_every_module_can_be_imported():
    for _, module in modules():
        if module != ("__main__",):
            importlib.import_module(
                ".".join(["steelyard", *(part for part in module if part != "__init__")])
            )


def place(room, module):
    """Where a module stands within its room; None: anywhere."""
    inner = module[1] if len(module) > 1 else ""
    return next((i for i, names in enumerate(INNER[room]) if inner in names), None)


@pytest.mark.parametrize("room", INNER)
def test_imports_within_a_room_come_from_the_left(room):
    wrong = set()
    for path, module in modules():
        if module[0] != room or place(room, module) is None:
            continue
        for target in imported(path):
            if not target or target[0] != room or place(room, target) is None:
                continue
            if place(room, target) > place(room, module):
                wrong.add((".".join(module), ".".join(target)))
    assert not wrong


def test_no_folder_is_too_full_to_be_read():
    for folder in [PACKAGE, *(path for path in PACKAGE.rglob("*") if path.is_dir())]:
        assert len(list(folder.glob("*.py"))) <= MOST_FILES, folder


def test_no_two_classes_share_a_name():
    homes = defaultdict(set)
    for path, module in modules():
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                homes[node.name.lstrip("_")].add(".".join(module))
    shared = {name: sorted(where) for name, where in homes.items() if len(where) > 1}
    # With or without an underscore: a reader hears the same.
    assert not shared


def test_long_private_functions_say_what_they_do():
    silent = []
    for path, module in modules():
        for node in nodes(path):
            if not isinstance(node, ast.FunctionDef) or not node.name.startswith("_"):
                continue
            magic = node.name.endswith("__")
            long = node.end_lineno - node.lineno + 1 > 10
            if long and not magic and ast.get_docstring(node) is None:
                silent.append(f"{'.'.join(module)}.{node.name}")
    assert not silent
