"""gymnasium knows the environments by name, and importing the package costs nothing."""

import subprocess
import sys

import pytest

MADE = "; assert type(env.unwrapped).__name__ == 'SwarmObserveEnv'; print('made')"


def output(code):
    done = subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium; env = gymnasium.make('swarm_mj:SwarmObserve-v0')",
        "import gymnasium, swarm_mj; env = gymnasium.make('SwarmObserve-v0')",
        "import gymnasium, swarm_mj.envs; env = gymnasium.make('SwarmObserve-v0')",
        "import swarm_mj.envs, gymnasium; env = gymnasium.make('SwarmObserve-v0')",
        "import swarm_mj, gymnasium; env = gymnasium.make('swarm_mj.envs:SwarmObserve-v0')",
    ],
)
def test_gymnasium_finds_the_environment(code):
    assert output(code + MADE) == "made"


def test_importing_the_package_loads_no_heavy_module_and_nothing_waits_for_gymnasium():
    code = (
        "import sys; finders = list(sys.meta_path); import swarm_mj\n"
        "print([m for m in ('numpy', 'mujoco', 'numba', 'gymnasium') if m in sys.modules], sys.meta_path == finders)"
    )
    assert output(code) == "[] True"
