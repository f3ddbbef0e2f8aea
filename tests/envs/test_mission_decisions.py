"""Compiled decisions of SwarmObserve-v1 are those that Python makes of the same kernels, and bound kernels are the kernels."""

from typing import NamedTuple

import numpy as np
from numba import types
from swarm_mj.envs.missions.config import MissionConfig
from swarm_mj.envs.missions.episodes import Episodes
from swarm_mj.envs.missions.flights import MissionFlights

from swarm_mj.simulator.fast.bound_calls import BoundCall, call, call_at
from swarm_mj.typing import Array, Mask, kernel

POOL = ["bennu-train-1", "ellipsoid-train-1"]
SEEDS = range(40, 46)


def episodes(threads=1):
    flown = Episodes(MissionConfig(missions=POOL), len(SEEDS), threads)
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


def test_compiled_decisions_are_those_of_the_kernels_one_by_one(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(MissionFlights, "job", lambda self, told: None)
        python = episodes()
    compiled = episodes(threads=2)
    judged, failed = counted(monkeypatch, "judge_pictures"), counted(monkeypatch, "fail")
    rng, live = np.random.default_rng(2), np.ones(len(SEEDS), np.bool_)
    while live.any():
        mask = compiled.tables.mask
        actions = (rng.random(mask.shape) * (mask + 0.05)).argmax(axis=-1)
        result = compiled.fly(actions, live)
        assert same(python.fly(actions, live), result)
        for ours, theirs in ((python.entities(), compiled.entities()), (python.infos(), compiled.infos())):
            assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
        live &= (result.end == 0) & ~result.truncated
    assert judged and failed
    for e in range(len(SEEDS)):
        (batch, k), (other, at) = compiled.locate(e), python.locate(e)
        assert batch.totals.percent[k] == other.totals.percent[at] > 0.0
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
