"""A flight as other programs take it: names and numbers of its objects, instants, states and attitudes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from swarm_mj.flight.observe import arrival_sample, camera_from
from swarm_mj.flight.plan import Plan
from swarm_mj.io.times import SECOND, epoch_of
from swarm_mj.observation.camera import CameraModel
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.spacecraft.attitude.mrp import dcm, quaternion_from_mrp, quaternions, steady
from swarm_mj.tracks.frames import C_EN
from swarm_mj.typing import Array

#: The first spacecraft is -900001; NAIF gives missions numbers of three digits. The clock of all is -900000.
FIRST_SPACECRAFT, CLOCK = -900_001, -900_000


@dataclass(frozen=True)
class FlightStates:
    """What is written.

    Attributes:
        plan: What was flown; body, rotation, Sun and Earth stand there.
        telemetry: All that was recorded.
    """

    plan: Plan
    telemetry: xr.Dataset

    @cached_property
    def comments(self) -> tuple[str, ...]:
        """Where it comes from, one line each."""
        scenario, version = self.plan.scenario, self.telemetry.attrs.get("swarm_mj_version", "of an unknown version")
        return (
            f"swarm_mj {version}, scenario {scenario.name}, seed {scenario.seed}",
            f"body {_ascii(scenario.body.name)}, gravity by {_ascii(scenario.body.gravity.model)}, "
            f"epoch {scenario.epoch} TDB",
            "frame N of swarm_mj has the axes of SPICE's ECLIPJ2000 and its origin in the body's centre of mass",
            "B: spacecraft, camera along +z; positions are geometric, without light time or aberration",
        )

    @cached_property
    def body(self) -> BodyName:
        """What others call the body."""
        return BodyName.of(self.plan.scenario.body.name)

    @cached_property
    def companion(self) -> BodyName | None:
        """The same of the body's companion; None: there is none. No two bodies have one number."""
        if (companion := self.plan.environment.companion) is None:
            return None
        named = BodyName.of(companion.name)
        code, name = (
            named.code - (named.code == self.body.code),
            f"{named.name[:-2]}_2" if named.name == self.body.name else named.name,
        )
        return BodyName(code, name)

    @cached_property
    def camera(self) -> CameraModel:
        """Of every spacecraft."""
        return camera_from(self.plan.scenario)

    @cached_property
    def epoch(self) -> int:
        """In nanoseconds of TDB past J2000."""
        return epoch_of(self.plan.scenario.epoch)

    @cached_property
    def times(self) -> Array:
        """Of the samples past the epoch [s], shape (t,)."""
        return np.asarray(self.telemetry["time"].values, np.float64)

    def flown(self, j: int) -> slice:
        """Samples of spacecraft j from its release on: what files of trajectories and attitudes hold of it.

        Aboard, it moves with the mothership; at the release its velocity jumps, and no interpolation may go across that.
        """
        released = self.telemetry.get("released")
        return slice(0 if released is None else int((released.values[:, j] == 0).sum()), None)

    @cached_property
    def instants(self) -> list[int]:
        """The same in nanoseconds of TDB past J2000."""
        return [self.epoch + round(t * SECOND) for t in self.times.tolist()]

    @cached_property
    def et(self) -> Array:
        """The same in seconds of TDB past J2000, shape (t,)."""
        return np.array([ns / SECOND for ns in self.instants])

    @cached_property
    def states_N(self) -> Array:
        """Positions [m] and velocities [m/s] relative to the body in N, shape (t, n, 6)."""
        return np.concatenate([self.telemetry["r_BN_N"].values, self.telemetry["v_BN_N"].values], axis=2)

    @cached_property
    def states_E(self) -> Array:
        """The same in EME2000."""
        t, n, _ = self.states_N.shape
        turned: Array = (self.states_N.reshape(t, n, 2, 3) @ C_EN.T).reshape(t, n, 6)
        return turned

    @cached_property
    def q_BN(self) -> Array:
        """Euler parameters (w, x, y, z) of B relative to N, without jumps of sign, shape (t, n, 4)."""
        return steady(quaternion_from_mrp(self.telemetry["sigma_BN"].values))

    @cached_property
    def q_BE(self) -> Array:
        """The same relative to EME2000."""
        return steady(quaternions(dcm(self.telemetry["sigma_BN"].values) @ C_EN.T))

    @cached_property
    def arrival(self) -> int:
        """Number of the sample at the instant of the arrival."""
        return arrival_sample(self.plan.scenario)


def _ascii(text: str) -> str:
    return " ".join(text.encode("ascii", "replace").decode().split())[:60]
