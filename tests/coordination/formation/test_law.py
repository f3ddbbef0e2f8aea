"""Formations about a point mass against the closed form, feedback against its equation, and what is known over links."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.coordination.formation.law import MESSAGE_BITS, FormationLaw, Messaging, coast
from swarm_mj.coordination.formation.structure import nodes, offset_structure, planned_structure
from swarm_mj.coordination.formation.tracking import Tracking, in_pulses
from swarm_mj.coordination.graph import Graph
from swarm_mj.errors import ScenarioError
from swarm_mj.mission.trajectories import propagate
from swarm_mj.spacecraft.control.force import ForceView
from tests.relative_motion import clohessy_wiltshire, hill_axes

GM, RADIUS = 4.463e5, 40e3
RATE = np.sqrt(GM / RADIUS**3)
DAY = 6000.0
MASS, FORCE = 8.0, 0.05


def gravity(t, r):
    return -GM * r / np.linalg.norm(r, axis=-1, keepdims=True) ** 3


def hill_states(offsets, rates, at):
    """States in N of offsets and rates in the turning axes of the circular orbit."""
    angle = RATE * at
    centre = RADIUS * np.array([np.cos(angle), np.sin(angle), 0.0])
    velocity = RATE * RADIUS * np.array([-np.sin(angle), np.cos(angle), 0.0])
    axes = hill_axes(centre, velocity)
    turning = rates + np.cross([0.0, 0.0, RATE], offsets)
    return centre + offsets @ axes, velocity + turning @ axes


def circular(start_s=0.0):
    """A structure of one spacecraft on the circular orbit."""
    times = nodes(DAY)
    r, v = hill_states(np.zeros((1, 3)), np.zeros((1, 3)), 0.0)
    return planned_structure(gravity, times, *propagate(gravity, r, v, times), start_s)


def fly(law, r, v, duration, *, period=1.0, lost=None, known=gravity):
    """Free flight between held forces, stepped as the flight itself is."""
    n, memory, gained, out = len(r), None, np.zeros((len(r), 3)), []
    full, working = np.full(n, 0.1), np.ones(n, bool)
    for k in range(round(duration / period)):
        if lost is not None and k * period >= lost[1]:
            working = np.arange(n) != lost[0]
        view = ForceView(
            t=k * period,
            period=period,
            r_BN_N=r.copy(),
            v_BN_N=v.copy(),
            q_BN=np.tile([1.0, 0, 0, 0], (n, 1)),
            mass=np.full(n, MASS),
            propellant=full,
            delta_v_N=gained.copy(),
            working=working.copy(),
        )
        force, memory = law.forces(view, memory)
        assert not force[~working].any()
        gained = gained + force * period / MASS
        middle = r + 0.5 * period * v
        v = v + period * (known(k * period, middle) + force / MASS)
        r = middle + 0.5 * period * v
        out.append((r, v))
    return np.array([a for a, _ in out]), np.array([b for _, b in out]), np.linalg.norm(gained, axis=1), memory


OFFSETS = np.array([[30.0, 0.0, 10.0], [-20.0, 60.0, 0.0], [0.0, -40.0, -25.0]])
RATES = np.array([[0.01, -2.0 * RATE * 30.0, 0.0], [0.0, 2.0 * RATE * 20.0, 0.004], [0.002, 0.0, 0.0]])


def test_natural_motion_is_that_of_clohessy_and_wiltshire():
    start = 1500.0
    planned = circular(start)
    r, v = hill_states(OFFSETS, RATES, start)
    structure = offset_structure(planned, nodes(DAY), r - planned.centre(start), v - planned.centre(start, 1))
    for t in (0.0, 700.0, 4000.0, DAY):
        axes = hill_axes(structure.centre(t), structure.centre(t, 1))
        expected = np.hstack((OFFSETS, RATES)) @ clohessy_wiltshire(RATE, t - start).T
        np.testing.assert_allclose(structure.offsets(t)[0] @ axes.T, expected[:, :3], atol=0.05)  # 100 m in 40 km
    np.testing.assert_allclose(structure.holding(3000.0), 0.0, atol=1e-12)


def test_the_closed_form_solves_hills_equations():
    n = RATE
    system = np.block(
        [
            [np.zeros((3, 3)), np.eye(3)],
            [np.diag([3 * n * n, 0, -n * n]), np.array([[0, 2 * n, 0], [-2 * n, 0, 0], [0, 0, 0]])],
        ]
    )
    found = solve_ivp(
        lambda t, y: (system @ y.reshape(6, 6)).ravel(), (0.0, 9000.0), np.eye(6).ravel(), rtol=1e-11, atol=1e-12
    )
    np.testing.assert_allclose(found.y[:, -1].reshape(6, 6), clohessy_wiltshire(n, 9000.0), rtol=1e-6, atol=1e-9)


def links(delay=0.0, loss=0.0):
    """Links between all that work."""

    def graph(view):
        ones = np.ones((len(view.working), len(view.working)))
        return Graph(rate_bit_s=1e9 * ones, delay_s=delay * ones, loss=loss * ones, works=view.working)

    return graph


def law_of(structure, *, damping=0.7, dead_band=0.0, **keys):
    tracking = Tracking(bandwidth=0.02, damping=damping, dead_band=dead_band)
    return FormationLaw(structure, tracking, links(), force=FORCE, least_impulse=0.0, **keys)


def test_an_offset_that_stays_costs_what_differential_gravity_takes():
    planned = circular()
    structure = offset_structure(planned, nodes(DAY), OFFSETS, None)
    once = fly(law_of(structure), *structure.states(0.0), 1.0)[2]
    assert once == pytest.approx(np.linalg.norm(structure.holding(0.0), axis=1), rel=1e-6)  # on the path nothing else
    r, v, spent, _ = fly(law_of(structure), *structure.states(0.0), 2000.0)
    assert np.abs(r[-1] - structure.path(2000.0)).max() < 0.01
    x, up = OFFSETS, np.array([1.0, 0.0, 0.0])
    for k in range(3):  # by hand: GM/R^3 (3 (d.e) e - d), which thrust must cancel
        needed = 0.0
        for t in np.arange(0.0, 2000.0, 10.0):
            up = planned.centre(t) / RADIUS
            needed += 10.0 * np.linalg.norm(GM / RADIUS**3 * (x[k] - 3.0 * (x[k] @ up) * up))
        assert spent[k] == pytest.approx(needed, rel=0.01)


def test_controlled_motion_is_that_of_the_same_law_by_dop853():
    structure = offset_structure(circular(), nodes(DAY), OFFSETS, None)
    place, velocity = structure.states(0.0)
    law, off = law_of(structure), np.array([[3.0, -2.0, 1.0], [0.0, 4.0, 0.0], [-1.0, 0.0, 2.0]])
    r, _, _, _ = fly(law, place + off, velocity, 300.0, period=0.25)

    def rhs(t, y):
        x, u = y.reshape(2, 3, 3)
        wish = law.tracking.feedback(x - structure.path(t), u - structure.path(t, 1), np.full(3, FORCE / MASS))
        thrust = wish + gravity(t, structure.centre(t)[None]) - gravity(t, x)
        assert np.linalg.norm(thrust, axis=1).max() < FORCE / MASS
        return np.concatenate((u.ravel(), (gravity(t, x) + thrust).ravel()))

    expected = solve_ivp(
        rhs,
        (0.0, 300.0),
        np.concatenate(((place + off).ravel(), velocity.ravel())),
        method="DOP853",
        rtol=1e-10,
        atol=1e-9,
    )
    assert np.abs(r[199] - place).max() > 0.1  # a swing to compare
    np.testing.assert_allclose(r[-1], expected.y[:9, -1].reshape(3, 3), atol=0.02)  # held for a period: O(T w e)


def test_small_errors_swing_with_the_bandwidth_and_damping_that_are_asked_for():
    structure = circular()
    place, velocity = structure.states(0.0)
    law = law_of(structure)
    r, _, _, _ = fly(law, place + [[1.0, 0.0, 0.0]], velocity, 400.0, period=0.1)
    error = (r - structure.path(0.1 * np.arange(1, 4001)))[:, 0, 0]
    w, z, t = 0.02, 0.7, 0.1 * np.arange(1, 4001)
    wd = w * np.sqrt(1.0 - z * z)
    np.testing.assert_allclose(error, np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)), atol=3e-3)


def test_far_away_it_returns_by_limited_thrust_without_overshoot():
    structure = circular()
    place, velocity = structure.states(0.0)
    law = law_of(structure, damping=1.0)
    r, _, _, _ = fly(law, place + [[0.0, 3000.0, 0.0]], velocity, 3000.0)
    along = (r - structure.path(np.arange(1.0, 3001.0)))[:, 0, 1]
    assert along.min() > -0.02 * 3000.0 and abs(along[-1]) < 1.0


def test_in_the_dead_band_thrusters_stay_shut_and_outside_they_return():
    structure = circular()
    place, velocity = structure.states(0.0)
    law = law_of(structure, dead_band=5.0)
    assert fly(law, place + [[4.0, 0.0, 0.0]], velocity, 50.0)[2][0] == 0.0
    r, _, spent, _ = fly(law, place + [[9.0, 0.0, 0.0]], velocity, 600.0)
    assert spent[0] > 0.0 and np.linalg.norm(r[-1] - structure.path(600.0)) < 5.0


def test_small_wishes_become_pulses_that_add_up():
    owed, got, pulses = np.zeros((1, 3)), np.zeros((1, 3)), 0
    least, step = np.array([0.01]), np.array([[0.0013, -0.0004, 0.0]])
    for _ in range(100):
        asked, total = in_pulses(step, owed, least)
        assert not asked.any() or np.linalg.norm(asked) >= 0.01
        got, owed, pulses = got + asked, total - asked, pulses + asked.any()
    np.testing.assert_allclose(got, 100 * step, atol=0.01)
    assert 10 <= pulses <= 20


def test_a_period_too_long_for_the_bandwidth_is_refused():
    with pytest.raises(ScenarioError, match=r"bandwidth_rad_s = 0.3: must be at most 0.25 "):
        Tracking(bandwidth=0.3, damping=1.0, dead_band=0.0).check_period(1.0)


def three(start_s=0.0):
    times = nodes(DAY)
    r, v = hill_states(OFFSETS, RATES, 0.0)
    return planned_structure(gravity, times, *propagate(gravity, r, v, times), start_s)


def relative(structure, r, k, t):
    """Errors relative to spacecraft k, shape (n,)."""
    error = r - structure.path(t)
    return np.linalg.norm(error - error[k], axis=1)


def test_followers_keep_to_their_leader_and_to_the_next_when_it_is_lost():
    structure = three()
    place, velocity = structure.states(0.0)
    pushed = velocity + [[0.1, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.0]]
    law = law_of(structure, reference="leader", messaging=Messaging(every_s=10.0, silence_s=25.0))
    r, _, spent, memory = fly(law, place, pushed, 1200.0, lost=(0, 600.0))
    assert relative(structure, r[598], 0, 599.0).max() < 0.1
    assert np.linalg.norm(r[598] - structure.path(599.0), axis=1).min() > 40.0  # all have gone along with it
    assert relative(structure, r[-1], 1, 1200.0)[1:].max() < 0.1
    # It was heard of last 590 s past the start.
    assert [(round(t), i, k) for t, i, k in law.log.leaders] == [(616, 1, 1), (616, 2, 1)]
    assert memory.navigation.bus.bits.tolist() == [60 * MESSAGE_BITS, 120 * MESSAGE_BITS, 120 * MESSAGE_BITS]
    assert spent[0] == 0.0


def test_late_and_lost_messages_cost_accuracy_and_none_at_all_the_formation():
    structure = three()
    place, velocity = structure.states(0.0)
    pushed = velocity + [[0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    law = law_of(structure, reference="leader", messaging=Messaging(every_s=10.0, silence_s=60.0, seed=3))
    law.links = links(3.0, 0.4)
    r, _, _, memory = fly(law, place, pushed, 600.0)
    assert relative(structure, r[-1], 0, 600.0).max() < 0.1 and memory.navigation.bus.lost > 30
    law.links = links(0.0, 1.0)
    r, _, _, memory = fly(law, place, pushed, 600.0)
    assert memory.leader.tolist() == [0, 1, 2]  # each is alone, and leads itself
    assert not memory.navigation.alive(599.0)[~np.eye(3, dtype=bool)].any()


def test_a_common_error_of_all_costs_nothing_where_the_mean_is_held():
    structure = three()
    place, velocity = structure.states(0.0)
    r, _, spent, _ = fly(law_of(structure, reference="mean"), place, velocity + [0.05, 0.02, 0.0], 600.0)
    assert spent.max() < 1e-3 and np.linalg.norm(r[-1] - structure.path(600.0), axis=1).min() > 30.0
    own = velocity + [[0.06, 0.0, 0.0], [-0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]]
    r, _, spent, _ = fly(law_of(structure, reference="mean"), place, own, 900.0)
    assert np.linalg.norm(r[-1] - structure.path(900.0), axis=1).max() < 0.1 and spent.min() > 0.02


def test_a_swap_in_orbit_keeps_its_distance_and_collides_unguarded():
    planned = circular()
    ring = np.array([[40.0, 0.0, 0.0], [-40.0, 0.3, 0.0], [0.0, 40.0, 1.0], [0.0, -40.0, 0.0]])
    structure = offset_structure(planned, nodes(DAY), -ring, None)
    start = planned.centre(0.0) + ring, np.broadcast_to(planned.centre(0.0, 1), ring.shape)
    pairs = np.triu_indices(4, 1)

    def least(law):
        r, _, _, memory = fly(law, *start, 900.0)
        apart = np.linalg.norm(r[:, pairs[0]] - r[:, pairs[1]], axis=2).min()
        return apart, np.linalg.norm(r[-1] - structure.path(900.0), axis=1).max(), memory

    apart, left, memory = least(law_of(structure, separation=10.0))
    assert apart >= 10.0 and left < 1.0 and memory.guarded.all()
    assert least(law_of(structure))[0] < 10.0


def test_free_flight_in_steps_is_free_flight():
    r, v = hill_states(OFFSETS, RATES, 0.0)
    a, b = r, v
    for k in range(100):
        a, b = coast(gravity, float(k), 1.0, a, b)
    expected = propagate(gravity, r, v, np.array([0.0, 100.0]))
    np.testing.assert_allclose(a, expected[0][-1], atol=1e-5)
    np.testing.assert_allclose(b, expected[1][-1], atol=1e-7)
