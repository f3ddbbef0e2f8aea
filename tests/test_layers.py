"""The plan of the house holds: imports go one way and never in a circle, and nobody reaches into another object's privates."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: The rooms in the order in which they build on each other; a module may import from its own room and from earlier ones.
ORDER = (
    ("errors", "moved", "machine_code", "typing", "plugins", "assets"),
    ("io",),
    ("scenarios",),
    ("smallbody",),
    ("spacecraft",),
    ("tracks",),
    ("mission",),
    ("dataflow",),
    ("simulator",),
    ("observation",),
    ("coordination",),
    ("flight",),
    ("designer",),
    ("interop",),
    ("results",),
    ("rendering",),
    ("campaigns",),
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
PARAMETRISED = pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(ROOT)))


def tree_of(path):
    return ast.parse(path.read_text("utf-8"))


def imports(path):
    """Modules of the package that a file imports, wherever in the file, and for types only too."""
    package = name_of(path) if path.name == "__init__.py" else name_of(path).rpartition(".")[0]
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package.split(".")[: len(package.split(".")) + 1 - node.level]) if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            for alias in node.names:
                inner = f"{module}.{alias.name}"
                yield inner if inner in NAMES else module


@PARAMETRISED
def test_a_module_imports_only_what_stands_before_it(path):
    part = name_of(path).split(".")[1] if "." in name_of(path) else None
    if part is None:
        return  # the package itself opens onto all rooms
    assert part in RANK, f"{part} has no place in the order of rooms"
    for name in imports(path):
        if name.startswith("swarm_mj.") and (target := name.split(".")[1]) in RANK:
            assert RANK[target] <= RANK[part], f"{path.name} imports {name}, which stands behind it"


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


@PARAMETRISED
def test_no_module_reads_another_objects_private_attributes(path):
    tree = tree_of(path)
    own = {node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)} | {"self", "cls"}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or not node.attr.startswith("_") or node.attr.startswith("__"):
            continue
        holder = node.value
        is_own = (isinstance(holder, ast.Name) and holder.id in own) or (
            isinstance(holder, ast.Call) and getattr(holder.func, "id", "") == "super"
        )
        allowed = {node.attr, ast.unparse(node)} & OF_LIBRARIES
        assert is_own or allowed, f"{path.name}:{node.lineno} reads {ast.unparse(node)}"


@pytest.mark.parametrize("part", WITHOUT_MUJOCO)
def test_pure_parts_do_not_import_mujoco(part):
    folder = ROOT / "swarm_mj" / part
    for path in folder.rglob("*.py"):
        assert not [name for name in imports(path) if name.split(".")[0] == "mujoco"], path
    assert folder.is_dir()


def test_files_stay_short():
    long = {str(p.relative_to(ROOT)): n for p in modules() if (n := len(p.read_text("utf-8").splitlines())) > 400}
    assert not long


#: A control law's documented argument list (`CompiledLaw.write_torque`), and what passes it on.
OF_THE_LAW = {"write_torque", "call_law", "_call"}
#: Made of keyword-only fields, as a scenario's sections are.
KEYWORD_ONLY = {"Simulation.__init__", "build_model", "run_campaign"}
MOST_ARGUMENTS = 8


def functions(tree, prefix=""):
    """All functions of a module with their qualified names."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{prefix}{node.name}", node
        inner = f"{prefix}{node.name}." if isinstance(node, ast.ClassDef) else prefix
        yield from functions(node, inner)


@PARAMETRISED
def test_no_function_takes_more_arguments_than_one_can_keep_in_mind(path):
    for name, function in functions(tree_of(path)):
        given = function.args
        by_place = [a.arg for a in (*given.posonlyargs, *given.args) if a.arg not in ("self", "cls")]
        if name in KEYWORD_ONLY:
            assert len(by_place) <= 2, f"{path.name}: {name} takes {by_place} by place"
        elif name not in OF_THE_LAW:
            count = len(by_place) + len(given.kwonlyargs)
            assert count <= MOST_ARGUMENTS, f"{path.name}: {name} takes {count} arguments"


def test_the_exceptions_to_the_number_of_arguments_are_still_needed():
    found = {name: f for path in modules() for name, f in functions(tree_of(path)) if name in OF_THE_LAW | KEYWORD_ONLY}
    assert found.keys() == OF_THE_LAW | KEYWORD_ONLY
    assert all(len(f.args.args) + len(f.args.kwonlyargs) > MOST_ARGUMENTS for f in found.values())
