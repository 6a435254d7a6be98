"""Pages in a real browser: headless Chromium of the system, driven by selenium.

Where it is not installed tests are skipped and say what to install; where STEELYARD_BROWSER is
``required``, they fail.
"""

import base64
import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

import pytest

_MISSING = (
    "no browser: install chromium and chromium-driver (apt-get install chromium chromium-driver)"
)
_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--disable-dev-shm-usage",
    # WebGL without a graphics card.
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip
PATIENCE = 300.0
"""[s] for anything to appear: only what never comes fails, however busy the machine is."""
TABBABLE = "a[href], button, select, input, [tabindex='0']"


@contextmanager
def browser() -> Iterator[object]:
    """A driver of Chromium; skips, or fails where a browser is required."""
    chromium = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    driver = shutil.which("chromedriver")
    if chromium is None or driver is None:
        if os.environ.get("STEELYARD_BROWSER") == "required":
            pytest.fail(_MISSING)
        pytest.skip(_MISSING)
    from selenium import webdriver

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = chromium
        for flag in (*_FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
        opened.set_script_timeout(PATIENCE)
        try:
            yield opened
        finally:
            opened.quit()


def open_page(
    driver, path: Path, *, width: int = 1600, scheme: str = "light", scripts: bool = True
) -> None:
    """Load a file as it would be from a mail attachment, with logs emptied before."""
    driver.get("about:blank")
    driver.get_log("browser"), driver.get_log("performance")
    driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": not scripts})
    look(driver, width=width, scheme=scheme)
    driver.get(path.resolve().as_uri())


def look(driver, *, width: int, scheme: str = "light", media: str = "", height: int = 1000) -> None:
    """Width of the window [px], and what the user prefers."""
    screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    prefers = [{"name": "prefers-color-scheme", "value": scheme}]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": prefers})


def until(driver, script: str, *arguments: object) -> object:
    """What a script returns as soon as that is true."""
    end = time.monotonic() + PATIENCE
    while not (value := driver.execute_script(script, *arguments)):
        assert time.monotonic() < end, f"never true: {script}"
        time.sleep(0.05)
    return value


def draw_all(driver, scheme: str = "light") -> None:
    """Scroll through the page until every picture is drawn in the colours of a scheme."""
    for name in driver.execute_script(
        "return [...document.querySelectorAll('.plot')].map((p) => p.id)"
    ):
        driver.execute_script(
            "document.getElementById(arguments[0]).scrollIntoView({block: 'center'})", name
        )
        until(
            driver,
            "return document.getElementById(arguments[0]).dataset.drawn === arguments[1]",
            name,
            scheme,
        )


def screenshot(driver, path: Path) -> None:
    """The whole page."""
    shot = driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True})
    path.write_bytes(base64.b64decode(shot["data"]))


def assert_quiet(driver) -> None:
    """Nothing on the console, nothing from anywhere but the file itself."""
    # Of source "rendering" are hints how a canvas could be faster.
    entries = [
        e
        for e in driver.get_log("browser")
        if e["level"] in {"SEVERE", "WARNING"} and e["source"] != "rendering"
    ]
    assert not entries, entries
    page = driver.current_url.partition("#")[0]
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            url = message["params"]["request"]["url"].partition("#")[0]
            assert url == page or url.startswith(("data:", "blob:", "about:")), url


def assert_sound(driver, *, scheme: str = "light") -> None:
    """What holds of every page: quiet, all pictures drawn, no wider than the window, all that can
    be operated has a name."""
    draw_all(driver, scheme)
    found = MappingProxyType(driver.execute_script(_LOOK, TABBABLE))
    assert found["overflow"] <= 0, found
    assert not found["empty"], "pictures without size"
    assert not found["nameless"], "nothing says what these are"
    assert found["headings"][:1] == ["H1"]
    assert not found["dangling"], "links to nowhere"
    assert_quiet(driver)


def assert_reachable(driver) -> None:
    """The Tab key comes to everything that can be operated, and one sees where it is."""
    from selenium.webdriver import ActionChains, Keys

    wanted = driver.execute_script(
        "document.activeElement.blur(); scrollTo(0, 0);const all ="
        " [...document.querySelectorAll(arguments[0])].filter((e) =>"
        " e.getClientRects().length);all.forEach((e, i) => { e.dataset.stop = i; }); return"
        " all.length",
        TABBABLE,
    )
    seen = set()
    for _ in range(2 * wanted + 5):
        ActionChains(driver, duration=0).send_keys(Keys.TAB).perform()
        at, shown = driver.execute_script(
            "const e = document.activeElement; return [e.dataset.stop,"
            " getComputedStyle(e).outlineStyle !== 'none']"
        )
        if at is not None:
            assert shown, driver.execute_script(
                "return document.activeElement.outerHTML.slice(0, 200)"
            )
            seen.add(int(at))
        if len(seen) == wanted:
            return
    left = [
        driver.execute_script(
            "return document.querySelector(`[data-stop='${arguments[0]}']`).outerHTML.slice(0,"
            " 200)",
            i,
        )
        for i in set(range(wanted)) - seen
    ]
    raise AssertionError(f"the Tab key does not come to {left}")


_LOOK = """
const named = (e) => (e.getAttribute("aria-label") || e.textContent || e.title || (e.labels && e.labels.length && e.labels[0].textContent) || "").trim();
return {
  overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  empty: [...document.querySelectorAll(".plot")].filter((plot) => {
    const inner = plot.querySelector(plot.closest("figure").classList.contains("scene") ? "canvas" : "svg.main-svg");
    return !inner || inner.getBoundingClientRect().width < 100 || inner.getBoundingClientRect().height < 100;
  }).map((plot) => plot.id),
  nameless: [...document.querySelectorAll(arguments[0])].filter((e) => e.offsetParent && !named(e)).map((e) => e.outerHTML.slice(0, 200)),
  headings: [...document.querySelectorAll("h1, h2")].map((e) => e.tagName),
  dangling: [...document.querySelectorAll("a[href^='#']")].filter((e) => !document.getElementById(e.hash.slice(1))).map((e) => e.hash),
};
"""
