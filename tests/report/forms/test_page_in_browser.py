"""The page in a real browser: drawn, quiet, reachable by keyboard, in both schemes and widths, on
paper, without scripts."""

import base64
import time

import numpy as np
import pytest
from browser import (
    PATIENCE,
    assert_quiet,
    assert_reachable,
    assert_sound,
    draw_all,
    look,
    open_page,
    screenshot,
    until,
)
from documents import CORNERS, EDGES, TIME, hostile, sample
from scipy.spatial.transform import Rotation

from steelyard.report.forms.page import page

pytestmark = pytest.mark.browser

ROBOT = "document.getElementById('figure-robot')"
SCENE = f"drawn.get({ROBOT}).scene"
EYE = f"const eye = {ROBOT}._fullLayout.scene.camera.eye; return [eye.x, eye.y, eye.z]"
# Drawings may differ by single precision.
CLOSE = {"rtol": 0, "atol": 1e-5}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(page(sample()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def opened(driver, written):
    """The sample, wide and light, with everything drawn."""
    open_page(driver, written)
    draw_all(driver)
    return driver


@pytest.fixture
def wide(opened):
    look(opened, width=1600)
    return opened


def press(driver, *keys):
    from selenium.webdriver import ActionChains

    ActionChains(driver, duration=0).send_keys(*keys).perform()


def click(driver, selector):
    driver.execute_script("document.querySelector(arguments[0]).click()", selector)


def background(driver):
    colour = driver.execute_script("return getComputedStyle(document.body).backgroundColor")
    return sum(int(part) for part in colour.strip("rgb()").split(","))


def points(driver, trace):
    """Of a trace as drawn, shape (n, 3)."""
    code = (
        f"const t = {ROBOT}._fullData[{trace}]; return ['x', 'y', 'z'].map((k) => Array.from(t[k]))"
    )
    return np.array(driver.execute_script(code)).T


def test_all_is_there_and_sound(opened, tmp_path):
    titles = opened.execute_script(
        "return [...document.querySelectorAll('section > h2')].map((e) => e.textContent)"
    )
    assert titles == [section.title for section in sample().sections]
    assert opened.execute_script("return document.querySelectorAll('.plot').length") == 4
    assert opened.execute_script(
        "return [...document.querySelectorAll('[role=img]')].every((e) => e.ariaLabel.length > 10)"
    )
    assert_sound(opened)
    screenshot(opened, tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 50_000


def test_lines_have_colours_of_their_own(opened):
    code = "return document.getElementById('figure-residuals')._fullData.map((t) => t.line.color)"
    assert len(set(opened.execute_script(code))) == 8


def test_everything_by_keyboard(wide):
    assert_reachable(wide)


class TestScene:
    def test_buttons_turn_the_view(self, wide):
        click(wide, "[data-view=reset]")
        first = np.array(wide.execute_script(EYE))
        click(wide, "[data-view=right]")
        turned = np.array(wide.execute_script(EYE))
        angle = np.arctan2(turned[1], turned[0]) - np.arctan2(first[1], first[0])
        assert np.degrees(angle) == pytest.approx(15)
        click(wide, "[data-view=left]")
        np.testing.assert_allclose(wide.execute_script(EYE), first, atol=1e-9)
        click(wide, "[data-view=up]")
        assert wide.execute_script(EYE)[2] > first[2]
        click(wide, "[data-view=closer]")
        center = np.array(
            [0, 0, wide.execute_script(f"return {ROBOT}._fullLayout.scene.camera.center.z")]
        )
        assert np.linalg.norm(wide.execute_script(EYE) - center) == pytest.approx(
            0.8 * np.linalg.norm(first - center)
        )
        click(wide, "[data-view=reset]")
        np.testing.assert_allclose(wide.execute_script(EYE), first, atol=1e-9)

    def test_keys_turn_the_view(self, wide):
        from selenium.webdriver import Keys

        wide.execute_script(f"{ROBOT}.focus()")
        for key in (
            Keys.ARROW_LEFT,
            Keys.ARROW_RIGHT,
            Keys.ARROW_UP,
            Keys.ARROW_DOWN,
            "+",
            "-",
            "0",
        ):
            press(wide, Keys.ARROW_LEFT)
            before = wide.execute_script(EYE)
            press(wide, key)
            assert np.linalg.norm(np.subtract(wide.execute_script(EYE), before)) > 0.01, key

    def test_points_of_the_platform_follow_its_pose(self, wide):
        """Against SciPy's rotations."""
        k = 240
        slider = "document.querySelector('[data-motion=time]')"
        wide.execute_script(
            f"{slider}.value = {float(TIME[k])!r}; {slider}.dispatchEvent(new Event('input'))"
        )
        angle = 0.3 * np.sin(TIME[k])
        position = np.array([np.cos(TIME[k]), np.sin(TIME[k]), 1.5])
        expected = Rotation.from_euler("z", angle).apply(EDGES) + position
        for i in range(8):
            anchor, attachment = points(wide, i)
            np.testing.assert_allclose(anchor, CORNERS[i], **CLOSE)
            np.testing.assert_allclose(attachment, expected[i], **CLOSE)
        assert (
            wide.execute_script("return document.querySelector('[data-motion=now]').textContent")
            == f"{TIME[k]:.2f} s"
        )

    def test_play_moves_them_and_leaves_the_view(self, wide):
        click(wide, "[data-view=right]")
        view, before = wide.execute_script(EYE), points(wide, 0)
        start = wide.execute_script(f"return {SCENE}.instant")
        click(wide, "[data-motion=play]")
        assert (
            wide.execute_script("return document.querySelector('[data-motion=play]').textContent")
            == "pause"
        )
        until(wide, f"return {SCENE}.instant > {start} + 0.5")
        click(wide, "[data-motion=play]")
        after = points(wide, 0)
        np.testing.assert_array_equal(after[0], before[0])
        assert np.linalg.norm(after[1] - before[1]) > 0.1
        np.testing.assert_allclose(wide.execute_script(EYE), view, atol=1e-9)

    def test_the_slider_by_keys(self, wide):
        from selenium.webdriver import Keys

        wide.execute_script("document.querySelector('[data-motion=time]').focus()")
        before = wide.execute_script(f"return {SCENE}.instant")
        press(wide, Keys.ARROW_RIGHT)
        assert wide.execute_script(f"return {SCENE}.instant") > before

    def test_another_course_and_the_shorter_way(self, wide):
        """From a quaternion to its negative nothing turns."""
        code = (
            "const s = document.querySelector('[data-motion=course]'); s.value = '1';"
            f" s.dispatchEvent(new Event('change')); {SCENE}.instant = {float(TIME[1]) / 10!r};"
            f" {SCENE}.show()"
        )
        wide.execute_script(code)
        np.testing.assert_allclose(
            [points(wide, i)[1] for i in range(8)], EDGES + np.array([0, 0, 2.0]), **CLOSE
        )
        wide.execute_script(
            "const s = document.querySelector('[data-motion=course]'); s.value = '0';"
            " s.dispatchEvent(new Event('change'))"
        )


def test_dark_and_narrow(opened):
    look(opened, width=1600)
    light = background(opened)
    look(opened, width=400, scheme="dark")
    assert background(opened) < 200 < 600 < light
    assert_sound(opened, scheme="dark")
    text = opened.execute_script(
        "return getComputedStyle(document.querySelector('#figure-residuals .legendtext')).fill"
    )
    assert min(int(part) for part in text.strip("rgb()").split(",")) > 200
    look(opened, width=400)
    assert_sound(opened)


@pytest.mark.slow
def test_on_paper_all_is_drawn_and_light(driver, written):
    """What was not yet in view too; afterwards the screen is as before."""
    open_page(driver, written, scheme="dark")
    until(driver, "return document.readyState === 'complete'")
    pdf = base64.b64decode(
        driver.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})["data"]
    )
    assert pdf.startswith(b"%PDF")
    until(
        driver,
        "return [...document.querySelectorAll('.plot')].every((p) => p.dataset.drawn === 'dark')",
    )
    darkest = driver.execute_script(
        "const c = document.querySelector('.copy'); const d = c.getContext('2d').getImageData(0, 0,"
        " c.width, c.height).data;let low = 765; for (let i = 0; i < d.length; i += 4) if (d[i + 3]"
        " > 200) low = Math.min(low, d[i] + d[i + 1] + d[i + 2]); return low"
    )
    assert darkest < 200, "the 3-D view was not drawn for paper"
    assert_sound(driver, scheme="dark")


def laid_out(driver):
    """All text of the page as it is laid out, asked for from outside."""
    document = driver.execute_cdp_cmd("DOMSnapshot.captureSnapshot", {"computedStyles": []})
    strings = document["strings"]
    return " ".join(strings[i] for i in document["documents"][0]["layout"]["text"] if i >= 0)


def test_without_scripts_tables_are_there(driver, written):
    open_page(driver, written, width=400, scripts=False)
    try:
        # A page is loaded before it is laid out, on a busy machine long before.
        end, shown = time.monotonic() + PATIENCE, ""
        while "All ten parameters" not in shown and time.monotonic() < end:
            shown = laid_out(driver)
        assert "All ten parameters" in shown
        assert "32 ± 19" in shown
        assert "needs JavaScript" in shown
        assert "play" not in shown
        assert_quiet(driver)
    finally:
        driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


@pytest.mark.slow
def test_names_stay_text(driver, tmp_path):
    document, names = hostile()
    (tmp_path / "h.html").write_text(page(document), encoding="utf-8")
    open_page(driver, tmp_path / "h.html", width=400)
    assert_sound(driver)
    whole = " ".join(names)
    assert driver.execute_script("return document.querySelector('h1').textContent") == whole
    assert driver.title.split() == whole.split()
    assert (
        driver.execute_script(
            "return document.querySelectorAll('img, iframe, object, main a').length"
        )
        == 0
    )
    code = (
        "return [...document.querySelectorAll('#figure-f .legendtext')].map((e) => e.textContent)"
    )
    assert [text.split() for text in driver.execute_script(code)] == [
        name.split() for name in names
    ]
    cells = driver.execute_script(
        "return [...document.querySelectorAll('tbody th')].map((e) => e.textContent)"
    )
    assert cells == names
    driver.execute_script(
        "Plotly.Fx.hover(document.getElementById('figure-f'), [{curveNumber: 1, pointNumber: 0}])"
    )
    hover = until(driver, "return document.querySelector('#figure-f .hoverlayer').textContent")
    assert names[1].split()[0] in hover
    assert (
        driver.execute_script(
            "return document.querySelectorAll('img, iframe, object, main a').length"
        )
        == 0
    )
    assert_quiet(driver)
