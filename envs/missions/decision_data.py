"""What a compiled decision of SwarmObserve-v1 is given: kernels, schedule, arrays of its flights and of the environment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.simulator.fast.bound_calls import BoundCall
from swarm_mj.typing import Array, Ints, Mask

from ..observe.kinematics import Kinematics
from ..observe.rewards import StepResult
from ..observe.task import Task
from .tables import EpisodeSheet, Tables


class Calls(NamedTuple):
    """The kernels of the flights of one mission, bound to their arrays and to `Rows.mask`.

    Attributes:
        choose: See `choose_targets`.
        decide: See `fly`, which sets the torques of a control period.
        advance: The same, which integrates it.
        whole: The same, which does both up to `Rows.until`.
        picture_rotations: See `update_rotations`, at a picture.
        pictures: See `take_pictures`.
        rotations: See `update_rotations`, at the end of the decision; writes `Rows.finite`.
        truth: See `copy_truth`, of `Rows.finite`.
        supply: See `noise_left`, which limits `Rows.until`.
        sense: See `sense_flights`, which writes the estimate; of `Rows.finite`.
        estimate: See `update_estimated_rotations`, of `Rows.finite`.
        score: See `score_step`, of `Rows.finite`.
        tables: See `write_tables`, of `Rows.shown`.
    """

    choose: BoundCall
    decide: BoundCall
    advance: BoundCall
    whole: BoundCall
    picture_rotations: BoundCall
    pictures: BoundCall
    rotations: BoundCall
    truth: BoundCall
    supply: BoundCall
    sense: BoundCall
    estimate: BoundCall
    score: BoundCall
    tables: BoundCall


class Schedule(NamedTuple):
    """What all decisions of a mission share.

    Attributes:
        period: Of control [s].
        step_s: Length of a decision [s].
        last_tick: Control periods in a flight.
        due: Whether pictures are due, by decision and control instant in it, shape (steps, ticks + 1).
        total_area: Of the target [m^2].
        patches: Number of patches.
        senses: Whether sensors may err.
    """

    period: float
    step_s: float
    last_tick: int
    due: Mask
    total_area: float
    patches: int
    senses: bool


def schedule_of(task: Task, *, senses: bool) -> Schedule:
    """Of the decisions of a mission."""
    due = np.zeros((len(task.due_in_step), task.ticks + 1), np.bool_)
    for step, instants in enumerate(task.due_in_step):
        due[step, instants] = True
    return Schedule(
        period=float(task.simulation.period),
        step_s=float(task.step_s),
        last_tick=task.last_tick,
        due=due,
        total_area=float(task.plan.region.total_area),
        patches=task.patches.count,
        senses=senses,
    )


class Rows(NamedTuple):
    """Arrays of the E flights of a batch; those without a word belong to it, see `Batch`, `EpisodeState` and `EpisodeTotals`.

    Attributes:
        mask: The flight at hand, shape (E,).
        until: To what tick, shape (E,).
        instant: Control periods flown of the decision where it stopped, shape (E,).
        judged: Whether the pictures of that instant have been, shape (E,).
        choice: As those of the control level `role`, shape (E, n).
        fine: Whether flights have flown to the end, shape (E,).
        finite: The same of the flight at hand, shape (E,).
        shown: Whether its tables are written, shape (E,).
        failed: Spacecraft newly lost to faults, shape (E, n).
        area: Newly seen, shape (E,) [m^2].
        doubt: Pictures that the observer itself must judge, shape (E, n).
        sigma_BR: A copy of the attitude errors at the last decision, shape (E, n, 3).
    """

    mask: Mask
    until: Ints
    instant: Ints
    judged: Mask
    choice: Ints
    fine: Mask
    finite: Mask
    shown: Mask
    failed: Mask
    area: Array
    doubt: Mask
    sigma_BR: Array
    tick: Ints
    flies: Mask
    effort: Array
    qpos: Array
    qvel: Array
    kind: Ints
    whom: Ints
    vector: Array
    work: Array
    lost: Mask


class Held(NamedTuple):
    """The targets that hold, shape (E, n, ...)."""

    kind: Ints
    spacecraft: Ints
    vector: Array


class Came(NamedTuple):
    """What is told of `EpisodeTotals`."""

    area: Array
    delivered: Array
    stored: Array
    seen_bit: Array
    lost_bit: Array
    lost: Mask


class Facts(NamedTuple):
    """What every step tells of E episodes of up to n spacecraft, as the info of the environment names it; (E,) or (E, n)."""

    time_s: Array
    coverage_percent: Array
    delivered_bit: Array
    stored_bit: Array
    seen_bit: Array
    lost_bit: Array
    alive: Mask


def no_facts(count: int, n: int) -> Facts:
    """Of that many episodes of up to n spacecraft."""
    numbers = {name: np.zeros(count) for name in Facts._fields}
    return Facts(**numbers | {"stored_bit": np.zeros((count, n)), "alive": np.zeros((count, n), np.bool_)})


class Told(NamedTuple):
    """Arrays of all E episodes of the environment.

    Attributes:
        choice: What the agents chose, shape (E, n).
        fine: Whether they have flown to the end, shape (E,).
        area: Newly seen, shape (E,) [m^2].
        result: Rewards and ends.
        tables: What the agents are shown.
        facts: See `Facts`.
    """

    choice: Ints
    fine: Mask
    area: Array
    result: StepResult
    tables: Tables
    facts: Facts


class Job(NamedTuple):
    """The flights of a batch, ready for `decide_flight`."""

    calls: Calls
    schedule: Schedule
    rows: Rows
    held: Held
    before: Kinematics
    now: Kinematics
    at_picture: Kinematics
    totals: Came
    sheet: EpisodeSheet
    result: StepResult
    tables: Tables
    told: Told
