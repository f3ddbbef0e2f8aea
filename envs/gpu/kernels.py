"""The kernels of a GPU: one thread per flight. In CUDA's simulator (`NUMBA_ENABLE_CUDASIM=1`) they run in Python."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import cuda

from swarm_mj.simulator.fast.conditions import (
    call_command,
    call_sense,
    inertia_of,
    known_attitudes,
    remember,
    series_of,
    weigh_flight,
)
from swarm_mj.simulator.fast.gyrostat_step import step_gyrostats
from swarm_mj.simulator.fast.integrator import integrate
from swarm_mj.simulator.fast.mj_memory import mj_view
from swarm_mj.smallbody.gravity.polyhedron import write_near_and_far
from swarm_mj.spacecraft.control.compiled import CompiledLaw, call_law
from swarm_mj.spacecraft.control.sliding_mode import write_torque

from .code import DeviceCode, slicer
from .columns import Tables
from .device import SIMULATED
from .flight import (
    Answer,
    Constants,
    Memory,
    end_step,
    fly_step,
    no_polyhedron,
    no_sensors,
    no_wheels,
    nothing_remembered,
    planned_array,
    planned_masses,
    restart,
    view_of,
)
from .flight import call_law as call_directly

#: Threads of a block: few, because each takes as many registers as there are for one.
THREADS = 1 if SIMULATED else 64


class Kernels(NamedTuple):
    """Of a step, in this order.

    Attributes:
        fly: Take the choices and fly for a step, see `fly_step`.
        end: See `end_step`.
        restart: See `restart`.
    """

    fly: Any
    end: Any
    restart: Any


#: By the function of the law that they call.
_MADE: dict[Any, Kernels] = {}


def make_kernels(memory: Memory, answer: Answer, law: CompiledLaw) -> Kernels:
    """Kernels by a control law, made once in a process: compiling them takes a minute.

    Args:
        memory: Of any flights, wherever it stands.
        answer: The same.
        law: The control law.
    """
    if law.write_torque not in _MADE:
        sources = kernel_sources(memory, answer, law)
        _MADE[law.write_torque] = Kernels(*(cuda.jit(function) for function in sources))
    return _MADE[law.write_torque]


def kernel_sources(memory: Memory, answer: Answer, law: CompiledLaw) -> Kernels:
    """The same before they are compiled, with all that they call made for a device."""
    instead = {
        integrate: step_gyrostats,
        mj_view: view_of,
        call_law: call_directly,
        write_torque: law.write_torque,
        write_near_and_far: no_polyhedron,
        weigh_flight: planned_masses,
        inertia_of: planned_array,
        series_of: planned_array,
        known_attitudes: planned_array,
        call_sense: no_sensors,
        call_command: no_wheels,
        remember: nothing_remembered,
    }
    decorate = (lambda function: function) if SIMULATED else cuda.jit(device=True)
    code = DeviceCode(decorate, instead, compiled=not SIMULATED)
    rows = {"memory_of": decorate(slicer(memory)), "answer_of": decorate(slicer(answer))}
    return Kernels(*(code.copied(function, **rows) for function in (_fly, _end, _restart)))


def launch(kernel: Any, count: int, *arguments: Any) -> None:
    """Run a kernel for that many flights; it may still be running afterwards."""
    kernel[-(-count // THREADS), THREADS](*arguments)


# The rows of a thread are put among the globals of these by `DeviceCode.copied`.
def memory_of(memory: Memory, e: int) -> Memory:
    """Flight e alone."""
    raise NotImplementedError


def answer_of(answer: Answer, e: int) -> Answer:
    """Flight e alone."""
    raise NotImplementedError


def _fly(constants: Constants, memory: Memory, answer: Answer, choices: Any) -> None:
    e = cuda.grid(1)
    if e < choices.shape[0]:
        fly_step(constants, memory_of(memory, e), answer_of(answer, e), choices[e : e + 1])


def _end(constants: Constants, memory: Memory, answer: Answer) -> None:
    e = cuda.grid(1)
    if e < answer.over.shape[0]:
        end_step(constants, memory_of(memory, e), answer_of(answer, e))


def _restart(memory: Memory, answer: Answer, tables: Tables, starts: Tables) -> None:
    e = cuda.grid(1)
    if e < answer.over.shape[0] and answer.over[e]:
        restart(answer.start, answer.final, memory.observation, tables, starts, e)
