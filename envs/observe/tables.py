"""What an agent is shown: tables of spacecraft, patches and pairs, and which choices make sense.

Everything is told in the target's own frame: east, north and up at its middle, turning with the body; of a whole body in A.
Lengths are in imaging altitudes, times in those of a crossing, areas in those of the whole target, so that all bodies look
alike. `table_kernels` fills them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Array32, Ints, Mask

from .kinematics import AttitudeEstimate, Kinematics, Tracking
from .totals import EpisodeTotals

#: Columns of the tables.
SPACECRAFT = (
    *("alive", "camera", "downlink", "imaging", "relaying", "talking", "holding", "link", "stored", "earth_in_sight"),
    *("east", "north", "up", "v_east", "v_north", "v_up", "boresight_east", "boresight_north", "boresight_up"),
    *("attitude_error", "rate", "wheel_speed", "in_reach", "in_reach_next"),
)
PATCHES = ("unseen", "lit", "east", "north", "up", "normal_east", "normal_north", "normal_up", "area")
PAIRS = ("worth", "worth_next", "gsd", "angle", "best", "others", "claimed", "peak", "peak_in")
GENERAL = (
    *("time_left", "seen", "delivered", "alive", "half_width", "picture", "turn", "heard"),
    *("sun_east", "sun_north", "sun_up", "earth_east", "earth_north", "earth_up"),
)
#: Decisions that are looked ahead for the peak of what a picture would be worth.
LOOKAHEAD = 10
#: No entry is larger than this.
BOUND = 5.0


class TableConstants(NamedTuple):
    """What all tables of a mission share.

    Attributes:
        axes_A: East, north and up, shape (3, 3).
        centre_A: The target's middle, shape (3,) [m].
        altitude_m: Lengths are divided by this.
        crossing_s: Times are divided by this.
        spin_rate: Of the body [rad/s].
        step_s: Length of a decision [s].
        duration_s: Of a flight [s].
        half_width_m: Of the target [m].
        half_angle: Of the camera [rad].
        pixel_angle: Of the camera [rad].
        max_gsd: That counts [m].
        top_speed: Of a wheel [rad/s].
        n_observers: Spacecraft with cameras, the first ones.
        patch_centre_A: Shape (K, 3) [m].
        patch_normal_A: Shape (K, 3).
        patch_area: Shape (K,) [m^2].
        total_area: Of all patches [m^2].
        of_cell: Patch of each cell, shape (C,).
        cell_area: Shape (C,) [m^2].
        earth_bit_s: To Earth, of all spacecraft together [bit/s].
        body: As what hides.
        earth_r_N: At the epoch, shape (3,) [m].
        earth_v_N: Shape (3,) [m/s].
        sun_r_N: At the epoch, shape (3,) [m].
        sun_v_N: Shape (3,) [m/s].
        drawn_light: Whether the Sun stands still over the target, where it was drawn.
        lowest_sun: Least cosine of the Sun's incidence on a patch that counts as lit; below -1 where light does not matter.
    """

    axes_A: Array
    centre_A: Array
    altitude_m: float
    crossing_s: float
    spin_rate: float
    step_s: float
    duration_s: float
    half_width_m: float
    half_angle: float
    pixel_angle: float
    max_gsd: float
    top_speed: float
    n_observers: int
    patch_centre_A: Array
    patch_normal_A: Array
    patch_area: Array
    total_area: float
    of_cell: Ints
    cell_area: Array
    earth_bit_s: float
    body: Occluder
    earth_r_N: Array
    earth_v_N: Array
    sun_r_N: Array
    sun_v_N: Array
    drawn_light: bool
    lowest_sun: float


class EpisodeSheet(NamedTuple):
    """What was drawn for E episodes, and what follows from it.

    Attributes:
        yardstick_area: What straight paths from the release pass, if nothing fails, shape (E,) [m^2].
        yardstick_bit: Its data straight down from the imaging altitude, shape (E,) [bit].
        complete_area: From which on all is seen, shape (E,) [m^2].
        sun_A: Direction of the Sun where it was drawn, shape (E, 3).
        present: Who flies from the start, shape (E, n).
        downlink: Whose link to Earth works, shape (E, n).
        camera_off: Whose camera has failed as it was drawn, shape (E, n).
        fails_s: When spacecraft are lost, cameras go off, links go off, shape (E, n, 3) [s].
    """

    yardstick_area: Array
    yardstick_bit: Array
    complete_area: Array
    sun_A: Array
    present: Mask
    downlink: Mask
    camera_off: Mask
    fails_s: Array


class EpisodeArrays(NamedTuple):
    """Where E episodes stand.

    Attributes:
        now: In truth.
        estimate: As the flight software has it.
        tracking: What the spacecraft track.
        totals: What the episodes have come to.
        sheet: What was drawn for them.
    """

    now: Kinematics
    estimate: AttitudeEstimate
    tracking: Tracking
    totals: EpisodeTotals
    sheet: EpisodeSheet


class Tables(NamedTuple):
    """Tables of E episodes of up to n spacecraft over K patches.

    Attributes:
        spacecraft: See `SPACECRAFT`, shape (E, n, .).
        patches: See `PATCHES`, shape (E, K, .).
        pairs: See `PAIRS`, shape (E, n, K, .).
        general: See `GENERAL`, shape (E, .).
        mask: Choices that make sense, shape (E, n, K + 1 + n).
    """

    spacecraft: Array32
    patches: Array32
    pairs: Array32
    general: Array32
    mask: NDArray[np.int8]


def no_sheet(count: int, n: int) -> EpisodeSheet:
    """Of that many episodes."""
    return EpisodeSheet(
        yardstick_area=np.ones(count),
        yardstick_bit=np.ones(count),
        complete_area=np.ones(count),
        sun_A=np.zeros((count, 3)),
        present=np.zeros((count, n), np.bool_),
        downlink=np.zeros((count, n), np.bool_),
        camera_off=np.zeros((count, n), np.bool_),
        fails_s=np.full((count, n, 3), np.inf),
    )


def no_tables(count: int, n: int, patches: int) -> Tables:
    """Of that many episodes."""
    return Tables(
        spacecraft=np.zeros((count, n, len(SPACECRAFT)), np.float32),
        patches=np.zeros((count, patches, len(PATCHES)), np.float32),
        pairs=np.zeros((count, n, patches, len(PAIRS)), np.float32),
        general=np.zeros((count, len(GENERAL)), np.float32),
        mask=np.zeros((count, n, patches + 1 + n), np.int8),
    )
