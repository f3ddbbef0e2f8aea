"""Snippets of README, of the site's first page and of the tutorial are run, commands typed."""

import re
import shlex
from pathlib import Path

import matplotlib
import pytest

from swarm_mj.cli.main import main
from swarm_mj.figures import drawing
from swarm_mj.io.atomic import FIGURES

ROOT = Path(__file__).parents[2]
TUTORIAL = ("fly", "look", "change", "design", "train")
#: Its commands and its Python need the extra `spice`.
ELSEWHERE = "docs/how-to/take_results_elsewhere.md"
#: What makes commands quick; what is left out has tests of its own.
QUICK = {"fly": ["--quiet", "--no-figures", "--no-report"], "design": ["--quiet", "--no-figures"]}
QUICK |= {"export": [], "observe": ["--quiet"]}


def snippets(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / page).read_text("utf-8"), re.DOTALL | re.MULTILINE)


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """An empty folder, the current one."""
    monkeypatch.chdir(tmp_path)
    # Two figures in the place of all, and drawn here: both have tests of their own.
    monkeypatch.setitem(FIGURES, "run", ("operation", "coverage"))
    monkeypatch.setattr(drawing, "usable_cores", lambda: 1)
    matplotlib.use("Agg")
    return tmp_path


def test_the_tutorial_is_the_five_pages_in_the_navigation():
    assert re.findall(r"tutorial/(\w+)\.md", (ROOT / "mkdocs.yml").read_text()) == list(TUTORIAL)
    assert {path.stem for path in (ROOT / "docs" / "tutorial").glob("*.md")} == set(TUTORIAL)


@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        "docs/index.md",
        "docs/how-to/environment_family.md",
        "docs/how-to/environments.md",
        "docs/how-to/faults.md",
        "docs/how-to/reports.md",
        "docs/how-to/swarm_observe.md",
        "docs/how-to/swarm_pointing.md",
        ELSEWHERE,
        *(f"docs/tutorial/{name}.md" for name in TUTORIAL),
    ],
)
def test_the_python_of_a_page_runs_from_top_to_bottom(page, desk):
    code = snippets(page, "python")
    assert code
    if page == ELSEWHERE:
        pytest.importorskip("spiceypy")
    names = {"__name__": "__main__"}
    for number, snippet in enumerate(code):
        exec(compile(snippet, f"{page}, snippet {number}", "exec"), names)


def test_pages_name_environments_so_that_the_order_of_imports_does_not_matter():
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("[hit]*/*.md"), *(ROOT / "examples").rglob("*.py")]
    assert not [page.name for page in pages if re.search(r"make(_vec)?\(\s*\"swarm_mj:", page.read_text("utf-8"))]


@pytest.mark.parametrize("name", [name for name in TUTORIAL if snippets(f"docs/tutorial/{name}.md", "sh")])
def test_the_commands_of_a_tutorial_page_work(name, desk):
    type_commands(f"docs/tutorial/{name}.md")
    assert list((desk / "results").glob("*/summary.json"))


def test_the_commands_of_the_page_on_other_programs_work(desk):
    pytest.importorskip("spiceypy")
    type_commands(ELSEWHERE)
    assert (desk / "results" / "eros-quick-export" / "spice" / "swarm.tm").is_file()
    assert (desk / "results" / "judged" / "observation.json").is_file()


def type_commands(page):
    for snippet in snippets(page, "sh"):
        for line in snippet.splitlines():
            program, command, *arguments = shlex.split(line)
            assert program == "swarm-mj"
            quick = [option for option in QUICK[command] if option not in arguments]
            assert main([command, *arguments, *quick]) == 0
