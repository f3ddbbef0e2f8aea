"""Pictures in README and docs come from the program's commands, and all of them are there."""

import re
import shlex
from pathlib import Path

import pytest

from swarm_mj.figures.design_figures import COMPOSERS as DESIGN_COMPOSERS
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.scenarios.loading import packaged_names

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "figures.md"
#: Which paper figures must have a counterpart.
PAPER = range(3, 12)


@pytest.fixture(scope="module")
def images():
    return pytest.importorskip("scripts.pages.images")


def test_pictures_are_figures_that_the_commands_draw(images):
    for folder, figure in images.PICTURES:
        command, scenario, *_ = images.COMMANDS[folder]
        assert scenario in packaged_names()
        assert figure in (COMPOSERS if command == "fly" else DESIGN_COMPOSERS)


def test_every_picture_is_there(images):
    for folder, figure in images.PICTURES:
        assert (images.IMAGES / images.picture_name(folder, figure)).stat().st_size > 10_000


def test_the_gallery_shows_every_figure_with_a_picture_and_the_command_that_draws_it(images):
    sections = re.split(r"^### ", PAGE.read_text("utf-8"), flags=re.MULTILINE)[1:]
    shown = {section.split("\n")[0]: section for section in sections}
    assert set(shown) == {*COMPOSERS, *DESIGN_COMPOSERS}
    pictures = []
    for name, section in shown.items():
        found = re.findall(r"`swarm-mj (.+)`\n\n!\[.+\]\(\.\./images/(.+)\.png\)", section)
        assert found, name
        for command, picture in found:
            folder = picture.removesuffix(f"-{name}")
            typed = tuple(shlex.split(command))
            assert images.COMMANDS[folder][: len(typed)] == typed
            pictures.append((folder, name))
    assert set(pictures) == set(images.PICTURES)


def test_the_gallery_has_a_counterpart_for_each_figure_of_the_paper():
    page = PAGE.read_text("utf-8")
    for number in PAPER:
        row = re.search(rf"^\| Figure {number} \| [^|]+ \| \[`(\w+)`\]\(#(\w+)\)", page, re.MULTILINE)
        assert row, number
        assert row[1] == row[2] and row[1] in {**COMPOSERS, **DESIGN_COMPOSERS}
