"""A decision of one flight of SwarmObserve-v1 in one compiled call: flown, pictures taken, scored, and its tables written.

Few flights over many missions have one flight or two of each: what Python costs for each mission would be most of the time.
The kernels are those of `EpisodeBatch` and `MissionFlights`, called by address and flight by flight; Python is asked only where
something fails, where a picture needs the observer itself, and for the seen share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.simulator.fast.bound_calls import BoundCall, call, call_at
from swarm_mj.typing import Array, Ints, Mask, inlined, kernel

from ..kinematics import Kinematics
from ..rewards import StepResult
from ..task import Task
from .tables import EpisodeSheet, Tables

#: Stages of a decision: begin, where nothing fails; begin; score. From 0: go on after the pictures at that instant.
CHECK, BEGIN, FINISH = -1, -2, -3
#: Answers: flown to the end; something fails at the beginning. From 0: at that instant the observer itself must judge pictures.
DONE, FAILS = -1, -2


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
        finish: See `finish_step`, of `Rows.finite`.
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
    finish: BoundCall
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
    """

    period: float
    step_s: float
    last_tick: int
    due: Mask
    total_area: float
    patches: int


def schedule_of(task: Task) -> Schedule:
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
    )


class Rows(NamedTuple):
    """Arrays of the E flights of a batch; those without a word belong to it, see `Batch`, `EpisodeState` and `EpisodeTotals`.

    Attributes:
        mask: The flight at hand, shape (E,).
        until: To what tick, shape (E,).
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
    attitude_error: Array
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


@kernel
def decide_flights(like: BoundCall, at: Ints, seats: Ints, which: Ints, stages: Ints, answers: Ints) -> None:
    """Call `decide_flight` of some episodes.

    Args:
        like: A job.
        at: Addresses of the jobs that fly the episodes, shape (E, 2).
        seats: Numbers of their flights there, shape (E,).
        which: Which episodes.
        stages: How far each is, shape (E,).
        answers: Receives the answers, shape (E,).
    """
    for i in range(which.shape[0]):
        e = which[i]
        answers[e] = call_at(like, at[e], (seats[e], e, stages[e]))


@kernel
def decide_flight(job: Job, k: int, e: int, stage: int) -> int:
    """Fly one flight for a decision, or score it.

    Args:
        job: The batch.
        k: Number of the flight in it.
        e: Number of the episode.
        stage: See CHECK.

    Returns:
        See DONE.
    """
    rows = job.rows
    rows.mask[:] = False
    rows.mask[k] = True
    if stage == FINISH:
        _finish(job, k, e)
        return DONE
    if stage == CHECK and _fails(job, k):
        return FAILS
    if stage < 0:
        _begin(job, k, e)
    answer = _fly_on(job, k, stage)
    if answer == DONE:
        _read(job, job.now, k)
        call(job.calls.rotations, ())
        rows.fine[k] = rows.finite[k] and rows.flies[k]
        job.told.fine[e], job.told.area[e] = rows.fine[k], rows.area[k]
    return answer


@inlined
def _fails(job: Job, k: int) -> bool:
    """Whether something has failed since the decision before began."""
    now, fails_s = job.rows.tick[k] * job.schedule.period, job.sheet.fails_s
    for j in range(fails_s.shape[1]):
        for i in range(3):
            if now - job.schedule.step_s < fails_s[k, j, i] <= now:
                return True
    return False


@inlined
def _begin(job: Job, k: int, e: int) -> None:
    rows, n, patches = job.rows, job.rows.choice.shape[1], job.schedule.patches
    for j in range(n):
        chosen = job.told.choice[e, j]
        # Earth stands elsewhere among roles, and who is no more or unheard, holds.
        earth = chosen == patches
        holds = job.totals.lost[k, j] or (earth and not job.sheet.downlink[k, j])
        rows.choice[k, j] = patches + n + 2 if holds else (patches + n + 1 if earth else chosen)
    call(job.calls.choose, ())
    for j in range(n):
        rows.kind[k, j], rows.whom[k, j] = job.held.kind[k, j], job.held.spacecraft[k, j]
        for i in range(3):
            rows.vector[k, j, i] = job.held.vector[k, j, i]
    _copy_instant(job.now, job.before, k)
    rows.effort[k] = rows.area[k] = 0.0


@kernel
def _copy_instant(now: Kinematics, to: Kinematics, k: int) -> None:
    to.t[k], to.r[k], to.v[k], to.q[k], to.omega[k] = now.t[k], now.r[k], now.v[k], now.q[k], now.omega[k]
    to.wheel[k], to.C_AN[k], to.r_A[k], to.C_BN[k] = now.wheel[k], now.C_AN[k], now.r_A[k], now.C_BN[k]


@inlined
def _fly_on(job: Job, k: int, stage: int) -> int:
    """Fly to the end of the decision from its beginning, or from where pictures have been judged."""
    rows, due, ticks = job.rows, job.schedule.due, job.schedule.due.shape[1] - 1
    at = max(stage, 0)
    start, judged = rows.tick[k] - at, stage >= 0
    step = start // ticks
    while at < ticks:
        stop = at
        while stop < ticks and not due[step, stop]:
            stop += 1
        if stop > at:
            rows.until[k] = start + stop
            call(job.calls.whole, ())
        elif not judged:
            call(job.calls.decide, ())
            if rows.flies[k] and _take_pictures(job, k):
                return at
        if not rows.flies[k]:
            return DONE
        if stop == at:
            call(job.calls.advance, ())
            at += 1
        else:
            at = stop
        judged = False
    if rows.tick[k] >= job.schedule.last_tick and not judged:
        effort = rows.effort[k]
        call(job.calls.decide, ())
        rows.effort[k] = effort
        if rows.flies[k] and due[step, ticks] and _take_pictures(job, k):
            return ticks
    return DONE


@kernel
def _take_pictures(job: Job, k: int) -> bool:
    """Take the pictures of this instant; returns whether the observer itself must judge any."""
    _read(job, job.at_picture, k)
    call(job.calls.picture_rotations, ())
    job.rows.doubt[k] = False
    call(job.calls.pictures, ())
    return job.rows.doubt[k].any()


@kernel
def _read(job: Job, now: Kinematics, k: int) -> None:
    """Time and state of a flight as they are."""
    rows, n, w = job.rows, now.r.shape[1], now.wheel.shape[2]
    q, v, now.t[k] = rows.qpos[k], rows.qvel[k], rows.tick[k] * job.schedule.period
    for j in range(n):
        at_q, at_v = q.shape[0] // n * j, v.shape[0] // n * j
        for i in range(3):
            now.r[k, j, i], now.v[k, j, i], now.omega[k, j, i] = q[at_q + i], v[at_v + i], v[at_v + 3 + i]
        for i in range(4):
            now.q[k, j, i] = q[at_q + 3 + i]
        for i in range(w):
            now.wheel[k, j, i] = v[at_v + 6 + i]


@inlined
def _finish(job: Job, k: int, e: int) -> None:
    rows, result = job.rows, job.result
    rows.finite[:] = False
    rows.shown[:] = False
    rows.finite[k], rows.shown[k] = rows.fine[k], rows.flies[k]
    for j in range(rows.lost.shape[1]):
        rows.failed[k, j] = rows.lost[k, j] and not job.totals.lost[k, j]
        job.totals.lost[k, j] = job.totals.lost[k, j] or rows.lost[k, j]
        for i in range(3):
            rows.sigma_BR[k, j, i] = rows.attitude_error[k, j, i]
    call(job.calls.truth, ())
    call(job.calls.finish, ())
    # As scores go by what is possible in the episode.
    scale, terms = job.schedule.total_area / job.sheet.possible_area[k], result.terms
    terms.seen[k] *= scale
    terms.delivered[k] *= scale
    reward = terms.seen[k] + terms.delivered[k] + terms.effort[k]
    result.reward[k] = reward + terms.saturation[k] + terms.approach[k] + terms.loss[k]
    call(job.calls.tables, ())
    _tell(job, k, e)


@inlined
def _tell(job: Job, k: int, e: int) -> None:
    told, totals, facts = job.told, job.totals, job.told.facts
    shown, own = told.tables, job.tables
    shown.spacecraft[e], shown.patches[e], shown.pairs[e] = own.spacecraft[k], own.patches[k], own.pairs[k]
    shown.general[e], shown.mask[e] = own.general[k], own.mask[k]
    for i in range(len(told.result.terms)):
        told.result.terms[i][e] = job.result.terms[i][k]
    told.result.reward[e], told.result.end[e] = job.result.reward[k], job.result.end[k]
    told.result.truncated[e] = job.result.truncated[k]
    told.result.hit[e] = job.result.hit[k]
    facts.time_s[e] = job.rows.tick[k] * job.schedule.period
    facts.coverage_percent[e] = 100.0 * totals.area[k] / job.sheet.possible_area[k]
    facts.delivered_bit[e], facts.seen_bit[e] = totals.delivered[k], totals.seen_bit[k]
    facts.lost_bit[e] = totals.lost_bit[k]
    facts.stored_bit[e] = totals.stored[k]
    for j in range(totals.lost.shape[1]):
        facts.alive[e, j] = not totals.lost[k, j]
