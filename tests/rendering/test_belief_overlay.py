"""What navigation believes, drawn over a camera's picture: where geometry puts it, for a sphere in closed form."""

from types import SimpleNamespace

import numpy as np
import trimesh

from swarm_mj.rendering.canvas import Box, Projection
from swarm_mj.rendering.frame import Belief
from swarm_mj.rendering.navigation import BeliefOverlay, known_to
from swarm_mj.rendering.palette import BELIEVED
from swarm_mj.simulator.telemetry import correlated

SIDE, HALF_DEG, RADIUS, FAR = 400, 10.0, 250.0, 4000.0
BOX = Box(30, 10, SIDE, SIDE)
#: Camera at +z of N looks along -z, its +x to the right along +x of N, its +y down along -y of N; the body is turned.
C_CN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
C_AN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
FOCAL_PX = 0.5 * SIDE / np.tan(np.radians(HALF_DEG))


NONE = np.empty((0, 3))


def drawn(off, covariance, landmarks_A=NONE):
    """Rows and columns in the view of all that is drawn."""
    sphere = trimesh.creation.icosphere(4, RADIUS)
    plan = SimpleNamespace(
        scenario=SimpleNamespace(camera=SimpleNamespace(half_angle_deg=HALF_DEG)),
        shape=SimpleNamespace(vertices=sphere.vertices, faces=sphere.faces),
    )
    r_N = np.array([0.0, 0.0, FAR])
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    view = Projection(r_N, axes, np.full(2, FOCAL_PX), BOX)
    belief = Belief((r_N + off)[None], covariance[None], (landmarks_A,))
    blank = np.zeros((SIDE + 20, SIDE + 40, 3), np.uint8)
    found = BeliefOverlay(plan, SIDE).draw(blank, view, belief, 0, r_N, C_CN, C_AN)
    assert not blank.any()
    rows, columns = np.nonzero((found == BELIEVED).all(axis=2))
    return columns - BOX.left + 0.5 - SIDE / 2, SIDE / 2 - (rows - BOX.top + 0.5)


def test_the_limb_stands_where_the_body_would_be_seen_from_the_believed_place():
    """Spacecraft thinks to be 100 m along +x: the body is expected to the left, as a circle of known radius."""
    x, y = drawn(np.array([100.0, 40.0, 0.0]), 1e-6 * np.eye(3))
    far = np.hypot(x, y) > 0.0
    centre = -FOCAL_PX * np.array([100.0, 40.0]) / FAR
    limb = np.hypot(x - centre[0], y - centre[1])[far]
    radius = FOCAL_PX * RADIUS / np.sqrt(FAR**2 - RADIUS**2)
    ring = limb > 0.5 * radius
    assert ring.sum() > 300 and np.abs(limb[ring] - radius).max() < 1.6
    assert limb[~ring].max() < 5.0  # the cross in its middle


def test_the_ellipse_holds_three_sigma_across_the_line_of_sight_and_landmarks_turn_with_the_body():
    covariance = np.diag([30.0**2, 10.0**2, 500.0**2])
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    x, y = drawn(np.zeros(3), turn @ covariance @ turn.T)
    inner = np.hypot(x, y) < 0.9 * FOCAL_PX * RADIUS / FAR
    along, across = 0.8 * x[inner] + 0.6 * y[inner], -0.6 * x[inner] + 0.8 * y[inner]
    assert (
        abs(np.abs(along).max() - FOCAL_PX * 90.0 / FAR) < 1.5
        and abs(np.abs(across).max() - FOCAL_PX * 30.0 / FAR) < 1.5
    )
    landmark_A = np.array([[0.0, -150.0, np.sqrt(RADIUS**2 - 150.0**2)]])  # +y of A is -x of N: at x = +150 m
    x, y = drawn(np.zeros(3), 1e-6 * np.eye(3), landmark_A)
    at = FOCAL_PX * 150.0 / (FAR - landmark_A[0, 2])
    near = np.hypot(x - at, y) < 6.0
    assert near.sum() > 8 and abs(x[near].mean() - at) < 1.0 and abs(y[near].mean()) < 1.0


def test_words_and_correlations():
    P = np.diag([4.0, 9.0, 1.0])
    P[0, 1] = P[1, 0] = 3.0
    sigma, shares = correlated(P)
    assert np.allclose(sigma, [2.0, 3.0, 1.0]) and np.allclose(shares, [0.0, 0.0, 0.5])
    words = known_to(Belief(np.zeros((1, 3)), 1e8 * np.eye(3)[None], (np.empty((0, 3)),)), 0)
    assert words == "knows its place to 30 km (yellow, 3 sigma)"
