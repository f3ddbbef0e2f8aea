"""What navigation by pictures believes, over what a camera sees: limb, centre of the body with its 3 sigma ellipse, landmarks.

All is drawn by the true pose of the camera: the limb stands where the body would be seen from the believed place.
"""

from __future__ import annotations

import json

import numpy as np
import xarray as xr
from PIL import Image, ImageDraw
from scipy import ndimage

from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.projection import PictureWindow
from swarm_mj.observation.raster import CompiledFaces
from swarm_mj.rendering.canvas import Projection
from swarm_mj.rendering.frame import Belief
from swarm_mj.rendering.palette import BELIEVED
from swarm_mj.simulator.telemetry import position_covariance
from swarm_mj.typing import Array, Pixels

#: Corners of an ellipse, and how many standard deviations it holds.
CORNERS, SIGMAS = 72, 3.0
#: Half the length of the cross of a landmark [px].
CROSS_PX = 3


class BeliefHistory:
    """What was believed in a flight.

    Args:
        plan: What was flown.
        telemetry: Its telemetry, with estimates.
    """

    def __init__(self, plan: Plan, telemetry: xr.Dataset) -> None:
        self._times = telemetry["time"].values
        self._off = telemetry["r_BN_N_estimate"].values - telemetry["r_BN_N"].values
        self._covariance = position_covariance(telemetry)
        self._latest_s = plan.scenario.navigation.optical.interval_s
        self._found: list[list[tuple[float, Array]]] = [[] for _ in plan.names]
        for one in json.loads(telemetry.attrs.get("navigation", "[]")):
            if one["spacecraft"] in plan.names:
                points = np.array(one["points_A"], np.float64).reshape(-1, 3)
                self._found[plan.names.index(one["spacecraft"])].append((one["t"], points))

    def at(self, t: float, r_N: Array) -> Belief:
        """What was believed at a time [s] of spacecraft that were at some positions, shape (n, 3) [m]."""
        k = int(np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self._times) - 1))
        landmarks = []
        for found in self._found:
            before = [points for at, points in found if t - self._latest_s <= at <= t]
            landmarks.append(before[-1] if before else np.empty((0, 3)))
        return Belief(r_N + self._off[k], self._covariance[k], tuple(landmarks))


class BeliefOverlay:
    """Draws what is believed over the pictures of cameras.

    Args:
        plan: What is flown.
        side_px: Of the square pictures.
    """

    def __init__(self, plan: Plan, side_px: int) -> None:
        camera = CameraModel(half_angle_deg=plan.scenario.camera.half_angle_deg, resolution_px=side_px)
        shape = plan.shape
        self._faces = CompiledFaces(shape.vertices, shape.faces, camera)

    def draw(
        self, pixels: Pixels, view: Projection, belief: Belief, j: int, r_N: Array, C_CN: Array, C_AN: Array
    ) -> Pixels:
        """The picture with what spacecraft j believes drawn into a view.

        Args:
            pixels: The picture, shape (height, width, 3).
            view: The camera's view in it.
            belief: What is believed.
            j: Whose camera it is, from 0.
            r_N: Where it is, shape (3,) [m].
            C_CN: Rotation from N to its camera, shape (3, 3).
            C_AN: Rotation from N to A, shape (3, 3).
        """
        out, box = pixels.copy(), view.box
        pose = CameraPose(C_AN @ belief.r_N[j], C_CN @ C_AN.T)
        seen = self._faces.draw(pose, PictureWindow(np.full(2, -1.0), np.ones(2)))[::-1] > 0
        limb = seen & ~ndimage.binary_erosion(seen, border_value=1)
        out[box.top : box.top + box.height, box.left : box.left + box.width][limb] = BELIEVED
        image = Image.fromarray(out)
        pen = ImageDraw.Draw(image)
        offset = r_N - belief.r_N[j]
        corners, inside = view.place(offset + self._ellipse(belief, j))
        if inside.all():
            pen.line([tuple(corner) for corner in (*corners, corners[0])], fill=BELIEVED, width=1)
        for x, y in _inside(view, offset[None]):
            pen.line((x - CROSS_PX, y - CROSS_PX, x + CROSS_PX, y + CROSS_PX), fill=BELIEVED)
            pen.line((x - CROSS_PX, y + CROSS_PX, x + CROSS_PX, y - CROSS_PX), fill=BELIEVED)
        for x, y in _inside(view, offset + belief.landmarks_A[j] @ C_AN):
            pen.line((x - CROSS_PX, y, x + CROSS_PX, y), fill=BELIEVED)
            pen.line((x, y - CROSS_PX, x, y + CROSS_PX), fill=BELIEVED)
        return np.array(image)

    def _ellipse(self, belief: Belief, j: int) -> Array:
        """Corners of the ellipse in which the body's centre lies, across the line of sight, shape (k, 3) [m]."""
        sight = belief.r_N[j] / np.linalg.norm(belief.r_N[j])
        across = np.linalg.svd(sight[None])[2][1:]
        values, vectors = np.linalg.eigh(across @ belief.covariance[j] @ across.T)
        angle = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
        circle = np.column_stack((np.cos(angle), np.sin(angle)))
        found: Array = SIGMAS * (circle * np.sqrt(np.maximum(values, 0.0))) @ vectors.T @ across
        return found


def _inside(view: Projection, points_N: Array) -> list[tuple[float, float]]:
    """Where points lie that are in a view."""
    places, inside = view.place(points_N)
    return [(float(x), float(y)) for x, y in places[inside]]


def known_to(belief: Belief, j: int) -> str:
    """How well spacecraft j knows where it is, in words."""
    largest = SIGMAS * float(np.sqrt(np.linalg.eigvalsh(belief.covariance[j])[-1]))
    size = f"{largest:.3g} m" if largest < 999.5 else f"{largest / 1e3:.3g} km"
    return f"knows its place to {size} (yellow, {SIGMAS:g} sigma)"
