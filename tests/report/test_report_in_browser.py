"""The report of a real identification in a real browser: with names that are hostile, at both
widths and in both schemes."""

from dataclasses import replace

import numpy as np
import pytest
from browser import assert_reachable, assert_sound, draw_all, look, open_page, until
from recordings import write_small

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.report.documents.identification import document_of
from steelyard.report.evidence.summary import summarise
from steelyard.report.forms.page import page

pytestmark = pytest.mark.browser

NAME = "<script>alert(1)</script>\"'&<img src=x onerror=alert(2)>"
EYE = (
    "const eye = document.getElementById('figure-robot')._fullLayout.scene.camera.eye; return"
    " [eye.x, eye.y, eye.z]"
)


@pytest.fixture(scope="module")
def opened(driver, tmp_path_factory):
    """Page of the small experiment, whose names somebody made to do harm."""
    folder = tmp_path_factory.mktemp("report")
    experiment = read_experiment(write_small(folder / "small"))
    runs = tuple(replace(run, name=NAME) for run in experiment.runs)
    experiment = replace(
        experiment, name=NAME, runs=runs, robot=replace(experiment.robot, name=NAME)
    )
    path = folder / "report.html"
    path.write_text(
        page(document_of(summarise(identify(experiment), experiment.robot.platform))),
        encoding="utf-8",
    )
    open_page(driver, path)
    draw_all(driver)
    return driver


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("width", [400, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_sound(opened, width, scheme):
    look(opened, width=width, scheme=scheme)
    assert_sound(opened, scheme=scheme)


def test_every_section_is_there(opened):
    titles = opened.execute_script(
        "return [...document.querySelectorAll('main h2')].map((h) => h.textContent.trim())"
    )
    assert titles == [
        "Result", "The platform", "Wrench on the platform", "Measurements and residuals", "Uncertainty budget",
        "Clocks and calibration",
        "Correlation of the parameters", "Provenance",
    ]  # fmt: skip


def test_hostile_names_are_text(opened):
    assert opened.execute_script("return document.querySelector('h1').textContent.trim()") == NAME
    assert not opened.execute_script("return document.querySelectorAll('img').length")
    shown = opened.execute_script("return document.body.innerText")
    assert f"Run {NAME}" in shown


@pytest.mark.slow
def test_the_keyboard_reaches_all(opened):
    look(opened, width=1600)
    assert_reachable(opened)


def test_the_robot_turns_and_moves(opened):
    look(opened, width=1600)
    before = np.array(opened.execute_script(EYE))
    opened.execute_script("document.querySelector('[data-view=left]').click()")
    until(
        opened,
        f"return (() => {{ {EYE} }})().some((v, i) => Math.abs(v - arguments[0][i]) > 1e-3)",
        before.tolist(),
    )
    cables = (
        "return"
        " Array.from(document.getElementById('figure-robot')._fullData[1].x).filter(Number.isFinite)"
    )
    first = np.array(opened.execute_script(cables))
    opened.execute_script(
        "const s = document.querySelector('[data-motion=time]'); s.value = (Number(s.min) +"
        " Number(s.max)) / 2;s.dispatchEvent(new Event('input', {bubbles: true}))"
    )
    until(
        opened,
        f"return (() => {{ {cables} }})().some((v, i) => Math.abs(v - arguments[0][i]) > 1e-3)",
        first.tolist(),
    )
    moved = np.array(opened.execute_script(cables))
    # Anchors stay where they are, attachments move with the platform.
    np.testing.assert_allclose(moved[::2], first[::2])
    assert np.abs(moved[1::2] - first[1::2]).max() > 1e-3
