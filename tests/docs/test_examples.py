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
    "campaign.py": "4 flights, of which 4 went through",
    "step.py": "after 200 s:",
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


#: What is repeated, and less of it.
SHORTER = {
    "campaign.py": [("runs=4", "runs=1")],
    "train": [("FLIGHTS = 16", "FLIGHTS = 4"), ("in range(6)", "in range(2)")],
    "fly": [("[2, 3, 4, 5, 6, 8]", "[2, 8]")],
}


def shortened(name, source):
    for long, short in SHORTER.get(name, ()):
        assert source.count(long) <= 1
        source = source.replace(long, short)
    return source


@pytest.mark.parametrize("name", examples.SCRIPTS)
def test_an_example_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(shortened(name, (FOLDER / name).read_text("utf-8")))
    runpy.run_path(str(tmp_path / name), run_name="__main__")
    assert SAYS[name] in capsys.readouterr().out


#: Before the cells of every notebook: no name and no file of the one before it is left, only what has been loaded.
ANEW = "%reset -f\nimport os, tempfile\nos.chdir(tempfile.mkdtemp(dir=os.getcwd()))\ndel os, tempfile"


@pytest.mark.slow
def test_notebooks_hold_no_output_and_run():
    """In one kernel, one after the other: a kernel takes seconds to load what all of them need."""
    together, codes = nbformat.v4.new_notebook(), {}
    for path in examples.notebooks():
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        codes[path.stem] = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert all(cell.outputs == [] and cell.execution_count is None for cell in codes[path.stem])
        for cell in codes[path.stem]:
            cell.source = shortened(path.stem, cell.source)
        together.cells += [nbformat.v4.new_code_cell(ANEW), *codes[path.stem]]
    executed.execute(together)
    for name, code in codes.items():
        outputs = [output for cell in code for output in cell.outputs]
        assert any("image/png" in output.get("data", {}) for output in outputs), name
        assert not any(output.get("name") == "stderr" and "Warning" in output.text for output in outputs), name
