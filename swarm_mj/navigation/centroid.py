"""Centre of brightness: how far off, where a body is a few pixels and its brightness leans towards the Sun.

Its distance from the projected centre of the body is taken from the predicted picture, whatever shape and law.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from swarm_mj.navigation.picture import (
    Fix,
    Predictor,
    Region,
    Rejected,
    SeenPicture,
    box_of,
    find_region,
    without_hot_pixels,
)
from swarm_mj.spacecraft.attitude.mrp import cross_matrix
from swarm_mj.typing import Array, Mask

#: Fewest electrons over their own deviation with which a centre means anything.
LEAST_SIGNAL_TO_NOISE = 5.0
#: By how much of the distance the position is moved for derivatives: some pixels, and little of the way to another phase angle.
STEP = 3e-3
#: Rounds of prediction.
ROUNDS = 3
#: By how much lit parts may reach beyond those of the prediction [px], and over the body's diameter: a terminator is dim, and
#: noise moves where it ends. Assumed; of 4,000 pictures of 5 to 40 px this refuses the one whose centre was wild.
BEYOND_PX, BEYOND_SHARE = 3.0, 0.1


def measure_centroid(seen: SeenPicture, predictor: Predictor, *, model_share: float = 0.0) -> Fix | Rejected:
    """Measure the direction to the body's centre by its centre of brightness.

    Args:
        seen: The picture.
        predictor: Predicts it.
        model_share: Error of the predicted offset, 1 sigma of each component over the body's apparent radius [-]: albedo that
            varies, a law that is not quite the body's.
    """
    signal = without_hot_pixels(seen)
    region = find_region(signal, seen.background, seen.psf_px)
    if region is None:
        return Rejected("centroid", "no light above the noise")
    if region.cut:
        return Rejected("centroid", "the body reaches out of the picture")
    if (seen.saturated & region.mask).any():
        return Rejected("centroid", "saturated pixels")
    rows, columns = np.nonzero(region.mask)
    away = np.column_stack((columns + 0.5, rows + 0.5)) - region.centre
    R = (away * seen.variance[rows, columns, None]).T @ away / region.flux**2
    if region.flux < LEAST_SIGNAL_TO_NOISE * np.sqrt(seen.variance[region.mask].sum()):
        return Rejected("centroid", "too faint")
    believed, moved, expected = seen, np.zeros(3), region
    for _ in range(ROUNDS):
        believed = seen.at(seen.pose.r_A + moved)
        found = _expected(believed, predictor)
        if found is None:
            return Rejected("centroid", "the predicted picture is dark, or the body is believed to reach out of it")
        expected = found
        centre_C = believed.pose.to_camera(np.zeros(3))
        J = seen.lens.pixel_jacobian(centre_C)
        missed = region.centre - expected.centre
        # Across the line of sight, where the picture tells of it.
        moved = moved - seen.pose.C_CA.T @ np.linalg.lstsq(J, missed, rcond=None)[0]
        if np.abs(missed).max() < 1e-3:
            break
    # Two parts whose neck is about as bright as the noise may be one in the picture and two in the prediction.
    if not _alike(region.mask, expected.mask, missed, BEYOND_PX + BEYOND_SHARE * predictor.diameter_px(seen)):
        return Rejected("centroid", "its lit parts are not those of the predicted picture")
    # From elsewhere the body shows other sides in other light, too, by which its brightness leans otherwise.
    H, step = np.empty((2, 3)), STEP * float(centre_C[2])
    for k in range(3):
        elsewhere = _expected(believed.at(believed.pose.r_A + step * seen.pose.C_CA[k]), predictor)
        if elsewhere is None:
            return Rejected("centroid", "the body is believed to reach out of the picture")
        H[:, k] = (elsewhere.centre - expected.centre) / step
    H_A = H @ seen.pose.C_CA
    R = R + (model_share * 0.5 * predictor.diameter_px(seen)) ** 2 * np.eye(2)
    # As if it had been measured from where it was believed to be at first.
    y = missed + H_A @ (believed.pose.r_A - seen.pose.r_A)
    return Fix("centroid", y, H_A, R, turning(J, centre_C), len(rows))


def _alike(one: Mask, other: Mask, moved: Array, beyond_px: float) -> bool:
    """Whether neither region reaches beyond the other, moved by so much [px], by more than some pixels."""
    columns, rows = np.rint(moved).astype(np.int64)
    other = np.roll(other, (rows, columns), (0, 1))
    box = box_of(one | other, int(beyond_px) + 1)
    assert box is not None  # both hold pixels
    one, other = one[box], other[box]
    away = (ndimage.distance_transform_edt(~mask) for mask in (one, other))
    return all(not (distance[mask] > beyond_px).any() for distance, mask in zip(away, (other, one), strict=True))


def _expected(seen: SeenPicture, predictor: Predictor) -> Region | None:
    """The region of the predicted picture; None: it is dark or cut."""
    predicted = predictor.predict(seen).signal
    found = find_region(predicted, seen.background, seen.psf_px)
    return None if found is None or found.cut else found


def turning(J: Array, point_C: Array) -> Array:
    """How a point's place on the detector goes with a small turn of the camera about its axes [px/rad], shape (2, 3)."""
    # Turned by theta, the camera sees p - theta x p.
    return J @ cross_matrix(point_C)
