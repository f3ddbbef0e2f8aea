"""The attitude filter against its own covariance, the statistics of its sensors and closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from swarm_mj.simulator.faults.dispersions import ARCSEC, DEG_PER_HOUR, DEG_PER_SQRT_HOUR
from swarm_mj.spacecraft.attitude.estimation import Assumed, estimate, first_state, sensors_of

PERIOD = 0.5
NOISE = {
    "gyro": 0.15 * DEG_PER_SQRT_HOUR,
    "walk": 10 * DEG_PER_HOUR / 60,
    "tracker": 30 * ARCSEC,
    "bias": 20 * DEG_PER_HOUR,
}


def quaternions(rotations):
    return rotations.as_quat(scalar_first=True)


class Trial:
    """n independent spacecraft that turn at a rate which itself turns, so that no axis is special."""

    def __init__(self, n, *, walk=NOISE["walk"], seed=3, speed=0.05):
        self.rng = np.random.default_rng(seed)
        self.n, self.t, self.speed = n, 0.0, speed
        self.state = first_state(NOISE["bias"] * self.rng.standard_normal((n, 3)))
        self.sensors = sensors_of(n, NOISE["gyro"], walk, NOISE["tracker"])
        self.assumed = Assumed(NOISE["gyro"], walk, NOISE["tracker"], NOISE["bias"])
        self.attitude = Rotation.random(n, rng=self.rng)

    def fly(self, periods):
        for _ in range(periods):
            rate = self.speed * np.array([np.sin(0.02 * self.t), np.cos(0.03 * self.t), 0.7])
            estimate(
                quaternions(self.attitude),
                np.tile(rate, (self.n, 1)),
                PERIOD,
                self.rng.standard_normal((self.n, 3, 3)),
                self.sensors,
                self.assumed,
                self.state,
            )
            self.before, self.truth = getattr(self, "truth", None), self.attitude
            self.attitude = self.attitude * Rotation.from_rotvec(PERIOD * rate)
            self.t += PERIOD

    @property
    def errors(self):
        estimated = Rotation.from_quat(self.state.q_BN, scalar_first=True)
        theta = (estimated.inv() * self.truth).as_rotvec()
        return np.hstack((theta, self.state.true_bias + self.sensors.gyro_offset - self.state.bias))

    @property
    def nees(self):
        return np.einsum("ni,nij,nj->n", self.errors, np.linalg.inv(self.state.covariance), self.errors)


@pytest.mark.parametrize("periods", [2, 40, 400])
def test_the_errors_of_the_filter_are_as_large_as_its_covariance_says(periods):
    trial = Trial(400)
    trial.fly(periods)
    low, high = chi2.ppf([0.0005, 0.9995], 6 * trial.n) / trial.n
    assert low < trial.nees.mean() < high
    # The whole distribution, not only its mean: as many beyond the 95 % quantile as there should be.
    assert (trial.nees > chi2.ppf(0.95, 6)).mean() == pytest.approx(0.05, abs=0.036)
    assert np.allclose(trial.errors.mean(axis=0), 0.0, atol=4 * trial.errors.std(axis=0) / np.sqrt(trial.n))


def test_the_errors_stay_as_large_as_the_covariance_says_through_a_dropout_of_the_star_tracker():
    trial = Trial(400)
    trial.fly(200)
    settled = trial.state.covariance[0, 0, 0]
    trial.sensors.star_tracker_works[:] = False
    trial.fly(120)
    # Attitude variance of an unaided gyro: white noise, a bias error that integrates, and its walk.
    t = 120 * PERIOD
    assert trial.state.covariance[0, 0, 0] > settled + 0.9 * NOISE["gyro"] ** 2 * t
    low, high = chi2.ppf([0.0005, 0.9995], 6 * trial.n) / trial.n
    assert low < trial.nees.mean() < high
    trial.sensors.star_tracker_works[:] = True
    trial.fly(60)
    assert trial.state.covariance[0, 0, 0] < 1.5 * settled


def test_the_filter_estimates_the_gyro_bias_and_its_steady_attitude_beats_the_star_tracker():
    trial = Trial(100, walk=0.01 * DEG_PER_HOUR)
    trial.fly(1)
    before = np.abs(trial.errors[:, 3:]).mean()
    trial.fly(1200)
    after = np.abs(trial.errors[:, 3:]).mean()
    assert after < 0.3 * before
    assert trial.errors[:, :3].std() < 0.7 * NOISE["tracker"]


def test_without_a_walk_the_bias_variance_falls_as_least_squares_says():
    # Noise-free gyro, still body: attitude + slope fit of N star tracker angles, so var(bias) = 12 s^2 / (T^2 N (N^2 - 1)).
    trial = Trial(1, walk=0.0)
    trial.assumed = Assumed(1e-12, 0.0, NOISE["tracker"], 1.0)
    trial.fly(200)
    expected = 12 * NOISE["tracker"] ** 2 / (PERIOD**2 * 200 * (200**2 - 1))
    assert trial.state.covariance[0, 5, 5] == pytest.approx(expected, rel=1e-3)


def test_a_jump_of_the_gyro_bias_is_found_again():
    trial = Trial(20)
    trial.fly(400)
    trial.sensors.gyro_offset[:] = 300 * DEG_PER_HOUR
    trial.fly(1)
    jumped = np.abs(trial.errors[:, 3:]).mean()
    trial.fly(600)
    assert np.abs(trial.errors[:, 3:]).mean() < 0.2 * jumped


def test_without_gyro_the_rate_comes_from_the_star_tracker_with_its_noise():
    trial = Trial(300)
    trial.fly(50)
    trial.sensors.gyro_works[:] = False
    trial.fly(50)
    rate = (trial.before.inv() * trial.truth).as_rotvec() / PERIOD
    scatter = (trial.state.omega_BN_B - rate).std()
    assert scatter == pytest.approx(np.sqrt(2) * NOISE["tracker"] / PERIOD, rel=0.1)
    assert np.linalg.norm(trial.errors[:, :3], axis=1).max() < 6 * NOISE["tracker"]


def test_a_mounting_error_of_the_star_tracker_goes_straight_into_the_attitude():
    trial = Trial(50, speed=0.0)
    trial.sensors.star_tracker_offset[:, 1] = 1e-3
    trial.fly(400)
    assert np.allclose(
        trial.errors[:, :3].mean(axis=0), (0.0, -1e-3, 0.0), atol=5 * NOISE["tracker"] / np.sqrt(50 * 10)
    )


def cross(v):
    return -np.cross(np.eye(3), v).T


class TextbookFilter:
    """Spacecraft j's filter with whole matrices of six rows, and the gyro that drives it.

    The transition is the matrix exponential of theta' = -[w x] theta - b, the noise that of Farrenkopf (1978), the update
    that of any Kalman filter. Without a gyro the rate is what the star tracker's last two attitudes say.
    """

    def __init__(self, trial, seen, j=0):
        self.trial, self.j, self.q, self.bias, self.before = trial, j, seen, np.zeros(3), trial.attitude[j]
        self.true_bias, assumed = trial.state.true_bias[j].copy(), trial.assumed
        self.P = np.diag(np.repeat([assumed.star_tracker_noise**2, assumed.initial_bias**2], 3))
        self.rate, self.tracked = np.zeros(3), seen

    def step(self, attitude, noise):
        assumed, sensors, j = self.trial.assumed, self.trial.sensors, self.j
        walk, gyro = sensors.bias_walk[j], sensors.gyro_noise[j]
        after = self.true_bias + walk * np.sqrt(PERIOD) * noise[1]
        white = np.sqrt(gyro**2 / PERIOD + walk**2 * PERIOD / 12) * noise[0]
        measured = (self.before.inv() * attitude).as_rotvec() / PERIOD + (self.true_bias + after) / 2 + white
        self.true_bias, self.before = after, attitude
        biased = float(sensors.gyro_works[j])
        if biased:
            self.rate = measured + sensors.gyro_offset[j] - self.bias
        self.q = self.q * Rotation.from_rotvec(PERIOD * self.rate)
        drift = np.zeros((6, 6))
        drift[:3, :3], drift[:3, 3:] = -cross(self.rate), -biased * np.eye(3)
        F, q, w = expm(drift * PERIOD), assumed.gyro_noise**2, assumed.bias_walk**2
        mixed = -biased * w * PERIOD**2 / 2
        Q = np.kron([[q * PERIOD + w * PERIOD**3 / 3, mixed], [mixed, w * PERIOD]], np.eye(3))
        Q[:3, :3] += (1.0 - biased) * (0.5 * 0.03 * PERIOD**2) ** 2 * np.eye(3)
        self.P = F @ self.P @ F.T + Q
        self.take(attitude * Rotation.from_rotvec(sensors.star_tracker_noise[j] * noise[2]), biased)

    def take(self, seen, biased):
        if not self.trial.sensors.star_tracker_works[self.j]:
            self.tracked = None
            return
        H, R = np.eye(3, 6), self.trial.assumed.star_tracker_noise**2 * np.eye(3)
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        change = K @ (self.q.inv() * seen).as_rotvec()
        self.P = (np.eye(6) - K @ H) @ self.P
        self.q, self.bias = self.q * Rotation.from_rotvec(change[:3]), self.bias + change[3:]
        if not biased and self.tracked is not None:
            self.rate = (self.tracked.inv() * seen).as_rotvec() / PERIOD
        self.tracked = seen


def of_all_kinds(n):
    """A trial with noise of all kinds of one size: no block and no term is small against another."""
    trial = Trial(n, seed=5)
    trial.assumed, trial.sensors = Assumed(2e-3, 3e-3, 1e-3, 4e-3), sensors_of(n, 2e-3, 3e-3, 1e-3)
    trial.sensors.gyro_offset[:] = np.array([2e-3, -1e-3, 3e-3]) * (1 + np.arange(n))[:, None]
    return trial


@pytest.mark.parametrize("angle", [0.95, 0.03], ids=["large", "small"])
def test_the_filter_is_a_kalman_filter_with_the_matrices_of_the_textbook(angle):
    """Nine spacecraft, of which some lose a gyro, a star tracker or both, beside others that do not."""
    n, direction = 9, np.array([0.42, -0.74, 0.53])
    turn = Rotation.from_rotvec(direction[None] * angle * np.linspace(0.3, 1.0, n)[:, None])
    trial, rng = of_all_kinds(n), np.random.default_rng(1)
    noise = rng.standard_normal((n, 3, 3))
    books = [TextbookFilter(trial, trial.attitude[j] * Rotation.from_rotvec(1e-3 * noise[j, 2]), j) for j in range(n)]
    for period in range(14):
        rate = turn.as_rotvec() / PERIOD
        estimate(quaternions(trial.attitude), rate, PERIOD, noise, trial.sensors, trial.assumed, trial.state)
        P = np.array([book.P for book in books])
        np.testing.assert_allclose(trial.state.covariance, P, rtol=0, atol=1e-12 * P.max())
        for name in ("bias", "true_bias"):
            expected = [getattr(book, name) for book in books]
            np.testing.assert_allclose(getattr(trial.state, name), expected, rtol=0, atol=1e-13)
        estimated = Rotation.from_quat(trial.state.q_BN, scalar_first=True)
        for j, book in enumerate(books):
            assert (book.q.inv() * estimated[j]).magnitude() < 2e-13
            if period > 0:
                np.testing.assert_allclose(trial.state.omega_BN_B[j], book.rate, rtol=0, atol=1e-12)
        trial.sensors.gyro_works[[1, 3, 8]] = not 4 <= period < 9
        trial.sensors.star_tracker_works[[3, 7, 8]] = not 6 <= period < 11
        trial.attitude = trial.attitude * turn
        noise = rng.standard_normal((n, 3, 3))
        for j, book in enumerate(books):
            book.step(trial.attitude[j], noise[j])
    assert np.abs(P[:, :3, 3:]).max() > 0.1 * np.abs(P[:, :3, :3]).max()


@pytest.mark.parametrize("n", [5, 8, 9])
def test_each_spacecraft_estimates_what_it_would_alone_to_the_last_bit(n):
    together, alone, rng = of_all_kinds(n), [], np.random.default_rng(2)
    for j in range(n):
        one = of_all_kinds(n)
        state = first_state(one.state.true_bias[j : j + 1])
        sensors = sensors_of(1, 2e-3, 3e-3, 1e-3)
        sensors.gyro_offset[0] = one.sensors.gyro_offset[j]
        alone.append((sensors, state))
    for period in range(9):
        attitude = quaternions(Rotation.random(n, rng=rng))  # far from each other: every branch for large angles
        rate, noise = rng.standard_normal((n, 3)), rng.standard_normal((n, 3, 3))
        for j, (sensors, _) in enumerate(alone):
            for mine in (together.sensors.gyro_works[j : j + 1], sensors.gyro_works[:1]):
                mine[:] = not (j == 2 and 2 <= period < 5)
            for mine in (together.sensors.star_tracker_works[j : j + 1], sensors.star_tracker_works[:1]):
                mine[:] = not (j in (1, 2) and 4 <= period < 6)
        estimate(attitude, rate, PERIOD, noise, together.sensors, together.assumed, together.state)
        for j, (sensors, state) in enumerate(alone):
            one = slice(j, j + 1)
            estimate(attitude[one], rate[one], PERIOD, noise[one], sensors, together.assumed, state)
            for name in ("q_BN", "omega_BN_B", "bias", "true_bias", "covariance"):
                assert np.array_equal(getattr(together.state, name)[one], getattr(state, name))


def test_the_bias_of_a_gyro_walks_with_the_variance_of_a_random_walk():
    trial = Trial(2000, walk=1e-5)
    start = trial.state.true_bias.copy()
    trial.fly(1)
    assert np.array_equal(trial.state.true_bias, start)
    trial.fly(64)
    assert (trial.state.true_bias - start).std() == pytest.approx(1e-5 * np.sqrt(64 * PERIOD), rel=0.03)
