"""A decision of one flight of SwarmObserve-v1 in one compiled call: flown, pictures taken, scored, and its tables written.

Few flights over many missions have one flight or two of each: what Python costs for each mission would be most of the time.
The kernels are those of `EpisodeBatch`, called by address and flight by flight; Python is asked only where something fails,
where a picture needs the observer itself, for the sensors' noise, and for the seen share.
"""

from __future__ import annotations

from swarm_mj.simulator.fast.bound_calls import BoundCall, call, call_at
from swarm_mj.simulator.slots import Slot
from swarm_mj.typing import Ints, inlined, jittable, kernel

from ..observe.kinematics import Kinematics
from .decision_data import Job, Rows

#: Stages of a decision: begin, where nothing fails; begin; go on where it stopped, see `Rows.instant`; score.
CHECK, BEGIN, GO_ON, FINISH = range(4)
#: Answers: flown to the end; something fails at the beginning; the observer itself must judge pictures; noise must be drawn.
DONE, FAILS, DOUBTS, DRY = range(4)


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
    if stage != GO_ON:
        _begin(job, k, e)
    answer = _fly_on(job, k)
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
    rows.instant[k], rows.judged[k] = 0, False


@kernel
def _copy_instant(now: Kinematics, to: Kinematics, k: int) -> None:
    to.t[k], to.r[k], to.v[k], to.q[k], to.omega[k] = now.t[k], now.r[k], now.v[k], now.q[k], now.omega[k]
    to.wheel[k], to.C_AN[k], to.r_A[k], to.C_BN[k] = now.wheel[k], now.C_AN[k], now.r_A[k], now.C_BN[k]


@inlined
def _fly_on(job: Job, k: int) -> int:
    """Fly to the end of the decision from its beginning, or from where it stopped."""
    rows, due, ticks = job.rows, job.schedule.due, job.schedule.due.shape[1] - 1
    start, judged = rows.tick[k] - rows.instant[k], rows.judged[k]
    step, at = start // ticks, rows.instant[k]
    while at < ticks:
        stop = at
        while stop < ticks and not due[step, stop]:
            stop += 1
        rows.until[k] = start + max(stop, at + 1)
        if job.schedule.senses and call(job.calls.supply, ()):
            return _stopped(rows, k, at, judged, DRY)
        if stop > at:
            call(job.calls.whole, ())
        elif not judged:
            call(job.calls.decide, ())
            if rows.flies[k] and _take_pictures(job, k):
                return _stopped(rows, k, at, True, DOUBTS)
        if not rows.flies[k]:
            return DONE
        if stop == at:
            call(job.calls.advance, ())
        at, judged = rows.tick[k] - start, False
    if job.schedule.senses and call(job.calls.supply, ()):
        return _stopped(rows, k, at, judged, DRY)
    if rows.tick[k] >= job.schedule.last_tick and not judged:
        effort = rows.effort[k]
        call(job.calls.decide, ())
        rows.effort[k] = effort
        if rows.flies[k] and due[step, ticks] and _take_pictures(job, k):
            return _stopped(rows, k, at, True, DOUBTS)
    return DONE


@jittable
def _stopped(rows: Rows, k: int, at: int, judged: bool, why: int) -> int:
    rows.instant[k], rows.judged[k] = at, judged
    return why


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
            rows.sigma_BR[k, j, i] = rows.work[k, Slot.SIGMA_BR, j, i]
    call(job.calls.truth, ())
    if job.schedule.senses:
        call(job.calls.sense, ())
        call(job.calls.estimate, ())
    call(job.calls.score, ())
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
