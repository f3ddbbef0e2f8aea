"""Data go one way: a module imports only what stands before it."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: The order of the layers; a module may import from its own layer and from earlier ones.
ORDER = [
    ("errors", "constants", "resources", "interruption", "plugins", "progress", "cache", "assets"),
    ("scenarios",),
    ("smallbody",),
    ("attitude",),
    ("mission",),
    ("design",),
    ("spacecraft",),
    ("faults",),
    ("simulation",),
    ("observation",),
    ("planning",),
    ("flight",),
    ("candidates",),
    ("designer",),
    ("output", "drawing"),
    ("report",),
    ("validation",),
    ("runner", "design_runner", "video_runner", "web_viewer", "viewer"),
    ("campaign",),
    ("envs",),
    ("bench",),
    ("commands",),
    ("cli",),
]
RANK = {name: rank for rank, layer in enumerate(ORDER) for name in layer}
#: Pure physics takes arrays and returns arrays.
WITHOUT_MUJOCO = ("smallbody", "attitude", "mission", "design", "observation", "scenarios", "faults")


def modules():
    return sorted(p for p in [*ROOT.glob("swarm_mj/**/*.py"), *ROOT.glob("envs/**/*.py")])


def part_of(path):
    relative = path.relative_to(ROOT)
    return "envs" if relative.parts[0] == "envs" else relative.parts[1].removesuffix(".py")


def imports(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            if node.module == "swarm_mj":
                yield from (f"swarm_mj.{alias.name}" for alias in node.names)
            else:
                yield node.module


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(ROOT)))
def test_a_module_imports_only_what_stands_before_it(path):
    part = part_of(path)
    if part == "__init__":
        return
    assert part in RANK, f"{part} has no place in the order of layers"
    for name in imports(path):
        if name.startswith("swarm_mj.") and (target := name.split(".")[1]) in RANK:
            assert RANK[target] <= RANK[part], f"{path.name} imports {name}, which stands behind it"


@pytest.mark.parametrize("part", WITHOUT_MUJOCO)
def test_pure_parts_do_not_import_mujoco(part):
    for path in modules():
        if part_of(path) == part:
            assert not [name for name in imports(path) if name.split(".")[0] == "mujoco"], path


def test_files_stay_short():
    long = {str(p.relative_to(ROOT)): n for p in modules() if (n := len(p.read_text("utf-8").splitlines())) > 400}
    assert not long
