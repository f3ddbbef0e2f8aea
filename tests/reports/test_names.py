"""Names in the 3-D picture of the report stand beside what they name and cover nothing."""

import pytest

webdriver = pytest.importorskip("selenium.webdriver")
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402

from .browser import errors, load, scrub, settled, wait  # noqa: E402

pytestmark = [pytest.mark.browser, pytest.mark.slow]

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
    report.execute_script("arguments[0].scrollIntoView({block: 'center'})", scene)
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
        return scene.moveCamera(scene.camera(away, [0, 0, 0], 5 * scene.bodyRadius)).then(() => true);
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
        return scene.moveCamera(scene.camera(sideways, spot, apart)).then(() => true);
    """
    report.execute_script(close)
    wait(report, lambda: [label["text"] for label in report.execute_script(NAMES)["labels"]] == ["sc1"])
    found = report.execute_script(NAMES)
    assert distance(found["labels"][0]["box"], found["places"][0]) < 25.0
