"""Flights on a GPU, flown in CUDA's simulator: a thread's Python stands for it, made of the processor's own kernels."""

from types import FunctionType

import gymnasium
import numpy as np
import pytest
import swarm_mj.envs as envs
from swarm_mj.envs.observe.batch import EpisodeBatch

from swarm_mj.errors import ScenarioError
from swarm_mj.simulator.fast import kernels as decisions
from swarm_mj.simulator.slots import Slot

#: Two spacecraft that fly past within two minutes, with pictures at other places of a step each time; from a minute on they
#: count as too close, by the beginning of a step. Sunlight pushes them aside by metres.
SHORT = (
    "design.visiting_points=[10, 16]",
    "design.time_of_flight_s=100",
    "duration_s=160",
    "control.period_s=1",
    "observation.max_gsd_m=4",
    "observation.interval_s=15",
    "safety.separation_grace_s=60",
    "safety.min_separation_m=100000",
    "perturbations.solar_tide=true",
    "perturbations.solar_radiation_pressure=true",
    "perturbations.srp_area_m2=1000",
    "perturbations.gravity_gradient_torque=true",
)
#: Torques cost so much that a decision counted twice is seen.
COSTLY = {"effort": -1e4}
STEPS = 16
ID = "swarm_mj.envs:SwarmObserve-v0"
SEEDS = [11, 12, 13]
CENTRE, SC1, EARTH, HOLD = 16, 17, 19, 20


@pytest.fixture(scope="module")
def gpu():
    """The module of the environment, with CUDA simulated, as `tests/conftest.py` asks for."""
    from swarm_mj.envs.gpu import vector

    assert vector.SIMULATED
    return vector


@pytest.fixture(scope="module")
def flown(gpu):
    """Two flights on the simulated device until one step beyond their end: what each step gave, copied."""
    env = envs.SwarmObserveGpuVectorEnv(2, starts=3, overrides=SHORT, reward_weights=COSTLY)
    observation, infos = env.reset(options={"flight_seed": SEEDS})
    steps = [(observation.copy(), infos["start"].copy())]
    for actions in chosen():
        observation, reward, terminated, truncated, infos = env.step(actions)
        terms = {name: values.copy() for name, values in infos.pop("reward_terms").items()}
        told = {name: values.copy() for name, values in infos.items()}
        steps.append((observation.copy(), reward.copy(), terminated.copy(), truncated.copy(), told, terms))
    doubts = env.doubts
    env.close()
    return steps, doubts


def chosen():
    """Actions of two flights of two spacecraft: patches, the other, Earth, hold, oneself."""
    rng = np.random.default_rng(3)
    actions = rng.integers(0, HOLD + 1, (STEPS + 1, 2, 2))
    actions[6:10] = rng.integers(0, CENTRE, (4, 2, 2))
    actions[10:STEPS, 1], actions[10:STEPS, 0, 1] = EARTH, SC1
    actions[10:STEPS, 0, 0] = EARTH
    return actions


def test_episodes_are_those_of_the_processor(gpu, flown):
    (first, *steps), doubts = flown
    assert first[1].tolist() == [0, 1] and not doubts.any()
    for e in range(2):
        overrides = [*gpu.OVERRIDES, *SHORT]
        single = gymnasium.make(ID, overrides=overrides, reward_weights=COSTLY).unwrapped
        start, _ = single.reset(options={"flight_seed": SEEDS[e]})
        assert np.array_equal(first[0][e], start)
        for actions, (observation, reward, terminated, truncated, told, terms) in zip(chosen(), steps, strict=True):
            expected, wanted, ended, cut, info = single.step(actions[e])
            over = bool(told["_final_obs"][e])
            assert (ended, cut, ended or cut) == (terminated[e], truncated[e], over)
            assert np.allclose((told["final_obs"] if over else observation)[e], expected, 0, 1e-6)
            assert abs(reward[e] - wanted) < 1e-6 and abs(told["coverage_percent"][e] - info["coverage_percent"]) < 1e-6
            assert told["delivered_bit"][e] == pytest.approx(info["delivered_bit"], abs=1e-6)
            assert all(abs(terms[name][e] - value) < 1e-6 for name, value in info["reward_terms"].items())
            if over:
                # The flight goes on from the next start but one that its neighbour took.
                assert told["start"][e] == (e + 1) % 3
                expected, _ = single.reset(options={"flight_seed": SEEDS[(e + 1) % 3]})
                assert np.array_equal(observation[e], expected)
        single.close()
    last = steps[STEPS - 1]
    assert (last[4]["coverage_percent"] > 10.0).all() and last[4]["delivered_bit"].max() > 0.0 and last[3].all()


def test_a_device_sees_no_function_of_the_processor(gpu):
    from swarm_mj.envs.gpu import kernels, starts

    task = envs.task.make_task(overrides=[*gpu.OVERRIDES, *SHORT]) if hasattr(envs, "task") else None
    task = task or __import__("swarm_mj.envs.observe.task", fromlist=["make_task"]).make_task(
        overrides=[*gpu.OVERRIDES, *SHORT]
    )

    one = starts.memory_of(EpisodeBatch(task, 1))
    sources = kernels.kernel_sources(one, starts.no_answer(task), starts.check_task(task))
    seen, left = set(), list(sources)
    while left:
        function = left.pop()
        if function in seen:
            continue
        seen.add(function)
        named = {name for name in function.__code__.co_names if name in function.__globals__}
        for value in (function.__globals__[name] for name in named):
            assert not hasattr(value, "py_func"), f"{function.__name__} calls {value}"
            if isinstance(value, FunctionType) and value.__module__.startswith("swarm_mj"):
                left.append(value)
    names = {function.__name__ for function in seen}
    assert {
        "fly",
        "step_gyrostats",
        "add_perturbations",
        "hold_gravity_gradient",
        "write_torque",
        "new_cells",
        "transmit",
        "compute_rewards",
    } <= names
    task.close()


def test_translated_arithmetic_is_that_of_the_kernel(gpu):
    from swarm_mj.envs.gpu.code import DeviceCode

    code = DeviceCode(lambda function: function, {}, compiled=True)
    rng = np.random.default_rng(0)
    qpos, qvel, axes, C_mid = rng.random(20), rng.random(18), rng.random((3, 3)), rng.random((3, 3))
    given = (qpos, qvel, C_mid, 0.5, 1e-5, axes)
    results = []
    for read in (decisions.read_state, code.of(decisions.read_state)):
        q_BN, work = np.zeros((2, 4)), np.zeros((len(Slot), 2, 3))
        assert read(*given, q_BN, work)
        results.append((q_BN, work))
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))
    assert code.of(decisions.read_state) is code.of(decisions.read_state)
    # No enumeration indexes an array, and no NumPy is called.
    found = code.of(decisions.read_state).__globals__
    assert type(found["Slot"].R_A) is int and found["np"] is not np


def test_the_memory_of_a_device_is_laid_out_as_that_of_the_simulator(gpu, monkeypatch):
    from swarm_mj.envs.gpu import device

    table = np.arange(60.0).reshape(12, 5)

    class Table:
        shape, dtype = table.shape, table.dtype
        __cuda_array_interface__ = table.__array_interface__

    monkeypatch.setattr(device.cuda, "from_cuda_array_interface", lambda given, owner: given, raising=False)
    for rows, shape in ((slice(3, 9), (2, 3)), (slice(0, 4), (4,)), (slice(2, 3), ()), (slice(0, 12), (2, 3, 2))):
        given = device.DeviceMemory().view(Table, rows, shape)
        expected = device.HostMemory().view(table, rows, shape)
        assert given["shape"] == expected.shape and given["strides"] == expected.strides
        assert given["data"][0] == expected.__array_interface__["data"][0] and given["typestr"] == "<f8"


def test_columns_share_what_shares_memory(gpu):
    from swarm_mj.envs.gpu.columns import Columns
    from swarm_mj.envs.gpu.device import HostMemory
    from swarm_mj.envs.observe.kinematics import AttitudeEstimate

    numbers = np.arange(6.0)[None]
    columns = Columns(AttitudeEstimate(numbers, numbers.reshape(1, 2, 3), np.full((1, 2), 7, np.int64)))
    tables = columns.filled(4)
    assert tables.numbers.shape == (6, 4) and tables.whole.shape == (2, 4)
    views = columns.views(tables, HostMemory())
    views.q[2, 4] = -1.0
    assert views.omega[2, 1, 1] == -1.0 and views.C_BN.tolist() == [[7, 7]] * 4 and views.q.strides[0] == 8


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"control": "pointing"}, "control = 'pointing'"),
        ({"overrides": ["physics.stepper=fast"]}, "physics.stepper = fast"),
        ({"overrides": ["observation.max_incidence_deg=80"]}, "observation.max_incidence_deg"),
        ({"overrides": ["dispersions.mass_percent=1"]}, "faults"),
        (
            {"overrides": ["control.controller=mrp_feedback", "control.parameters.integral_gain=0.01"]},
            "the control law",
        ),
        ({"observability": "graph"}, "observability"),
        ({"starts": 0}, "starts = 0"),
    ],
)
def test_what_a_gpu_cannot_fly_is_named(gpu, arguments, words):
    with pytest.raises(ScenarioError, match=words):
        envs.SwarmObserveGpuVectorEnv(1, **arguments)


def test_without_a_device_the_message_says_what_to_do(gpu, monkeypatch):
    from swarm_mj.envs.gpu import device

    monkeypatch.setattr(device, "SIMULATED", False)
    monkeypatch.setattr(device.cuda, "is_available", lambda: False)
    with pytest.raises(ScenarioError, match=r"no GPU to fly on: CUDA finds none; install swarm_mj\[gpu\]"):
        envs.SwarmObserveGpuVectorEnv(1)


def test_impossible_choices_are_refused(gpu):
    env = envs.SwarmObserveGpuVectorEnv(1, starts=1, overrides=SHORT)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((1, 2), np.int64))
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction):
        env.step(np.full((1, 2), HOLD + 1))
    env.close()


def test_dlpack_hands_over_strides_and_shares_memory(gpu):
    from swarm_mj.envs.gpu import dlpack

    held = len(dlpack._HELD)
    for dtype in (np.float32, np.float64, np.int64, np.bool_):
        table = (np.arange(12).reshape(3, 4) % 5).astype(dtype)
        array = table.T
        producer = dlpack.Exported(array, array.__array_interface__, (dlpack.PROCESSOR, 0))
        received = np.from_dlpack(producer)
        assert received.dtype == dtype and received.strides == array.strides and np.array_equal(received, array)
        table[1, 2] = 7
        assert received[2, 1] == dtype(7)
        assert len(dlpack._HELD) == held + 1
        del received
        assert len(dlpack._HELD) == held
    producer.__dlpack__()  # taken by nobody
    assert len(dlpack._HELD) == held
    assert dlpack.exported(table) is table
