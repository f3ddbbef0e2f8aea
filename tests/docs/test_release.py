"""What names the version agrees: the package, the changelog, the citation."""

import re
from datetime import date
from importlib.metadata import version
from pathlib import Path

import yaml

import swarm_mj as sm

ROOT = Path(__file__).parents[2]


def test_package_changelog_and_citation_name_the_same_version_and_date():
    assert version("swarm_mj") == sm.__version__
    number, day = re.search(
        r"^## \[(\d+\.\d+\.\d+)\] - (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    ).groups()
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert number == sm.__version__ == citation["version"]
    assert date.fromisoformat(day) == citation["date-released"]


def test_the_citation_is_of_the_software_with_the_paper_as_a_reference():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["type"] == "software" and citation["title"].startswith("swarm_mj")
    assert "preferred-citation" not in citation  # programs would give that in place of the software
    assert [reference["number"] for reference in citation["references"]] == ["AAS 19-144"]


def test_workflows_and_issue_forms_are_valid_yaml_and_name_what_exists():
    for path in (ROOT / ".github").rglob("*.yml"):
        yaml.safe_load(path.read_text())
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        for target in re.findall(r"run: make ([a-z-]+)", path.read_text()):
            assert target in targets
