"""The report in a real browser without a display: it loads, and everything follows the slider."""

import numpy as np
import pytest

from swarm_mj.flight.fly import asteroid_attitudes
from swarm_mj.records.run_record import read_run

webdriver = pytest.importorskip("selenium.webdriver")
from selenium.webdriver.common.by import By  # noqa: E402

from .browser import cells_seen, errors, load, scrub, settled, text, wait  # noqa: E402

pytestmark = [pytest.mark.browser, pytest.mark.slow]


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


def test_the_night_side_shows_its_ground_and_a_target_there_faces_the_camera(report):
    light = report.execute_script("return [...Mesh.light([0, 0, 1, 1, 0, 0, 0.6, 0, -0.8, 0, 0, -1], [0, 0, 1])]")
    assert light[0] == 1.0 and light[3] == 0.0 and light == sorted(light, reverse=True) and light[2] > 0.02
    toward = """
        const scene = page.runs[0].scene, sun = scene.sun, faced = [0, 0, 0];
        scene.target.faceNormals.forEach((v, place) => { faced[place % 3] += v; });
        scene.sun = sun.map((_, place) => -unit(faced)[place % 3]);
        const found = dot(scene.shownOf(scene.shown, unit(faced)), scene.side(...scene.run.scene.near));
        scene.sun = sun;
        return found;
    """
    assert report.execute_script(toward) > 0.0


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
    assert start[2] < end[2] == 144
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


def test_inertial_axes_show_the_flight_as_the_telemetry_has_it_and_the_body_turns(report, folder):
    run = read_run(folder)
    scrub(report, 0.7)
    shown = """
        const scene = page.runs[0].scene;
        const { x, y, z } = scene.div.data.find((trace) => trace.meta === "target");
        return [page.ticks[page.shown], Array.from(scene.position(page.shown, 1)), [x[0], y[0], z[0]]];
    """
    choose = "const a = document.getElementById('axes'); a.value = arguments[0]; a.dispatchEvent(new Event('change'))"
    t, r_km, corner_km = report.execute_script(shown)
    now = run.telemetry.sel(time=t)
    C_AN = asteroid_attitudes(run.telemetry)[int(np.argmin(np.abs(run.times - t)))]
    assert np.allclose(r_km, now["r_BN_N"].values[1] / 1e3, atol=1e-4)
    report.execute_script(choose, "body-fixed")
    settled(report)
    _, r_A_km, corner_A_km = report.execute_script(shown)
    assert np.allclose(r_A_km, C_AN @ now["r_BN_N"].values[1] / 1e3, atol=1e-4)
    assert np.allclose(corner_A_km, C_AN @ corner_km, atol=1e-4) and not np.allclose(corner_A_km, corner_km, atol=1e-2)


def test_the_scale_follows_spacecraft_far_from_the_body_which_is_named_where_it_is_a_speck(report):
    far = """
        const scene = page.runs[0].scene;
        scene.run.scene.near = [50, 60];
        cameraViews.near(scene);
    """
    report.execute_script(far)
    look = (
        "const s = page.runs[0].scene; return [s.half, s.inBox(s.position(s.shown, 0)), s.div.layout.scene.xaxis.range]"
    )
    halves = []
    for share in (0.0, 0.45, 1.0):
        scrub(report, share)
        wait(report, lambda: report.execute_script("return page.runs[0].scene.queue.then(() => true)"))
        half, inside, shown = report.execute_script(look)
        assert inside and shown == [-half, half]
        halves.append(half)
    assert halves[1] < min(halves[0], halves[2]) and all(np.log2(half / halves[1]) % 1.0 == 0.0 for half in halves)
    names = "return [...document.querySelectorAll('.labels span')].filter((s) => !s.hidden).map((s) => s.textContent)"
    assert "433 Eros" not in report.execute_script(names)
    away = "s.moveCamera(s.camera([0, 1, 0], [0, 0, 0], 200 * s.bodyRadius)).then(() => true)"
    report.execute_script(f"const s = page.runs[0].scene; return {away}")
    wait(report, lambda: "433 Eros" in report.execute_script(names))
    assert not errors(report)


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


def test_two_runs_share_one_slider(browser, comparison):
    load(browser, comparison)
    assert browser.execute_script("return page.runs.length") == 2
    scrub(browser, 0.4)
    first = text(browser, "share")
    scrub(browser, 1.0)
    shares = [float(part.split()[0]) for part in text(browser, "share").split("|")]
    assert first != text(browser, "share")
    assert (
        len(shares) == 2 and shares[0] > shares[1]
    )  # the narrower camera of the second sees less at the arrival alone
    hidden = "return [...document.querySelectorAll('#parameters tr.same')].every((row) => row.offsetParent === null)"
    assert browser.execute_script(hidden)
    box = browser.find_element(By.ID, "only-differences")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", box)
    box.click()
    assert not browser.execute_script(hidden)
    assert not errors(browser)
