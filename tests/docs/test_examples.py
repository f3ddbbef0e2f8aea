"""The short examples run and are short; the notebooks run in a kernel and hold no output."""

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples"
examples = pytest.importorskip("scripts.site.examples")
executed = pytest.importorskip("scripts.site.executed")
nbformat = pytest.importorskip("nbformat")

#: What each of them must print.
SAYS = {
    "fly.py": "% of the target observed in the passage",
    "compare.py": "half-angle [deg]",
    "design.py": "proven minimal",
    "own_body.py": "Flight('peanut', 2 spacecraft",
    "campaign.py": "16 flights, of which 16 went through",
    "step.py": "after 100 s:",
}


def test_every_example_is_on_the_page_and_in_this_test():
    found = {path.name for path in FOLDER.glob("*.py")} - {"train_sb3.py", "pointing_sb3.py", "pointing_pixels.py"}
    assert found == set(examples.SCRIPTS) == set(SAYS)
    assert {path.stem for path in (FOLDER / "notebooks").glob("*.ipynb")} == set(examples.NOTEBOOKS)


@pytest.mark.parametrize("name", examples.SCRIPTS)
def test_an_example_has_at_most_30_lines_and_uses_the_public_api(name):
    source = (FOLDER / name).read_text("utf-8")
    assert len(source.splitlines()) <= 30
    assert "import swarm_mj as sm" in source and "from swarm_mj" not in source


@pytest.mark.parametrize("name", examples.SCRIPTS)
def test_an_example_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / name), run_name="__main__")
    assert SAYS[name] in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("path", examples.notebooks(), ids=lambda path: path.stem)
def test_a_notebook_holds_no_output_and_runs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    executed.execute(notebook)
    drawn = [output for cell in code for output in cell.outputs if "image/png" in output.get("data", {})]
    assert drawn
    assert not any(
        output.get("name") == "stderr" and "Warning" in output.text for cell in code for output in cell.outputs
    )
