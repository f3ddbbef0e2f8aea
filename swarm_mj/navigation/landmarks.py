"""Landmarks: places of the body's surface found again in a picture, by correlation with a predicted one.

A landmark is a place whose surroundings vary in both directions on the predicted picture (Shi and Tomasi 1994). Its patch is
looked for by normalised cross-correlation, then moved by fractions of a pixel until brightness, but for a gain and an offset,
fits by least squares (Lucas and Kanade 1981). Where a landmark lies on the body the prediction's mesh tells.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from skimage.feature import match_template

from swarm_mj.navigation.centroid import turning
from swarm_mj.navigation.picture import Fix, Predictor, Rejected, SeenPicture, without_hot_pixels
from swarm_mj.typing import Array, Ints, Mask

#: Half the side of a patch [px], and the least distance between two landmarks.
HALF, APART = 10, 14
#: Landmarks at most, and the fewest with which a position is believed.
MOST, LEAST = 40, 6
#: Correlation below which a landmark is not believed, and by how much it must exceed that of any other place.
LEAST_CORRELATION, DISTINCT = 0.8, 0.05
#: Largest error of a landmark along any direction, 1 sigma [px]; along an edge it would be larger.
LARGEST_PX = 1.0
#: Share of the landmarks that must agree, and how well: median of their distances from where the fit puts them [px].
SHARE, AGREE_PX = 0.6, 1.0
#: Error of a landmark besides what its own patch tells, 1 sigma [px]; so that those of Eros, Bennu and a dumb-bell err as
#: they say or less.
FLOOR = 0.0055
#: What cubic interpolation leaves of the variance of noise, on the mean over all places between pixels.
CUBIC = 0.75
#: Residuals of a patch by terrain that the model lacks are alike over so many pixels along each side: measured on rough Eros.
ALIKE_PX = 9.0
#: A landmark is left out if it lies so many deviations, estimated robustly, from where the others put it.
OUTLIER = 4.0
#: How many components of landmarks weigh as much as what their patches say of their errors, beside how they scatter.
SCATTER_DOF = 2.0
#: Rounds of prediction, after which a step must be within what the fit says of its error, squared over its covariance; where it
#: is not, as where landmarks are found and lost in turn, rounds that go half as far, at most so many in all.
ROUNDS, SETTLED, MOST_ROUNDS = 3, 1.0, 8
#: Least relief of a place over that of the best.
RELIEF = 1e-3
#: Landmarks are looked for so near [px]. Pictures that may be farther off are aligned first, by pixels so coarse that it is not
#: more than so many of them, and must then be as much alike.
NEAR_PX, COARSE_PX, ALIGNED = 12.0, 24.0, 0.6


class Found(NamedTuple):
    """Landmarks found again.

    Attributes:
        shift: How far off they are on the other one [px], shape (n, 2).
        covariance: Of the shifts [px^2], shape (n, 2, 2).
        points_C: Where they lie relative to the camera, by the prediction [m], shape (n, 3).
    """

    shift: Array
    covariance: Array
    points_C: Array


def measure_landmarks(
    seen: SeenPicture, predictor: Predictor, *, search_px: float = 12.0, floor_px: float = FLOOR
) -> Fix | Rejected:
    """Measure the position by landmarks.

    Args:
        seen: The picture.
        predictor: Predicts it.
        search_px: How far from where they are believed landmarks are looked for at first [px].
        floor_px: Error of a landmark besides noise and residuals, 1 sigma [px].
    """
    signal = without_hot_pixels(seen)
    start, believed, search = seen.pose.r_A, seen, search_px
    dr, P, count = np.zeros(3), np.eye(3), 0
    if search > NEAR_PX:
        aside = _align(seen, predictor, signal, search)
        if isinstance(aside, Rejected):
            return aside
        believed, search = seen.at(seen.pose.r_A + aside), NEAR_PX
    last: Found | None = None
    for k in range(MOST_ROUNDS):
        found = find_landmarks(believed, predictor, signal, search)
        if isinstance(found, Rejected):
            return found
        last = found
        solved = _position(believed, found, floor_px)
        if isinstance(solved, Rejected):
            return solved
        dr, P, count = solved
        off = float(dr @ np.linalg.solve(P, dr))
        believed = believed.at(believed.pose.r_A + (dr if k < ROUNDS else 0.5 * dr))
        moved_px = np.linalg.norm(dr) * seen.lens.focal_px / max(float(np.linalg.norm(believed.pose.r_A)), 1e-9)
        if k > 0 and (moved_px < 0.02 or (k >= ROUNDS - 1 and off < SETTLED)):
            break
        search = min(search, 4.0)
    else:
        return Rejected("landmarks", "the fit does not settle")
    # A turn of the camera moves all landmarks as one; what position would do the same follows from the fit.
    assert last is not None  # there are rounds
    turn = _turn_as_position(believed, last, floor_px)
    points_A = believed.pose.r_A + last.points_C @ believed.pose.C_CA
    return Fix("landmarks", believed.pose.r_A - start, np.eye(3), P, turn, count, points_A)


def _align(seen: SeenPicture, predictor: Predictor, signal: Array, search_px: float) -> Array | Rejected:
    """How far aside the camera is [m], in A, by the middle of a coarse predicted picture in a coarse one, to their pixel."""
    predicted = predictor.predict(seen, depths=True, fewest=2)
    assert predicted.depth is not None
    scale = max(1, int(search_px / COARSE_PX))
    small, model = _coarse(signal, scale), _coarse(predicted.signal, scale)
    margin = min(int(np.ceil(search_px / scale)), min(small.shape) // 3)
    patch = model[margin:-margin, margin:-margin]
    if min(patch.shape) < 8 or not patch.std() > 0.0:
        return Rejected("landmarks", "the predicted picture is dark or has nothing to align by")
    score = match_template(small, patch)
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    if not score[best] >= ALIGNED:
        return Rejected("landmarks", "the picture does not look like the predicted one anywhere near")
    shift = scale * np.array([best[1] - margin, best[0] - margin], np.float64)
    hit = predicted.depth > 0.0
    depth = float(np.median(predicted.depth[hit])) if hit.any() else float(np.linalg.norm(seen.pose.r_A))
    aside: Array = seen.pose.C_CA.T @ np.append(-shift * depth / seen.lens.focal_px, 0.0)
    return aside


def _coarse(picture: Array, scale: int) -> Array:
    """Means of blocks of pixels."""
    rows, columns = (size // scale for size in picture.shape)
    blocks = picture[: rows * scale, : columns * scale].reshape(rows, scale, columns, scale)
    return np.asarray(blocks.mean(axis=(1, 3)))


def find_landmarks(seen: SeenPicture, predictor: Predictor, signal: Array, search_px: float) -> Found | Rejected:
    """Choose landmarks on the predicted picture and look for them on the other."""
    predicted = predictor.predict(seen, depths=True)
    assert predicted.depth is not None
    places = _choose(predicted.signal, predicted.depth > 0.0)
    if len(places) < LEAST:
        return Rejected("landmarks", f"fewer than {LEAST} places with enough relief")
    splined, radius = ndimage.spline_filter(signal, 3, mode="nearest"), int(np.ceil(search_px))
    kept, shifts, covariances = [], [], []
    for column, row in places:
        patch = predicted.signal[row - HALF : row + HALF + 1, column - HALF : column + HALF + 1]
        top, left = row - HALF - radius, column - HALF - radius
        low = max(top, 0), max(left, 0)
        area = signal[low[0] : row + HALF + radius + 1, low[1] : column + HALF + radius + 1]
        if min(area.shape) < 2 * HALF + 3:
            continue
        score = match_template(area, patch)
        best = np.unravel_index(int(np.argmax(score)), score.shape)
        edge = 0 in best or best[0] == score.shape[0] - 1 or best[1] == score.shape[1] - 1
        if edge or not score[best] >= LEAST_CORRELATION or _is_ambiguous(score, best):
            continue
        rough = np.array([low[1] + best[1] + HALF - column, low[0] + best[0] + HALF - row], np.float64)
        refined = _refine(predicted.signal, signal, splined, seen.variance, seen.edge_px, column, row, rough)
        if refined is not None:
            kept.append((column, row))
            shifts.append(refined[0])
            covariances.append(refined[1])
    if len(kept) < LEAST:
        return Rejected("landmarks", f"fewer than {LEAST} landmarks found again")
    across, down = np.transpose(kept)
    image = seen.lens.to_image(np.array(kept) + 0.5)
    points = np.column_stack((image, np.ones(len(image)))) * predicted.depth[down, across][:, None]
    return Found(np.array(shifts), np.array(covariances), points)


def _gradient(picture: Array) -> tuple[Array, Array]:
    """How a picture changes along rows and columns, same shape each."""
    down, across = np.gradient(picture)
    return np.asarray(down), np.asarray(across)


def _is_ambiguous(score: Array, best: tuple[Any, ...]) -> bool:
    """Whether another peak of a correlation is nearly as high as the highest."""
    peaks = (score == ndimage.maximum_filter(score, 3)) & (score > score[best] - DISTINCT)
    peaks[max(best[0] - 2, 0) : best[0] + 3, max(best[1] - 2, 0) : best[1] + 3] = False
    return bool(peaks.any())


def _choose(predicted: Array, solid: Mask) -> Ints:
    """Pixels (column, row) with the most relief, none near another, the picture's edge or the sky; shape (n, 2)."""
    gy, gx = _gradient(predicted)
    size = 2 * HALF + 3
    xx, yy, xy = (ndimage.uniform_filter(each, size) for each in (gx * gx, gy * gy, gx * gy))
    least = 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    inner = ndimage.minimum_filter(solid.astype(np.int8), size, mode="constant").astype(np.bool_)
    least = np.where(inner, least, 0.0)
    floor = RELIEF * float(least.max(initial=0.0))
    chosen: list[tuple[int, int]] = []
    while len(chosen) < MOST:
        row, column = divmod(int(least.argmax()), least.shape[1])
        if least[row, column] <= floor:
            break
        chosen.append((column, row))
        least[max(row - APART, 0) : row + APART + 1, max(column - APART, 0) : column + APART + 1] = 0.0
    return np.array(chosen, np.int64).reshape(-1, 2)


def _refine(
    predicted: Array,
    signal: Array,
    splined: Array,
    variance: Array,
    edge_px: float,
    column: int,
    row: int,
    shift: Array,
) -> tuple[Array, Array] | None:
    """Shift by fractions of a pixel [px], and its covariance [px^2], of a patch about a pixel; None: it does not converge."""
    rows, columns = np.mgrid[row - HALF : row + HALF + 1, column - HALF : column + HALF + 1].astype(np.float64)
    patch = predicted[row - HALF : row + HALF + 1, column - HALF : column + HALF + 1]
    gy, gx = _gradient(predicted[row - HALF - 1 : row + HALF + 2, column - HALF - 1 : column + HALF + 2])
    basis = np.stack((-gx[1:-1, 1:-1].ravel(), -gy[1:-1, 1:-1].ravel(), patch.ravel(), np.ones(patch.size)), axis=1)
    normal = basis.T @ basis
    size = np.sqrt(np.diag(normal)) + 1e-300
    if np.linalg.cond(normal / np.outer(size, size)) > 1e10:
        return None
    inverse = np.linalg.inv(normal)
    at = shift.copy()
    left, gain, fit = np.zeros(patch.size), 1.0, np.zeros(4)
    for _ in range(8):
        moved = ndimage.map_coordinates(
            splined, (rows + at[1], columns + at[0]), order=3, mode="nearest", prefilter=False
        ).ravel()
        fit = np.asarray(inverse @ (basis.T @ moved))
        gain = float(fit[2])
        if not gain > 0.0:
            return None
        step = fit[:2] / gain
        left = moved - basis @ fit
        at += np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < 1e-3:
            break
    else:
        return None
    if np.abs(at - shift).max() > 2.0:
        return None
    top, left_of = int(np.rint(row - HALF + at[1])), int(np.rint(column - HALF + at[0]))
    side = 2 * HALF + 1
    if top < 0 or left_of < 0 or top + side > signal.shape[0] or left_of + side > signal.shape[1]:
        return None
    noise = variance[top : top + side, left_of : left_of + side].ravel()
    own = (inverse @ basis.T)[:2] / gain
    by_noise = (own * noise) @ own.T
    # What is left beyond the noise, and the samples that pictures are made of, is terrain, alike from pixel to pixel.
    edges = 2.0 * edge_px**2 * float((gx[1:-1, 1:-1] ** 2 + gy[1:-1, 1:-1] ** 2).mean())
    beyond = max(float(left @ left) / len(left) - CUBIC * float(noise.mean()) - edges, 0.0)
    covariance = by_noise + ALIKE_PX**2 * beyond * inverse[:2, :2] / gain**2
    return (at, covariance) if np.linalg.eigvalsh(covariance)[-1] < LARGEST_PX**2 else None


def _position(seen: SeenPicture, found: Found, floor_px: float) -> tuple[Array, Array, int] | Rejected:
    """Position by the shifts: correction [m] in A, its covariance, and how many landmarks agree."""
    slopes = -seen.lens.pixel_jacobian(found.points_C) @ seen.pose.C_CA
    chosen = np.arange(len(found.shift))
    for _ in range(5):
        if len(chosen) < LEAST:
            return Rejected("landmarks", f"{len(chosen)} landmarks agree, fewer than {LEAST}")
        weight = np.linalg.inv(found.covariance[chosen] + floor_px**2 * np.eye(2))
        A = slopes[chosen]
        info = np.einsum("nki,nkl,nlj->ij", A, weight, A)
        if np.linalg.cond(info) > 1e12:
            return Rejected("landmarks", "the landmarks do not determine a position")
        P = np.linalg.inv(info)
        dr = P @ np.einsum("nki,nkl,nl->i", A, weight, found.shift[chosen])
        left = found.shift[chosen] - A @ dr
        size = np.sqrt(np.einsum("nk,nkl,nl->n", left, weight, left) / 2.0)
        scale = max(float(np.median(size)) / 0.8326, 1.0)  # of two components, the median is sqrt(ln 2)
        kept = size < OUTLIER * scale
        if kept.all():
            if len(chosen) < SHARE * len(found.shift) or float(np.median(np.linalg.norm(left, axis=1))) > AGREE_PX:
                return Rejected("landmarks", "the landmarks contradict each other")
            # Landmarks are believed as they scatter, but for what does not show in their scatter.
            ratio = (SCATTER_DOF + 2.0 * float((size**2).sum())) / (SCATTER_DOF + 2 * len(chosen) - 3)
            if ratio > 1.0:
                return dr, ratio * 0.5 * (P + P.T), len(chosen)
            each = ratio * found.covariance[chosen] + floor_px**2 * np.eye(2)
            K = np.einsum("ij,nkj,nkl->inl", P, A, weight)
            spread = np.einsum("inl,nlm,jnm->ij", K, each, K)
            return dr, 0.5 * (spread + spread.T), len(chosen)
        chosen = chosen[kept]
    return Rejected("landmarks", "no landmarks agree")


def _turn_as_position(seen: SeenPicture, found: Found, floor_px: float) -> Array:
    """How the position that the fit gives goes with a small turn of the camera about its axes [m/rad], shape (3, 3)."""
    weight = np.linalg.inv(found.covariance + floor_px**2 * np.eye(2))
    J = seen.lens.pixel_jacobian(found.points_C)
    slopes = -J @ seen.pose.C_CA
    turns = np.array([turning(each, point) for each, point in zip(J, found.points_C, strict=True)])
    info = np.einsum("nki,nkl,nlj->ij", slopes, weight, slopes)
    return np.asarray(np.linalg.solve(info, np.einsum("nki,nkl,nlj->ij", slopes, weight, turns)))
