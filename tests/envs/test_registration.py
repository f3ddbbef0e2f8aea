"""gymnasium knows the environment whatever is imported first, and importing it costs nothing."""

import subprocess
import sys

import pytest

MADE = "assert env.unwrapped.__class__.__name__ == 'SwarmObserveEnv'; print('made')"


@pytest.mark.parametrize("module", ["swarm_mj", "swarm_mj.envs"])
@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium; env = gymnasium.make('{module}:SwarmObserve-v0')",
        "import {module}; import gymnasium; env = gymnasium.make('SwarmObserve-v0')",
        "import gymnasium; import {module}; env = gymnasium.make('SwarmObserve-v0')",
        "import {module}; from gymnasium.envs.registration import make; env = make('SwarmObserve-v0')",
    ],
)
def test_gymnasium_finds_the_environment_in_any_order_of_imports(module, code):
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code.format(module=module) + "; " + MADE],
        capture_output=True,
        text=True,
    )
    assert done.stdout.strip() == "made", done.stderr


def test_importing_the_environments_loads_no_heavy_module_and_gymnasium_is_left_as_it_was():
    code = (
        "import sys, swarm_mj.envs\n"
        "print([m for m in ('numpy', 'mujoco', 'numba', 'gymnasium') if m in sys.modules])\n"
        "import gymnasium, inspect\n"
        "print('exec_module' in vars(gymnasium.__spec__.loader), len(inspect.getsource(gymnasium)) > 100)\n"
        "print(any('swarm' in type(f).__module__ for f in sys.meta_path))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:3] == ["[]", "False True", "False"]


def test_without_gymnasium_the_import_fails_as_ever():
    code = (
        "import sys, swarm_mj.envs\n"
        "class Hide:\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'gymnasium': raise ModuleNotFoundError('hidden')\n"
        "sys.meta_path.insert(1, Hide())\n"
        "try:\n"
        "    import gymnasium\n"
        "except ModuleNotFoundError as error:\n"
        "    print(error)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "hidden"
