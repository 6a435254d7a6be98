"""The conda recipe says what pyproject.toml says."""

import re
import tomllib

import pytest
from places import ROOT
from ruamel.yaml import YAML

RECIPE = YAML(typ="safe").load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text())
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]


def parted(requirement):
    """Name and versions of a requirement, as both write it."""
    name, versions = re.fullmatch(r"([\w.-]+) ?([<>=!~].*)?", requirement).groups()
    return name.lower(), set((versions or "").replace(" ", "").split(","))


def test_name_version_licence_and_summary_agree():
    assert RECIPE["package"] == {"name": PROJECT["name"], "version": "${{ version }}"}
    assert RECIPE["context"]["version"] == PROJECT["version"]
    assert RECIPE["about"]["license"] == PROJECT["license"]
    assert [RECIPE["about"]["license_file"]] == PROJECT["license-files"]
    assert RECIPE["about"]["summary"] == PROJECT["description"]


def test_commands_agree():
    commands = [f"{name} = {where}" for name, where in PROJECT["scripts"].items()]
    assert RECIPE["build"]["python"]["entry_points"] == commands


@pytest.mark.parametrize(
    ("part", "needed"),
    [
        ("run", PROJECT["dependencies"]),
        ("host", [*PYPROJECT["build-system"]["requires"], "pip"]),
    ],
)
def test_requirements_agree(part, needed):
    wanted = [f"python {PROJECT['requires-python']}", *needed]
    found = RECIPE["requirements"][part]
    assert sorted(map(parted, found)) == sorted(map(parted, wanted))


def test_the_source_is_this_checkout():
    folder = ROOT / "packaging" / "conda"
    assert (folder / RECIPE["source"]["path"]).resolve() == ROOT.resolve()
