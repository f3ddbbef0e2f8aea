"""The page of short examples, each with what it prints and draws."""

from __future__ import annotations

import ast
from pathlib import Path

from scripts.site import executed

FOLDER = Path(__file__).parents[2] / "examples"
#: In the order in which they are shown.
SCRIPTS = (
    "fly.py",
    "compare.py",
    "design.py",
    "own_body.py",
    "campaign.py",
    "step.py",
)
NOTEBOOKS = ("fly", "design", "train")


def notebooks() -> list[Path]:
    """The notebooks, in the order in which they are shown."""
    return [FOLDER / "notebooks" / f"{name}.ipynb" for name in NOTEBOOKS]


def page(pictures: dict[str, bytes], *, execute: bool) -> str:
    """Markdown of the page; with `execute` every example is run and its output shown."""
    return "\n".join([INTRODUCTION, *(_example(FOLDER / name, pictures, execute) for name in SCRIPTS)])


def _example(path: Path, pictures: dict[str, bytes], execute: bool) -> str:
    source = path.read_text("utf-8")
    words = (ast.get_docstring(ast.parse(source)) or "").strip()
    title = words.split("\n")[0].rstrip(".")
    output = executed.as_markdown(executed.run([source])[0], pictures) if execute else ""
    return f"## {title}\n\n`python examples/{path.name}`\n\n```python\n{source.strip()}\n```\n\n{output}\n"


INTRODUCTION = """# Examples

Short programs from the folder `examples`, each at most 30 lines, run when this page is built: below each stands what it
prints. [fly](fly.md), [design](design.md) and [train](train.md) are notebooks, in `examples/notebooks`. One more program,
`examples/train_sb3.py`, trains by PPO and needs the extra `rl`.
`examples/pointing_sb3.py` and `examples/pointing_pixels.py` learn [SwarmPointing-v0](../how-to/swarm_pointing.md).
"""
