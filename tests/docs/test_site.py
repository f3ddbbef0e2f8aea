"""The site builds strictly and without a network, and its reference is complete. Other tests run its cells."""

import os
import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest

import swarm_mj as sm

ROOT = Path(__file__).parents[2]
api = pytest.importorskip("scripts.site.api")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    # Signatures stay on one line: to break them takes a third of the time.
    quick = {"SWARM_MJ_SITE_EXECUTE": "0", "SWARM_MJ_SITE_LINE": "10000"}
    environment = {**os.environ, **quick, "NO_MKDOCS_2_WARNING": "1"}
    built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return folder


class Fetched(HTMLParser):
    """What a browser fetches to show a page, and the anchors on it."""

    def __init__(self, path):
        super().__init__()
        self.addresses, self.anchors = [], set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors.add(given.get("id"))
        if tag != "a" and given.get("rel") not in ("canonical", "next", "prev"):
            self.addresses += [given[key] for key in ("src", "href") if given.get(key)]


@cache
def read(path):
    return Fetched(path)


def test_pages_fetch_nothing_that_is_not_part_of_the_site(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        for address in read(page).addresses:
            if not address.startswith("data:"):
                assert "//" not in address, f"{page}: {address}"
                if page.name != "404.html":  # whose addresses count from the top of a server
                    assert (page.parent / re.split(r"[?#]", address)[0]).exists(), f"{page}: {address}"
    for sheet in site.rglob("*.css"):
        assert not re.findall(r"url\([\"']?(?:https?:)?//|@import", sheet.read_text("utf-8")), sheet


def test_every_public_name_is_on_the_page_of_the_public_api(site):
    page = (site / "reference" / "api.html").read_text("utf-8")
    for name in sm.__all__:
        assert f"sm.{name}" in page, name


def test_what_is_said_beside_a_field_and_above_one_is_in_the_reference(site):
    simulator, flow = (
        (site / "reference" / "api" / f"{room}.html").read_text("utf-8") for room in ("simulator", "dataflow")
    )
    assert "Time between two decisions [s]." in simulator  # beside `World.period`
    assert "Tick from which on Python has something to do before the decision" in simulator  # above `Flights.due`
    assert "in the last column, to Earth [bit]" in flow  # above `Contacts.peak_bit`, in two lines
    assert api.with_fields_described("    a: int  #: what\n") == "    a: int\n    'What.'\n"


def test_every_public_function_and_class_of_the_library_is_in_the_reference(site):
    rooms = api.rooms()
    assert {"api", "smallbody", "simulator", "envs"} <= set(rooms)
    for room, modules in rooms.items():
        anchors = read(site / "reference" / "api" / f"{room}.html").anchors
        for module in modules:
            for node in module.code.body:
                name = getattr(node, "name", "_")
                if not name.startswith("_"):
                    assert f"{module.name}.{name}" in anchors


def test_every_command_and_option_is_on_the_page_of_the_command_line(site):
    page = (site / "reference" / "command_line.html").read_text("utf-8")
    usage = subprocess.run([sys.executable, "-m", "swarm_mj", "--help"], capture_output=True, text=True).stdout
    commands = re.findall(r"^    (\w+) ", usage, re.MULTILINE)
    assert {"fly", "design", "campaign", "validate"} <= set(commands)
    for command in commands:
        assert f"swarm-mj {command}" in page
    assert "--overlay" not in page and "--scheduler" in page and "--policy" in page


def test_formulas_are_drawn_by_the_browser_itself(site):
    page = (site / "theory" / "attitude_control.html").read_text("utf-8")
    assert page.count("<math") > 100
    assert "\\(" not in page and "\\[" not in page and "arithmatex" not in page


def test_pages_name_a_command_that_exists_where_they_are_generated():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for page in (ROOT / "docs").rglob("*.md"):
        text = page.read_text("utf-8")
        for module in re.findall(r"python -m ((?:scripts|benchmarks)[\w.]+)", text):
            path = ROOT / module.replace(".", "/")
            assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), f"{page}: {module}"
        for target in re.findall(r"`make ([a-z-]+)", text):
            assert target in targets, f"{page}: make {target}"
