"""What navigation is given: a picture, what is believed of the pose it was taken from, and a model to predict pictures with.

A picture tells of the camera's position r in A by how far what it shows lies from what a prediction shows. Each way of
measuring gives that as a `Fix`: y = H dr + noise of covariance R, with dr the true position less the believed one, in A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from swarm_mj.observation.camera import CameraPose
from swarm_mj.observation.detector import Exposed
from swarm_mj.observation.lens import Lens
from swarm_mj.observation.shading import GRID, MOST, ShadedBody
from swarm_mj.typing import Array, Mask

#: How many sigmas of the background a smoothed pixel must exceed to belong to the body.
DETECTED = 5.0
#: How far beyond the detected region its light is still looked for, over the spread of the lens and at least [px].
MARGIN_SIGMAS, MARGIN_PX = 5.0, 3
#: A pixel so many sigmas of the background above it, the four beside which are as dark as the sky, is hot.
HOT = 8.0
#: Samples along a pixel of predicted pictures, and of those that are taken and held against them, at least: on other places,
#: lest the errors of both are the same. Of bodies so small that more fit (`GRID` over their pixels, below some 170) both have
#: the same, and what these miss of shadows is the same in both.
FEWEST_SAMPLES, TAKEN_SAMPLES = 4, 6
#: What is left of an edge's error by samples, where pixels that the mesh parts are drawn as it parts them, and where the lens
#: bends and they are not: chosen so that errors of limbs are those that are said, in the mean of a sphere, Eros, Bennu and a
#: dumb-bell of 100 to 400 pixels.
PARTED, BENT = 0.12, 0.6


def edge_error(diameter_px: float, *, bent: bool = False) -> float:
    """Error by which the edge of a predicted picture lies off in a pixel, 1 sigma [px]; `bent`: where the lens does.

    Of k samples along a pixel those k that an edge passes are off by up to half their distance each, on the picture that is
    taken as well; the lens takes the mean of some pixels. Of that a share is left.
    """
    k = min(max(GRID / (diameter_px + 2.0), FEWEST_SAMPLES), MOST)
    return float((BENT if bent else PARTED) * np.sqrt(2.0 * k / 12.0) / k**2)


class Fix(NamedTuple):
    """What a picture tells.

    Attributes:
        kind: How it was measured: `centroid`, `limb`, `horizon` or `landmarks`.
        y: Shape (m,); [px] of a centroid, else [m].
        H: Derivatives of y by the camera's position in A, shape (m, 3).
        R: Covariance of y, shape (m, m); without errors of the camera's attitude.
        turn: Derivatives of y by a small turn of the camera about its axes [unit of y / rad], shape (m, 3).
        used: Points that were used: of the limb, or landmarks; pixels of a centroid.
        points_A: Landmarks on the body [m], shape (k, 3).
    """

    kind: str
    y: Array
    H: Array
    R: Array
    turn: Array
    used: int
    points_A: Array = np.empty((0, 3))

    def covariance(self, attitude_rad: float) -> Array:
        """R with an error of the camera's attitude about each axis, 1 sigma, shape (m, m)."""
        return self.R + attitude_rad**2 * self.turn @ self.turn.T


class Rejected(NamedTuple):
    """A picture of which nothing was believed.

    Attributes:
        kind: How it was to be measured.
        why: In a few words.
    """

    kind: str
    why: str


@dataclass(frozen=True, eq=False)
class SeenPicture:
    """A picture as navigation is given it.

    Attributes:
        signal: Electrons above bias and dark current, shape (height, width).
        variance: Of each pixel [electrons^2], same shape.
        background: Variance of a pixel without light [electrons^2].
        per_factor: Electrons of a radiance factor of 1.
        saturated: Pixels that are full, same shape.
        lens: Lens and detector.
        psf_px: Standard deviation of the point spread [px].
        edge_px: Error of edges by the samples of which pictures are made, 1 sigma of a pixel [px].
        pose: What is believed of the camera's pose, in A.
        sun_A: Direction to the Sun in A, shape (3,).
    """

    signal: Array
    variance: Array
    background: float
    per_factor: float
    saturated: Mask
    lens: Lens
    psf_px: float
    edge_px: float
    pose: CameraPose
    sun_A: Array

    @classmethod
    def of(
        cls, exposed: Exposed, lens: Lens, psf_px: float, diameter_px: float, pose: CameraPose, sun_A: Array
    ) -> Self:
        """A picture that was read out, of a body of some diameter [px], with a believed pose; the rest as of the attributes."""
        return cls(
            signal=exposed.signal,
            variance=exposed.variance,
            background=exposed.background_variance,
            per_factor=exposed.electrons_per_factor,
            saturated=exposed.saturated,
            lens=lens,
            psf_px=psf_px,
            edge_px=edge_error(diameter_px, bent=lens.is_distorted),
            pose=pose,
            sun_A=np.asarray(sun_A, np.float64),
        )

    def at(self, r_A: Array) -> SeenPicture:
        """The same picture, believed to be taken from elsewhere [m]."""
        return replace(self, pose=CameraPose(r_A, self.pose.C_CA))

    def turned(self, turn: Array) -> SeenPicture:
        """The same picture, believed to be taken by a camera turned about its axes by a small angle [rad], shape (3,)."""
        C_CA = Rotation.from_rotvec(-turn).as_matrix() @ self.pose.C_CA
        return replace(self, pose=CameraPose(self.pose.r_A, C_CA))


class Prediction(NamedTuple):
    """A predicted picture without noise, shape (height, width).

    Attributes:
        signal: [electrons].
        depth: Under each pixel, Z in C [m], 0 for the sky; None where it was not asked for.
    """

    signal: Array
    depth: Array | None = None


class Predictor:
    """Predicts pictures by a model of the body, which need not be the body itself.

    Args:
        body: The model.
        radius: Of its vertices, the largest [m].
    """

    def __init__(self, body: ShadedBody, radius: float) -> None:
        self._body, self.radius = body, radius
        self._last: tuple[tuple[object, ...], Prediction] | None = None

    def predict(self, seen: SeenPicture, *, depths: bool = False, fewest: int = FEWEST_SAMPLES) -> Prediction:
        """The picture that the believed pose would give; kept until another one is asked for, and not to be written to."""
        pose, sun = seen.pose, np.asarray(seen.sun_A, np.float64)
        key = (seen.lens, pose.r_A.tobytes(), pose.C_CA.tobytes(), sun.tobytes(), seen.psf_px, seen.per_factor, fewest)
        if self._last is None or self._last[0] != key:
            factor = self._body.draw_spread(seen.lens, pose, sun, seen.psf_px, fewest=fewest)
            self._last = key, Prediction(factor.astype(np.float64) * seen.per_factor)
        if depths and self._last[1].depth is None:
            self._last = key, self._last[1]._replace(depth=self._body.depths(seen.lens, pose))
        return self._last[1]

    def fills(self, seen: SeenPicture) -> bool:
        """Whether the body would be under the centre of every pixel, so that no sky is in the picture."""
        return bool((self._body.depths(seen.lens, seen.pose) > 0.0).all())

    def diameter_px(self, seen: SeenPicture) -> float:
        """Of the sphere about the model, as the believed pose sees it [px]."""
        return self.diameter_at(float(np.linalg.norm(seen.pose.r_A)), seen.lens)

    def diameter_at(self, distance: float, lens: Lens) -> float:
        """The same of a camera at a distance from the centre [m]."""
        return 2.0 * self.radius * lens.focal_px / max(distance, self.radius)


class Region(NamedTuple):
    """Where the body is on a picture.

    Attributes:
        mask: Pixels that may have light of it, shape (height, width).
        box: Rows and columns that hold them.
        centre: Centre of brightness [px], shape (2,).
        flux: Sum of its signal [electrons].
        cut: Whether it reaches the picture's edge.
    """

    mask: Mask
    box: tuple[slice, slice]
    centre: Array
    flux: float
    cut: bool


def margin_px(psf_px: float) -> int:
    """How far the light of a body reaches beyond it [px]."""
    return max(MARGIN_PX, int(np.ceil(MARGIN_SIGMAS * psf_px)))


def box_of(mask: Mask, margin: int) -> tuple[slice, slice] | None:
    """Rows and columns of the marked pixels and of those around; None: there are none."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    (height, width), m = mask.shape, margin
    return (
        slice(max(int(rows[0]) - m, 0), min(int(rows[-1]) + m + 1, height)),
        slice(max(int(columns[0]) - m, 0), min(int(columns[-1]) + m + 1, width)),
    )


def without_hot_pixels(seen: SeenPicture) -> Array:
    """The signal without pixels that are bright alone against the sky, shape (height, width)."""
    sigma, signal = np.sqrt(max(seen.background, 1e-12)), seen.signal
    rows, columns = np.nonzero(signal > HOT * sigma)
    if not len(rows):
        return signal
    dark = np.pad(signal < 3.0 * sigma, 1, constant_values=True)
    alone = np.ones(len(rows), np.bool_)
    for down, across in ((0, 1), (2, 1), (1, 0), (1, 2)):
        alone &= dark[rows + down, columns + across]
    if not alone.any():
        return signal
    cleaned = signal.copy()
    cleaned[rows[alone], columns[alone]] = 0.0
    return cleaned


def find_region(signal: Array, background: float, psf_px: float) -> Region | None:
    """The brightest connected region of a picture; None: there is none above the noise."""
    sigma = np.sqrt(max(background, 1e-12))
    grown = margin_px(psf_px)
    # What no pixel near it exceeds by two sigmas the mean of nine does not by five thirds.
    around = box_of(signal > DETECTED / 3.0 * sigma, 2 + grown)
    if around is None:
        return None
    # The mean of 3 x 3 pixels has a third of their noise. Parts whose margins meet are one: a neck may be too dim to be seen.
    smooth = ndimage.uniform_filter(signal[around], 3, mode="nearest")
    number, count = ndimage.label(ndimage.binary_dilation(smooth > DETECTED / 3.0 * sigma, iterations=grown))
    if count == 0:
        return None
    flux = ndimage.sum_labels(signal[around], number, np.arange(1, count + 1))
    mask = np.zeros(signal.shape, np.bool_)
    mask[around] = number == int(np.argmax(flux)) + 1
    box = box_of(mask, 0)
    assert box is not None  # it was found
    centre, total = centre_of_brightness(signal[box], mask[box], (box[1].start, box[0].start))
    if total <= 0.0:
        return None
    cut = bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
    return Region(mask, box, centre, total, cut)


def centre_of_brightness(signal: Array, mask: Mask, origin: tuple[int, int] = (0, 0)) -> tuple[Array, float]:
    """Centre [px], shape (2,), and sum of the signal of some pixels; `origin` is the column and row of the first."""
    light = np.where(mask, signal, 0.0)
    total = float(light.sum())
    across, down = light.sum(axis=0), light.sum(axis=1)
    x = float(across @ (np.arange(light.shape[1]) + origin[0] + 0.5))
    y = float(down @ (np.arange(light.shape[0]) + origin[1] + 0.5))
    return (np.array([x, y]) / total if total != 0.0 else np.full(2, np.nan)), total
