"""What tests of the environments share: flights of either kind behind the same calls, and plain geometry of its own."""

import os
from dataclasses import dataclass
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.policies.policy import OWN, PER_PATCH, WEIGHTS, ArrayPolicy, describe, geometry_of

from swarm_mj.mission.behaviors import TargetKind, Targets

ID = "swarm_mj.envs:SwarmObserve-v0"
#: Choices of a spacecraft of `eros-observe` at the level `role`, with 16 patches and five spacecraft.
CENTRE, SC1, EARTH, HOLD = 16, 17, 22, 23
#: Ground sampling distance over range of the scenario's camera: 2.5 deg half-angle, 512 pixels.
PIXEL = 2.0 * np.tan(np.radians(2.5)) / 512.0
#: A test that runs with either kind of flights.
BOTH = pytest.mark.parametrize("kind", ["single", "vector"])


def place(flights, e, j, *, position=None, velocity=None, rate=None):
    """Put spacecraft j of flight e elsewhere, or let it move otherwise: in N [m, m/s], body rate [rad/s]."""
    qpos, qvel = flights.qpos[e].reshape(flights.n, -1).copy(), flights.qvel[e].reshape(flights.n, -1).copy()
    if position is not None:
        qpos[j, :3] = position
    if velocity is not None:
        qvel[j, :3] = velocity
    if rate is not None:
        qvel[j, 3:6] = rate
    flights.place(e, qpos, qvel)


class Flights:
    """Flights of one environment, E = 1 if `kind` is "single", else 3."""

    def __init__(self, kind, **arguments):
        self.count = 1 if kind == "single" else 3
        if kind == "single":
            self.env = gymnasium.make(ID, **arguments).unwrapped
            self.batches = [self.env.batch]
        else:
            self.env = gymnasium.make_vec(ID, num_envs=3, threads=2, **arguments)
            self.batches = self.env.batch.batches
            assert len(self.batches) == (2 if arguments.get("observer", "horizon") == "horizon" else 1)
        self.task = self.batches[0].task
        self.plan = self.task.plan
        self.t = 0.0

    def reset(self, *flight_seeds):
        """Start with these flight seeds; the single environment takes the first."""
        wanted = flight_seeds[0] if self.count == 1 else list(flight_seeds)
        observation, _ = self.env.reset(seed=0, options={"flight_seed": wanted})
        self.t = 0.0
        return np.atleast_2d(observation)

    def step(self, action):
        """The same action in every flight, or one for each; observations (E, F), terms by name (E,), infos."""
        actions = np.broadcast_to(action, (self.count, np.shape(action)[-1]))
        if self.count == 1:
            observation, _, terminated, truncated, infos = self.env.step(actions[0])
            terms = {name: np.array([value]) for name, value in infos["reward_terms"].items()}
        else:
            observation, _, terminated, truncated, infos = self.env.step(np.array(actions))
            terms = infos["reward_terms"]
        assert not np.any(terminated)
        assert not np.any(truncated)
        self.t += self.task.step_s
        return np.atleast_2d(observation), terms, infos

    def gather(self, pick):
        """Of all flights, by batch."""
        return np.concatenate([np.array(pick(batch)) for batch in self.batches])

    def parts(self, observations):
        """Observations by name, shape (E, n, size)."""
        rows = [self.task.observation_layout.split(row) for row in observations]
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    @property
    def r_N(self):
        """Positions, shape (E, n, 3) [m]."""
        return self._qpos[..., :3]

    @property
    def C_BN(self):
        """Rotations from N to B, shape (E, n, 3, 3)."""
        return rotation(self._qpos[..., 3:7]).swapaxes(-1, -2)

    @property
    def wheel_speed(self):
        """Shape (E, n, w) [rad/s]."""
        return self.gather(lambda batch: batch.flights.qvel).reshape(self.count, self.plan.n, -1)[..., 6:]

    @property
    def _qpos(self):
        return self.gather(lambda batch: batch.flights.qpos).reshape(self.count, self.plan.n, -1)

    def close(self):
        """Close the environment."""
        self.env.close()


@dataclass(frozen=True)
class LookAt:
    """The behaviour of a swarm that looks at one thing throughout."""

    kind: TargetKind
    point_A: tuple[float, float, float] = (0.0, 0.0, 0.0)
    n: int = 5
    dedicated_communications: ClassVar[bool] = False

    def targets(self, view, memory):
        kind, index = np.full(self.n, int(self.kind)), np.zeros(self.n, np.int64)
        return Targets(kind, index, np.tile(np.array(self.point_A), (self.n, 1))), memory


def fly(env, action, seed):
    """Fly one action to the end from a flight seed; all infos."""
    env.reset(seed=0, options={"flight_seed": seed})
    infos, done = [], False
    while not done:
        *_, reward, terminated, truncated, info = env.step(action)
        infos.append(info | {"reward": reward})
        done = terminated or truncated
    return infos


def random_network(task):
    """A network that prefers everything now and then."""
    rng, width, n, hidden, pointer = np.random.default_rng(3), OWN + 16 * PER_PATCH, task.plan.n, 8, 6
    shapes = [(hidden, width), (hidden,), (hidden, hidden), (hidden,), (pointer, hidden + PER_PATCH), (pointer,)]
    shapes += [(pointer,), (n + 3, hidden), (n + 3,)]
    weights = {name: rng.normal(0.0, 0.7, shape) for name, shape in zip(WEIGHTS, shapes, strict=True)}
    return ArrayPolicy(weights, geometry_of(task), describe(task))


def rotation(q):
    """Matrices that carry components in B to N, of quaternions (w, x, y, z), shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def angle_deg(a, b):
    """Between two vectors [deg]."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


def resident_mib():
    """Memory of this process [MiB]."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
