"""What MkDocs calls while it builds the site; named in mkdocs.yml. Run it as `python -m mkdocs` from the top folder.

Generated pages are made in memory. Tutorial pages, examples and notebooks are run and shown with their output, unless the
environment variable SWARM_MJ_SITE_EXECUTE is 0.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from scripts.site import api, bibliography, commands, examples, executed, formulas, plug_ins, scenario_keys

#: Pages that are generated, by their place below docs/.
PAGES: dict[str, Callable[[], str]] = {
    "reference/api.md": api.public_page,
    "reference/command_line.md": commands.page,
    "reference/scenario.md": scenario_keys.page,
    "reference/plug_ins.md": plug_ins.page,
    "reference/bibliography.md": bibliography.page,
    "contributing.md": lambda: _of_the_top_folder("CONTRIBUTING.md"),
    "changelog.md": lambda: _of_the_top_folder("CHANGELOG.md"),
}


def executes() -> bool:
    """Whether pages are run."""
    return os.environ.get("SWARM_MJ_SITE_EXECUTE", "1") != "0"


def on_startup(command: str, dirty: bool) -> None:
    """Lay out the sources for the API reference: its plug-in passes over folders that are not there when it is configured."""
    api.lay_out()


def on_config(config: MkDocsConfig) -> None:
    """Lay out the sources for the API reference, and name its pages in the navigation."""
    api.lay_out()
    reference = next(section["Reference"] for section in config.nav or [] if "Reference" in section)
    reference.append({"Rooms of the library": [{room: f"reference/api/{room}.md"} for room in api.rooms()]})


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, examples and notebooks with what they draw."""
    for place, page in PAGES.items():
        _add(files, config, place, page())
    for room, modules in api.rooms().items():
        _add(files, config, f"reference/api/{room}.md", api.room_page(room, modules))
    _add_examples(files, config)
    if executes():
        _run_tutorial(files, config)
    return files


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Draw formulas."""
    return formulas.drawn(html)


def _of_the_top_folder(name: str) -> str:
    """A page that stands beside README, with its links as they are on the site."""
    return (api.ROOT / name).read_text("utf-8").replace("](docs/", "](")


def _add_examples(files: Files, config: MkDocsConfig) -> None:
    pictures: dict[str, bytes] = {}
    _add(files, config, "examples/scripts.md", examples.page(pictures, execute=executes()))
    for path in examples.notebooks():
        page = executed.notebook_page(path, pictures, execute=executes())
        _add(files, config, f"examples/{path.stem}.md", page)
    _add_pictures(files, config, "examples", pictures)


def _run_tutorial(files: Files, config: MkDocsConfig) -> None:
    pictures: dict[str, bytes] = {}
    for path in sorted((Path(config.docs_dir) / "tutorial").glob("*.md")):
        page = executed.page_with_outputs(path.read_text("utf-8"), pictures)
        _add(files, config, f"tutorial/{path.name}", page)
    _add_pictures(files, config, "tutorial", pictures)


def _add(files: Files, config: MkDocsConfig, place: str, content: str | bytes) -> None:
    old = files.get_file_from_path(place)
    if old is not None:
        files.remove(old)
    files.append(File.generated(config, place, content=content))


def _add_pictures(files: Files, config: MkDocsConfig, folder: str, pictures: dict[str, bytes]) -> None:
    for name, png in pictures.items():
        _add(files, config, f"{folder}/{name}", png)
