"""A Chromium without a display, and what tests of the report ask of it."""

import shutil

import pytest

webdriver = pytest.importorskip("selenium.webdriver")
from selenium.common.exceptions import WebDriverException  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-gl=angle",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
)  # fmt: skip
PATIENCE_S = 90

LIGHT, DARK = "light", "dark"


def _found(*names):
    return next((path for name in names if (path := shutil.which(name))), None)


def start(profile):
    """Start it with a profile of its own; skips the test where that cannot be."""
    chromium = _found("chromium", "chromium-browser", "google-chrome")
    driver = _found("chromedriver")
    if not chromium or not driver:
        pytest.skip("no Chromium with its chromedriver (Debian: chromium chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    try:
        window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    except WebDriverException as error:
        pytest.skip(f"Chromium does not start: {error.msg}")
    window.set_script_timeout(PATIENCE_S)
    window.set_page_load_timeout(PATIENCE_S)
    return window


def size(browser, width, height=900):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
    )


def scheme(browser, name):
    features = [{"name": "prefers-color-scheme", "value": name}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def load(browser, path, width=1280):
    size(browser, width)
    scheme(browser, LIGHT)
    browser.get_log("browser")
    browser.get(path.as_uri())
    wait(browser, lambda: browser.execute_script("return document.body.dataset.ready"))


def wait(browser, condition):
    return WebDriverWait(browser, PATIENCE_S, poll_frequency=0.05).until(lambda _: condition())


def settled(browser):
    """Wait until everything shows the same instant; returns its number."""
    script = "return page.busy ? null : String(page.shown) === document.body.dataset.shown ? page.shown : null"
    wait(browser, lambda: browser.execute_script(script) is not None)
    return browser.execute_script("return page.shown")


def cells_seen(browser):
    """Number of target cells that the 3-D picture paints as observed."""
    trace = "page.runs[0].scene.div.data.find((trace) => trace.meta === 'target')"
    return browser.execute_script(f"return [...{trace}.intensity].filter((value) => value > 0.5).length")


def scrub(browser, share):
    """Put the slider at a share of its length, as a drag does."""
    browser.execute_script(
        "const s = document.getElementById('slider'); s.value = Math.round(arguments[0] * s.max);"
        "s.dispatchEvent(new Event('input', {bubbles: true}))",
        share,
    )
    return settled(browser)


def text(browser, name):
    return browser.find_element(By.ID, name).text


def errors(browser):
    return [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
