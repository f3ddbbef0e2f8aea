"""What one thread of a GPU does with its flight: a step of an episode, by the processor's own kernels for a batch of one.

These functions are translated by `DeviceCode`, and so is all that they call. They allocate nothing: what kernels need stands in
`Memory`, which a restart overwrites, and `Answer`, which it leaves alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from swarm_mj.mission.behaviors import Targets
from swarm_mj.observation.horizon_kernels import Scene
from swarm_mj.simulator.fast.flight_kernels import ADVANCE, DECIDE, fly, split_states
from swarm_mj.simulator.fast.flights import Flights, World
from swarm_mj.simulator.fast.mj_memory import KERNEL, MjView, Scratch
from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.control.sliding_mode import write_torque
from swarm_mj.typing import Array, Array32, Ints, Mask

from ..observe.actions import Choices, choose_targets
from ..observe.kinematics import (
    AttitudeEstimate,
    BodyRotation,
    Kinematics,
    Tracking,
    copy_truth,
    update_rotations,
)
from ..observe.pictures import Gained, PictureConstants, take_pictures
from ..observe.rewards import Flown, Hazards, Outcome, StepResult
from ..observe.step import StepConstants, finish_step
from ..observe.totals import EpisodeTotals

#: Of `ENDS`: over by its duration, where that counts as an end.
HORIZON = 5
_SIGMA_BR = int(Slot.SIGMA_BR)


class Hold(NamedTuple):
    """What `MjView` takes of the model.

    Attributes:
        first_hub: Body id of the first spacecraft's hub.
        timestep: [s].
        spin_inertia: Of a wheel [kg m^2].
        body_mass: Masses, shape (nbody,) [kg].
        body_inertia: Principal moments, shape (nbody, 3) [kg m^2].
        ctrlrange: Lower and upper limits of the motor torques, shape (3 n, 2) [N m].
        wheel_axes_B: Rows, shape (3, 3).
    """

    first_hub: int
    timestep: float
    spin_inertia: float
    body_mass: Array
    body_inertia: Array
    ctrlrange: Array
    wheel_axes_B: Array


class Plain(NamedTuple):
    """The arrays of `PlainData` that are read, with the number of the flight in front."""

    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    xfrc_applied: Array
    asteroid_quat: Array


class Constants(NamedTuple):
    """What all flights share.

    Attributes:
        world: Of the flights.
        hold: Of the model.
        rotation: Of the body.
        scene: Target, maps, camera and criterion.
        pictures: What pictures share besides.
        step: What the ends of steps share.
        choices: What a spacecraft may be told to look at.
        is_due: Whether pictures are due, by control instant, shape (k,).
        timesteps: In a control period.
        ticks: Control periods in a step.
        last_tick: Control periods in a flight.
        horizon_terminates: Whether a flight that is over by its duration counts as ended.
    """

    world: World
    hold: Hold
    rotation: BodyRotation
    scene: Scene
    pictures: PictureConstants
    step: StepConstants
    choices: Choices
    is_due: Mask
    timesteps: int
    ticks: int
    last_tick: int
    horizon_terminates: bool


class Memory(NamedTuple):
    """What a flight is between two steps, with the number of the flight in front of every array.

    Attributes:
        flights: As `fly` takes them.
        qpos: Their positions by spacecraft, the same memory, shape (E, n, 10).
        qvel: Their velocities, shape (E, n, 9).
        plain: What `MjView` takes of a flight.
        blind: Whose camera is off: nobody's, shape (E, n).
        before: The instant at the beginning of the step.
        now: The one at its end.
        estimate: What the flight software knows.
        totals: What the episode has come to.
        observation: Shape (E, F).
    """

    flights: Flights
    qpos: Array
    qvel: Array
    plain: Plain
    blind: Mask
    before: Kinematics
    now: Kinematics
    estimate: AttitudeEstimate
    totals: EpisodeTotals
    observation: Array32


class Answer(NamedTuple):
    """What a step tells, and room for it, with the number of the flight in front of every array.

    Attributes:
        live: True, shape (E,).
        finite: Whether the state is, shape (E,).
        until: A tick that no flight reaches, shape (E,).
        at_picture: The instant of a picture.
        area: Newly seen, shape (E,) [m^2].
        doubt: Of the present pictures, shape (E, n).
        doubts: Pictures so far of which the maps could not tell all, in all episodes, shape (E,).
        new: Scratch, shape (E, C).
        answer: Scratch, shape (E, samples).
        C_CA: Scratch, shape (E, 3, 3).
        failed: Spacecraft lost to faults: none, shape (E, n).
        received: By Earth in the step, shape (E,) [bit].
        hazards: See `Hazards`.
        result: Rewards and ends.
        over: Which episodes are, shape (E,).
        terminated: Those that ended by themselves, shape (E,).
        percent: Seen share of the target at the end of the step, shape (E,) [%].
        delivered: Received by Earth until then, shape (E,) [bit].
        refused: Whose choices there were not, so that the targets before held on, shape (E,).
        start: From which of the starts the episode flies, shape (E,).
        final: The last observation of the episode before, shape (E, F).
    """

    live: Mask
    finite: Mask
    until: Ints
    at_picture: Kinematics
    area: Array
    doubt: Mask
    doubts: Ints
    new: Mask
    answer: Any
    C_CA: Array
    failed: Mask
    received: Array
    hazards: Hazards
    result: StepResult
    over: Mask
    terminated: Mask
    percent: Array
    delivered: Array
    refused: Mask
    start: Ints
    final: Array32


class AsPlanned(NamedTuple):
    """In the place of a record of `Conditions`: of a flight without faults, dispersions and a fourth wheel."""

    command: int
    sense: int
    own_field: int
    field_factor: float


class Flying(NamedTuple):
    """In the place of `MjBatch`: a model, and flights."""

    hold: Hold
    plain: Plain


def view_of(flying: Flying, e: int) -> MjView:
    """In the place of `mj_view`; what the kernel stepper does not touch is any array."""
    hold, plain = flying.hold, flying.plain
    q = plain.qpos[e]
    return MjView(
        0,
        0,
        KERNEL,
        6,
        hold.first_hub,
        hold.timestep,
        hold.spin_inertia,
        q,
        plain.qvel[e],
        plain.act[e],
        q,
        q,
        q,
        plain.ctrl[e],
        plain.xfrc_applied[e],
        hold.body_mass,
        hold.body_inertia,
        plain.asteroid_quat[e],
        hold.ctrlrange,
        hold.wheel_axes_B,
        Scratch(q, q, q, q, q, q, q),
    )


def call_law(
    law: int,
    sigma_BR: Array,
    omega_BR_B: Array,
    omega_BN_B: Array,
    omega_RN_B: Array,
    domega_RN_B: Array,
    wheel_momentum_B: Array,
    inertia_B: Array,
    inertia_effective_B: Array,
    numbers: Array,
    torque_B: Array,
) -> None:
    """In the place of the processor's: a device calls no addresses, so that `write_torque` is replaced by the law's own."""
    write_torque(
        sigma_BR,
        omega_BR_B,
        omega_BN_B,
        omega_RN_B,
        domega_RN_B,
        wheel_momentum_B,
        inertia_B,
        inertia_effective_B,
        numbers,
        torque_B,
    )


def no_polyhedron(r_A: Array, body: Any, cell: float, known: Array, a_A: Array) -> None:
    """In the place of `write_near_and_far`, which allocates; `check_task` refuses what needs it."""


def planned_masses(conditions: Any, e: int, hub: Ints, xfrc: Array) -> None:
    """In the place of `weigh_flight`; a device flies as planned, and so all below."""


def planned_array(conditions: Any, e: int, planned: Array) -> Array:
    """In the place of `inertia_of`, `series_of` and `known_attitudes`."""
    return planned


def no_sensors(address: int, conditions: Any, e: int, tick: int, period: float, q_BN: Array, omega_BN_B: Array) -> None:
    """In the place of `call_sense`."""


def no_wheels(
    address: int, conditions: Any, e: int, torque_B: Array, released: Mask, ctrl: Array, peaks: Array
) -> float:
    """In the place of `call_command`."""
    return 0.0


def nothing_remembered(conditions: Any, e: int, qvel: Array, r_N: Array) -> None:
    """In the place of `remember`."""


def fly_step(constants: Constants, memory: Memory, answer: Answer, choice: Ints) -> None:
    """Take the choices, shape (1, n), of a flight and fly it for one step with its pictures."""
    flights = memory.flights
    held = Targets(flights.kind, flights.spacecraft, flights.vector)
    boresight_N = memory.estimate.C_BN[:, :, 2]
    answer.refused[0] = not choose_targets(constants.choices, choice, boresight_N, answer.live, held)
    flying, period = Flying(constants.hold, memory.plain), constants.world.period
    conditions = (AsPlanned(0, 0, 0, 1.0),)
    start, steps = flights.tick[0], 2 * constants.ticks
    flights.effort[0], answer.area[0] = 0.0, 0.0
    # Decide, advance, decide, advance; at the end of a flight decide once more, for the last pictures.
    for k in range(steps + 1):
        deciding = k % 2 == 0
        if k == steps and flights.tick[0] < constants.last_tick:
            break
        effort = flights.effort[0]
        part = DECIDE if deciding else ADVANCE
        fly(constants.world, flights, flying, conditions, constants.timesteps, part, answer.live, answer.until)
        if not flights.finite[0]:
            break
        if k == steps:
            flights.effort[0] = effort
        if deciding and constants.is_due[start + k // 2]:
            _take_pictures(constants, memory, answer, period)


def _take_pictures(constants: Constants, memory: Memory, answer: Answer, period: float) -> None:
    now, live = answer.at_picture, answer.live
    _read(memory, now, period)
    update_rotations(constants.rotation, now, live, answer.finite)
    gained = Gained(answer.area, answer.doubt, answer.new[0], answer.answer[0], answer.C_CA[0])
    kind = memory.flights.kind
    take_pictures(constants.scene, constants.pictures, now, memory.totals, kind, memory.blind, live, gained)
    for j in range(kind.shape[1]):
        answer.doubts[0] += 1 if answer.doubt[0, j] else 0
        answer.doubt[0, j] = False


def _read(memory: Memory, now: Kinematics, period: float) -> None:
    split_states(memory.qpos, memory.qvel, now.r, now.v, now.q, now.omega, now.wheel)
    now.t[0] = memory.flights.tick[0] * period


def end_step(constants: Constants, memory: Memory, answer: Answer) -> None:
    """Send data, measure dangers, observe, reward, and tell whether the episode is over."""
    flights, now, totals, result = memory.flights, memory.now, memory.totals, answer.result
    _read(memory, now, constants.world.period)
    update_rotations(constants.rotation, now, answer.live, answer.finite)
    answer.finite[0] = answer.finite[0] and flights.finite[0]
    copy_truth(now, memory.estimate, answer.finite)
    if answer.area[0] > 0.0:
        totals.percent[0] = _percent_seen(constants, totals)
    tracking = Tracking(flights.kind, flights.spacecraft, flights.work[:, _SIGMA_BR], memory.blind)
    flown = Flown(flights.tick, answer.live, answer.finite, answer.area, flights.effort, answer.failed)
    outcome = Outcome(memory.observation, answer.received, answer.hazards, result)
    finish_step(constants.step, memory.before, now, memory.estimate, tracking, totals, flown, outcome)
    if constants.horizon_terminates and result.truncated[0]:
        result.end[0], result.truncated[0] = HORIZON, False
    answer.terminated[0] = result.end[0] > 0
    answer.over[0] = answer.terminated[0] or result.truncated[0]
    answer.percent[0], answer.delivered[0] = totals.percent[0], totals.delivered[0]


def _percent_seen(constants: Constants, totals: EpisodeTotals) -> float:
    """Seen share of the target [%]; NumPy sums in another order on the processor."""
    area, seen, whole = constants.step.observation.cell_area, 0.0, 0.0
    for i in range(area.shape[0]):
        whole += area[i]
        if totals.seen[0, i]:
            seen += area[i]
    return 100.0 * seen / whole


def restart(start: Ints, final: Array32, observation: Array32, tables: Any, starts: Any, e: int) -> None:
    """Let a flight begin another episode: a column of prepared starts, of which the next is taken.

    Args:
        start: See `Answer`, shape (E,).
        final: See `Answer`, shape (E, F).
        observation: The present ones, shape (E, F).
        tables: Of all flights, see `Tables`.
        starts: The same of the starts.
        e: The flight's number.
    """
    for i in range(final.shape[1]):
        final[e, i] = observation[e, i]
    begin = (start[e] + 1) % starts.numbers.shape[1]
    start[e] = begin
    _copy_column(starts.numbers, tables.numbers, begin, e)
    _copy_column(starts.whole, tables.whole, begin, e)
    _copy_column(starts.flags, tables.flags, begin, e)
    _copy_column(starts.singles, tables.singles, begin, e)


def _copy_column(source: Any, target: Any, start: int, e: int) -> None:
    for row in range(target.shape[0]):
        target[row, e] = source[row, start]
