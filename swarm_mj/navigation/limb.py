"""The lit limb: direction and distance by where the body ends against the sky.

Of any shape, pixels of a band about the lit limb of a predicted picture are fitted by least squares: the picture is the
predicted one, times a gain, moved with the position by its own slopes. That begins with both pictures blurred, so that the limb
may be some pixels off, and ends with them as they are; whatever shape, shading, faces and pixels do to an edge cancels.

Of ellipsoids it follows by points of the limb alone (Christian and Robinson 2016, JGCD 39, 2757, "Noniterative horizon-based
optical navigation by Cholesky factorization"): with A the matrix of the ellipsoid in C and U^T U = A, lines of sight s to the
limb touch a unit sphere after the change of scale, U s / |U s| = s', and s'^T n = 1 gives n, and the position of the camera
relative to the centre r = -U^-1 n / sqrt(n^T n - 1). Points of the limb are where rays from the centre of brightness leave the
light: an edge (a + b t + c x) inside, nothing outside, spread by a Gaussian, t and x along and across its normal. Brightness
that falls towards the limb puts an edge somewhat inside; by how much, the same edges tell on a predicted picture.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.special import erf

from swarm_mj.compilation import allocation_free
from swarm_mj.navigation.picture import (
    FEWEST_SAMPLES,
    Fix,
    Prediction,
    Predictor,
    Region,
    Rejected,
    SeenPicture,
    box_of,
    find_region,
    without_hot_pixels,
)
from swarm_mj.spacecraft.attitude.mrp import cross_matrix
from swarm_mj.typing import Array, Ints, Ints32, Mask

#: Rays that are tried, at most one for each `SPACING` pixels of the limb.
RAYS, SPACING = 96, 1.5
#: How far from the side of the Sun rays go: beyond, limb and terminator meet.
ARC = np.radians(75.0)
#: Phase angle below which the whole limb is lit.
FULL = np.radians(3.0)
#: Fewest edges with which a position is believed.
LEAST_EDGES = 12
#: Pixels of a profile on both sides of an edge.
REACH = 5
#: Half the width of the pixels that are fitted along an edge [px].
HALF_WIDTH = 1.8
#: Least cosine between an edge's normal and its ray.
LEAST_COSINE = 0.3
#: Error of an edge besides noise, 1 sigma [px]: a Gaussian in place of pixels, light that does not vary as a plane; and what
#: comes to it over the diameter on the picture [px^2], since the more it curves, the less so. Chosen so that horizons of a
#: sphere of 30 to 400 pixels err as they say.
EDGE_FLOOR, EDGE_CURVED = 0.004, 0.25
#: Of the error of a predicted picture's edges in a pixel, what is left of it in an edge along a ray, which passes several.
EDGE_SHARE = 0.6
#: An edge is left out if it lies so many deviations, estimated robustly, from the others.
OUTLIER = 4.0
#: Rounds of an edge's fit.
EDGE_ROUNDS = 6
#: Rounds of prediction for the horizon of an ellipsoid.
HORIZON_ROUNDS = 3
#: By how much pictures are blurred before they are matched [px], and how many rounds each.
BLURS = ((6.0, 4), (2.0, 4), (0.0, 16))
#: A blur has done its part when a step moves the limb by less than such a share of it.
NEAR_ENOUGH = 0.5
#: A fit has settled when its last step, squared over its covariance, is as small.
SETTLED = 0.02
#: Half the width of the band of pixels that are fitted [px].
BAND = 4
#: By how much pictures are moved to draw their slopes [px].
SHIFT_PX = 0.25
#: Errors of a model's limb are alike over so many pixels.
ALIKE_PX = 10.0
#: Share of what the bright parts of the body show from which its limb counts as lit: dimmer ones tell little.
LIT_SHARE = 0.1
#: Pixels so many deviations off are left out; least brightness over the model's: darker, it is something else that was fitted.
FAR_OFF, LEAST_GAIN = 6.0, 0.2
#: Root mean square of the residuals over the noise beyond which the picture is not believed to be one of the model.
MISFIT = 30.0
#: What is told where there are too few pixels to fit, and where these tell too little.
NO_LIMB, UNDETERMINED = "too little of the lit limb is in the picture", "the limb does not determine a position"
#: Largest error of a position over its distance, 1 sigma: beyond, the picture does not go with the position in proportion.
LARGEST = 0.02
#: Sides of the squares of which it is told how much they pull a fit by what noise does not explain [px]: errors within one are
#: taken for one, those of two for independent. Chosen by pictures of Eros and Bennu; 4 and 16 do nearly as well.
SQUARE_PX = 8
#: Mean square of residuals over that of noise, less one, beyond which the body is another one than the model: errors along the
#: whole limb no square shows; and by how much variances grow with what is beyond: so that flights by a model of 2,000 faces err
#: as they say, and the pictures of docs/results/optical.md hardly change.
UNLIKE, UNLIKE_GROWTH = 0.3, 16.0


class Edges(NamedTuple):
    """Edges along rays.

    Attributes:
        place: On the detector [px], shape (n, 2).
        normal: Of the edge, outward, shape (n, 2).
        valid: Which were found, shape (n,).
        sigma: Error of each along its normal by noise [px], shape (n,).
    """

    place: Array
    normal: Array
    valid: Mask
    sigma: Array


def find_edges(signal: Array, variance: Array, centre: Array, directions: Array, psf_px: float, level: float) -> Edges:
    """Find where a picture ends along rays.

    Args:
        signal: [electrons], shape (height, width).
        variance: Of the pixels [electrons^2], same shape.
        centre: Where rays begin [px], shape (2,).
        directions: Unit vectors, shape (n, 2).
        psf_px: Standard deviation of the point spread [px].
        level: Signal that is surely light [electrons].
    """
    height, width = signal.shape
    t = np.arange(int(np.hypot(height, width)), dtype=np.float64)
    points = centre + t[None, :, None] * directions[:, None]
    rim = REACH + 2.0
    inside = (points > rim).all(axis=2) & (points[..., 0] < width - rim) & (points[..., 1] < height - rim)
    at = points[..., 1] - 0.5, points[..., 0] - 0.5
    lit = (ndimage.map_coordinates(signal, at, order=1, mode="constant") > level) & inside
    # The outermost place with light whose way outward stays on the picture for a while.
    last = len(t) - 1 - np.argmax(lit[:, ::-1], axis=1)
    valid = lit.any(axis=1) & (last + 2 < inside.sum(axis=1)) & (last > REACH)
    place = centre + (np.where(valid, last, 0.0) + 0.5)[:, None] * directions
    place[~valid] = 0.5 * np.array([width, height])
    normal, curvature = directions.copy(), 1.0 / np.maximum(last, REACH)
    # Pixels are samples of the picture spread by the lens and by themselves.
    spread = float(np.sqrt(psf_px**2 + 1.0 / 12.0))
    grid = np.stack(np.meshgrid(np.arange(-REACH - 1, REACH + 2), np.arange(-REACH - 1, REACH + 2)), -1).reshape(-1, 2)
    start, sigma = place.copy(), np.full(len(place), np.inf)
    for k in range(EDGE_ROUNDS):
        pixel = np.clip(np.floor(place).astype(np.int64)[:, None] + grid, 0, (width - 1, height - 1))
        away = pixel + 0.5 - place[:, None]
        values = signal[pixel[..., 1], pixel[..., 0]]
        if k < 2:
            normal = _gradient_direction(values, away, normal)
        across = away[..., 0] * -normal[:, None, 1] + away[..., 1] * normal[:, None, 0]
        along = np.einsum("npk,nk->np", away, normal) + 0.5 * curvature[:, None] * across**2
        near = (np.abs(along) < REACH) & (np.abs(across) < HALF_WIDTH)
        step, weight, fits = _fit_step(along, across, values, near, spread)
        valid &= fits
        place = place + np.where(valid, np.clip(step, -1.0, 1.0), 0.0)[:, None] * normal
        sigma = np.sqrt(np.einsum("np,np->n", weight**2, variance[pixel[..., 1], pixel[..., 0]]))
    valid &= (np.linalg.norm(place - start, axis=1) < REACH) & np.isfinite(sigma) & (np.abs(step) < 0.1)
    valid &= np.einsum("nk,nk->n", normal, directions) > LEAST_COSINE
    return Edges(place, normal, valid, sigma)


def _gradient_direction(values: Array, away: Array, before: Array) -> Array:
    """Directions in which the picture falls about places, shape (n, 2); `before` where it does not."""
    weight = np.exp(-0.5 * (away**2).sum(axis=2) / 1.5**2)
    moment = np.einsum("np,npk->nk", weight * (values - np.average(values, axis=1, weights=weight)[:, None]), away)
    length = np.linalg.norm(moment, axis=1, keepdims=True)
    return np.divide(-moment, length, out=before.copy(), where=length > 0.0)


def _fit_step(t: Array, across: Array, values: Array, near: Mask, spread: float) -> tuple[Array, Array, Mask]:
    """One round of least squares for a step (a + b t + c x) Q((t - t0) / spread) each, Q falling from 1 to 0, about t0 = 0.

    Returns:
        New t0 [px], shape (n,); how it moves with the values, shape (n, m); and whether it may be believed, shape (n,).
    """
    u = t / spread
    fall = 0.5 * (1.0 - erf(u / np.sqrt(2.0))) * near
    slope = np.exp(-0.5 * u * u) / (spread * np.sqrt(2.0 * np.pi)) * near
    basis = np.stack((fall, t * fall, across * fall), axis=2)
    normal = basis.swapaxes(1, 2) @ basis + 1e-9 * np.eye(3)
    abc = np.linalg.solve(normal, basis.swapaxes(1, 2) @ (values * near)[..., None])[..., 0]
    rate = (abc[:, :1] + abc[:, 1:2] * t + abc[:, 2:] * across) * slope
    weight = np.linalg.pinv(np.concatenate((rate[..., None], basis), axis=2))[:, 0]
    step = np.einsum("nm,nm->n", weight, values * near)
    return step, weight, (abc[:, 0] > 0.0) & np.isfinite(step)


def ray_directions(seen: SeenPicture, extent_px: float) -> Array:
    """Unit vectors on the detector to the lit side, shape (n, 2); all around where the Sun stands behind the camera."""
    sun_C = seen.pose.C_CA @ seen.sun_A / np.linalg.norm(seen.sun_A)
    towards = sun_C[:2]
    phase = np.arccos(np.clip(-sun_C[2], -1.0, 1.0))
    if phase < FULL:
        middle, arc = 0.0, np.pi
    else:
        middle, arc = float(np.arctan2(towards[1], towards[0])), ARC
    count = int(np.clip(arc * extent_px / SPACING, 8, RAYS))
    angles = middle + arc * (2.0 * (np.arange(count) + 0.5) / count - 1.0)
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _light_level(signal: Array, region: Region, background: float) -> float:
    """Signal that is surely of the body: above the noise, and a fifth of what its lit part shows."""
    return float(max(6.0 * np.sqrt(background), 0.2 * np.quantile(signal[region.mask], 0.75)))


def measure_limb(seen: SeenPicture, predictor: Predictor, *, model_px: float = 0.0) -> Fix | Rejected:
    """Measure the position by matching the limb with that of a predicted picture.

    Args:
        seen: The picture.
        predictor: Predicts it.
        model_px: Error of the model's limb, 1 sigma at places `ALIKE_PX` apart [px]; 0: the model is the body.
    """
    signal = without_hot_pixels(seen)
    region = find_region(signal, seen.background, seen.psf_px)
    if region is None:
        return Rejected("limb", "no light above the noise")
    start, believed = seen.pose.r_A, seen
    if region.cut and predictor.fills(seen):
        return Rejected("limb", NO_LIMB)
    if not region.cut:
        for _ in range(2):
            expected = find_region(predictor.predict(believed).signal, seen.background, seen.psf_px)
            if expected is None:
                return Rejected("limb", "the predicted picture is dark")
            if expected.cut:
                break
            J = seen.lens.pixel_jacobian(believed.pose.to_camera(np.zeros(3)))
            aside = np.linalg.lstsq(J, region.centre - expected.centre, rcond=None)[0]
            believed = believed.at(believed.pose.r_A - seen.pose.C_CA.T @ aside)
    solved: _Fitted | Rejected = Rejected("limb", "no fit")
    for blur, rounds in BLURS:
        if blur > 0.1 * predictor.diameter_px(seen):
            continue
        blurred = ndimage.gaussian_filter(signal, blur) if blur > 0.0 else signal
        for _ in range(rounds):
            solved = _match_pixels(believed, predictor, blurred, model_px, blur)
            if isinstance(solved, Rejected):
                return solved
            believed = believed.at(believed.pose.r_A + solved.dr)
            if np.linalg.norm(believed.pose.r_A) < 0.5 * predictor.radius:
                return Rejected("limb", "led into the body")
            near = _moved_px(believed, solved.dr, predictor.radius) < NEAR_ENOUGH * blur
            if near or solved.dr @ np.linalg.solve(solved.P, solved.dr) < SETTLED:
                break
    assert not isinstance(solved, Rejected)
    if solved.dr @ np.linalg.solve(solved.P, solved.dr) > 1.0:
        return Rejected("limb", "the fit does not settle")
    solved = _match_pixels(believed, predictor, signal, model_px, 0.0, exact=True)
    if isinstance(solved, Rejected):
        return solved
    if solved.misfit > MISFIT:
        return Rejected("limb", "the limb does not look like the model's")
    turn = -seen.pose.C_CA.T @ cross_matrix(believed.pose.to_camera(np.zeros(3)))
    if np.linalg.eigvalsh(solved.P)[-1] > (LARGEST * float(np.linalg.norm(believed.pose.r_A))) ** 2:
        return Rejected("limb", UNDETERMINED)
    return Fix("limb", believed.pose.r_A - start, np.eye(3), solved.P, turn, solved.used)


class _Fitted(NamedTuple):
    """Correction of the position [m], its covariance, pixels used, and residuals over what they should be."""

    dr: Array
    P: Array
    used: int
    misfit: float


def _moved_px(seen: SeenPicture, dr: Array, radius: float) -> float:
    """By how much the limb of a body of some radius [m] moves on the detector, at most, as the camera does by `dr` [m]."""
    distance = float(np.linalg.norm(seen.pose.r_A))
    along = float(dr @ seen.pose.r_A) / distance
    aside = sqrt(max(float(dr @ dr) - along**2, 0.0))
    return seen.lens.focal_px / distance * (aside + abs(along) * radius / distance)


def _match_pixels(
    seen: SeenPicture, predictor: Predictor, signal: Array, model_px: float, blur: float, *, exact: bool = False
) -> _Fitted | Rejected:
    """Fit the pixels about the lit limb, of pictures that are blurred by so many pixels.

    Its covariance is that of noise and model, as if its slopes were those of the picture; `exact`: by drawn slopes, and
    where what is left pulls more than noise and model would, by that.
    """
    predicted = predictor.predict(seen, depths=True, fewest=2 if blur > 0.0 else FEWEST_SAMPLES)
    if blur > 0.0:
        predicted = predicted._replace(signal=_blurred(predicted.signal, blur))
    band, moves = _band(seen, predicted, BAND + int(2.0 * blur))
    if len(moves) < 3 * LEAST_EDGES:
        return Rejected("limb", NO_LIMB)
    light = predicted.signal[band]
    slopes = _splined_slopes(predicted.signal, band)
    slope = np.linalg.norm(slopes, axis=1)
    basis = np.column_stack((light, np.einsum("nk,nkl->nl", slopes, moves)))
    variance = np.maximum(light, 0.0) + seen.background + (seen.edge_px * slope) ** 2
    chosen = ~seen.saturated[band]
    residual: Array = np.zeros(len(light))
    fit, used = np.zeros(4), chosen
    for _ in range(3):
        used, B, w = chosen, basis[chosen], 1.0 / variance[chosen]
        info = (B * w[:, None]).T @ B
        scale = np.sqrt(np.diag(info))
        if not (scale > 0.0).all() or np.linalg.cond(info / np.outer(scale, scale)) > 1e10:
            return Rejected("limb", UNDETERMINED)
        fit = np.asarray(np.linalg.solve(info, (B * w[:, None]).T @ signal[band][chosen]))
        residual = np.asarray(signal[band] - basis @ fit)
        left = residual / np.sqrt(variance)
        kept = ~seen.saturated[band] & (
            np.abs(left) < FAR_OFF * max(1.4826 * float(np.median(np.abs(left[chosen]))), 1.0)
        )
        if (kept == chosen).all():
            break
        chosen = kept
    K = (B * w[:, None]).T
    true = B
    if exact:
        drawn = np.einsum("nk,nkl->nl", _drawn_slopes(seen, predictor, band), moves)
        true = np.column_stack((light, drawn))[used]
    # The fit ends where K residual = 0: what noise moves that by, the picture's own slopes say.
    settle = np.linalg.inv(K @ true)
    pull = info
    if model_px > 0.0:
        # Places of the limb err alone; the pixels of one, across the band, as one.
        error = K * (model_px * slope[used]) * np.sqrt(2.0 * ALIKE_PX)
        pull = info + error @ error.T
    misfit = float(np.sqrt(np.mean(residual[used] ** 2 / (variance + (model_px * slope) ** 2)[used])))
    if exact:
        unlike = 1.0 + UNLIKE_GROWTH * max(misfit**2 - 1.0 - UNLIKE, 0.0)
        pull = _at_least(pull, _pulled(K * residual[used], band, used), unlike)
    P4 = settle @ pull @ settle.T
    gain = float(fit[0])
    if not gain > LEAST_GAIN:
        return Rejected("limb", "the picture is not as bright as the model's")
    C = seen.pose.C_CA
    P = C.T @ P4[1:, 1:] @ C / gain**2
    return _Fitted(C.T @ fit[1:] / gain, 0.5 * (P + P.T), int(used.sum()), misfit)


def _pulled(score: Array, band: Mask, used: Mask) -> Array:
    """Sum of the outer products of what each square of pixels pulls a fit by, shape (4, 4).

    `score`: what each pixel of a band that was used pulls by, shape (4, n).
    """
    rows, columns = (each[used] // SQUARE_PX for each in np.nonzero(band))
    _, square = np.unique(rows * band.shape[1] + columns, return_inverse=True)
    each = np.stack([np.bincount(square, row) for row in score])
    return np.asarray(each @ each.T)


def _at_least(covariance: Array, found: Array, least: float) -> Array:
    """So many times a covariance, and along those directions in which the one found is larger, that one."""
    root = np.linalg.cholesky(covariance)
    half = np.linalg.solve(root, found)
    ratio, along = np.linalg.eigh(np.linalg.solve(root, half.T))
    wide = root @ along * np.sqrt(np.maximum(ratio, least))
    return np.asarray(wide @ wide.T)


def _blurred(signal: Array, blur: float) -> Array:
    """A predicted picture spread by a Gaussian [px]: only about what is not dark."""
    box = box_of(signal > 0.0, int(4.0 * blur) + 1)
    if box is not None:
        signal = signal.copy()
        signal[box] = ndimage.gaussian_filter(signal[box], blur)
    return signal


def _splined_slopes(signal: Array, band: Mask) -> Array:
    """How the pixels of a band change along columns and rows [electrons/px], shape (n, 2), by splines."""
    box = box_of(band, 4)
    assert box is not None  # pixels were found
    found = []
    for axis in (1, 0):
        spline = ndimage.spline_filter1d(signal[box], 3, axis, mode="nearest")
        found.append(0.5 * (np.roll(spline, -1, axis) - np.roll(spline, 1, axis))[band[box]])
    return np.column_stack(found)


def _drawn_slopes(seen: SeenPicture, predictor: Predictor, band: Mask) -> Array:
    """The same by pictures of a camera that is turned a little."""
    found, angle = [], SHIFT_PX / seen.lens.focal_px
    for turn in (np.array([0.0, angle, 0.0]), np.array([-angle, 0.0, 0.0])):
        # The camera turned by this, the picture moves to the left or up, so that a pixel shows what was right of it or below.
        ahead, behind = (predictor.predict(seen.turned(side * turn)).signal[band] for side in (1.0, -1.0))
        found.append((ahead - behind) / (2.0 * SHIFT_PX))
    return np.column_stack(found)


def _band(seen: SeenPicture, predicted: Prediction, width: int) -> tuple[Mask, Array]:
    """Pixels up to some width inside and outside the lit limb.

    Returns:
        Which they are, shape (height, width), and how what is there moves on the detector with its position in C [px/m], shape
        (n, 2, 3).
    """
    assert predicted.depth is not None
    solid = predicted.depth > 0.0
    band = np.zeros(solid.shape, np.bool_)
    if (box := box_of(solid, width + 2)) is None:
        return band, np.empty((0, 2, 3))
    inside = np.ascontiguousarray(solid[box])
    rim, (square, beside) = np.zeros_like(inside), np.empty((2, *inside.shape), np.int32)
    mark_rim(inside, width, square, beside, rim)
    # Lit: light within the band's width.
    near = ndimage.maximum_filter(predicted.signal[box], 2 * width + 1)
    bright = LIT_SHARE * float(np.quantile(predicted.signal[solid], 0.9))
    band[box] = rim & (near > max(bright, 3.0 * np.sqrt(seen.background)))
    rows, columns = np.nonzero(band[box])
    # Beside the body pixels move as the nearest of it.
    depth = predicted.depth[box].ravel()[beside[rows, columns]]
    image = seen.lens.to_image(np.column_stack((columns + box[1].start + 0.5, rows + box[0].start + 0.5)))
    return band, seen.lens.pixel_jacobian(np.column_stack((image, np.ones(len(image)))) * depth[:, None])


@allocation_free
def mark_rim(solid: Mask, width: int, square: Ints32, nearest: Ints32, rim: Mask) -> None:
    """Mark pixels up to some width inside and outside the edge of the solid ones; all of one shape.

    Args:
        solid: Which pixels are of the body.
        width: [px].
        square: Scratch.
        nearest: Where the nearest solid pixel of each in the rim is, counted along rows.
        rim: False before.
    """
    height, across = solid.shape
    square[:] = width * width + 1
    for y in range(height):
        for x in range(across):
            own = solid[y, x]
            # The nearest pixel of the other kind has one of the own kind above, below or beside it.
            if not (
                (y > 0 and solid[y - 1, x] != own)
                or (y + 1 < height and solid[y + 1, x] != own)
                or (x > 0 and solid[y, x - 1] != own)
                or (x + 1 < across and solid[y, x + 1] != own)
            ):
                continue
            for down in range(max(y - width, 0), min(y + width + 1, height)):
                for to in range(max(x - width, 0), min(x + width + 1, across)):
                    off = (down - y) ** 2 + (to - x) ** 2
                    if solid[down, to] != own and off < square[down, to]:
                        square[down, to] = off
                        nearest[down, to] = y * across + x if own else down * across + to
                        rim[down, to] = True


class Horizon(NamedTuple):
    """What the horizon of an ellipsoid tells: position of the camera in C relative to its centre [m], and its covariance."""

    r_C: Array
    P: Array


def horizon_position(sights_C: Array, ellipsoid_C: Array, sigma_rad: Array | float) -> Horizon:
    """Position by lines of sight to the limb of an ellipsoid; Christian and Robinson 2016.

    Args:
        sights_C: To points of the limb, of any length, shape (n, 3); in C.
        ellipsoid_C: Its matrix in C: x^T A x = 1 on the surface, shape (3, 3) [1/m^2].
        sigma_rad: Error of each line of sight across the limb, 1 sigma [rad], a number or shape (n,).

    Raises:
        ValueError: The lines of sight belong to no position outside the ellipsoid.
    """
    U = np.linalg.cholesky(ellipsoid_C).T
    s = sights_C / np.linalg.norm(sights_C, axis=1, keepdims=True)
    scaled = s @ U.T
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    Hs = scaled / length
    # Each row's residual is 1 - s'^T n; its error follows from that of s across itself.
    n = np.linalg.lstsq(Hs, np.ones(len(Hs)), rcond=None)[0]
    for _ in range(2):
        J = -(n @ (np.eye(3) - Hs[:, :, None] * Hs[:, None]) / length) @ U
        across = J - np.einsum("nk,nk->n", J, s)[:, None] * s
        sigma = np.linalg.norm(across, axis=1) * sigma_rad
        weight = 1.0 / np.maximum(sigma, 1e-300) ** 2
        P_n = np.linalg.inv((Hs * weight[:, None]).T @ Hs)
        n = P_n @ (Hs * weight[:, None]).T @ np.ones(len(Hs))
    outside = float(n @ n) - 1.0
    if not outside > 0.0:
        raise ValueError("the lines of sight belong to no position outside the ellipsoid")
    root = outside**-0.5
    U_inverse = np.linalg.inv(U)
    F = -root * U_inverse @ (np.eye(3) - np.outer(n, n) / outside)
    return Horizon(-root * U_inverse @ n, F @ P_n @ F.T)


def measure_horizon(
    seen: SeenPicture, predictor: Predictor, semi_axes: Array, *, edge_px: float | None = None
) -> Fix | Rejected:
    """Measure the position by the horizon of an ellipsoid.

    Args:
        seen: The picture.
        predictor: Predicts it.
        semi_axes: Of the ellipsoid along the axes of A [m], shape (3,).
        edge_px: Error of an edge besides noise, 1 sigma [px]; None: what is known of it.
    """
    if edge_px is None:
        floor = EDGE_FLOOR + EDGE_CURVED / predictor.diameter_px(seen)
        edge_px = float(np.hypot(floor, EDGE_SHARE * seen.edge_px))
    signal = without_hot_pixels(seen)
    region = find_region(signal, seen.background, seen.psf_px)
    if region is None:
        return Rejected("horizon", "no light above the noise")
    C_CA, believed = seen.pose.C_CA, seen
    fit: tuple[Horizon, int] | None = None
    ellipsoid_C = C_CA @ np.diag(1.0 / np.asarray(semi_axes, np.float64) ** 2) @ C_CA.T
    level = _light_level(signal, region, seen.background)
    for _ in range(HORIZON_ROUNDS):
        extent = float(max(semi_axes)) * seen.lens.focal_px / float(np.linalg.norm(believed.pose.r_A))
        directions = ray_directions(believed, extent)
        found = find_edges(signal, seen.variance, region.centre, directions, seen.psf_px, level)
        bias, known = _edge_bias(believed, predictor, directions, ellipsoid_C)
        places = found.place - bias[:, None] * found.normal
        chosen = found.valid & known
        solved = _fit_horizon(seen, places[chosen], found.sigma[chosen], ellipsoid_C, edge_px)
        if isinstance(solved, Rejected):
            return solved
        fit = solved
        moved = C_CA.T @ fit[0].r_C - believed.pose.r_A
        believed = believed.at(believed.pose.r_A + moved)
        if np.linalg.norm(moved) * seen.lens.focal_px < 0.1 * np.linalg.norm(believed.pose.r_A):
            break
    assert fit is not None  # there are rounds
    horizon, count = fit
    turn = C_CA.T @ cross_matrix(horizon.r_C)
    return Fix("horizon", believed.pose.r_A - seen.pose.r_A, np.eye(3), C_CA.T @ horizon.P @ C_CA, turn, count)


def _fit_horizon(
    seen: SeenPicture, places: Array, noise_px: Array, ellipsoid_C: Array, edge_px: float
) -> tuple[Horizon, int] | Rejected:
    """Position by points of the limb on the detector, without those that do not agree; and how many do."""
    chosen: Ints = np.arange(len(places))
    noise = np.hypot(noise_px, edge_px)
    image = seen.lens.to_image(places)
    sights = np.column_stack((image, np.ones(len(image))))
    # A pixel off the line of sight is a smaller angle.
    sigma = noise / seen.lens.focal_px / np.linalg.norm(sights, axis=1) ** 2
    for _ in range(5):
        if len(chosen) < LEAST_EDGES:
            return Rejected("horizon", f"fewer than {LEAST_EDGES} edges of the limb agree")
        try:
            horizon = horizon_position(sights[chosen], ellipsoid_C, sigma[chosen])
        except (ValueError, np.linalg.LinAlgError):
            return Rejected("horizon", "the edges belong to no position outside the ellipsoid")
        left = horizon_residuals(sights[chosen], ellipsoid_C, horizon.r_C) / sigma[chosen]
        kept = np.abs(left) < OUTLIER * max(1.4826 * float(np.median(np.abs(left))), 1.0)
        if kept.all():
            return horizon, len(chosen)
        chosen = chosen[kept]
    return Rejected("horizon", "no edges agree")


def _edge_bias(seen: SeenPicture, predictor: Predictor, directions: Array, ellipsoid_C: Array) -> tuple[Array, Mask]:
    """How far outside the horizon edges are found on a predicted picture [px], shape (n,), and of which rays that is known."""
    predicted = predictor.predict(seen).signal
    region = find_region(predicted, seen.background, seen.psf_px)
    if region is None:
        return np.zeros(len(directions)), np.zeros(len(directions), np.bool_)
    level = _light_level(predicted, region, seen.background)
    found = find_edges(predicted, seen.variance, region.centre, directions, seen.psf_px, level)
    r_C = -seen.pose.to_camera(np.zeros(3))

    def missed(places: Array) -> Array:
        image = seen.lens.to_image(places)
        return horizon_residuals(np.column_stack((image, np.ones(len(image)))), ellipsoid_C, r_C)

    at, out = missed(found.place), missed(found.place + found.normal)
    bias = np.divide(at, out - at, out=np.zeros(len(at)), where=out != at)
    return bias, found.valid & (np.abs(bias) < REACH)


def horizon_residuals(sights: Array, A: Array, r_C: Array) -> Array:
    """Angles by which lines of sight miss the horizon seen from a position, to first order [rad], shape (n,)."""
    s = sights / np.linalg.norm(sights, axis=1, keepdims=True)
    # A line r + t s touches where (r^T A s)^2 = (s^T A s)(r^T A r - 1).
    rs, ss, rr = s @ A @ r_C, np.einsum("nk,kl,nl->n", s, A, s), float(r_C @ A @ r_C) - 1.0
    f = rs**2 - ss * rr
    gradient = 2.0 * rs[:, None] * (A @ r_C) - 2.0 * rr * (s @ A)
    gradient -= np.einsum("nk,nk->n", gradient, s)[:, None] * s
    missed: Array = f / np.linalg.norm(gradient, axis=1)
    return missed
