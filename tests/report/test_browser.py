"""The report in a real browser without a display: it loads, moves, fits a narrow page and obeys the keyboard."""

import shutil

import pytest

webdriver = pytest.importorskip("selenium.webdriver")
from selenium.common.exceptions import WebDriverException  # noqa: E402
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-gl=angle",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
)  # fmt: skip
PATIENCE_S = 90

pytestmark = [pytest.mark.browser, pytest.mark.slow]
LIGHT, DARK = "light", "dark"


def _found(*names):
    return next((path for name in names if (path := shutil.which(name))), None)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    chromium = _found("chromium", "chromium-browser", "google-chrome")
    driver = _found("chromedriver")
    if not chromium or not driver:
        pytest.skip("no Chromium with its chromedriver (Debian: chromium chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    try:
        window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    except WebDriverException as error:
        pytest.skip(f"Chromium does not start: {error.msg}")
    window.set_script_timeout(PATIENCE_S)
    window.set_page_load_timeout(PATIENCE_S)
    yield window
    window.quit()


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


@pytest.fixture
def report(browser, folder):
    load(browser, folder / "report.html")
    return browser


def test_it_loads_without_errors_and_without_the_network(report):
    assert report.title == "swarm_mj: eros-quick"
    assert not errors(report)
    assert report.execute_script("return performance.getEntriesByType('resource').map((e) => e.name)") == []


def test_the_3d_picture_and_the_plots_are_drawn(report):
    drawn = """
        const canvas = document.querySelector('#scene-0 canvas');
        const gl = canvas.getContext('webgl') || canvas.getContext('webgl2');
        return [canvas.width, canvas.height, gl !== null, document.querySelectorAll('#plots .scatterlayer path.js-line').length]
    """
    width, height, has_gl, lines = report.execute_script(drawn)
    assert width > 300 and height > 200 and has_gl
    assert lines >= 9  # two spacecraft in three plots, the swarm, modes and links


#: Counts what is drawn by WebGL and notes, once the page says that it is ready, what was there by then.
WATCH = """
    window.drawn = 0;
    for (const kind of [WebGLRenderingContext, WebGL2RenderingContext]) {
        for (const name of ["drawArrays", "drawElements"]) {
            const draw = kind.prototype[name];
            kind.prototype[name] = function (...rest) { window.drawn += 1; return draw.apply(this, rest); };
        }
    }
    window.there = () => [window.drawn, document.querySelectorAll("#plots path.js-line").length,
        [...document.querySelectorAll(".labels span")].map((span) => span.textContent).join(" ")];
    new MutationObserver(() => {
        if (document.body?.dataset.ready && !window.atReady) window.atReady = window.there();
    }).observe(document, { subtree: true, childList: true, attributes: true });
"""


def test_ready_means_that_everything_is_drawn(browser, folder):
    added = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": WATCH})
    try:
        load(browser, folder / "report.html")
        pause = "const done = arguments[0]; setTimeout(() => done([window.atReady, window.there()]), 1500);"
        at_ready, later = browser.execute_async_script(pause)
        assert at_ready == later
        draws, lines, names = later
        assert draws > 0 and lines >= 9 and "sc1" in names
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


NAMES = """
    const scene = Object.create(page.runs[0].scene);
    scene.view = scene.div._fullLayout.scene._scene.getCamera();
    const k = sampleAt(scene.times, page.ticks[page.shown]);
    const places = scene.flat(Array.from({ length: scene.n }, (_, j) => scene.position(k, j)));
    const signs = Object.fromEntries(scene.signs(k).map(({ word, to }) => [word, scene.flat([to])[0]]));
    const frame = scene.div.getBoundingClientRect();
    const [x, y] = [frame.left + frame.width / 2, frame.top + frame.height / 2];
    const labels = [...scene.names.element.children].filter((span) => !span.hidden).map((span) => {
        const range = document.createRange();
        range.selectNodeContents(span);
        const box = range.getBoundingClientRect();
        return { text: span.textContent, box: [box.left - x, box.top - y, box.right - x, box.bottom - y] };
    });
    return { labels, places, signs, wide: frame.width, tall: frame.height };
"""


def overlap(first, second):
    return first[0] < second[2] and second[0] < first[2] and first[1] < second[3] and second[1] < first[3]


def distance(box, point):
    """Distance of a point from a box, zero inside [px]."""
    (left, top, right, bottom), (x, y) = box, point
    return max(left - x, 0.0, x - right) + max(top - y, 0.0, y - bottom)


@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_names_in_the_3d_picture_cover_neither_each_other_nor_a_marker(browser, folder, width, share):
    load(browser, folder / "report.html", width=width)
    scrub(browser, share)
    found = browser.execute_script(NAMES)
    boxes, wide, tall = [label["box"] for label in found["labels"]], found["wide"], found["tall"]
    assert sorted(" ".join(label["text"] for label in found["labels"]).split()) == ["sc1", "sc2"]
    for number, (left, top, right, bottom) in enumerate(boxes):
        assert -wide / 2 < left < right < wide / 2 and -tall / 2 < top < bottom < tall / 2
        assert not any(left < x < right and top < y < bottom for x, y in found["places"])
        assert not any(overlap(boxes[number], other) for other in boxes[number + 1 :])


def names_stand_beside_what_they_name(browser):
    found = browser.execute_script(NAMES)
    points = {**found["signs"], **{f"sc{j + 1}": place for j, place in enumerate(found["places"])}}
    words = [(word, label["box"]) for label in found["labels"] for word in label["text"].split()]
    boxes = [label["box"] for label in found["labels"]]
    apart = not any(overlap(box, other) for n, box in enumerate(boxes) for other in boxes[n + 1 :])
    return bool(words) and apart and all(distance(box, points[word]) < 25.0 for word, box in words)


def test_names_follow_a_picture_that_is_turned_and_zoomed_by_hand(report):
    camera = "return JSON.stringify(page.runs[0].scene.div._fullLayout.scene._scene.getCamera())"
    report.find_element(By.ID, "directions").click()
    settled(report)
    scene = report.find_element(By.ID, "scene-0")
    start = report.execute_script(camera)
    hand = webdriver.ActionChains(report).move_to_element(scene).click_and_hold()
    hand.move_by_offset(90, 60).move_by_offset(20, 40).perform()
    wait(report, lambda: report.execute_script(camera) != start and names_stand_beside_what_they_name(report))
    webdriver.ActionChains(report).release().perform()
    turned = report.execute_script(camera)
    origin = ScrollOrigin.from_element(scene)
    webdriver.ActionChains(report).scroll_from_origin(origin, 0, 250).perform()
    wait(report, lambda: report.execute_script(camera) != turned and names_stand_beside_what_they_name(report))
    assert not errors(report)


def test_a_spacecraft_behind_the_body_has_no_name(report):
    behind = """
        const scene = page.runs[0].scene;
        const k = sampleAt(scene.times, page.ticks[page.shown]);
        const away = unit(scene.position(k, 0)).map((v) => -v);
        return scene.look(scene.camera(away, [0, 0, 0], 5 * scene.bodyRadius)).then(() => true);
    """
    assert len(report.execute_script(NAMES)["labels"]) > 0
    report.execute_script(behind)
    wait(report, lambda: not any("sc1" in label["text"] for label in report.execute_script(NAMES)["labels"]))


def test_a_spacecraft_outside_the_picture_does_not_join_its_name_to_that_of_another(report):
    close = """
        const scene = page.runs[0].scene;
        const k = sampleAt(scene.times, page.ticks[page.shown]);
        const [spot, other] = [scene.position(k, 0), scene.position(k, 1)];
        const apart = Math.hypot(...spot.map((v, axis) => v - other[axis]));
        const sideways = unit(cross(spot.map((v, axis) => v - other[axis]), [0, 0, 1]));
        return scene.look(scene.camera(sideways, spot, apart)).then(() => true);
    """
    report.execute_script(close)
    wait(report, lambda: [label["text"] for label in report.execute_script(NAMES)["labels"]] == ["sc1"])
    found = report.execute_script(NAMES)
    assert distance(found["labels"][0]["box"], found["places"][0]) < 25.0


def test_a_browser_that_cannot_unpack_the_plots_says_so(browser, folder):
    missing = {"source": "delete window.DecompressionStream"}
    added = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", missing)
    try:
        browser.get((folder / "report.html").as_uri())
        warning = wait(browser, lambda: browser.find_elements(By.CSS_SELECTOR, "#replay .warning"))[0]
        assert "cannot be drawn in this browser" in warning.text
        assert browser.execute_script("return document.body.dataset.ready || null") is None
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)
        browser.get_log("browser")


def test_the_slider_changes_the_coverage_shown(report):
    scrub(report, 0.0)
    start = text(report, "clock"), text(report, "share"), cells_seen(report)
    scrub(report, 1.0)
    end = text(report, "clock"), text(report, "share"), cells_seen(report)
    assert start[0] == "0 min 00 s" and end[0] == "20 min 00 s"
    assert float(start[1].split()[0]) < 10.0 < 99.0 < float(end[1].split()[0])
    assert start[2] < end[2] == 170
    scrub(report, 0.3)
    assert start[2] < cells_seen(report) < end[2]


def test_the_table_of_the_instant_follows_the_slider(report):
    rows = ".now tbody tr:first-child td"
    scrub(report, 0.4)
    observing = [cell.text for cell in report.find_elements(By.CSS_SELECTOR, rows)]
    scrub(report, 1.0)
    relaying = [cell.text for cell in report.find_elements(By.CSS_SELECTOR, rows)]
    assert observing[0] == "target observing" and relaying[0] == "Earth tracking"
    assert observing[3] == "open"


def test_play_moves_time_on_and_pauses_and_ends(report):
    scrub(report, 0.2)
    play = report.find_element(By.ID, "play")
    before = report.execute_script("return page.tick")
    play.click()
    wait(report, lambda: report.execute_script("return page.tick") > before + 2)
    assert play.get_attribute("aria-label") == "Pause"
    play.click()
    assert play.get_attribute("aria-label") == "Play"
    at = settled(report)
    assert report.execute_script("return page.tick") == at
    report.execute_script("document.getElementById('speed').value = '10000'")
    play.click()
    wait(report, lambda: not report.execute_script("return page.playing"))
    assert settled(report) == report.execute_script("return page.ticks.length - 1")
    assert not errors(report)


@pytest.mark.parametrize("subplot", ["xy", "x2y2", "x3y3", "x4y4"])
def test_pointing_at_a_plot_shows_its_time_everywhere_and_leaving_goes_back(report, subplot):
    kept = scrub(report, 1.0)
    area = report.find_element(By.CSS_SELECTOR, f".nsewdrag[data-subplot={subplot}]")
    report.execute_script("arguments[0].scrollIntoView({block: 'center'})", area)
    quarter = -round(area.size["width"] / 4)
    webdriver.ActionChains(report).move_to_element_with_offset(area, quarter, 0).perform()
    wait(report, lambda: text(report, "clock").startswith(("4 min 5", "5 min 0")))
    shown = settled(report)
    assert report.execute_script("return page.tick") == kept
    box = "const b = (s) => document.querySelector(s).getBoundingClientRect();"
    left, width = report.execute_script(box + "const a = b('.nsewdrag[data-subplot=xy]'); return [a.left, a.width]")
    cursor = report.execute_script(box + "const c = b('#cursor'); return c.left + c.width / 2")
    t = report.execute_script("return page.ticks[arguments[0]]", shown)
    assert cursor == pytest.approx(left + width * t / 1200.0, abs=1.5)
    row = report.find_element(By.CSS_SELECTOR, ".now tbody tr td:nth-of-type(2)").text
    assert row == report.execute_script("return short(page.runs[0].pointing[page.runs[0].n * arguments[0]])", shown)
    webdriver.ActionChains(report).move_to_element(report.find_element(By.ID, "play")).perform()
    wait(report, lambda: text(report, "clock") == "20 min 00 s")
    assert settled(report) == kept


def test_zooming_one_plot_zooms_all(report):
    ranges = """
        const done = arguments[0];
        Plotly.relayout(page.plots, {'xaxis4.range[0]': 8, 'xaxis4.range[1]': 12}).then(() =>
            done(['xaxis', 'xaxis2', 'xaxis3', 'xaxis4'].map((axis) => page.plots._fullLayout[axis].range)))
    """
    for low, high in report.execute_async_script(ranges):
        assert (low, high) == (8, 12)


@pytest.mark.parametrize("width", [400, 1280])
def test_no_page_is_wider_than_its_window(browser, folder, comparison, width):
    for path in (folder / "report.html", comparison):
        load(browser, path, width)
        browser.execute_script("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
        wide = browser.execute_script("return document.documentElement.scrollWidth")
        assert wide <= width, path.name
        outside = """
            return [...document.querySelectorAll('button, input, select, .plot3d, #plots')].filter((e) => {
                const box = e.getBoundingClientRect(); return box.left < 0 || box.right > innerWidth + 0.5;
            }).map((e) => e.id || e.outerHTML)
        """
        assert browser.execute_script(outside) == []


def test_the_arrow_keys_move_the_slider_and_space_plays(report):
    scrub(report, 0.5)
    slider = report.find_element(By.ID, "slider")
    before = settled(report)
    slider.send_keys(Keys.ARROW_RIGHT)
    assert settled(report) == before + 1
    slider.send_keys(Keys.ARROW_LEFT, Keys.ARROW_LEFT)
    assert settled(report) == before - 1
    assert slider.get_attribute("aria-valuetext").startswith(text(report, "clock"))
    slider.send_keys(Keys.HOME)
    assert settled(report) == 0
    slider.send_keys(Keys.END)
    assert text(report, "clock") == "20 min 00 s"
    play = report.find_element(By.ID, "play")
    play.send_keys(Keys.SPACE)
    wait(report, lambda: report.execute_script("return page.playing"))
    play.send_keys(Keys.SPACE)
    wait(report, lambda: not report.execute_script("return page.playing"))


def test_every_control_is_reached_with_the_tab_key(report):
    wanted = {"theme", "views", "scene-0", "play", "slider", "speed"}
    report.find_element(By.ID, "theme").send_keys("")
    report.execute_script("document.getElementById('theme').focus()")
    reached = {"theme"}
    for _ in range(60):
        report.switch_to.active_element.send_keys(Keys.TAB)
        reached.add(report.switch_to.active_element.get_attribute("id"))
    assert wanted <= reached


def test_keys_and_buttons_turn_and_zoom_the_3d_picture(report):
    eye = "const c = page.runs[0].scene.div.layout.scene.camera; return [c.eye.x, c.eye.y, c.eye.z]"
    busy = "arguments[arguments.length - 1](null)"
    before = report.execute_script(eye)
    scene = report.find_element(By.ID, "scene-0")
    scene.send_keys(Keys.ARROW_RIGHT)
    wait(report, lambda: report.execute_script(eye) != before)
    turned = report.execute_script(eye)
    assert turned[2] == pytest.approx(before[2], abs=1e-6)
    report.find_element(By.CSS_SELECTOR, "[data-look=closer]").click()
    wait(report, lambda: report.execute_script(eye) != turned)
    report.execute_async_script(busy)
    report.find_element(By.CSS_SELECTOR, "[data-look=overview]").click()
    wait(report, lambda: report.execute_script(eye) == pytest.approx(before, abs=1e-9))
    assert not errors(report)


def contrast(first, second):
    """Contrast of two sRGB colours (WCAG 2.2)."""

    def luminance(colour):
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in colour)]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("name", [LIGHT, DARK])
def test_text_is_readable_in_light_and_dark(report, name):
    scheme(report, name)
    settled(report)
    colours = """
        const rgb = (text) => text.match(/[0-9.]+/g).slice(0, 3).map(Number);
        const style = (selector) => getComputedStyle(document.querySelector(selector));
        return ['h1', 'nav a', 'p.soft', '.numbers dd', '.numbers dt', 'caption', 'td'].map((selector) =>
            [selector, rgb(style(selector).color), rgb(style('section').backgroundColor)]
        ).concat([['plot', rgb(style('#plots .ytick text').fill), rgb(style('section').backgroundColor)]])
    """
    wait(report, lambda: min(contrast(a, b) for _, a, b in report.execute_script(colours)) >= 4.5)
    dark = report.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert (contrast([int(v) for v in dark[4:-1].split(",")], (255, 255, 255)) > 4.5) == (name == DARK)


def test_the_button_switches_the_theme_of_page_and_plots(report):
    ink = "return getComputedStyle(document.querySelector('#plots .ytick text')).fill"
    before = report.execute_script(ink)
    report.find_element(By.ID, "theme").click()
    wait(report, lambda: report.execute_script(ink) != before)
    assert not errors(report)


def test_two_runs_share_one_slider(browser, comparison):
    load(browser, comparison)
    assert browser.execute_script("return page.runs.length") == 2
    scrub(browser, 0.4)
    first = text(browser, "share")
    scrub(browser, 1.0)
    shares = [float(part.split()[0]) for part in text(browser, "share").split("|")]
    assert first != text(browser, "share")
    assert len(shares) == 2 and shares[0] > shares[1]  # the narrower camera of the second sees less at the visit alone
    hidden = "return [...document.querySelectorAll('#parameters tr.same')].every((row) => row.offsetParent === null)"
    assert browser.execute_script(hidden)
    box = browser.find_element(By.ID, "only-differences")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", box)
    box.click()
    assert not browser.execute_script(hidden)
    assert not errors(browser)
