"""MRP algebra against SciPy's rotations, and kinematics against finite differences."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from swarm_mj.spacecraft.attitude import mrp

components = st.floats(-1.0, 1.0)
quaternions = st.tuples(components, components, components, components).map(np.array)
vectors = st.tuples(components, components, components).map(np.array)


def to_unit(q: np.ndarray) -> np.ndarray:
    assume(np.linalg.norm(q) > 1e-3)
    return q / np.linalg.norm(q)


def rotation(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


@given(quaternions)
def test_quaternions_become_the_short_mrp_that_scipy_gives(q: np.ndarray) -> None:
    q = to_unit(q)
    sigma = mrp.mrp_from_quaternion(q)
    assert np.linalg.norm(sigma) <= 1.0 + 1e-15
    if abs(q[0]) > 1e-9:
        np.testing.assert_allclose(sigma, rotation(q).as_mrp(), rtol=0, atol=1e-14)


@given(quaternions)
def test_a_quaternion_survives_the_way_to_mrp_and_back(q: np.ndarray) -> None:
    q = to_unit(q)
    back = mrp.quaternion_from_mrp(mrp.mrp_from_quaternion(q))
    assert abs(np.dot(back, q)) == pytest.approx(1.0, abs=4e-15)


@given(quaternions)
def test_dcm_maps_inertial_to_body_components(q: np.ndarray) -> None:
    q = to_unit(q)
    C_BN = mrp.dcm(mrp.mrp_from_quaternion(q))
    np.testing.assert_allclose(C_BN, rotation(q).as_matrix().T, rtol=0, atol=5e-15)


@given(vectors)
def test_the_shadow_is_the_same_attitude(sigma: np.ndarray) -> None:
    assume(np.linalg.norm(sigma) > 0.05)
    shadow = -sigma / (sigma @ sigma)
    np.testing.assert_allclose(mrp.dcm(shadow), mrp.dcm(sigma), rtol=0, atol=1e-13)


@given(quaternions, quaternions)
def test_addition_composes_and_subtraction_undoes_it(q_BR: np.ndarray, q_RN: np.ndarray) -> None:
    sigma_BR, sigma_RN = (mrp.mrp_from_quaternion(to_unit(q)) for q in (q_BR, q_RN))
    sigma_BN = mrp.add_mrp(sigma_BR, sigma_RN)
    np.testing.assert_allclose(mrp.dcm(sigma_BN), mrp.dcm(sigma_BR) @ mrp.dcm(sigma_RN), rtol=0, atol=5e-15)
    np.testing.assert_allclose(mrp.dcm(mrp.subtract_mrp(sigma_BN, sigma_RN)), mrp.dcm(sigma_BR), rtol=0, atol=1e-14)


@given(vectors, vectors)
def test_subtraction_agrees_with_the_direct_formula_of_schaub_and_junkins(s: np.ndarray, r: np.ndarray) -> None:
    ss, rr = s @ s, r @ r
    denominator = 1 + ss * rr + 2 * s @ r
    assume(denominator > 1e-2)
    direct = ((1 - rr) * s - (1 - ss) * r + 2 * np.cross(s, r)) / denominator
    np.testing.assert_allclose(mrp.dcm(mrp.subtract_mrp(s, r)), mrp.dcm(direct), rtol=0, atol=1e-12)


def test_subtraction_is_finite_where_the_direct_formula_divides_by_zero() -> None:
    sigma = np.array([1.0, 0.0, 0.0])
    result = mrp.subtract_mrp(sigma, -sigma)
    np.testing.assert_allclose(result, 0.0, rtol=0, atol=1e-15)


@given(quaternions, vectors)
def test_kinematics_match_a_finite_difference_of_the_attitude(q: np.ndarray, omega_BN_B: np.ndarray) -> None:
    q = to_unit(q)
    assume(abs(q[0]) > 0.05)
    h = 1e-5
    ahead = rotation(q) * Rotation.from_rotvec(h * omega_BN_B)
    behind = rotation(q) * Rotation.from_rotvec(-h * omega_BN_B)
    difference = (ahead.as_mrp() - behind.as_mrp()) / (2 * h)
    sigma = mrp.mrp_from_quaternion(q)
    np.testing.assert_allclose(mrp.mrp_rate(sigma, omega_BN_B), difference, rtol=0, atol=1e-9)


def test_broadcasting_agrees_with_single_attitudes() -> None:
    q = np.random.default_rng(0).normal(size=(40, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    flat = mrp.mrp_from_quaternion(q)
    grid = mrp.mrp_from_quaternion(q.reshape(8, 5, 4))
    np.testing.assert_array_equal(mrp.dcm(grid)[3, 2], mrp.dcm(flat[17]))
