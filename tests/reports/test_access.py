"""The report for everyone: on a narrow page, by keyboard, in light and dark."""

import pytest

pytest.importorskip("selenium.webdriver")
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

from .browser import DARK, LIGHT, errors, load, scheme, scrub, settled, text, wait  # noqa: E402

pytestmark = [pytest.mark.browser, pytest.mark.slow]


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


@pytest.mark.parametrize("width", [400, 1280])
def test_the_title_of_the_time_axis_lies_clear_of_its_numbers_bars_and_legend(browser, folder, comparison, width):
    for path in (folder / "report.html", comparison):
        load(browser, path, width)
        boxes = """
            const box = (e) => {
                const {left, top, right, bottom} = e.getBoundingClientRect(); return [left, top, right, bottom];
            };
            const all = (selector) => [...document.querySelectorAll(selector)].map(box);
            return [all('#plots .g-x4title'), all('#plots .x4tick'), all('#plots .nsewdrag[data-subplot="x4y4"]'),
                    all('#plots .legend, #plots .legend2')];
        """
        (title,), ticks, areas, legends = browser.execute_script(boxes)
        assert len(ticks) >= 3 and len(areas) == 1 and legends, path.name
        for other in (*ticks, *areas, *legends):
            apart = (title[0] >= other[2], title[2] <= other[0], title[1] >= other[3], title[3] <= other[1])
            assert any(apart), (path.name, title, other)


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
    report.find_element(By.CSS_SELECTOR, "[data-view=closer]").click()
    wait(report, lambda: report.execute_script(eye) != turned)
    report.execute_async_script(busy)
    report.find_element(By.CSS_SELECTOR, "[data-view=overview]").click()
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
