"""The wheel, installed in a venv of its own and used from a folder outside the checkout."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

import swarm_mj

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    # Built from a copy, so that a build folder of the checkout cannot leak into it.
    source = tmp_path_factory.mktemp("source") / "swarm_mj"
    patterns = shutil.ignore_patterns(".*", "*.egg-info", "__pycache__")

    def ignore(folder, names):
        made = {"build", "dist", "results", "site"} if Path(folder) == ROOT else set()
        return patterns(folder, names) | (made & set(names))

    shutil.copytree(ROOT, source, ignore=ignore)
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(out), str(source)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Runs a program of the venv with the wheel; dependencies come from this environment."""
    folder = tmp_path_factory.mktemp("venv")
    venv.create(folder, with_pip=True)
    pip = [str(folder / "bin" / "pip"), "install", "--quiet", "--no-deps", "--disable-pip-version-check", str(wheel)]
    subprocess.run(pip, check=True, capture_output=True)
    outside = tmp_path_factory.mktemp("outside")
    # As PYTHONPATH, the folder gives its packages but not the hook of an editable install.
    environment = {**os.environ, "PYTHONPATH": sysconfig.get_paths()["purelib"]}
    environment.pop("NUMBA_CACHE_DIR", None)

    def run(program, *arguments):
        command = [str(folder / "bin" / program), *arguments]
        return subprocess.run(command, cwd=outside, env=environment, capture_output=True, text=True)

    take_compiled(Path(run("python", "-c", "import swarm_mj; print(swarm_mj.__file__)").stdout.strip()).parent)
    return run, outside, folder


def take_compiled(package):
    """Give an installed package the machine code that Numba keeps of the checkout's, for each file that is the same."""
    for theirs in package.rglob("*.py"):
        within = theirs.relative_to(package)
        ours = ROOT / within if within.parts[0] in ("envs", "assets") else ROOT / "swarm_mj" / within
        assert ours.read_bytes() == theirs.read_bytes(), within
        # What Numba knows a file by; its bytecode is of that time, too.
        os.utime(theirs, ns=(ours.stat().st_atime_ns, ours.stat().st_mtime_ns))
        kept = theirs.parent / "__pycache__"
        kept.mkdir(exist_ok=True)
        for compiled in (ours.parent / "__pycache__").glob(f"{ours.stem}.*.nb[ic]"):
            shutil.copy(compiled, kept)


@pytest.mark.slow
def test_the_wheel_holds_assets_envs_and_scenarios_and_no_other_top_level_package(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0].removesuffix(f"-{swarm_mj.__version__}.dist-info") for name in names} == {"swarm_mj"}
    for needed in (
        "swarm_mj/assets/eros.obj",
        "swarm_mj/assets/eros_shape_harmonics.csv",
        "swarm_mj/assets/bennu_shape_harmonics.csv",
        "swarm_mj/scenarios/bodies/bennu.yaml",
        "swarm_mj/assets/mjcf/cubesat.xml",
        "swarm_mj/assets/mjcf/scene.xml",
        "swarm_mj/envs/__init__.py",
        "swarm_mj/envs/observe/vector.py",
        "swarm_mj/scenarios/eros-config1.yaml",
        "swarm_mj/py.typed",
    ):
        assert needed in names
    packages = {str(Path(p).parent) for p in map(str, ROOT.glob("swarm_mj/**/__init__.py"))}
    for package in packages:
        assert f"{Path(package).relative_to(ROOT)}/__init__.py" in names


@pytest.mark.slow
def test_the_installed_wheel_flies_a_scenario_outside_the_checkout(installed):
    run, outside, folder = installed
    where = run("python", "-c", "import swarm_mj.envs, swarm_mj.assets as a; print(a.__file__)")
    assert str(folder) in where.stdout, where.stderr
    assert "eros-config1" in run("swarm-mj", "available").stdout
    flown = run("swarm-mj", "fly", "eros-quick", "--quiet", "--no-figures")
    assert flown.returncode == 0, flown.stderr
    assert (outside / "results" / "eros-quick" / "summary.json").exists()
