"""The plan of the house holds: imports go one way and never in a circle, and nobody reaches into another object's privates."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: The rooms in the order in which they build on each other; a module may import from its own room and from earlier ones.
ORDER = (
    ("errors", "typing", "compilation", "plugins", "assets"),
    ("io",),
    ("scenarios",),
    ("smallbody",),
    ("spacecraft",),
    ("tracks",),
    ("mission",),
    ("dataflow",),
    ("simulator",),
    ("observation",),
    ("navigation",),
    ("coordination",),
    ("flight",),
    ("designer",),
    ("interop",),
    ("records",),
    ("figures",),
    ("reports",),
    ("products",),
    ("rendering",),
    ("campaigns",),
    ("ideas",),
    ("envs",),
    ("verification",),
    ("api",),
    ("cli",),
    ("__main__",),
)
RANK = {name: rank for rank, rooms in enumerate(ORDER) for name in rooms}
#: Pure physics takes arrays and returns arrays.
WITHOUT_MUJOCO = (
    "scenarios",
    "smallbody",
    "spacecraft/attitude",
    "spacecraft/control",
    "tracks",
    "mission",
    "dataflow",
    "simulator/faults",
    "observation",
    "navigation",
    "coordination",
)
#: Names with an underscore that their libraries document (NamedTuple), or offer no public name for.
OF_LIBRARIES = {"_replace", "_asdict", "_fields", "_make", "_field_defaults"}
OF_LIBRARIES |= {"os._exit", "argparse._SubParsersAction", "mjmodel._address", "data._address"}
# Of numba's struct proxies: its guide to extending it reads them so.
OF_LIBRARIES |= {"_getvalue"}
# Numba offers no other way to keep machine code otherwise than by its own class.
OF_LIBRARIES |= {"dispatcher._cache"}


def modules():
    return sorted([*ROOT.glob("swarm_mj/**/*.py"), *ROOT.glob("envs/**/*.py")])


def name_of(path):
    """Dotted name of a module's file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = ("swarm_mj", *parts) if parts[0] == "envs" else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {name_of(path): path for path in modules()}
TREES = {path: ast.parse(path.read_text("utf-8")) for path in modules()}


@cache
def imports(path):
    """Modules that a file imports, wherever in the file, and for types only too."""
    return tuple(_imports(path))


def _imports(path):
    package = name_of(path) if path.name == "__init__.py" else name_of(path).rpartition(".")[0]
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package.split(".")[: len(package.split(".")) + 1 - node.level]) if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            for alias in node.names:
                inner = f"{module}.{alias.name}"
                yield inner if inner in NAMES else module


def test_a_module_imports_only_what_stands_before_it():
    for module, path in NAMES.items():
        if module == "swarm_mj":
            continue  # the package itself opens onto all rooms
        part = module.split(".")[1]
        assert part in RANK, f"{part} has no place in the order of rooms"
        for name in imports(path):
            if name.startswith("swarm_mj.") and (target := name.split(".")[1]) in RANK:
                assert RANK[target] <= RANK[part], f"{module} imports {name}, which stands behind it"


def test_no_imports_form_a_circle():
    graph = {name: {found for found in imports(path) if found in NAMES} for name, path in NAMES.items()}
    del graph["swarm_mj"]
    done: set[str] = set()

    def visit(name, trail):
        assert name not in trail, f"a circle of imports: {' -> '.join([*trail[trail.index(name) :], name])}"
        if name not in done:
            for following in sorted(graph.get(name, ())):
                visit(following, [*trail, name])
            done.add(name)

    for name in graph:
        visit(name, [])


def private_reads(tree):
    """Attributes with an underscore that a file reads of anything but itself."""
    own = {node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)} | {"self", "cls"}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or not node.attr.startswith("_") or node.attr.startswith("__"):
            continue
        holder = node.value
        is_own = (isinstance(holder, ast.Name) and holder.id in own) or (
            isinstance(holder, ast.Call) and getattr(holder.func, "id", "") == "super"
        )
        if not is_own and not {node.attr, ast.unparse(node)} & OF_LIBRARIES:
            yield f"{node.lineno} reads {ast.unparse(node)}"


def test_no_module_reads_another_objects_private_attributes():
    assert [f"{path.name}:{read}" for path, tree in TREES.items() for read in private_reads(tree)] == []


@pytest.mark.parametrize("part", WITHOUT_MUJOCO)
def test_pure_parts_do_not_import_mujoco(part):
    folder = ROOT / "swarm_mj" / part
    for path in folder.rglob("*.py"):
        assert not [name for name in imports(path) if name.split(".")[0] == "mujoco"], path
    assert folder.is_dir()
