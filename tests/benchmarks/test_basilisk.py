"""The benchmark against Basilisk: both programs and SciPy fly the same flight."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))  # the benchmarks are no part of the installed package

from benchmarks.basilisk import ours, reference  # noqa: E402
from benchmarks.basilisk.page import page  # noqa: E402
from benchmarks.basilisk.problem import DURATION_S, LEG_S, PERIOD_S, Flight, difference, make_problem  # noqa: E402
from benchmarks.basilisk.scale import SIZES, memory, stretch  # noqa: E402

PROGRAMS = ("mujoco", "kernel", "basilisk")


@pytest.fixture(scope="module")
def problem():
    return make_problem()


@pytest.fixture(scope="module")
def truth(problem):
    """A flight beyond the first change of references; error control alone chooses the steps, far below what is asked here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reference, "DURATION_S", LEG_S + 30.0)
        return reference.fly(problem, PERIOD_S)


@pytest.fixture(scope="module")
def flights(problem):
    made = {}

    def fly(program):
        if program not in made and program == "basilisk":
            pytest.importorskip("Basilisk")
            from benchmarks.basilisk import peer

            made[program] = peer.fly(problem, 0.1)
        elif program not in made:
            made[program] = ours.fly(problem, 0.1, program)
        return made[program]

    return fly


def assert_equal(one, other):
    worst = difference(one, other)
    assert worst.position_m < 0.01
    assert worst.attitude_rad < 1e-6
    assert worst.wheel_speed < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("stepper", ["mujoco", "kernel"])
def test_the_swarm_flies_in_basilisk_as_it_does_here(flights, stepper):
    assert_equal(flights(stepper), flights("basilisk"))


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_every_program_flies_what_scipy_integrates(flights, truth, program):
    whole, rows = flights(program), len(truth.r_N)
    assert_equal(Flight(**{name: states[:rows] for name, states in vars(whole).items()}), truth)
    turned = 2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(truth.attitude[0] * truth.attitude[599], axis=-1))))
    assert turned.max() > 1.0 and np.abs(np.diff(truth.wheel_speed, axis=0)).max() > 1.0


#: Stretches that end before, at and after the end of a leg.
ENDS = (10.0, LEG_S - PERIOD_S, LEG_S, LEG_S + 10.0, 2.0 * LEG_S + 5.0)


def assert_is_sample(state, flight, t):
    row = round(t / PERIOD_S)
    assert np.allclose(state.r_N[0], flight.r_N[row], rtol=0, atol=1e-9)
    assert np.allclose(np.abs(np.sum(state.attitude[0] * flight.attitude[row], axis=-1)), 1.0, rtol=0, atol=1e-14)
    assert np.allclose(state.wheel_speed[0], flight.wheel_speed[row], rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_flight_in_stretches_is_the_whole_flight(problem, flights, program):
    whole = flights(program)
    if program == "basilisk":
        from benchmarks.basilisk import peer

        swarm = peer.make(problem, 0.1, record=False)
    else:
        swarm = ours.Swarm(ours.make(problem, 0.1, program))
    for t in ENDS:
        swarm.fly_to(t)
        assert_is_sample(swarm.state(), whole, t)


def test_the_problem_has_as_many_spacecraft_as_asked_and_is_the_same_on_every_call():
    one, other = make_problem(53), make_problem(53)
    assert one.n == 53 and one.directions_N.shape == (4, 53, 3) and one.initial.wheel_speed.shape == (53, 3)
    for name in ("r_BN_N", "v_BN_N", "sigma_BN", "omega_BN_B", "wheel_speed"):
        assert np.array_equal(getattr(one.initial, name), getattr(other.initial, name)), name
    # There are 51 points: the last two fly to the first two, turned otherwise.
    assert np.allclose(one.initial.v_BN_N[51:], one.initial.v_BN_N[:2])
    assert not np.allclose(one.initial.sigma_BN[51:], one.initial.sigma_BN[:2])


@pytest.mark.parametrize("rounds", [1, 9, 15, 50])
def test_all_rounds_fit_into_the_flight_and_many_spacecraft_fly_shorter(rounds):
    flown = [stretch(n, rounds) for n in SIZES]
    assert flown == sorted(flown, reverse=True) and flown[-1] >= 5
    assert all((rounds + 1) * seconds <= DURATION_S for seconds in flown)


@pytest.mark.slow
def test_memory_is_that_of_a_process_of_its_own(problem):
    ballast = np.ones(100_000_000)
    assert memory("kernel", problem)["before_mib"] < 600.0 < ballast.nbytes / 2**20


@pytest.mark.slow
def test_basilisk_turns_eros_as_we_do(problem):
    pytest.importorskip("Basilisk")
    from benchmarks.basilisk import peer

    built = peer.make(problem, 0.5, record=False)
    rotation = built.parts[1]
    built.sim.ConfigureStopTime(int(1e9))
    built.sim.ExecuteSimulation()
    message = rotation.planetOutMsgs[0].read()
    assert np.allclose(message.J20002Pfix, problem.environment.C_AN(1.0), rtol=0, atol=1e-12)


def test_differences_are_angles_whatever_the_sign_of_the_quaternion():
    still = np.zeros((1, 1, 3))
    one = Flight(r_N=still, attitude=np.array([[[1.0, 0.0, 0.0, 0.0]]]), wheel_speed=still + 2.0)
    half = 0.5e-7
    other = Flight(
        r_N=still + [[[3.0, 4.0, 0.0]]],
        attitude=-np.array([[[np.cos(half), np.sin(half), 0, 0]]]),
        wheel_speed=still + 4.0,
    )
    worst = difference(one, other)
    assert worst.position_m == pytest.approx(5.0)
    assert worst.attitude_rad == pytest.approx(1e-7, rel=1e-6)
    assert worst.wheel_speed == pytest.approx(0.5)


def test_without_basilisk_the_command_says_so_and_succeeds():
    code = (
        "import sys, runpy, importlib.util as u; find = u.find_spec; "
        "u.find_spec = lambda name, *a: None if name == 'Basilisk' else find(name, *a); "
        "sys.argv = ['basilisk']; runpy.run_module('benchmarks.basilisk', run_name='__main__')"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0 and "pip install" in ended.stderr


NUMBERS = {"position_m": 1.5e-5, "attitude_rad": 2.5e-7, "wheel_speed": 3.5e-8}


def agreement():
    """How far programs differ, with an attitude error of fourth order in the step."""
    steps = [
        {"program": program, "step_s": step, **NUMBERS, "attitude_rad": 2.5e-7 * (2 * step) ** 4}
        for step in (0.5, 0.25)
        for program in PROGRAMS
    ]
    between = [{"program": program, "step_s": 0.1, **NUMBERS} for program in PROGRAMS[:2]]
    drift = [{"speed_m_s": 40.0, "mujoco": 3e-7, "kernel": 4e-11}]
    return {"reference_with_longer_steps": NUMBERS, "steps": steps, "between": between, "drift": drift}


def timing(what, stepper):
    return {
        "what": what,
        "stepper": stepper,
        "basilisk_step_s": 0.1,
        "step_s": 0.1,
        "basilisk_cpu_s": 0.8,
        "cpu_s": 0.2,
        "ratio": 4.1,
        "ratio_quartiles": [4.0, 4.2],
        "ratio_of_stepping": 5.3,
    }


def scale(stepper):
    return {
        "spacecraft": 1000,
        "stepper": stepper,
        "flown_s": 5,
        "basilisk_cpu_s": 1.25,
        "cpu_s": 0.25,
        "ratio": 5.1,
        "ratio_quartiles": [5.0, 5.2],
        "basilisk_faster_than_flight": 3.9,
        "faster_than_flight": 12345.0,
        "basilisk_memory": {"peak_mib": 480.0, "before_mib": 229.0},
        "memory": {"peak_mib": 450.0, "before_mib": 228.0},
        "difference": {"position_m": 6e-7, "attitude_rad": 7e-11, "wheel_speed": 8e-9},
    }


@pytest.mark.parametrize(
    "words",
    [
        ("2.12.1", "a processor"),
        ("1.5e-05", "2.5e-07", "3.5e-08", "16 times", "3e-07"),
        ("4.1 (4.0 to 4.2)", "5.3"),
        ("1,000", "5.1 (5.0 to 5.2)", "4 / 12,345", "480 / 450", "228 to 229 MiB", "6e-07 m, 7e-11 rad and 8e-09"),
    ],
    ids=["versions", "agreement", "timing", "scale"],
)
def test_the_page_shows_every_number(words):
    cases = ("equal step", "cheapest accurate step")
    results = {
        "basilisk": "2.12.1",
        "rounds": 3,
        "agreement": agreement(),
        "timing": [timing(what, stepper) for what in cases for stepper in PROGRAMS[:2]],
        "scale": [scale(stepper) for stepper in PROGRAMS[:2]],
    }
    text = page(results, {"processor": "a processor", "cores": 2, "python": "3.11", "mujoco": "4.0"})
    for word in words:
        assert word in text, word
