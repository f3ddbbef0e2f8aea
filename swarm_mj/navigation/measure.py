"""Which way a picture is measured: the centre of brightness far away, the limb nearer, landmarks close."""

from __future__ import annotations

import numpy as np

from swarm_mj.navigation.centroid import measure_centroid
from swarm_mj.navigation.landmarks import FLOOR, measure_landmarks
from swarm_mj.navigation.limb import measure_limb
from swarm_mj.navigation.picture import Fix, Predictor, Rejected, SeenPicture, without_hot_pixels
from swarm_mj.scenarios.schema_navigation import OpticalNavigation

#: How far landmarks are looked for at least [px], and how many sigmas of the believed position.
SEARCH_PX, SEARCH_SIGMAS = 6.0, 3.0
#: Share of a picture's bright pixels that may be saturated.
SATURATED = 0.2


def measure(seen: SeenPicture, predictor: Predictor, asked: OpticalNavigation, position_sigma: float) -> Fix | Rejected:
    """Measure a picture by the first way that suits it and gives something.

    Args:
        seen: The picture.
        predictor: Predicts it.
        asked: Which ways may be used, and from which size on.
        position_sigma: Of the believed position, along its widest axis [m].

    Returns:
        What it told, or why nothing, way by way.
    """
    if seen.saturated.any():
        # Pixels that are bright alone are hot, not of the body.
        bright = without_hot_pixels(seen) > 6.0 * np.sqrt(seen.background)
        if (seen.saturated & bright).sum() > SATURATED * bright.sum():
            return Rejected(
                "none",
                "saturated pixels: shorter exposures (camera.detector.exposure_range_s), or where they are the shortest, a "
                "smaller lens (camera.aperture_m) or smaller pixels (camera.resolution_px) are needed",
            )
    refused: list[Rejected] = []
    for method in suited(asked, predictor.diameter_px(seen)):
        if method == "centroid":
            found = measure_centroid(seen, predictor, model_share=asked.centroid_model)
        elif method == "limb":
            found = measure_limb(seen, predictor, model_px=asked.limb_model_px)
        else:
            depth = max(float(np.linalg.norm(seen.pose.r_A)) - predictor.radius, 0.1 * predictor.radius)
            sigma_px = position_sigma * seen.lens.focal_px / depth
            search = max(SEARCH_PX, SEARCH_SIGMAS * sigma_px)
            floor = float(np.hypot(FLOOR, asked.landmark_model_px))
            found = measure_landmarks(seen, predictor, search_px=search, floor_px=floor)
        if isinstance(found, Fix):
            return found
        refused.append(found)
    if not refused:
        return Rejected("none", "no way to measure suits the size of the body on the picture")
    return Rejected(refused[0].kind, "; ".join(f"{each.kind}: {each.why}" for each in refused))


def suited(asked: OpticalNavigation, diameter_px: float) -> list[str]:
    """Ways to measure that suit a body of such a size on the picture [px], the best first."""
    order = ["centroid"]
    if diameter_px >= asked.limb_from_px:
        order = ["limb", "centroid"]
    if diameter_px >= asked.landmarks_from_px:
        order = ["landmarks", "limb"]
    return [method for method in order if method in asked.methods]
