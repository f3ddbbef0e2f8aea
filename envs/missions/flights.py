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

from ..actions import RoleLevel, choose_targets
from ..batch import EpisodeBatch
from ..kinematics import Tracking, copy_truth, update_rotations
from ..pictures import nothing_gained, take_pictures
from ..rewards import Flown, Outcome, StepResult, no_outcome
from ..step import finish_step
from .decisions import Calls, Came, Facts, Held, Job, Rows, Told, decide_flight, schedule_of
from .draws import EpisodeDraw
from .mission import CROSSING_S, DURATION_S, EARTH_BIT_S, PICTURE_INTERVAL_S, TIME_OF_FLIGHT_S, Mission
from .reach import cells_in_reach
from .table_kernels import write_tables
from .tables import EpisodeSheet, Standing, TableConstants, Tables, no_sheet, no_tables

#: Share of the target that counts as possible at least, so that no episode is about a few cells.
LEAST_POSSIBLE = 0.2


class MissionFlights(EpisodeBatch):
    """E episodes of one mission.

    Args:
        mission: What is flown.
        count: Number of episodes E.

    Attributes:
        mission: What is flown.
        sheet: What was drawn for them.
        tables: What their agents are shown.
    """

    def __init__(self, mission: Mission, count: int) -> None:
        self.mission = mission
        super().__init__(mission.task, count, continues_after_impact=True)
        n, patches = mission.task.plan.n, mission.task.patches.count
        self.sheet: EpisodeSheet = no_sheet(count, n, patches)
        self.tables: Tables = no_tables(count, n, patches)
        self._table_constants = _table_constants(mission)
        self._earth, self._hold = patches + n + 1, patches + n + 2
        self._itself = patches + 1 + np.arange(n)
        self._doubt = np.zeros((count, n), np.bool_), np.zeros(count)

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

    def step(self, actions: NDArray[Any], live: Mask | None = None) -> StepResult:
        """Fly on for one step with the choices held, see `EpisodeBatch.step`; choices are those of SwarmObserve-v1, (E, n)."""
        live = self._all if live is None else live
        # What failed since the step before began.
        now = self.time_s[:, None, None]
        failing = (self.sheet.fails_s <= now) & (self.sheet.fails_s > now - self.task.step_s)
        for e in np.flatnonzero(live & failing.any(axis=(1, 2))):
            self._fail(int(e))
        result = super().step(self._roles(np.asarray(actions, np.int64)), live)
        # As scores go by what is possible in the episode.
        scale = np.where(live, self.task.plan.region.total_area / self.sheet.possible_area, 1.0)
        seen, delivered = result.terms.seen * scale, result.terms.delivered * scale
        terms = result.terms._replace(seen=seen, delivered=delivered)
        self._show(live & self.flights.finite)
        return result._replace(terms=terms, reward=sum(terms[1:], terms[0]))

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

    def job(self, told: Told) -> BoundCall | None:
        """The flights for `decide_flights`; None where `step` must fly them, because Python has a say in every decision.

        Args:
            told: Where episodes are told of.
        """
        flights, task, level = self.flights, self.task, self.level
        if not isinstance(flights, CompiledBatch) or not isinstance(level, RoleLevel) or task.criterion.needs_sun:
            return None
        rows, outcome = self._rows(flights), no_outcome(self.observation, task.plan.n)
        calls = self._calls(flights, level, rows, outcome)
        if calls is None:
            return None
        totals = self.totals
        came = Came(totals.area, totals.delivered, totals.stored, totals.seen_bit, totals.lost_bit, totals.lost)
        self._doubt = rows.doubt, rows.area
        job = Job(
            calls=calls,
            schedule=schedule_of(task),
            rows=rows,
            held=Held(*level.held),
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

    def _rows(self, flights: CompiledBatch) -> Rows:
        count, n = self.count, self.task.plan.n
        return Rows(
            **{name: np.zeros(count, np.bool_) for name in ("mask", "fine", "finite", "shown")},
            **{name: np.zeros((count, n), np.bool_) for name in ("failed", "doubt")},
            until=np.zeros(count, np.int64),
            choice=np.zeros((count, n), np.int64),
            area=np.zeros(count),
            sigma_BR=np.zeros((count, n, 3)),
            tick=flights.tick,
            flies=flights.finite,
            effort=flights.effort,
            qpos=flights.qpos,
            qvel=flights.qvel,
            kind=flights.kind,
            whom=flights.index,
            vector=flights.vector,
            attitude_error=flights.sigma_BR,
            lost=flights.lost,
        )

    def _calls(self, flights: CompiledBatch, level: RoleLevel, rows: Rows, outcome: Outcome) -> Calls | None:
        """The kernels of a decision; None where one of them does not do."""
        scene, never = self.task.scene, np.full(self.count, NEVER, np.int64)
        decide, advance = (flights.bound(part, rows.mask, never) for part in (DECIDE, ADVANCE))
        whole = flights.bound(WHOLE, rows.mask, rows.until)
        if scene is None or decide is None or advance is None or whole is None:
            return None
        at_picture, now, totals, mask = self._at_picture, self.now, self.totals, rows.mask
        gained = nothing_gained(scene, rows.area, self.task.plan.n)._replace(doubt=rows.doubt)
        pictures = (scene, self._pictures, at_picture, totals, flights.kind, flights.blind, mask, gained)
        tracking = Tracking(flights.kind, flights.index, rows.sigma_BR, flights.blind)
        flown = Flown(flights.tick, mask, rows.finite, rows.area, flights.effort, rows.failed)
        standing = Standing(now, self.estimate, tracking, totals, self.sheet)
        finish = (self._constants, self.before, now, self.estimate, tracking, totals, flown, outcome)
        boresight_N = self.estimate.C_BN[:, :, 2]
        return Calls(
            choose=BoundCall(choose_targets, (level.choices, rows.choice, boresight_N, mask, level.held)),
            decide=decide,
            advance=advance,
            whole=whole,
            picture_rotations=BoundCall(update_rotations, (self._rotation, at_picture, mask, rows.finite)),
            pictures=BoundCall(take_pictures, pictures),
            rotations=BoundCall(update_rotations, (self._rotation, now, mask, rows.finite)),
            truth=BoundCall(copy_truth, (now, self.estimate, rows.finite)),
            finish=BoundCall(finish_step, finish),
            tables=BoundCall(write_tables, (self._table_constants, standing, rows.shown, self.tables)),
        )

    def fail(self, e: int) -> None:
        """Let fail in episode e what fails now."""
        self._fail(e)

    def judge_pictures(self, e: int) -> None:
        """Let the observer itself judge the pictures of episode e at this instant that compiled code was in doubt about."""
        doubt, area = self._doubt
        self._judge_all(doubt & (np.arange(self.count) == e)[:, None], area)

    def find_cause(self, e: int) -> None:
        """Say why episode e diverged, in `flights.causes`."""
        flights, it = self.flights, np.arange(self.count) == e
        if flights.finite[e]:
            # Deciding again names the spacecraft.
            flights.decide(it)
        elif isinstance(flights, CompiledBatch):
            flights.find_causes(it)

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        """See `EpisodeBatch`."""
        return [*super()._remembered, *self.sheet, *self.tables]

    def _roles(self, choice: NDArray[np.int64]) -> NDArray[np.int64]:
        """Choices as those of the control level `role`: Earth stands elsewhere there, and who is no more or unheard, holds."""
        patches, lost = self.task.patches.count, self.totals.lost
        earth = choice == patches
        roles = np.where(earth, self._earth, choice)
        return np.where(lost | (earth & ~self.sheet.downlink), self._hold, roles)

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
