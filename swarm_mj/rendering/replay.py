"""A recorded flight at any time: what lies between two samples of telemetry is interpolated.

Positions follow the cubic through both samples' positions and velocities, attitudes the shortest turn at constant rate
(slerp), the body its rotation law. Modes and links hold from one sample to the next. Cells fill at the times at which the
run first observed them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.errors import OutputError
from swarm_mj.flight.observe import flown_cameras
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.records.passage import encounter
from swarm_mj.records.run_record import read_run
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.navigation import BeliefHistory
from swarm_mj.rendering.transfers import transfers_of
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.spacecraft.attitude.mrp import quaternion_from_mrp, quaternions
from swarm_mj.typing import Array, Mask

#: Corners of a trail, and of all trails together; a flyby bends little.
TRAIL_POINTS, ALL_TRAIL_POINTS = 60, 600


def trail_points(n: int) -> int:
    """Corners of the trail of one of n spacecraft over a whole flight."""
    return int(np.clip(ALL_TRAIL_POINTS // n, 8, TRAIL_POINTS))


class Replay:
    """A flight to be drawn.

    Args:
        plan: The plan that was flown.
        telemetry: Its telemetry.
        first_seen_s: Time at which each cell was first observed [s], NaN for never, shape (n_cells,).
        delivery: What became of the data; None: not known.

    Raises:
        OutputError: The telemetry or the cells are not those of the plan.
    """

    def __init__(
        self, plan: Plan, telemetry: xr.Dataset, first_seen_s: Array, delivery: Delivery | None = None
    ) -> None:
        if telemetry.sizes["spacecraft"] != plan.n or len(first_seen_s) != plan.region.n_cells:
            raise OutputError(
                f"{telemetry.sizes['spacecraft']} spacecraft and {len(first_seen_s)} target cells were recorded, but the "
                f"scenario now gives {plan.n} and {plan.region.n_cells}: fly it again with this version"
            )
        self.plan, self.times = plan, telemetry["time"].values
        self._record = (telemetry, first_seen_s, delivery)
        self._first_seen_s = first_seen_s
        self._position = CubicHermiteSpline(self.times, telemetry["r_BN_N"].values, telemetry["v_BN_N"].values)
        self._q_BN = quaternion_from_mrp(telemetry["sigma_BN"].values)
        self._q_CN = (
            None if plan.scenario.camera.as_the_body else quaternions(flown_cameras(plan.scenario, telemetry)[0])
        )
        self._kind = telemetry["mode"].values.astype(np.int64)
        if plan.scenario.camera.gimbal is not None:  # which looks at the body while the spacecraft holds a direction
            self._kind[self._kind == TargetKind.DIRECTION] = TargetKind.ASTEROID
        self._tracked = telemetry["tracked_spacecraft"].values.astype(np.int64)
        self._link = _flags(telemetry, "link_closed")
        self._works = _flags(telemetry, "operational")
        self._camera_on = _flags(telemetry, "camera_on")
        self._transfers = transfers_of(delivery, float(self.times[-1]))
        self._beliefs = BeliefHistory(plan, telemetry) if "r_BN_N_estimate" in telemetry else None
        self._trail_times = np.linspace(self.times[0], self.times[-1], trail_points(plan.n))
        self._trail_N = self._position(self._trail_times)

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def path_N(self) -> Array:
        """Positions over the time from the first sample to the last, shape (m, n, 3) [m]."""
        return self._trail_N

    def between(self, begin_s: float | None = None, end_s: float | None = None) -> Replay:
        """The part of the flight between two times [s]; None: its first sample, its last.

        Raises:
            OutputError: Fewer than two samples lie there.
        """
        first, last = float(self.times[0]), float(self.times[-1])
        begin, end = first if begin_s is None else begin_s, last if end_s is None else end_s
        telemetry, first_seen_s, delivery = self._record
        inside = np.flatnonzero((self.times >= begin) & (self.times <= end))
        if len(inside) < 2:
            raise OutputError(
                f"start {begin:g} s, end {end:g} s: fewer than two samples of telemetry lie between them; the flight was "
                f"recorded from {first:g} to {last:g} s, every {(last - first) / max(len(self.times) - 1, 1):g} s"
            )
        part = telemetry.isel(time=slice(int(inside[0]), int(inside[-1]) + 1))
        return Replay(self.plan, part, first_seen_s, delivery)

    def encounter(self) -> tuple[float, float] | None:
        """Begin and end of what a film shows where the body is passed in a small part of the flight [s]; None: all of it."""
        arrival_s, radius = last_arrival_s(self.plan.scenario), self.plan.shape.max_radius
        near = encounter(self.times, self._position(self.times), arrival_s, radius)
        return None if near is None else (float(self.times[near.start]), float(self.times[near.stop - 1]))

    def at(self, t: float) -> Instant:
        """The flight at time `t` [s], held at its ends."""
        t = float(np.clip(t, self.times[0], self.times[-1]))
        k = int(np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 1))
        r_BN_N = self._position(t)
        with np.errstate(invalid="ignore"):
            seen = self._first_seen_s <= t
        return Instant(
            t=t,
            r_BN_N=r_BN_N,
            C_BN=self._attitudes(self._q_BN, t, k),
            C_AN=self.plan.environment.C_AN(t),
            kind=self._kind[k],
            tracked=self._tracked[k],
            link=None if self._link is None else self._link[k],
            lost=None if self._works is None else ~self._works[k],
            blind=None if self._camera_on is None else ~self._camera_on[k],
            seen=seen,
            trail_N=np.concatenate((self._trail_N[self._trail_times < t], r_BN_N[None])),
            traffic=None if self._transfers is None else self._transfers.at(t),
            C_CN=None if self._q_CN is None else self._attitudes(self._q_CN, t, k),
            belief=None if self._beliefs is None else self._beliefs.at(t, r_BN_N),
        )

    def _attitudes(self, q: Array, t: float, k: int) -> Array:
        before = Rotation.from_quat(q[k], scalar_first=True)
        if k + 1 < len(self.times):
            share = (t - self.times[k]) / (self.times[k + 1] - self.times[k])
            turn = before.inv() * Rotation.from_quat(q[k + 1], scalar_first=True)
            before = before * Rotation.from_rotvec(share * turn.as_rotvec())
        return before.as_matrix().transpose(0, 2, 1)


def _flags(telemetry: xr.Dataset, name: str) -> Mask | None:
    """A variable of flags, shape (t, n); None where the flight has none."""
    return telemetry[name].values.astype(bool) if name in telemetry else None


def load_replay(folder: Path) -> Replay:
    """The flight recorded in a result folder of `swarm-mj fly`.

    Raises:
        OutputError: The folder is not a run's, or its files are damaged or of another version.
    """
    record = read_run(folder)
    plan = make_plan(record.scenario, check_separation=False)
    try:
        return Replay(plan, record.telemetry, record.coverage["first_seen_s"], record.delivery)
    except OutputError as error:
        raise OutputError(f"{folder}: {error}") from None
