"""The kernels of a GPU compile for one that need not be there, where the extra `gpu` is installed."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("numba_cuda", reason="the extra gpu is not installed")


@pytest.mark.slow
def test_every_kernel_compiles_for_a_device(tmp_path):
    command = [sys.executable, "-m", "swarm_mj.envs.gpu.ptx", "--cc", "9.0", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"NUMBA_ENABLE_CUDASIM": "0"})
    assert done.returncode == 0, done.stderr[-2000:]
    for name in ("fly", "end", "restart"):
        text = (tmp_path / f"{name}.ptx").read_text()
        assert ".target sm_90" in text and ".entry" in text
