"""Where E episodes stand: what their cameras have seen and their radios sent, what their software knows and agents are shown.

The steps of a decision are a few kernels, each called once for all flights of all missions. Who flies the flights is another
matter: a `Fleet` in the environments, and in `swarm-mj fly` the simulation that asks a policy.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.observation.camera import Motion
from swarm_mj.observation.capture import Picture, causes, limits_of, pictures, pixels_on, sight, watching
from swarm_mj.observation.coverage import Cause
from swarm_mj.typing import Array, Ints, Mask

from ..batch_env import StepOutcome
from .kinematics import (
    AttitudeEstimate,
    Kinematics,
    Tracking,
    add_listed,
    copy_instant,
    copy_truth,
    listed,
    no_estimate,
    no_kinematics,
    update_estimated_rotations,
    update_rotations,
)
from .mission import Mission
from .pictures import take_pictures
from .radio import pass_interval
from .rewards import measures, no_result, write_ends
from .table_kernels import write_tables
from .tables import EpisodeArrays, EpisodeSheet, Tables, no_sheet, no_tables
from .totals import EpisodeTotals, no_totals, record_cells, reset_totals, with_room_for

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)
_SURFACE, _DIRECTION = int(TargetKind.SURFACE), int(TargetKind.DIRECTION)


class EpisodeFlights(Protocol):
    """E flights as their episodes need to see them; see `Fleet`."""

    tick: Ints
    held: Targets
    kind: Ints
    spacecraft: Ints
    sigma_BR: Array
    off: Mask

    def read(self, now: Kinematics, live: Mask) -> None:
        """Copy times and states of the live flights into an instant."""
        ...

    def know(self, estimate: AttitudeEstimate, live: Mask) -> Mask:
        """Put what the flight software has in the place of the truth; returns where that differs."""
        ...


class PerMissionConstants(NamedTuple):
    """What compiled code reads of the missions, lists of constants one mission after another.

    Attributes:
        rotations: See `update_rotations`.
        scenes: See `take_pictures`; None where the observer judges every picture.
        pictures: See `take_pictures`.
        intervals: See `pass_interval`.
        tables: See `write_tables`.
    """

    rotations: Any
    scenes: Any
    pictures: Any
    intervals: Any
    tables: Any


class EpisodeState:
    """The state of E episodes.

    Args:
        flights: Who flies them.
        count: Number of episodes E.
        n: Spacecraft of each.
        patches: Patches of each target, K.

    Attributes:
        missions: Those that fly, in the order in which they were added.
        mission: Which of them each episode flies, shape (E,).
        totals: What the episodes have come to.
        sheet: What was drawn for them.
        tables: What their agents are shown.
        now: The instant to which the flights have come, in truth.
        before: The one before that.
        estimate: Attitudes and rates between two steps as the flight software has them.
        result: Rewards and ends of the last step.
    """

    def __init__(self, flights: EpisodeFlights, count: int, n: int, patches: int) -> None:
        self.flights, self.count, self.n, self.patches = flights, count, n, patches
        self.missions: list[Mission] = []
        self.mission: Ints = np.zeros(count, np.int64)
        self.totals: EpisodeTotals = no_totals(count, n, 0)
        self.sheet: EpisodeSheet = no_sheet(count, n)
        self.tables: Tables = no_tables(count, n, patches)
        self.before, self.now = (no_kinematics(count, n, 0) for _ in range(2))
        self.estimate = no_estimate(count, n)
        self.result: StepOutcome = no_result(count)
        self._counted = np.zeros_like(self.result.terms)
        self._doubts, self._hit = (np.zeros((count, n), np.bool_) for _ in range(2))
        self._aims_A: Array = np.zeros((0, patches, 3))
        self._of: PerMissionConstants | None = None

    def add(self, mission: Mission) -> int:
        """Let some episodes fly a mission; returns its number."""
        constants = (mission.rotation, mission.scene, mission.pictures, mission.radio, mission.tables)
        if self._of is None:
            self._of = PerMissionConstants(*(None if part is None else listed(part) for part in constants))
            wheels = len(mission.plan.properties.wheel_axes_B)
            self.before, self.now = (no_kinematics(self.count, self.n, wheels) for _ in range(2))
        else:
            for items, part in zip(self._of, constants, strict=True):
                add_listed(items, part)
        self.missions.append(mission)
        self._aims_A = np.concatenate([self._aims_A, mission.patches.centre_A[None]])
        self.totals = with_room_for(self.totals, mission.plan.region.n_cells)
        return len(self.missions) - 1

    @property
    def constants(self) -> PerMissionConstants:
        """Of the missions."""
        assert self._of is not None, "there is no mission yet"
        return self._of

    @property
    def tracking(self) -> Tracking:
        """What the spacecraft track."""
        flights = self.flights
        return Tracking(flights.kind, flights.spacecraft, flights.sigma_BR, flights.off | self.sheet.camera_off)

    def forget(self, e: int) -> None:
        """Let episode e stand before its beginning."""
        reset_totals(self.totals, e)
        self.totals.target[e, : self.missions[self.mission[e]].plan.region.n_cells] = True

    def deal(self, e: int, yardstick_area: float) -> None:
        """Write down what episode e is measured by: the yardsticks of area [m^2] and data, and what is all of it."""
        mission, sheet = self.missions[self.mission[e]], self.sheet
        area = mission.patches.cell_area
        sheet.yardstick_area[e] = yardstick_area
        sheet.yardstick_bit[e] = mission.nominal_bit * yardstick_area / area.sum()
        can_count = area[self.totals.target[e, : len(area)]].sum()
        sheet.complete_area[e] = can_count - (1.0 - 0.01 * mission.complete) * area.sum()

    def begin_step(self, live: Mask) -> None:
        """Let rewards count from here."""
        self._counted[live] = measures(self.totals, self.sheet)[live]

    def arrive(self, live: Mask) -> Mask:
        """Bring flights to where they have flown to: data move meanwhile, who meets the body is lost; returns who is finite."""
        copy_instant(self.now, self.before, live)
        finite, of = self.update(live), self.constants
        self._hit[live] = False
        tracking, downlink = self.tracking, self.sheet.downlink
        pass_interval(
            of.intervals, self.mission, self.before, self.now, tracking, downlink, self.totals, finite, self._hit
        )
        return finite

    def choose(self, choice: NDArray[Any], live: Mask) -> None:
        """Let targets be what was chosen, shape (E, n), among patches, Earth and relays."""
        kinds = np.asarray(choice, np.int64)
        boresight_N = np.ascontiguousarray(self.estimate.C_BN[:, :, 2])
        works = ~self.totals.lost
        choose_targets(
            self._aims_A, self.mission, kinds, works, works & self.sheet.downlink, boresight_N, live, self.flights.held
        )

    def take_pictures(self, due: Mask) -> None:
        """Take the pictures of the flights in which they are due now, shape (E,)."""
        now, tracking, doubts, of = self.now, self.tracking, self._doubts, self.constants
        if of.scenes is None:
            n_observers = self.missions[0].plan.n_observers
            singly = due[:, None] & watching(n_observers, tracking.kind, ~(self.totals.lost | tracking.blind))
        else:
            doubts[due] = False
            light = self._light(due)
            take_pictures(of.scenes, of.pictures, self.mission, now, self.totals, tracking, light, due, doubts)
            singly = doubts & due[:, None]
        for e in np.flatnonzero(singly.any(axis=1)):
            self._judge(int(e), singly[e])

    def _light(self, due: Mask) -> Mask:
        """Cells that are lit where pictures are due, shape (E, C); of no flights where light does not change."""
        if not any(mission.sun_changes for mission in self.missions):
            return np.zeros((0, 0), np.bool_)
        light = np.ones(self.totals.seen.shape, np.bool_)
        for e in np.flatnonzero(due):
            mission = self.missions[self.mission[e]]
            if mission.sun_changes:
                light[e, : mission.plan.region.n_cells] = mission.lit_at(float(self.now.t[e]))
        return light

    def _judge(self, e: int, who: Mask) -> None:
        """Judge pictures of flight e by the observer itself: where the maps are in doubt, or there are none."""
        mission, now = self.missions[self.mission[e]], self.now
        environment = mission.plan.environment
        t, moving = float(now.t[e]), Motion(now.v[e], now.omega[e], environment.spin_N)
        for picture in pictures(t, who, now.r[e], now.C_BN[e], now.C_AN[e], environment.sun.at(t), moving):
            self._judge_singly(e, mission, picture)

    def _judge_singly(self, e: int, mission: Mission, picture: Picture) -> None:
        totals, region, criterion = self.totals, mission.plan.region, mission.criterion
        target = totals.target[e, : region.n_cells]
        light = (lambda: target) if mission.drawn_light else None
        cause = causes(mission.observer, picture.pose, criterion, picture.sun_A, picture.motion, light)
        new = (cause == Cause.NONE) & ~totals.seen[e, : region.n_cells] & target
        gained = float(region.area[new].sum())
        if gained > 0.0:
            limits = limits_of(criterion, mission.observer.camera, region)
            pixels = pixels_on(limits, region.area[new], *sight(region, picture.r_A, new)).sum()
            bits = float(pixels) * mission.bits_per_pixel
            most = float(mission.plan.scenario.data.storage_bit)
            record_cells(totals, e, picture.spacecraft, new, gained, bits, most)

    def update(self, live: Mask) -> Mask:
        """Bring the instant up to date; returns which of the live flights are finite."""
        finite = np.zeros(self.count, np.bool_)
        self.flights.read(self.now, live)
        update_rotations(self.constants.rotations, self.mission, self.now, live, finite)
        return finite

    def update_estimate(self, live: Mask) -> None:
        """Bring up to date what the flight software knows: bit for bit the truth where sensors are perfect."""
        copy_truth(self.now, self.estimate, live)
        imperfect = self.flights.know(self.estimate, live)
        if imperfect.any():
            update_estimated_rotations(self.estimate, imperfect)

    def score(self, live: Mask, finite: Mask) -> None:
        """Work out rewards and ends of a step of the live flights, into `result`."""
        mission, result, good = self.missions[0], self.result, (live & finite)[:, None]
        gained = (measures(self.totals, self.sheet) - self._counted) * np.array(mission.weights)
        result.terms[live] = np.where(good, gained, 0.0)[live]
        result.reward[live] = result.terms[live].sum(axis=1)
        write_ends(self.totals, self.sheet, finite, self.flights.tick >= mission.last_tick, live, result)

    def show(self, live: Mask) -> None:
        """Write the tables of the live flights."""
        arrays = EpisodeArrays(self.now, self.estimate, self.tracking, self.totals, self.sheet)
        write_tables(self.constants.tables, self.mission, arrays, live, self.tables)

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        """Arrays over the episodes that hold what they are between two steps."""
        return [*self.totals, *self.sheet, *self.tables, *self.now, *self.before, *self.estimate]

    def rows_of(self, e: int) -> list[Any]:
        """What episode e is, besides its flight, copied."""
        return [rows[e].copy() for rows in self._remembered]

    def put_rows(self, e: int, found: list[Any]) -> None:
        """Go on from what `rows_of` gave, in episodes of the same missions."""
        for rows, row in zip(self._remembered, found, strict=True):
            if rows[e].shape == np.shape(row):
                rows[e] = row
            else:  # targets of other missions may have more cells
                rows[e] = 0
                rows[e][: len(row)] = row[: rows.shape[1]]


@kernel
def choose_targets(
    aims_A: Array,
    mission: Ints,
    choice: Ints,
    works: Mask,
    downlink: Mask,
    boresight_N: Array,
    live: Mask,
    held: Targets,
) -> None:
    """Let targets be what was chosen: a patch, Earth, or a spacecraft; itself, and what cannot be, means to hold the attitude.

    Args:
        aims_A: Middles of the K patches by mission, shape (M, K, 3) [m].
        mission: Of each flight, shape (E,).
        choice: 0 to K - 1 for patches, K for Earth, K + 1 to K + n for spacecraft, shape (E, n).
        works: Who is not lost, shape (E, n).
        downlink: Who of these reaches Earth, shape (E, n).
        boresight_N: Where +z looks in N, shape (E, n, 3).
        live: Flights to do so, shape (E,).
        held: Receives the targets, shape (E, n, ...).
    """
    patches = aims_A.shape[1]
    for e in range(choice.shape[0]):
        if not live[e]:
            continue
        for j in range(choice.shape[1]):
            c, goes_on = choice[e, j], held.kind[e, j] == _DIRECTION
            held.spacecraft[e, j] = 0
            if not works[e, j] or c == patches + 1 + j or (c == patches and not downlink[e, j]):
                held.kind[e, j] = _DIRECTION
                if not goes_on:
                    for k in range(3):
                        held.vector[e, j, k] = boresight_N[e, j, k]
                continue
            for k in range(3):
                held.vector[e, j, k] = aims_A[mission[e], c, k] if c < patches else 0.0
            if c < patches:
                held.kind[e, j] = _SURFACE
            elif c == patches:
                held.kind[e, j] = _EARTH
            else:
                held.kind[e, j], held.spacecraft[e, j] = _SPACECRAFT, c - patches - 1
