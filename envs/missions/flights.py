"""Episodes of one mission of SwarmObserve-v1, flown together in one thread."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from swarm_mj.simulator.compiled_batch import CompiledBatch
from swarm_mj.simulator.fast.bound_calls import BoundCall
from swarm_mj.simulator.fast.flight_kernels import ADVANCE, DECIDE, WHOLE
from swarm_mj.simulator.fast.flights import NEVER
from swarm_mj.simulator.loop_state import InitialState
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.typing import Array, Mask

from ..observe.actions import RoleLevel, choose_targets
from ..observe.batch import EpisodeFlights
from ..observe.kinematics import Tracking, copy_truth, update_estimated_rotations, update_rotations
from ..observe.pictures import nothing_gained, take_pictures
from ..observe.rewards import Flown, Outcome, no_outcome
from ..observe.step import score_step
from .decision_data import Calls, Came, Facts, Held, Job, Rows, Told, schedule_of
from .decisions import decide_flight
from .draws import EpisodeDraw
from .mission import CROSSING_S, DURATION_S, EARTH_BIT_S, PICTURE_INTERVAL_S, TIME_OF_FLIGHT_S, Mission
from .reach import cells_in_reach
from .table_kernels import write_tables
from .tables import EpisodeSheet, Standing, TableConstants, Tables, no_sheet, no_tables

#: Share of the target that counts as possible at least, so that no episode is about a few cells.
LEAST_POSSIBLE = 0.2


class MissionFlights(EpisodeFlights):
    """E episodes of one mission.

    Args:
        mission: What is flown.
        count: Number of episodes E.

    Attributes:
        mission: What is flown.
        sheet: What was drawn for them.
        tables: What their agents are shown.
    """

    flights: CompiledBatch
    level: RoleLevel

    def __init__(self, mission: Mission, count: int) -> None:
        self.mission = mission
        super().__init__(mission.task, count)
        # Every mission is of this kind: its body, law and radios are this module's own choice.
        assert isinstance(self.flights, CompiledBatch) and isinstance(self.level, RoleLevel), self.why_python
        n, patches = mission.task.plan.n, mission.task.patches.count
        self.sheet: EpisodeSheet = no_sheet(count, n, patches)
        self.tables: Tables = no_tables(count, n, patches)
        self._table_constants = _table_constants(mission)
        self._rows = self._make_rows()

    def start(self, e: int, draw: EpisodeDraw) -> None:
        """Start episode e anew as it was drawn."""
        mission, plan = self.mission, self.task.plan
        error_m_s = draw.release_error * mission.altitude_m / TIME_OF_FLIGHT_S
        velocity = mission.velocity_N(draw.visiting_point, draw.altitude, draw.speed) + error_m_s
        place = np.repeat(plan.deployment.r0_N[None], plan.n, axis=0)
        wheels = np.zeros((plan.n, plan.properties.n_wheels))
        self.flights.blind[e] = self.flights.lost[e] = False
        start = InitialState(
            r_BN_N=place,
            v_BN_N=velocity,
            sigma_BN=draw.sigma_BN,
            omega_BN_B=draw.omega_BN_B,
            wheel_speed=wheels,
            seed=draw.seed,
        )
        live, sheet = self._put(e, start), self.sheet
        if self.flights.senses:
            # Sensors are read of all, before anybody is lost.
            self._update_kinematics(self.now, live)
            self._update_estimate(live)
        sheet.present[e] = np.arange(plan.n) < draw.spacecraft
        sheet.downlink[e] = True
        sheet.fails_s[e] = np.where(sheet.present[e, :, None], draw.fails * DURATION_S, np.inf)
        self._light(e, draw, place, velocity)
        self._lose(e, ~sheet.present[e])
        self._fail(e)
        self._update_kinematics(self.now, live)
        self._update_estimate(live)
        self._show(live)

    def facts(self) -> Facts:
        """What every step tells of all episodes."""
        totals = self.totals
        return Facts(
            time_s=self.time_s,
            coverage_percent=100.0 * totals.area / self.sheet.possible_area,
            delivered_bit=totals.delivered,
            stored_bit=totals.stored,
            seen_bit=totals.seen_bit,
            lost_bit=totals.lost_bit,
            alive=~totals.lost,
        )

    def job(self, told: Told) -> BoundCall:
        """The flights for `decide_flights`.

        Args:
            told: Where episodes are told of.
        """
        # Agents are shown tables, not the observations of v0.
        task, outcome = self.task, no_outcome(np.zeros((self.count, 0), np.float32), self.task.plan.n)
        totals = self.totals
        came = Came(totals.area, totals.delivered, totals.stored, totals.seen_bit, totals.lost_bit, totals.lost)
        job = Job(
            calls=self._calls(outcome),
            schedule=schedule_of(task, senses=self.flights.senses),
            rows=self._rows,
            held=Held(*self.level.held),
            before=self.before,
            now=self.now,
            at_picture=self._at_picture,
            totals=came,
            sheet=self.sheet,
            result=outcome.result,
            tables=self.tables,
            told=told,
        )
        return BoundCall(decide_flight, (job,), (types.int64, types.int64, types.int64))

    def _make_rows(self) -> Rows:
        flights, count, n = self.flights, self.count, self.task.plan.n
        return Rows(
            mask=np.zeros(count, np.bool_),
            until=np.zeros(count, np.int64),
            instant=np.zeros(count, np.int64),
            judged=np.zeros(count, np.bool_),
            choice=np.zeros((count, n), np.int64),
            fine=np.zeros(count, np.bool_),
            finite=np.zeros(count, np.bool_),
            shown=np.zeros(count, np.bool_),
            failed=np.zeros((count, n), np.bool_),
            area=np.zeros(count),
            doubt=np.zeros((count, n), np.bool_),
            sigma_BR=np.zeros((count, n, 3)),
            tick=flights.tick,
            flies=flights.finite,
            effort=flights.effort,
            qpos=flights.qpos,
            qvel=flights.qvel,
            kind=flights.kind,
            whom=flights.index,
            vector=flights.vector,
            work=flights.work,
            lost=flights.lost,
        )

    def _calls(self, outcome: Outcome) -> Calls:
        """The kernels of a decision."""
        flights, level, rows, scene = self.flights, self.level, self._rows, self.task.scene
        assert scene is not None
        never = np.full(self.count, NEVER, np.int64)
        at_picture, now, estimate, totals, mask = self._at_picture, self.now, self.estimate, self.totals, rows.mask
        gained = nothing_gained(scene, rows.area, self.task.plan.n)._replace(doubt=rows.doubt)
        pictures = (scene, self._pictures, at_picture, totals, flights.kind, flights.blind, mask, gained)
        tracking = Tracking(flights.kind, flights.index, rows.sigma_BR, flights.blind)
        flown = Flown(flights.tick, mask, rows.finite, rows.area, flights.effort, rows.failed)
        standing = Standing(now, estimate, tracking, totals, self.sheet)
        constants = self.task.step_constants(continues_after_impact=True)
        choices = (level.choices, rows.choice, estimate.C_BN[:, :, 2], mask, level.held)
        return Calls(
            choose=BoundCall(choose_targets, choices),
            decide=flights.bound(DECIDE, mask, never),
            advance=flights.bound(ADVANCE, mask, never),
            whole=flights.bound(WHOLE, mask, rows.until),
            picture_rotations=BoundCall(update_rotations, (self._rotation, at_picture, mask, rows.finite)),
            pictures=BoundCall(take_pictures, pictures),
            rotations=BoundCall(update_rotations, (self._rotation, now, mask, rows.finite)),
            truth=BoundCall(copy_truth, (now, estimate, rows.finite)),
            supply=flights.bound_supply(mask, rows.until),
            sense=flights.bound_sense(rows.finite, estimate.q, estimate.omega),
            estimate=BoundCall(update_estimated_rotations, (estimate, rows.finite)),
            score=BoundCall(score_step, (constants, self.before, now, tracking, totals, flown, outcome)),
            tables=BoundCall(write_tables, (self._table_constants, standing, rows.shown, self.tables)),
        )

    def fail(self, e: int) -> None:
        """Let fail in episode e what fails now."""
        self._fail(e)

    def judge_pictures(self, e: int) -> None:
        """Let the observer itself judge the pictures of episode e at this instant that compiled code was in doubt about."""
        rows = self._rows
        self._judge_all(rows.doubt & (np.arange(self.count) == e)[:, None], rows.area)

    def provide_noise(self, e: int) -> None:
        """Draw more of the noise that the sensors of episode e add."""
        self.flights.provide_noise(np.arange(self.count) == e)

    def find_cause(self, e: int) -> None:
        """Say why episode e diverged, in `flights.causes`."""
        flights, it = self.flights, np.arange(self.count) == e
        if flights.finite[e]:
            # Deciding again names the spacecraft.
            flights.decide(it)
        else:
            flights.find_causes(it)

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        """See `EpisodeFlights`."""
        return [*super()._remembered, *self.sheet, *self.tables]

    def _light(self, e: int, draw: EpisodeDraw, r_N: Array, v_N: Array) -> None:
        """Count dark cells as seen, and find what of the others is possible; the Sun stands where it is at the visit."""
        mission, task, sheet = self.mission, self.task, self.sheet
        up, level = np.sin(draw.sun_elevation), np.cos(draw.sun_elevation)
        east, north, out = mission.axes_A
        sun = up * out + level * (np.sin(draw.sun_azimuth) * east + np.cos(draw.sun_azimuth) * north)
        sheet.sun_A[e] = sun
        lit = mission.lit(sun)
        self.totals.seen[e] = ~lit
        areas = task.patches.cell_area
        sheet.lit_area[e] = np.bincount(task.patches.of_cell, areas * lit, task.patches.count)
        until = np.where(sheet.present[e], np.minimum(sheet.fails_s[e, :, :2].min(axis=1), DURATION_S), 0.0)
        reached = cells_in_reach(task.scene, self._rotation, r_N, v_N, until, PICTURE_INTERVAL_S, lit)
        sheet.possible_area[e] = max(float(areas[reached].sum()), LEAST_POSSIBLE * float(areas.sum()))

    def _fail(self, e: int) -> None:
        """Let fail what fails now."""
        lost, camera, downlink = (self.sheet.fails_s[e] <= self.time_s[e]).T
        self.flights.blind[e] |= camera
        self.sheet.downlink[e] &= ~downlink
        self._lose(e, lost & ~self.totals.lost[e])

    def _lose(self, e: int, who: Mask) -> None:
        if who.any():
            self.totals.lost[e] |= who
            self.flights.park(e, *np.flatnonzero(who).tolist())

    def _show(self, live: Mask) -> None:
        standing = Standing(self.now, self.estimate, self._tracking(), self.totals, self.sheet)
        write_tables(self._table_constants, standing, live, self.tables)


def _table_constants(mission: Mission) -> TableConstants:
    task, plan = mission.task, mission.task.plan
    patches, region, camera = task.patches, plan.region, task.observer.camera
    normal = np.column_stack(
        [np.bincount(patches.of_cell, region.area * region.normal_A[:, i], patches.count) for i in range(3)]
    )
    earth = plan.environment.earth
    return TableConstants(
        axes_A=mission.axes_A,
        centre_A=mission.centre_A,
        altitude_m=mission.altitude_m,
        crossing_s=CROSSING_S,
        spin_rate=float(plan.environment.spin_rate),
        step_s=float(task.step_s),
        duration_s=DURATION_S,
        half_width_m=mission.half_width_m,
        half_angle=float(np.arctan(camera.tan_half_angle)),
        pixel_angle=float(camera.pixel_angle),
        max_gsd=float(plan.scenario.observation.max_gsd_m or np.inf),
        top_speed=float(plan.properties.max_wheel_speed),
        patch_centre_A=patches.centre_A,
        patch_normal_A=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        patch_area=patches.area,
        of_cell=patches.of_cell.astype(np.int64),
        cell_area=patches.cell_area,
        nominal_bit=float(task.nominal_bit),
        earth_bit_s=EARTH_BIT_S,
        body=occluder_of(plan.shape),
        earth_r_N=np.array(earth.position, np.float64),
        earth_v_N=np.array(earth.velocity, np.float64),
    )
