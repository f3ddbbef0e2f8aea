"""The calls of plug-ins: behaviours and control laws, and a look at what they answer.

Answers are checked before compiled code takes them, which does not see where an array ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm_mj.errors import PluginError
from swarm_mj.mission.behaviors import Behavior, SteadyBehavior, SwarmView, TargetKind, Targets
from swarm_mj.plugins import as_array, call, name_of, shown
from swarm_mj.simulator.state import FlightState
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.typing import Array

#: Kinds of targets whose vector is used.
_WITH_VECTOR = (int(TargetKind.SURFACE), int(TargetKind.DIRECTION))


@dataclass
class Memory:
    """What the plug-ins of one flight remember, and from which tick on its behaviour must be asked again."""

    behavior: Any = None
    law: Any = None
    due: int = 0


def ask_for_targets(behavior: Behavior, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
    """What `Behavior.targets` answers.

    Raises:
        PluginError: It fails, or answers something else than its protocol says.
    """
    answer = call(behavior, "behaviour", "targets", view, memory)
    try:
        (kind, spacecraft, vector), memory = answer
    except (TypeError, ValueError):
        raise PluginError(
            f"the behaviour {name_of(behavior)} answers {shown(answer)}: targets must return (Targets, memory)"
        ) from None
    n = len(view.r_BN_N)
    targets = Targets(
        as_array(kind, (n,), np.int64, behavior, "the behaviour {} answers targets whose kind"),
        as_array(spacecraft, (n,), np.int64, behavior, "the behaviour {} answers targets whose spacecraft"),
        as_array(vector, (n, 3), np.float64, behavior, "the behaviour {} answers targets whose vector"),
    )
    if not np.isfinite(targets.vector).all():
        bad = np.isin(targets.kind, _WITH_VECTOR) & ~np.isfinite(targets.vector).all(axis=1)
        if bad.any():
            j = int(np.argmax(bad))
            raise PluginError(
                f"the behaviour {name_of(behavior)} answers targets whose vector is {targets.vector[j].tolist()} for "
                f"spacecraft {j}, counted from 0"
            )
    return targets, memory


def ask_how_long(behavior: SteadyBehavior, view: SwarmView, memory: Any) -> float:
    """What `SteadyBehavior.steady_for` answers [s].

    Raises:
        PluginError: It fails, or answers no number.
    """
    answer = call(behavior, "behaviour", "steady_for", view, memory)
    try:
        seconds = float(answer)
    except (TypeError, ValueError):
        seconds = np.nan
    if np.isnan(seconds):
        raise PluginError(
            f"the behaviour {name_of(behavior)} answers {shown(answer)}: steady_for must return a number of seconds"
        )
    return max(seconds, 0.0)


def ask_for_torque(controller: Controller, inputs: ControlInput, memory: Any) -> tuple[Array, Any]:
    """What `Controller.torque` answers; it may hold numbers that are not finite.

    Raises:
        PluginError: It fails, or answers something else than its protocol says.
        SwarmError: What the law itself refuses, such as a control period that is too long.
    """
    answer = call(controller, "control law", "torque", inputs, memory)
    try:
        torque_B, memory = answer
    except (TypeError, ValueError):
        raise PluginError(
            f"the control law {name_of(controller)} answers {shown(answer)}: torque must return (torque_B, memory)"
        ) from None
    what = "the control law {} answers a torque that"
    return as_array(torque_B, inputs.sigma_BR.shape, np.float64, controller, what), memory


def no_such_target(targets: Targets) -> str:
    """In words, that targets cannot be aimed at; see `decide.mark_new_targets`."""
    return (
        f"the behaviour aims at what is not there: kinds {targets.kind.tolist()}, spacecraft "
        f"{targets.spacecraft.tolist()} of {len(targets.kind)}, counted from 0"
    )


def divergence_of(state: FlightState, controller: Controller | None) -> str:
    """In words, why a flight cannot go on.

    Args:
        state: Of the flight.
        controller: The law that answered last; None where torques are held.
    """
    names, t = state.model.names, state.time
    fine = np.isfinite(state.numbers()).all(axis=1)
    if not fine.all():
        return (
            f"the flight diverged: {names[int(np.argmin(fine))]} has a state that is not finite at t = {t:g} s. Check gains, "
            "wheel limits, gravity and physics.timestep_s"
        )
    j = int(np.argmin(np.isfinite(state.torque_B).all(axis=1)))
    who = "what holds torques" if controller is None else f"the control law {name_of(controller)}"
    return (
        f"the flight diverged: {who} gives {names[j]} the torque {state.torque_B[j].tolist()} N m at t = {t:g} s, whose state "
        "is finite. Check the law and its parameters"
    )
