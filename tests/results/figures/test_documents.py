"""Pictures in README and docs come from the program's commands, and all of them are there."""

import re
from pathlib import Path

import pytest

from swarm_mj.results.figures import COMPOSERS
from swarm_mj.results.figures.design import COMPOSERS as DESIGN_COMPOSERS
from swarm_mj.scenarios.loading import packaged_names

ROOT = Path(__file__).parents[3]
#: Which paper figures must have a counterpart.
PAPER = range(3, 12)


@pytest.fixture(scope="module")
def images():
    return pytest.importorskip("scripts.pages.images")


def test_pictures_are_figures_that_the_commands_draw(images):
    for folder, figure in images.PICTURES:
        command, scenario, *_ = images.COMMANDS[folder]
        assert scenario in packaged_names()
        assert figure in (COMPOSERS if command == "run" else DESIGN_COMPOSERS)


def test_every_picture_is_there(images):
    for folder, figure in images.PICTURES:
        assert (images.IMAGES / images.picture_name(folder, figure)).stat().st_size > 10_000


def test_page_of_figures_shows_every_picture_once_drawn(images):
    shown = re.findall(r"\]\(\.\./images/([^)]+)\)\]", (ROOT / "docs" / "reference" / "figures.md").read_text("utf-8"))
    made = {images.picture_name(folder, figure) for folder, figure in images.PICTURES}
    assert set(shown) <= made
    assert {figure for folder, figure in images.PICTURES} == {
        figure for folder, figure in images.PICTURES if images.picture_name(folder, figure) in shown
    }


def test_page_of_figures_has_a_counterpart_for_each_of_the_papers():
    page = (ROOT / "docs" / "reference" / "figures.md").read_text("utf-8")
    for number in PAPER:
        row = re.search(rf"^\| Figure {number} \| [^|]+ \| `(\w+)`", page, re.MULTILINE)
        assert row, number
        assert row[1] in {**COMPOSERS, **DESIGN_COMPOSERS}


def test_page_of_figures_names_every_figure_and_its_source():
    page = (ROOT / "docs" / "reference" / "figures.md").read_text("utf-8")
    for name in {**COMPOSERS, **DESIGN_COMPOSERS}:
        assert f"`{name}`" in page
    for link in re.findall(r"\]\(\.\./\.\./([^)]+)\)", page):
        assert (ROOT / link).is_file(), link
