"""Every package that the library imports is declared, so that a fresh install has it."""

import ast
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Distribution of a module where the names differ.
DISTRIBUTION = {
    "yaml": "pyyaml",
    "mpl_toolkits": "matplotlib",
    "PIL": "pillow",
    "erfa": "pyerfa",
    "skimage": "scikit-image",
}
#: Imported where present, with something else in their place where not.
OPTIONAL = {"polyhedral_gravity", "astropy", "shapely", "glfw"}
#: Imported by what an extra brings: training, multi-agent, the window, campaigns on clusters, SPICE kernels, maps, ONNX.
EXTRAS = {
    "stable_baselines3",
    "sb3_contrib",
    "torch",
    "pettingzoo",
    "pygame",
    "distributed",
    "pyarrow",
    "spiceypy",
    "rasterio",
    "onnxruntime",
}


def test_every_imported_package_is_a_declared_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = {re.split(r"[<>=;\[ ]", d)[0].lower().replace("_", "-") for d in project["dependencies"]}
    imported = set()
    for path in [*ROOT.glob("swarm_mj/**/*.py"), *ROOT.glob("envs/**/*.py")]:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.split(".")[0])
    foreign = imported - set(sys.stdlib_module_names) - {"swarm_mj"} - OPTIONAL - EXTRAS
    missing = {m for m in foreign if DISTRIBUTION.get(m, m).lower().replace("_", "-") not in declared}
    assert not missing


def test_every_package_folder_is_in_the_wheels_list():
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    listed = set(tool["packages"]) - {"swarm_mj.envs", "swarm_mj.assets"}
    there = {".".join(p.parent.relative_to(ROOT).parts) for p in ROOT.glob("swarm_mj/**/__init__.py")}
    there |= {f"swarm_mj.envs.{p.parent.name}" for p in ROOT.glob("envs/*/__init__.py")}
    assert listed == there
