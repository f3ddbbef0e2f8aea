"""Centre of brightness: how far off, where a body is a few pixels and its brightness leans towards the Sun.

Its distance from the projected centre of the body is taken from the predicted picture, whatever shape and law.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.navigation.picture import (
    Fix,
    Predictor,
    Rejected,
    SeenPicture,
    find_region,
    without_hot_pixels,
)
from swarm_mj.spacecraft.attitude.mrp import cross_matrix
from swarm_mj.typing import Array

#: Fewest electrons over their own deviation with which a centre means anything.
LEAST_SIGNAL_TO_NOISE = 5.0
#: By how much of the distance the position is moved for derivatives: some pixels, and little of the way to another phase angle.
STEP = 3e-3
#: Rounds of prediction.
ROUNDS = 3


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
    believed, moved, expected = seen, np.zeros(3), np.zeros(2)
    for _ in range(ROUNDS):
        believed = seen.at(seen.pose.r_A + moved)
        centre = _expected(believed, predictor)
        if centre is None:
            return Rejected("centroid", "the predicted picture is dark, or the body is believed to reach out of it")
        expected = centre
        centre_C = believed.pose.to_camera(np.zeros(3))
        J = seen.lens.pixel_jacobian(centre_C)
        missed = region.centre - expected
        # Across the line of sight, where the picture tells of it.
        moved = moved - seen.pose.C_CA.T @ np.linalg.lstsq(J, missed, rcond=None)[0]
        if np.abs(missed).max() < 1e-3:
            break
    # From elsewhere the body shows other sides in other light, too, by which its brightness leans otherwise.
    H, step = np.empty((2, 3)), STEP * float(centre_C[2])
    for k in range(3):
        elsewhere = _expected(believed.at(believed.pose.r_A + step * seen.pose.C_CA[k]), predictor)
        if elsewhere is None:
            return Rejected("centroid", "the body is believed to reach out of the picture")
        H[:, k] = (elsewhere - expected) / step
    H_A = H @ seen.pose.C_CA
    R = R + (model_share * 0.5 * predictor.diameter_px(seen)) ** 2 * np.eye(2)
    # As if it had been measured from where it was believed to be at first.
    y = missed + H_A @ (believed.pose.r_A - seen.pose.r_A)
    return Fix("centroid", y, H_A, R, turning(J, centre_C), len(rows))


def _expected(seen: SeenPicture, predictor: Predictor) -> Array | None:
    """Centre of brightness of the predicted picture [px]; None: it is dark or cut."""
    predicted = predictor.predict(seen).signal
    found = find_region(predicted, seen.background, seen.psf_px)
    return None if found is None or found.cut else found.centre


def turning(J: Array, point_C: Array) -> Array:
    """How a point's place on the detector goes with a small turn of the camera about its axes [px/rad], shape (2, 3)."""
    # Turned by theta, the camera sees p - theta x p.
    return J @ cross_matrix(point_C)
