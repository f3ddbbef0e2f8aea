"""What there is to draw at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.rendering.palette import FAINT, MODES, Rgb
from swarm_mj.typing import Array, Ints, Mask


class Belief(NamedTuple):
    """What is believed of the positions of n spacecraft.

    Attributes:
        r_N: Positions, shape (n, 3) [m].
        covariance: In N, shape (n, 3, 3) [m^2].
        landmarks_A: Those of the latest picture of each, shape (k, 3) each [m].
    """

    r_N: Array
    covariance: Array
    landmarks_A: tuple[Array, ...]


class Traffic(NamedTuple):
    """Data under way at one time.

    Attributes:
        links: Sender and receiver of each transfer, numbers from 0; -1 for Earth.
        beat: How far packets are from one place to the next, 0 to 1.
        on_earth_bit: Received by Earth so far; NaN: not known, as in a flight that is still under way.
        on_way_bit: Sent to Earth and not yet received; likewise.
    """

    links: tuple[tuple[int, int], ...]
    beat: float
    on_earth_bit: float
    on_way_bit: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Instant:
    """State of a flight at one time.

    Attributes:
        t: Time past the epoch [s].
        r_BN_N: Positions, shape (n, 3) [m].
        C_BN: Rotations from N to B, shape (n, 3, 3).
        C_AN: Rotation from N to A, shape (3, 3).
        kind: `TargetKind` of what each line of sight tracks, shape (n,).
        tracked: Spacecraft tracked, from 0, where kind is SPACECRAFT, shape (n,).
        link: Whether each radio link is closed, shape (n,); None: not known.
        seen: Cells of the target observed so far, shape (n_cells,).
        trail_N: Positions so far, evenly spaced in time, the last at `t`, shape (m, n, 3) [m].
        lost: Spacecraft that no longer work, shape (n,); None: all work.
        blind: Spacecraft whose cameras are off, shape (n,); None: none.
        traffic: Data under way; None: not known, or none in the whole flight.
        note: Stands in a line of its own.
        C_CN: Rotations from N to the frames of the cameras, shape (n, 3, 3); None: they are those of the spacecraft.
        belief: Where the spacecraft believe to be; None: they know.
    """

    t: float
    r_BN_N: Array
    C_BN: Array
    C_AN: Array
    kind: Ints
    tracked: Ints
    link: Mask | None
    seen: Mask
    trail_N: Array
    lost: Mask | None = None
    blind: Mask | None = None
    traffic: Traffic | None = None
    note: str = ""
    C_CN: Array | None = None
    belief: Belief | None = None

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return len(self.r_BN_N)

    @property
    def boresight_N(self) -> Array:
        """Where lines of sight go in N, shape (n, 3): the camera's to the body, that of +z to all else."""
        return np.where(looks_at_body(self.kind)[:, None], self.cameras[:, 2], self.C_BN[:, 2])

    @property
    def cameras(self) -> Array:
        """Rotations from N to the frames of the cameras, shape (n, 3, 3)."""
        return self.C_BN if self.C_CN is None else self.C_CN

    @property
    def works(self) -> Mask:
        """Whether each spacecraft works, shape (n,)."""
        return np.ones(self.n, np.bool_) if self.lost is None else ~self.lost

    @property
    def looks_at_body(self) -> Mask:
        """Whether each spacecraft points a camera that is on at the body, shape (n,)."""
        looks: Mask = looks_at_body(self.kind) & self.works
        return looks if self.blind is None else looks & ~self.blind

    @property
    def colours(self) -> list[Rgb]:
        """Colour of each spacecraft's name and line of sight."""
        return [
            MODES[TargetKind(int(kind))] if works else FAINT for kind, works in zip(self.kind, self.works, strict=True)
        ]

    @property
    def sight_length(self) -> Array:
        """How far each line of sight is drawn [m]: to the body's centre, to the spacecraft tracked; 0: without end."""
        length = np.where(looks_at_body(self.kind), np.linalg.norm(self.r_BN_N, axis=1), 0.0)
        to_other = self.kind == TargetKind.SPACECRAFT
        other = self.tracked[to_other]
        length[to_other] = np.linalg.norm(self.r_BN_N[to_other] - self.r_BN_N[other], axis=1)
        return length
