"""Compiled decisions of SwarmObserve-v1 are those that Python makes of the same kernels, and bound kernels are the kernels."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import types
from swarm_mj.envs.missions import pool
from swarm_mj.envs.missions.config import MissionConfig
from swarm_mj.envs.missions.episodes import Episodes
from swarm_mj.envs.missions.flights import MissionFlights
from swarm_mj.envs.missions.jobs import result_of
from swarm_mj.envs.observe.batch import EpisodeBatch

from swarm_mj.simulator.fast.bound_calls import BoundCall, call, call_at
from swarm_mj.simulator.fast.flights import NEVER
from swarm_mj.typing import Array, Mask, kernel

POOL = ["bennu-train-1", "ellipsoid-train-1"]
SEEDS = range(40, 46)


class Continuing(EpisodeBatch):
    """Flights that go on without the spacecraft that hit the body."""

    def __init__(self, task, count):
        super().__init__(task, count, continues_after_impact=True)


class KernelByKernel(MissionFlights, Continuing):
    """The flights of a mission, where Python calls one kernel after the other."""

    def step(self, choice, live):
        # Nothing is scheduled, so that nothing happens for which Python would have to be asked.
        wrong = self.flights._wrong
        self.flights._ask = lambda live: None if wrong is None else wrong.due.fill(NEVER)
        now, patches, lost = self.time_s[:, None, None], self.task.patches.count, self.totals.lost
        failing = (self.sheet.fails_s <= now) & (self.sheet.fails_s > now - self.task.step_s)
        for e in np.flatnonzero(live & failing.any(axis=(1, 2))):
            self._fail(int(e))
        n, earth = self.task.plan.n, choice == patches
        roles = np.where(earth, patches + n + 1, choice)
        result = super().step(np.where(lost | (earth & ~self.sheet.downlink), patches + n + 2, roles), live)
        scale = np.where(live, self.task.plan.region.total_area / self.sheet.possible_area, 1.0)
        terms = result.terms._replace(seen=result.terms.seen * scale, delivered=result.terms.delivered * scale)
        self._show(live & self.flights.finite)
        return result._replace(terms=terms, reward=sum(terms[1:], terms[0]))


class KernelByKernelEpisodes(Episodes):
    """Episodes of such flights."""

    def fly(self, actions, live):
        result = result_of(np.zeros((7, self.count)), self.n)
        for e in np.flatnonzero(live):
            batch, k = self.locate(e)
            choice, flies = np.zeros((batch.count, self.n), np.int64), np.zeros(batch.count, np.bool_)
            choice[k], flies[k] = actions[e], True
            flown = batch.step(choice, flies)
            for theirs, ours in zip((*flown.terms, *flown[1:]), (*result.terms, *result[1:]), strict=True):
                ours[e] = theirs[k]
            self._tell(batch, k, e)
        return result


def begun(kind, threads=1, dispersions=None):
    flown = kind(MissionConfig(missions=POOL, dispersions=dispersions), len(SEEDS), threads)
    for k in range(len(POOL)):
        task = flown.pool[k].task
        # The Sun shines on the body as it is; asked once, the mission keeps what it needs for light.
        flown.pool[k].lit(np.array([0.0, 0.0, 1.0]))
        # High horizons all about, and the camera between the peaks: then maps leave to the observer itself what they hide.
        horizon = task.scene.horizon
        high = horizon._replace(sine=np.full_like(horizon.sine, 0.9), highest=np.full_like(horizon.highest, 0.9))
        task.scene = task.scene._replace(radius=1e9, horizon=high)
    flown.reset(dict(enumerate(SEEDS)))
    return flown


def counted(monkeypatch, name):
    calls, act = [], getattr(MissionFlights, name)
    monkeypatch.setattr(MissionFlights, name, lambda self, e: (calls.append(e), act(self, e)))
    return calls


def same(result, other):
    return all(
        np.array_equal(a, b) for a, b in zip((*result.terms, *result[1:]), (*other.terms, *other[1:]), strict=True)
    )


#: With a delay that only some flights have, as it is drawn in whole control periods.
WRONG = {"star_tracker_noise_arcsec": 60.0, "gyro_bias_deg_h": 5.0, "mass_percent": 3.0, "delay_s": 0.6}


@pytest.mark.parametrize("dispersions", [None, WRONG, {"delay_s": 0.6}], ids=["as planned", "dispersed", "late"])
def test_compiled_decisions_are_those_of_the_kernels_one_by_one(monkeypatch, dispersions):
    with monkeypatch.context() as patch:
        patch.setattr(pool, "MissionFlights", KernelByKernel)
        python = begun(KernelByKernelEpisodes, dispersions=dispersions)
        python.reset(dict(enumerate(SEEDS)))
    compiled = begun(Episodes, threads=2, dispersions=dispersions)
    names = ("judge_pictures", "fail", "provide_noise")
    judged, failed, noise = (counted(monkeypatch, name) for name in names)
    rng, live = np.random.default_rng(2), np.ones(len(SEEDS), np.bool_)
    while live.any():
        mask = compiled.tables.mask
        actions = (rng.random(mask.shape) * (mask + 0.05)).argmax(axis=-1)
        result = compiled.fly(actions, live)
        assert same(python.fly(actions, live), result)
        for ours, theirs in ((python.entities(), compiled.entities()), (python.infos(), compiled.infos())):
            assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
        live &= (result.end == 0) & ~result.truncated
    assert judged and failed and bool(noise) == (dispersions is WRONG)
    for e in range(len(SEEDS)):
        (batch, k), (other, at) = compiled.locate(e), python.locate(e)
        assert batch.totals.percent[k] == other.totals.percent[at] > 0.0
        # Who was lost later has not switched a camera on again.
        off = batch.sheet.fails_s[k, :, 1] <= batch.time_s[k] - batch.task.step_s
        assert (batch.flights.blind[k] >= off).all() and (batch.flights.blind[k] == other.flights.blind[at]).all()
    for flown in (python, compiled):
        flown.close()


class Numbers(NamedTuple):
    """What a kernel is given."""

    values: Array
    factor: float
    wanted: bool
    count: int
    nested: tuple[Mask, int]


@kernel
def scaled(numbers: Numbers, strided: Array, k: int) -> float:
    total = 0.0
    for i in range(strided.shape[0]):
        if numbers.wanted and numbers.nested[0][i]:
            total += numbers.factor * strided[i] * numbers.values[k] + numbers.count + numbers.nested[1]
    numbers.values[k] = total
    return total


@kernel
def call_both(like: BoundCall, at: Array, answers: Array) -> None:
    for i in range(at.shape[0]):
        answers[i] = call_at(like, at[i], (i,))


@kernel
def call_inside(inner: tuple, k: int) -> float:
    return 2.0 * call(inner[0], (k,))


def test_a_bound_kernel_is_the_kernel_with_its_arguments():
    def given(factor):
        return Numbers(np.array([2.0, 3.0]), factor, True, 7, (np.array([True, False, True]), -2))

    strided = np.arange(12.0).reshape(3, 4)[:, 1]
    bound = [BoundCall(scaled, (given(factor), strided), (types.int64,)) for factor in (0.5, -4.0)]
    answers = np.zeros(2)
    call_both(bound[0], np.array([b.at for b in bound]), answers)
    # 0.5 * (1 + 9) * 2 and -4 * (1 + 9) * 3, each with 5 twice.
    assert answers.tolist() == [20.0, -110.0]
    outer = BoundCall(call_inside, ((bound[1],),), (types.int64,))
    call_both(outer, outer.at[None], answers[:1])
    assert answers[0] == 2.0 * (-4.0 * 10.0 * 2.0 + 10.0)
    assert bound[0].kind == bound[1].kind != outer.kind
