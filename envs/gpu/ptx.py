"""Compiles the kernels for a GPU that need not be there: `python -m swarm_mj.envs.gpu.ptx --cc 9.0 --out folder`.

It proves that the sources can be flown on a device, and what `ptxas -v` says of the files tells registers and spills. Needs the
extra `gpu`, but no driver.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numba import cuda, typeof

from ..observe.batch import EpisodeBatch
from ..observe.task import make_task
from .columns import Columns
from .device import SIMULATED, HostMemory, placed
from .kernels import kernel_sources
from .starts import check_task, constants_of, memory_of, no_answer
from .vector import OVERRIDES


def compiled(cc: tuple[int, int]) -> dict[str, str]:
    """PTX of every kernel by its name, for a compute capability."""
    if SIMULATED:
        raise SystemExit("nothing is compiled in CUDA's simulator: unset NUMBA_ENABLE_CUDASIM")
    task, count, memory = make_task(overrides=OVERRIDES), 2, HostMemory()
    batch, law = EpisodeBatch(task, 1), check_task(task)
    flights, answers = Columns(memory_of(batch)), Columns(no_answer(task))
    tables = flights.filled(count)
    one, answer = flights.views(tables, memory), answers.views(answers.filled(count), memory)
    level: Any = batch.level
    constants = placed(constants_of(task, level), memory)
    choices = np.zeros((count, task.plan.n), np.int64)
    given = {
        "fly": (constants, one, answer, choices),
        "end": (constants, one, answer),
        "restart": (one, answer, tables, tables),
    }
    sources, found = kernel_sources(one, answer, law)._asdict(), {}

    class Device:
        """What numba asks of the present device."""

        compute_capability = cc

    with patch("numba.cuda.dispatcher.get_current_device", lambda: Device):
        for name, arguments in given.items():
            found[name], _ = cuda.compile_ptx(sources[name], tuple(map(typeof, arguments)), cc=cc)
    task.close()
    return found


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cc", default="9.0", help="compute capability, such as 8.0 or 9.0")
    parser.add_argument("--out", type=Path, default=Path("ptx"), help="folder for the files")
    given = parser.parse_args()
    major, minor = map(int, given.cc.split("."))
    given.out.mkdir(parents=True, exist_ok=True)
    for name, text in compiled((major, minor)).items():
        (given.out / f"{name}.ptx").write_text(text)
        print(f"{given.out / name}.ptx: {len(text) / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
