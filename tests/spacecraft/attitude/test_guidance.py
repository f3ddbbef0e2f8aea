"""Guidance against finite differences of its own attitude history and against closed forms of parallel transport."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from swarm_mj.spacecraft.attitude import guidance, mrp
from swarm_mj.spacecraft.attitude.guidance import LineOfSight, Reference, TrackingError

N = 12


def track(rho, rho_dot, rho_ddot, q_BN, restart, q_RN) -> Reference:
    n = len(rho)
    reference = Reference(np.array(q_RN, dtype=float), *(np.full((n, 3), np.nan) for _ in range(3)))
    sight = LineOfSight(rho, rho_dot, rho_ddot)
    guidance.track_line_of_sight(sight, q_BN, np.full(n, restart), reference)
    return reference


def flyby(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets that pass at 14 to 25 km and 60 m/s, on curved paths."""
    rng = np.random.default_rng(7)
    start, velocity, a, phase = (rng.normal(size=(N, 3)) * scale for scale in (12e3, 40.0, 30.0, 3.0))
    angle = 0.05 * t + phase
    return (
        start + velocity * t + a * np.sin(angle),
        velocity + 0.05 * a * np.cos(angle),
        -(0.05**2) * a * np.sin(angle),
    )


def random_attitudes(n: int = N, seed: int = 1) -> np.ndarray:
    return Rotation.random(n, random_state=seed).as_quat(scalar_first=True)


def z_axes(q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q, scalar_first=True).apply([0.0, 0.0, 1.0])


def history(h: float, steps: int, t0: float = 0.0) -> list[Reference]:
    q = random_attitudes()
    result = [track(*flyby(t0), q, True, q)]
    for k in range(1, steps):
        result.append(track(*flyby(t0 + k * h), q, False, result[-1].q_RN))
    return result


def rate_between(before: np.ndarray, after: np.ndarray, duration: float) -> np.ndarray:
    turn = Rotation.from_quat(after, scalar_first=True) * Rotation.from_quat(before, scalar_first=True).inv()
    return turn.as_rotvec() / duration


def test_z_axis_lies_on_the_line_of_sight_to_rounding() -> None:
    for t, reference in zip(np.arange(400) * 0.5, history(0.5, 400), strict=True):
        rho = flyby(t)[0]
        los = rho / np.linalg.norm(rho, axis=1, keepdims=True)
        np.testing.assert_allclose(reference.los_N, los, rtol=0, atol=2.3e-16)
        np.testing.assert_allclose(z_axes(reference.q_RN), los, rtol=0, atol=1e-15)


def test_reference_rate_is_the_derivative_of_the_reference_attitude() -> None:
    h = 0.05
    references = history(h, 41)
    for before, now, after in zip(references[:-2], references[1:-1], references[2:], strict=True):
        np.testing.assert_allclose(rate_between(before.q_RN, after.q_RN, 2 * h), now.omega_RN_N, rtol=0, atol=1e-9)


def test_reference_acceleration_is_the_derivative_of_the_reference_rate() -> None:
    h = 0.05
    references = history(h, 41)
    for before, now, after in zip(references[:-2], references[1:-1], references[2:], strict=True):
        np.testing.assert_allclose((after.omega_RN_N - before.omega_RN_N) / (2 * h), now.domega_RN_N, rtol=0, atol=1e-9)
    assert np.abs(references[20].domega_RN_N).max() > 1e-6


def test_reference_never_turns_about_the_line_of_sight() -> None:
    h = 0.5
    references = history(h, 200)
    for before, after in zip(references[:-1], references[1:], strict=True):
        assert np.abs(np.sum(after.omega_RN_N * after.los_N, axis=1)).max() < 1e-17
        midway = before.los_N + after.los_N
        twist = np.sum(rate_between(before.q_RN, after.q_RN, 1.0) * midway, axis=1) / np.linalg.norm(midway, axis=1)
        assert np.abs(twist).max() < 2e-15


@pytest.mark.parametrize("cone_deg", [10.0, 60.0, 90.0, 130.0])
def test_going_round_a_cone_turns_the_reference_by_the_solid_angle(cone_deg: float) -> None:
    cone, steps = np.deg2rad(cone_deg), 4000
    q = np.array([[1.0, 0.0, 0.0, 0.0]])
    first = None
    for k in range(steps + 1):
        angle = 2 * np.pi * k / steps
        rho = 1e4 * np.array([[np.sin(cone) * np.cos(angle), np.sin(cone) * np.sin(angle), np.cos(cone)]])
        q = track(rho, 0 * rho, 0 * rho, q, k == 0, q).q_RN
        first = q if first is None else first
    turn = Rotation.from_quat(q[0], scalar_first=True) * Rotation.from_quat(first[0], scalar_first=True).inv()
    solid_angle = 2 * np.pi * (1 - np.cos(cone))
    expected = Rotation.from_rotvec(solid_angle * np.array([np.sin(cone), 0.0, np.cos(cone)]))
    assert (turn * expected.inv()).magnitude() < 1e-5


def test_restart_takes_the_attitude_closest_to_the_body() -> None:
    q_BN, rho = random_attitudes(), flyby(0.0)[0]
    reference = track(*flyby(0.0), q_BN, True, random_attitudes(seed=2))
    needed = np.arccos(np.sum(z_axes(q_BN) * rho, axis=1) / np.linalg.norm(rho, axis=1))
    sigma = mrp.subtract_mrp(mrp.mrp_from_quaternion(reference.q_RN), mrp.mrp_from_quaternion(q_BN))
    turned = 4.0 * np.arctan(np.linalg.norm(sigma, axis=1))
    np.testing.assert_allclose(turned, needed, rtol=0, atol=1e-7)
    np.testing.assert_allclose(turned, guidance.pointing_error(q_BN, reference.los_N), rtol=0, atol=1e-13)


def test_without_restart_the_body_attitude_does_not_matter() -> None:
    q_RN = random_attitudes(seed=3)
    one = track(*flyby(0.0), random_attitudes(seed=4), False, q_RN)
    other = track(*flyby(0.0), random_attitudes(seed=5), False, q_RN)
    np.testing.assert_array_equal(one.q_RN, other.q_RN)


def test_reference_moves_no_further_than_its_rate_allows() -> None:
    references = history(0.5, 200)
    for before, after in zip(references[:-1], references[1:], strict=True):
        angle = np.linalg.norm(rate_between(before.q_RN, after.q_RN, 1.0), axis=1)
        fastest = np.maximum(np.linalg.norm(before.omega_RN_N, axis=1), np.linalg.norm(after.omega_RN_N, axis=1))
        assert np.all(angle <= 0.5 * fastest * 1.01)


@pytest.mark.parametrize("distance", [0.0, 0.99])
def test_coincident_bodies_hold_the_previous_reference_at_rest(distance: float) -> None:
    q_BN, q_RN = random_attitudes(seed=6), random_attitudes(seed=7)
    rho = np.tile([distance, 0.0, 0.0], (N, 1))
    held = track(rho, np.ones((N, 3)), np.ones((N, 3)), q_BN, False, q_RN)
    np.testing.assert_allclose(held.q_RN, q_RN, rtol=0, atol=3e-16)
    np.testing.assert_allclose(held.los_N, z_axes(q_RN), rtol=0, atol=1e-15)
    assert not held.omega_RN_N.any()
    assert not held.domega_RN_N.any()
    fresh = track(rho, np.ones((N, 3)), np.ones((N, 3)), q_BN, True, np.full((N, 4), np.nan))
    np.testing.assert_allclose(fresh.q_RN, q_BN, rtol=0, atol=3e-16)


@pytest.mark.parametrize("offset", [0.0, 1e-17, 1e-12, 0.99e-8, 1.01e-8, 1e-6])
def test_opposite_line_of_sight_is_reached_about_the_body_x_axis(offset: float) -> None:
    q_BN = random_attitudes()
    body = Rotation.from_quat(q_BN, scalar_first=True)
    los = body.apply([0.0, np.sin(offset), -np.cos(offset)])
    reference = track(1e4 * los, 0 * los, 0 * los, q_BN, True, q_BN)
    np.testing.assert_allclose(z_axes(reference.q_RN), los, rtol=0, atol=1e-15)
    x_axes = Rotation.from_quat(reference.q_RN, scalar_first=True).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(x_axes, body.apply([1.0, 0.0, 0.0]), rtol=0, atol=1e-7)


def test_a_fixed_direction_has_no_rate_however_far_it_is() -> None:
    rho = 2e11 * Rotation.random(N, random_state=8).apply([0.0, 0.0, 1.0])
    reference = track(rho, np.zeros((N, 3)), np.zeros((N, 3)), random_attitudes(), True, random_attitudes())
    assert not reference.omega_RN_N.any()
    assert not reference.domega_RN_N.any()


def test_attitude_error_agrees_with_mrp_and_dcm_algebra() -> None:
    rng = np.random.default_rng(9)
    q_BN, q_RN = random_attitudes(seed=10), random_attitudes(seed=11)
    omega_BN_B, omega_RN_N, domega_RN_N = rng.normal(size=(3, N, 3))
    error = TrackingError(*(np.empty((N, 3)) for _ in range(4)))
    reference = Reference(q_RN, omega_RN_N, domega_RN_N, np.empty((N, 3)))
    guidance.attitude_error(q_BN, omega_BN_B, reference, error)
    sigma, omega_BR, omega_RN, domega = error
    sigma_BN, sigma_RN = mrp.mrp_from_quaternion(q_BN), mrp.mrp_from_quaternion(q_RN)
    C_BN = mrp.dcm(sigma_BN)
    np.testing.assert_allclose(mrp.dcm(sigma), C_BN @ np.swapaxes(mrp.dcm(sigma_RN), 1, 2), rtol=0, atol=1e-14)
    assert np.all(np.linalg.norm(sigma, axis=1) <= 1)
    np.testing.assert_allclose(omega_RN, np.einsum("nij,nj->ni", C_BN, omega_RN_N), rtol=0, atol=1e-14)
    np.testing.assert_allclose(domega, np.einsum("nij,nj->ni", C_BN, domega_RN_N), rtol=0, atol=1e-14)
    np.testing.assert_allclose(omega_BR, omega_BN_B - omega_RN, rtol=0, atol=1e-14)


@given(st.floats(-16.0, np.log10(np.pi)), st.floats(0.0, 2 * np.pi))
def test_pointing_error_keeps_its_relative_accuracy_down_to_zero(exponent: float, azimuth: float) -> None:
    angle = 10.0**exponent
    assume(angle < np.pi)
    los = np.array([[np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]])
    error = guidance.pointing_error(np.array([[1.0, 0.0, 0.0, 0.0]]), los)
    assert error[0] == pytest.approx(angle, rel=1e-14, abs=1e-30)


def test_each_spacecraft_is_computed_on_its_own() -> None:
    q_BN, q_RN = random_attitudes(seed=12), random_attitudes(seed=13)
    restart = np.arange(N) % 2 == 0
    rho, rho_dot, rho_ddot = flyby(3.0)
    rho[5] = 0.0
    together = Reference(q_RN.copy(), *(np.empty((N, 3)) for _ in range(3)))
    guidance.track_line_of_sight(LineOfSight(rho, rho_dot, rho_ddot), q_BN, restart, together)
    for i in range(N):
        one = slice(i, i + 1)
        alone = track(rho[one], rho_dot[one], rho_ddot[one], q_BN[one], restart[i], q_RN[one])
        for joint, single in zip(together, alone, strict=True):
            np.testing.assert_array_equal(joint[one], single)


def second_axis(towards: guidance.Towards, direction=(0.3, -0.5, 0.8)) -> guidance.Aiming:
    d, axis = np.array(direction), np.array([0.2, 1.0, 0.1])
    return guidance.PLAIN._replace(
        towards=int(towards), axis_B=axis / np.linalg.norm(axis), direction_N=d / np.linalg.norm(d)
    )


def orbit(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spacecraft on circles about the origin, which turn about different normals, so that r x v stays where it is."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, N, 3)) * 10e3
    b -= a * (np.einsum("ij,ij->i", a, b) / np.einsum("ij,ij->i", a, a))[:, None]
    return (
        a * np.cos(0.01 * t) + b * np.sin(0.01 * t),
        0.01 * (b * np.cos(0.01 * t) - a * np.sin(0.01 * t)),
        -1e-4 * (a * np.cos(0.01 * t) + b * np.sin(0.01 * t)),
    )


SUN, EARTH = np.array([1.2e11, -0.5e11, 0.3e11]), np.array([-0.4e11, 1.1e11, 0.2e11])


def rolled(h: float, steps: int, aiming: guidance.Aiming) -> list[Reference]:
    q = random_attitudes()
    result: list[Reference] = []
    for k in range(steps):
        r, v, a = orbit(k * h)
        target = flyby(k * h)
        sight = LineOfSight(target[0] - r, target[1] - v, target[2] - a)
        start = result[-1].q_RN if result else q
        reference = track(*sight, q, not result, start)
        guidance.roll_references(aiming, SUN, EARTH, r, v, a, sight, reference)
        result.append(reference)
    return result


KINDS = [kind for kind in guidance.Towards if kind != guidance.Towards.NOTHING]


@pytest.mark.parametrize("towards", KINDS)
def test_the_second_axis_is_as_near_to_its_direction_as_pointing_lets_it(towards) -> None:
    aiming = second_axis(towards)
    r, v, _ = orbit(20 * 0.05)
    reference = rolled(0.05, 21, aiming)[-1]
    wanted = {
        guidance.Towards.SUN: np.broadcast_to(SUN, r.shape),
        guidance.Towards.EARTH: np.broadcast_to(EARTH, r.shape),
        guidance.Towards.VELOCITY: v,
        guidance.Towards.DIRECTION: np.broadcast_to(aiming.direction_N, r.shape),
        guidance.Towards.ORBIT_NORMAL: np.cross(r, v),
    }[towards]
    turns = Rotation.from_quat(reference.q_RN, scalar_first=True)
    np.testing.assert_allclose(z_axes(reference.q_RN), reference.los_N, rtol=0, atol=1e-15)

    def nearness(angle: float) -> np.ndarray:
        axis = (Rotation.from_rotvec(angle * reference.los_N) * turns).apply(aiming.axis_B)
        return np.einsum("ij,ij->i", axis, wanted / np.linalg.norm(wanted, axis=1, keepdims=True))

    best = nearness(0.0)
    clear = np.linalg.norm(np.cross(reference.los_N, wanted), axis=1) > 0.1 * np.linalg.norm(wanted, axis=1)
    assert clear.sum() > N // 2
    assert all((nearness(angle) < best)[clear].all() for angle in (-2.0, -0.3, -1e-3, 1e-3, 0.3, 2.0, np.pi))


@pytest.mark.parametrize("towards", KINDS)
def test_rates_of_a_rolled_reference_are_derivatives_of_its_attitude_and_of_its_rate(towards) -> None:
    h = 0.01
    references = rolled(h, 41, second_axis(towards))
    roll = 0.0
    for before, now, after in zip(references[:-2], references[1:-1], references[2:], strict=True):
        np.testing.assert_allclose(rate_between(before.q_RN, after.q_RN, 2 * h), now.omega_RN_N, rtol=0, atol=1e-8)
        change = (after.omega_RN_N - before.omega_RN_N) / (2 * h)
        loose = towards == guidance.Towards.VELOCITY  # whose second derivative is left out
        if not loose:
            np.testing.assert_allclose(change, now.domega_RN_N, rtol=0, atol=1e-8)
        roll = max(roll, np.abs(np.einsum("ij,ij->i", now.omega_RN_N, now.los_N)).max())
    assert roll > 1e-4


def test_a_direction_on_the_line_of_sight_does_not_turn_the_reference() -> None:
    target = flyby(0.0)
    q = random_attitudes()
    plain = track(*target, q, True, q)
    for k in range(N):
        aiming = second_axis(guidance.Towards.DIRECTION, plain.los_N[k] + 0.05 * np.array([0.0, 0.0, 1.0]))
        reference = track(*target, q, True, q)
        guidance.roll_references(aiming, SUN, EARTH, *target, LineOfSight(*target), reference)
        np.testing.assert_array_equal(reference.q_RN[k], plain.q_RN[k])
