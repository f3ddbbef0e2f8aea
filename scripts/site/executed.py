"""Cells that are run when the site is built, and what they print and draw as Markdown.

The cells of a page share one Jupyter kernel, in a folder of their own. A cell that fails fails the build.
"""

from __future__ import annotations

import base64
import hashlib
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

#: A fenced block of Python on a page.
FENCE = re.compile(r"^```python\n(.*?)^```\n", re.DOTALL | re.MULTILINE)
#: Colours and cursor movements of terminals.
ANSI = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
#: Seconds that a cell may take, compilation at a first run included.
TIME_LIMIT_S = 600


def run(cells: Sequence[str]) -> list[list[dict[str, Any]]]:
    """Run cells of Python one after the other; their outputs as nbformat describes them.

    Raises:
        nbclient.exceptions.CellExecutionError: A cell raised something.
    """
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    execute(notebook)
    return [cell.outputs for cell in notebook.cells]


def execute(notebook: nbformat.NotebookNode) -> None:
    """Run a notebook's cells in a kernel of its own and in an empty folder; the outputs go into the notebook.

    Raises:
        nbclient.exceptions.CellExecutionError: A cell raised something.
    """
    quiet = ["--IPKernelApp.log_level=40"]
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=TIME_LIMIT_S, resources=resources, extra_arguments=quiet).execute()


def page_with_outputs(markdown: str, pictures: dict[str, bytes]) -> str:
    """A page with the output of every fenced block of Python below it; pictures are added to `pictures` by file name."""
    outputs = iter(run([found[1] for found in FENCE.finditer(markdown)]))
    return FENCE.sub(lambda found: found[0] + "\n" + as_markdown(next(outputs), pictures) + "\n", markdown)


def notebook_page(path: Path, pictures: dict[str, bytes], *, execute: bool) -> str:
    """A notebook as Markdown; with `execute` its cells are run and their outputs shown."""
    cells = nbformat.read(path, as_version=4).cells
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    outputs = iter(run(code) if execute else [[] for _ in code])
    parts = []
    for cell in cells:
        parts.append(cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```")
        if cell.cell_type == "code":
            parts.append(as_markdown(next(outputs), pictures))
    return "\n\n".join(part for part in parts if part) + "\n"


def as_markdown(outputs: Sequence[dict[str, Any]], pictures: dict[str, bytes]) -> str:
    """Outputs of a cell: text in fences, tables as HTML, pictures by file name."""
    return "\n\n".join(part for output in _joined(outputs) for part in _parts(output, pictures))


def _joined(outputs: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Outputs with the pieces of a stream put together; what is said to stderr (progress, remarks) is left out."""
    text = "".join(output["text"] for output in outputs if output.get("name") == "stdout")
    if text.strip():
        yield {"output_type": "stream", "text": text}
    yield from (output for output in outputs if output["output_type"] != "stream")


def _parts(output: dict[str, Any], pictures: dict[str, bytes]) -> Iterator[str]:
    if output["output_type"] == "stream":
        yield _fenced(output["text"])
        return
    data = output["data"]
    if "text/html" in data:
        yield f'<div class="output">\n{_one_line(data["text/html"])}\n</div>'
    elif "image/png" in data:
        png = base64.b64decode(data["image/png"])
        name = f"{hashlib.sha256(png).hexdigest()[:16]}.png"
        pictures[name] = png
        yield f"![output of the cell above]({name})"
    elif "text/plain" in data:
        yield _fenced(data["text/plain"])


def _one_line(html: str) -> str:
    """HTML without line breaks and style sheets, so that Markdown leaves it as it is."""
    return " ".join(re.sub(r"<style.*?</style>", "", html, flags=re.DOTALL).split())


def _fenced(text: str) -> str:
    return f"``` {{ .text .output }}\n{ANSI.sub('', text).rstrip()}\n```"
