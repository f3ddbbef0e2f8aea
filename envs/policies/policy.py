"""Trained policies as arrays: a small file without pickle, evaluated in NumPy alone.

A policy is one network shared by all spacecraft of the control level `role`. It does not read the observation itself but
features of it, worked out here with the geometry of the patches, so that training (`examples/train_sb3.py`) and flying use the
same numbers. For spacecraft j and patch k

    h_j  = tanh(W2 tanh(W1 [own_j, all patch features of j] + b1) + b2)
    p_jk = v . tanh(W3 [h_j, patch_jk] + b3)      logit of each patch
    q_j  = W4 h_j + b4                            logits of the other choices

and the action is the choice with the largest logit, for every spacecraft by itself.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveFloat, PositiveInt

from swarm_mj.errors import ScenarioError
from swarm_mj.io.arrays import Declared, arrays_in
from swarm_mj.io.atomic import atomic_file
from swarm_mj.io.records import Record, reading, record_from
from swarm_mj.typing import Array, Ints

from ..observe.observations import COLUMNS, FEATURES, LAYOUT
from ..observe.task import Task
from .provenance import Provenance, check_provenance, given_arguments, provenance_of, refuse_other_environment

Arrays = dict[str, NDArray[Any]]

#: The environment that such policies are trained for.
ENVIRONMENT = "SwarmObserve-v0"
#: Raise when features or network change, so that an old file is refused instead of flown wrongly.
FORMAT = 1
#: Features of a spacecraft by itself and of a spacecraft with a patch; `PatchGeometry.features` says which.
OWN, PER_PATCH = 26, 7
#: Arrays of the network.
WEIGHTS = ("W1", "b1", "W2", "b2", "W3", "b3", "v", "W4", "b4")
#: Arrays of a file, as they are written and as they must be to be read; `ABOUT` is JSON.
ABOUT = {"about": Declared("U")}
ARRAYS = {
    "weight_W1": Declared("f4", ("first", "features")),
    "weight_b1": Declared("f4", ("first",)),
    "weight_W2": Declared("f4", ("hidden", "first")),
    "weight_b2": Declared("f4", ("hidden",)),
    "weight_W3": Declared("f4", ("pointer", "hidden and patch")),
    "weight_b3": Declared("f4", ("pointer",)),
    "weight_v": Declared("f4", ("pointer",)),
    "weight_W4": Declared("f4", ("others", "hidden")),
    "weight_b4": Declared("f4", ("others",)),
    "geometry_centre_A": Declared("f8", ("patches", 3)),
    "geometry_normal_A": Declared("f8", ("patches", 3)),
    "geometry_area": Declared("f8", ("patches",), 1e-12),
    "geometry_position_scale": Declared("f8", (), 1e-12),
    "geometry_pixel_angle": Declared("f8", (), 1e-12, 1.6),
    "geometry_half_angle": Declared("f8", (), 1e-12, 1.6),
    "geometry_max_gsd": Declared("f8", (), 1e-12, gaps="inf"),
    "geometry_nominal_gsd": Declared("f8", (), 1e-12),
}
#: What to do about a file that cannot be read.
REMEDY = "give a policy that this version of examples/train_sb3.py wrote"


class PolicyFormat(Record):
    """The version of a policy's file, which says whether the rest can be read."""

    format: int


class PolicyAbout(PolicyFormat, Provenance):
    """What a policy's file says of it, see `describe` and `provenance`; training adds to it."""

    scenario: str
    control: str
    step_s: PositiveFloat
    spacecraft: PositiveInt
    choices: PositiveInt
    readings: PositiveInt
    validation_return: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PatchGeometry:
    """What turns an observation into features: the patches in A and the scales.

    Attributes:
        centre_A: Middles of the patches, shape (K, 3) [m].
        normal_A: Mean normals of the patches, shape (K, 3).
        area: Shape (K,) [m^2].
        position_scale: What positions in an observation are divided by [m].
        pixel_angle: Of the camera [rad].
        half_angle: Of the camera [rad].
        max_gsd: Largest ground sampling distance that counts [m]; infinite for no limit.
        nominal_gsd: Ground sampling distance straight down from the imaging altitude [m].
    """

    centre_A: Array
    normal_A: Array
    area: Array
    position_scale: float
    pixel_angle: float
    half_angle: float
    max_gsd: float
    nominal_gsd: float

    @property
    def count(self) -> int:
        """Number of patches K."""
        return len(self.area)

    def worth(self, position: Array, unseen: Array) -> tuple[Array, Array]:
        """What a picture of each patch would bring, in nominal volumes of the whole target, and its sampling distance.

        Args:
            position: In the units of an observation, shape (E, n, 3).
            unseen: Share of each patch nobody has seen, shape (E, K).

        Returns:
            Worth, zero where no picture would count, and ground sampling distance [m], shape (E, n, K).
        """
        to_camera = position[:, :, None] * self.position_scale - self.centre_A
        distance = np.linalg.norm(to_camera, axis=3)
        cosine = np.maximum((to_camera * self.normal_A).sum(axis=3) / distance, 1e-3)
        across = distance * self.pixel_angle
        gsd = across / cosine
        brings = 1.0 + (self.nominal_gsd / across) ** 2 * cosine
        return unseen[:, None] * (self.area / self.area.sum()) * brings * (gsd <= self.max_gsd), gsd

    def features(self, observation: NDArray[np.floating]) -> Array:
        """Features of E observations, shape (E, n, OWN + K PER_PATCH).

        Of a spacecraft by itself: position, velocity, boresight and x axis in A, body rate in A, data aboard, imaging, link,
        the five roles, time left, seen, delivered. With each patch, patch by patch: its unseen area, what a picture would
        bring, that share among the spacecraft, ground sampling distance over the limit, angle from the boresight, how many
        others look there, and whether the greedy rule would send the spacecraft there.
        """
        K = self.count
        given = np.asarray(observation, np.float64)
        n = (given.shape[1] - K - 3) // FEATURES
        block = given[:, : n * FEATURES].reshape(len(given), n, FEATURES)
        tail = given[:, n * FEATURES :]
        part = {name: block[:, :, columns] for name, columns in COLUMNS.items()}
        boresight, x = part["boresight"], part["x_axis"]
        axes = np.stack([x, np.cross(boresight, x), boresight], axis=3)
        rate_A = (axes * part["rate"][:, :, None]).sum(axis=3)
        common = np.repeat(tail[:, None, K:], n, axis=1)
        own = [part["position"], part["velocity"], boresight, x, rate_A, part["stored"]]
        own += [part["imaging"], part["link"], part["role"], common]
        patch = self._with_patches(part, 1.0 - tail[:, :K])
        return np.concatenate([*own, patch.reshape(len(given), n, K * PER_PATCH)], axis=2)

    def _with_patches(self, part: Mapping[str, Array], unseen: Array) -> Array:
        position, boresight = part["position"], part["boresight"]
        worth, gsd = self.worth(position, unseen)
        toward = self.centre_A - position[:, :, None] * self.position_scale
        toward /= np.linalg.norm(toward, axis=3, keepdims=True)
        cosine = (toward * boresight[:, :, None]).sum(axis=3)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        looks = np.exp(-((angle / self.half_angle) ** 2)) * part["imaging"]
        limit = self.max_gsd if np.isfinite(self.max_gsd) else 2.0 * self.nominal_gsd
        area = unseen * (self.area / self.area.mean())
        greedy = assign(worth)
        patch = [
            np.broadcast_to(area[:, None], worth.shape),
            10.0 * worth,
            worth / np.maximum(worth.sum(axis=1, keepdims=True), 1e-9),
            np.minimum(gsd / limit, 2.0),
            np.minimum(angle, 1.5),
            looks.sum(axis=1, keepdims=True) - looks,
            (greedy[:, :, None] == np.arange(self.count)).astype(np.float64),
        ]
        return np.stack(patch, axis=3)


def assign(worth: Array) -> Ints:
    """The greedy rule: one after another each spacecraft takes the patch worth most, a different one; -1 where none is.

    Args:
        worth: Of each patch for each spacecraft, shape (E, n, K).
    """
    left = worth.copy()
    choice = np.zeros(worth.shape[:2], np.int64)
    for j in range(worth.shape[1]):
        choice[:, j] = left[:, j].argmax(axis=1)
        # Others take it only when nothing else is left.
        left[np.arange(len(left)), :, choice[:, j]] *= 1e-3
    return np.where(worth.max(axis=2) > 0.0, choice, -1)


def greedy_actions(features: NDArray[np.floating], geometry: PatchGeometry) -> Ints:
    """What the greedy rule says, looking ahead: with nothing in reach a spacecraft turns to what it will reach, or talks.

    Args:
        features: Shape (E, n, OWN + K PER_PATCH).
        geometry: Of the patches.

    Returns:
        Actions of the control level `role`, shape (E, n).
    """
    patch = features[:, :, OWN:].reshape(*features.shape[:2], geometry.count, PER_PATCH)
    area, gsd, chosen = patch[..., 0], patch[..., 3], patch[..., 6]
    position, velocity = features[..., :3], features[..., 3:6]
    ahead = (area / gsd).argmax(axis=2)
    receding = (position * velocity).sum(axis=2) > 0.0
    earth = geometry.count + features.shape[1] + 1
    idle = np.where(receding, earth, ahead)
    return np.where(chosen.any(axis=2), chosen.argmax(axis=2), idle).astype(np.int64)


def geometry_of(task: Task) -> PatchGeometry:
    """The geometry of an environment's task.

    Raises:
        ScenarioError: The spacecraft have not three wheels, for which the places of the features are.
    """
    if task.observation_layout.features != FEATURES:
        wheels, layout = len(task.plan.properties.wheel_axes_B), task.plan.scenario.spacecraft.wheel_layout
        raise ScenarioError(
            f"spacecraft.wheel_layout = {layout!r}: features of policies are those of three wheels, not of {wheels}; must be "
            "orthogonal"
        )
    region, patches, camera = task.plan.region, task.patches, task.observer.camera
    scenario = task.plan.scenario
    weighted = [np.bincount(patches.of_cell, region.area * region.normal_A[:, i], patches.count) for i in range(3)]
    normal = np.column_stack(weighted)
    return PatchGeometry(
        centre_A=patches.centre_A,
        normal_A=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        area=patches.area,
        position_scale=task.observation_layout.position_scale,
        pixel_angle=float(camera.pixel_angle),
        half_angle=float(np.arctan(camera.tan_half_angle)),
        max_gsd=scenario.observation.max_gsd_m or float("inf"),
        nominal_gsd=float(scenario.design.imaging_altitude_m * camera.pixel_angle),
    )


@dataclass(frozen=True, eq=False)
class ArrayPolicy:
    """A trained policy.

    Attributes:
        weights: Arrays of the network by name, see `WEIGHTS`.
        geometry: Of the patches it was trained on.
        about: What it is for: see `describe`, and whatever training adds.
    """

    weights: Mapping[str, Array]
    geometry: PatchGeometry
    about: Mapping[str, Any]

    def logits(self, features: Array) -> Array:
        """Preference for each choice of each spacecraft, shape (E, n, K + n + 3)."""
        w, K = self.weights, self.geometry.count
        patch = features[:, :, OWN:].reshape(*features.shape[:2], K, PER_PATCH)
        hidden = np.tanh(np.tanh(features @ w["W1"].T + w["b1"]) @ w["W2"].T + w["b2"])
        size = hidden.shape[2]
        context = hidden @ w["W3"][:, :size].T + w["b3"]
        pointed = np.tanh(patch @ w["W3"][:, size:].T + context[:, :, None]) @ w["v"]
        return np.concatenate([pointed, hidden @ w["W4"].T + w["b4"]], axis=2)

    def act(self, observation: NDArray[np.floating]) -> Ints:
        """The actions of E observations, shape (E, n), or of one, shape (n,).

        They are taken for observations of the patches in `geometry`: fly `for_task(task).act`, as `fly_seeds` does.
        """
        given = np.atleast_2d(observation)
        # Flight by flight: products of matrices round differently with their number.
        chosen = np.concatenate([self.logits(self.geometry.features(row[None])).argmax(axis=2) for row in given])
        return chosen if np.ndim(observation) == 2 else chosen[0]

    def for_task(self, task: Task) -> ArrayPolicy:
        """The policy with the patches, camera and scales of a task in the place of those that it was trained on.

        Where they are the same but for rounding the policy stays as it is, bit for bit. Elsewhere it is flown with features
        that are true there; how well its network uses them is another matter.

        Raises:
            ScenarioError: The environment's spaces are not those of training; the message names what differs.
        """
        self.check(task)
        here = geometry_of(task)
        same = all(np.allclose(getattr(here, f.name), getattr(self.geometry, f.name)) for f in fields(PatchGeometry))
        return self if same else replace(self, geometry=here)

    def check(self, task: Task) -> None:
        """Refuse an environment whose spaces are not those of training.

        Raises:
            ScenarioError: The message names what differs.
        """
        check_provenance(self.about, ENVIRONMENT, LAYOUT)
        found = describe(task)
        del found["scenario"]
        for name, value in found.items():
            if self.about.get(name) != value:
                raise ScenarioError(f"policy: trained for {name} = {self.about.get(name)!r}, but it is {value!r} here")
        # A choice that does not exist must not reach the flight.
        offered = self.geometry.count, self.weights["W4"].shape[0], self.weights["b4"].shape[0]
        asked = task.patches.count, task.plan.n + 3, task.plan.n + 3
        if offered != asked:
            raise ScenarioError(
                f"policy: its arrays offer {offered[0]} patches and {offered[1]} (W4) or {offered[2]} (b4) further choices, "
                f"but here are {asked[0]} and {asked[1]}"
            )


def describe(task: Task) -> dict[str, Any]:
    """What a policy for a task has to know about it."""
    return {
        "scenario": task.plan.scenario.name,
        "control": task.config.control,
        "step_s": task.step_s,
        "spacecraft": task.plan.n,
        "choices": task.patches.count + task.plan.n + 3,
        # The size of an observation, under the name that it has in the files of format 1.
        "readings": task.observation_layout.space.shape[0],
    }


def provenance(task: Task) -> dict[str, Any]:
    """What a file should tell of a policy trained for a task."""
    return provenance_of(ENVIRONMENT, LAYOUT, given_arguments(task.config))


def save_policy(file: str | Path, policy: ArrayPolicy) -> None:
    """Write a policy as `.npz`; it takes the place of an earlier one only when it is whole.

    Raises:
        OutputError: The file cannot be written.
    """
    arrays: Arrays = {f"weight_{name}": np.asarray(policy.weights[name], np.float32) for name in WEIGHTS}
    arrays |= {
        f"geometry_{item.name}": np.asarray(getattr(policy.geometry, item.name)) for item in fields(PatchGeometry)
    }
    text = json.dumps({"format": FORMAT} | dict(policy.about), sort_keys=True)
    with atomic_file(Path(file)) as partial, partial.open("wb") as stream:
        np.savez_compressed(stream, about=np.array(text), **arrays)  # type: ignore[arg-type]


def load_policy(file: str | Path) -> ArrayPolicy:
    """Read what `save_policy` wrote; nothing in the file is executed.

    Raises:
        ScenarioError: The file is missing, is no policy, or one of another environment or format.
    """
    path = Path(file)
    with reading(f"policy {path}", REMEDY, ScenarioError):
        text = str(arrays_in(path, ABOUT)["about"])
        found = record_from(text, PolicyFormat)["format"]
    if found != FORMAT:
        refuse_other_environment(path, ENVIRONMENT)
    with reading(f"policy {path}", REMEDY, ScenarioError):
        if found != FORMAT:
            raise ValueError(f"it has format {found}, this program reads {FORMAT}")
        about = record_from(text, PolicyAbout)
        arrays = arrays_in(path, ARRAYS)
        _check_widths(arrays)
    del about["format"]
    weights = {name: arrays[f"weight_{name}"].astype(np.float64) for name in WEIGHTS}
    given = {item.name: arrays[f"geometry_{item.name}"] for item in fields(PatchGeometry)}
    geometry: dict[str, Any] = {name: value if value.ndim else float(value) for name, value in given.items()}
    return ArrayPolicy(weights, PatchGeometry(**geometry), about)


def _check_widths(arrays: Arrays) -> None:
    """Refuse a network whose inputs are not as wide as the features."""
    patches, hidden = len(arrays["geometry_area"]), len(arrays["weight_W2"])
    for name, width in (("weight_W1", OWN + patches * PER_PATCH), ("weight_W3", hidden + PER_PATCH)):
        if arrays[name].shape[1] != width:
            raise ValueError(
                f"{name} has the shape {arrays[name].shape}, must have {width} columns for {patches} patches"
            )
