"""The attitude filter against its own covariance, the statistics of its sensors and closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from swarm_mj.simulator.faults.attitude_filter import Assumed, Sensors, estimate, first_state
from swarm_mj.simulator.faults.dispersions import ARCSEC, DEG_PER_HOUR, DEG_PER_SQRT_HOUR

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
        self.sensors = Sensors(
            np.full(n, NOISE["gyro"]),
            np.full(n, walk),
            np.full(n, NOISE["tracker"]),
            np.zeros((n, 3)),
            np.zeros((n, 3)),
            np.ones(n, bool),
            np.ones(n, bool),
        )
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
    trial.sensors.star_tracker_offset[:] = (0.0, 1e-3, 0.0)
    trial.fly(400)
    assert np.allclose(
        trial.errors[:, :3].mean(axis=0), (0.0, -1e-3, 0.0), atol=5 * NOISE["tracker"] / np.sqrt(50 * 10)
    )
