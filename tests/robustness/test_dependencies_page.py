"""docs/results/dependencies.md lists every declared dependency with its bound and its licence."""

import re
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.robust

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
DECLARED = [
    text
    for text in [*PROJECT["dependencies"], *(d for group in PROJECT["optional-dependencies"].values() for d in group)]
    if not text.startswith("swarm_mj")
]
PAGE = (ROOT / "docs" / "results" / "dependencies.md").read_text("utf-8")


def parts(text):
    name, bound = re.match(r"([A-Za-z0-9._-]+)\s*(?:\[[^\]]*\])?\s*([^;]*)", text).groups()
    return name, bound.strip()


def test_every_dependency_has_a_lower_bound_and_stands_on_the_page_with_it_and_licence_and_purpose():
    for name, bound in map(parts, DECLARED):
        assert re.match(r">=\d", bound), name
        row = next((line for line in PAGE.splitlines() if line.startswith(f"| {name} |")), None)
        assert row, f"{name} is missing: run python -m scripts.pages.dependencies"
        _, _, versions, licence, purpose, _ = (cell.strip() for cell in row.split("|"))
        assert versions.startswith(bound), name
        assert licence not in {"", "not stated"} and purpose, name


def test_nothing_under_the_gpl_is_always_installed():
    always = PAGE.split("## Always installed")[1].split("## ")[0] + PAGE.split("ones bring along\n")[1]
    assert len(re.findall(r"^\| ", always, re.MULTILINE)) > len(PROJECT["dependencies"])
    assert not re.search(r"(?<!L)GPL|GNU General", always)
