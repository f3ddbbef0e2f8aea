"""What pictures tell: against closed forms, and against what each measurement says of its own error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from scipy.stats import chi2

from swarm_mj.navigation import limb
from swarm_mj.navigation.centroid import measure_centroid
from swarm_mj.navigation.landmarks import measure_landmarks
from swarm_mj.navigation.limb import horizon_position, horizon_residuals, mark_rim, measure_horizon, measure_limb
from swarm_mj.navigation.measure import measure, suited
from swarm_mj.navigation.picture import Fix, Rejected, centre_of_brightness, find_region
from swarm_mj.observation.camera import CameraPose, look_at
from swarm_mj.observation.photometry import radiance_factors, surface_of
from swarm_mj.observation.shading import ShadedBody
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.schema_navigation import OpticalNavigation
from swarm_mj.scenarios.schema_photometry import Photometry
from tests.navigation.scenes import Studio, ball, geometry

#: Chance with which a right covariance fails.
CHANCE = 1e-4


@pytest.fixture(scope="module")
def studio():
    return Studio(*ball())


def quadrature(studio, surface, r_A, C_CA, sun_A, n=300):
    """Centre of brightness of the sphere [px] by Gauss's rule over what the camera sees of it."""
    u = r_A / np.linalg.norm(r_A)
    least = 1000.0 / np.linalg.norm(r_A)
    x, w = np.polynomial.legendre.leggauss(n)
    cosine, around = 0.5 * (1 - least) * x + 0.5 * (1 + least), 2 * np.pi * (np.arange(2 * n) + 0.5) / (2 * n)
    e1 = np.cross(u, [0.3, 0.5, 0.8])
    e1 /= np.linalg.norm(e1)
    e2, sine = np.cross(u, e1), np.sqrt(1 - cosine**2)
    ring = np.cos(around)[:, None] * e1 + np.sin(around)[:, None] * e2
    normal = (cosine[:, None, None] * u + sine[:, None, None] * ring).reshape(-1, 3)
    ray = 1000.0 * normal - r_A
    far = np.linalg.norm(ray, axis=1)
    mu, to_sun = -np.einsum("nk,nk->n", normal, ray) / far, sun_A / np.linalg.norm(sun_A)
    light = radiance_factors(surface, normal @ to_sun, mu, -(ray @ to_sun) / far)
    points = ray @ C_CA.T
    # On the picture a piece of the surface takes up its area across the ray, over the cube of the depth.
    weight = np.repeat(w, 2 * n) * light * mu * far / points[:, 2] ** 3
    return weight @ studio.lens.to_pixels(points) / weight.sum()


@pytest.mark.parametrize("law", ["lambert", "lommel_seeliger"])
def test_the_centre_of_brightness_of_a_sphere_is_that_of_quadrature(studio, law):
    surface, rng = surface_of(Photometry(law=law)), np.random.default_rng(0)
    body = ShadedBody(*ball(6), surface)
    for phase, diameter in ((10.0, 8.0), (50.0, 60.0), (90.0, 25.0), (115.0, 150.0)):
        r_A, C_CA, sun_A = geometry(rng, studio.distance(diameter), np.radians(phase), 0.01)
        drawn = body.draw_spread(studio.lens, CameraPose(r_A, C_CA), sun_A, 0.6).astype(float)
        centre, _ = centre_of_brightness(drawn, np.ones(drawn.shape, bool))
        assert np.abs(centre - quadrature(studio, surface, r_A, C_CA, sun_A)).max() < 0.01


def test_the_offset_of_a_far_lambert_sphere_is_the_closed_form(studio):
    surface = surface_of(Photometry(law="lambert"))
    for phase in (0.2, 1.0, 2.0):
        r_A = np.array([0.0, -1e9, 0.0])
        C_CA = look_at(r_A, np.zeros(3)).C_CA
        sun_A = AU * np.array([np.sin(phase), -np.cos(phase), 0.0])
        centre = quadrature(studio, surface, r_A, C_CA, sun_A)
        offset = np.linalg.norm(centre - studio.lens.centre) / (1000.0 / 1e9 * studio.lens.focal_px)
        closed = np.sin(phase) / (np.sin(phase) + (np.pi - phase) * np.cos(phase))
        assert offset == pytest.approx(3.0 * np.pi / 16.0 * (1.0 + np.cos(phase)) * closed, rel=1e-4)


def consistent(studio, measured, sizes, count, seed, *, prior=1e-3, phases=(5.0, 115.0)):
    """Sum of the squared errors of fixes over their covariances within the bounds of chi-square; gives all that was found."""
    rng, total, dof, found = np.random.default_rng(seed), 0.0, 0, []
    for _ in range(count):
        distance = studio.distance(np.exp(rng.uniform(*np.log(sizes))))
        r_A, C_CA, sun_A = geometry(rng, distance, np.radians(rng.uniform(*phases)), 0.01)
        off = prior * distance * rng.normal(size=3)
        fix = measured(studio.shot(r_A, C_CA, sun_A, rng, r_A + off))
        found.append(fix)
        if isinstance(fix, Fix):
            error = fix.y + fix.H @ off
            total, dof = total + error @ np.linalg.solve(fix.R, error), dof + len(error)
    assert chi2.ppf(CHANCE, dof) < total < chi2.isf(CHANCE, dof), total / dof
    return found


def test_centres_of_brightness_err_as_they_say(studio):
    found = consistent(studio, lambda seen: measure_centroid(seen, studio.predictor), (2.0, 40.0), 24, 1)
    assert all(isinstance(fix, Fix) for fix in found)


def test_centroids_of_parts_that_the_prediction_lacks_are_refused(studio):
    rng = np.random.default_rng(7)
    r_A, C_CA, sun_A = geometry(rng, studio.distance(20.0), 0.6)
    seen = studio.shot(r_A, C_CA, sun_A, rng, r_A)
    for by, kind in ((3, Fix), (18, Rejected)):
        twice = replace(seen, signal=np.maximum(seen.signal, np.roll(seen.signal, by, 1)))
        assert isinstance(found := measure_centroid(twice, studio.predictor), kind)
    assert found.why == "its lit parts are not those of the predicted picture"


def test_limbs_err_as_they_say_and_tell_the_distance(studio):
    found = consistent(studio, lambda seen: measure_limb(seen, studio.predictor), (25.0, 90.0), 10, 2)
    assert sum(isinstance(fix, Fix) for fix in found) >= 9
    assert all(len(fix.y) == 3 for fix in found if isinstance(fix, Fix))


def test_limbs_of_a_body_of_any_shape_err_as_they_say():
    lump = Studio(*ball(4, (1000.0, 600.0, 450.0)), law="hapke")
    consistent(lump, lambda seen: measure_limb(seen, lump.predictor), (40.0, 90.0), 8, 3)


@pytest.mark.parametrize("unknown", ["albedo", "shape"])
def test_limbs_of_what_the_model_does_not_know_are_believed_less(studio, unknown, monkeypatch):
    (vertices, faces), rng = ball(), np.random.default_rng(3)
    other = Studio(vertices, faces)
    if unknown == "albedo":
        # What is left squares of pixels show by themselves.
        monkeypatch.setattr(limb, "UNLIKE", np.inf)
        other.body = ShadedBody(vertices, faces, other.body.surface, np.exp(0.2 * rng.normal(size=len(faces))))
    else:
        # They do not show that a rough limb stands farther out all along.
        other.body = ShadedBody(
            vertices * (1.0 + 2e-3 * rng.normal(size=(len(vertices), 1))), faces, other.body.surface
        )
    total, dof = 0.0, 0
    for _ in range(10):
        distance = studio.distance(np.exp(rng.uniform(*np.log((60.0, 150.0)))))
        r_A, C_CA, sun_A = geometry(rng, distance, np.radians(rng.uniform(5.0, 100.0)), 0.01)
        off = 1e-3 * distance * rng.normal(size=3)
        fix = measure_limb(other.shot(r_A, C_CA, sun_A, rng, r_A + off), studio.predictor)
        if isinstance(fix, Fix):
            total, dof = total + (fix.y + off) @ np.linalg.solve(fix.R, fix.y + off), dof + 3
    # By noise alone they would err by ten times what they say, and more.
    assert dof >= 24 and 0.1 < total / dof < 8.0


def test_limbs_that_hardly_know_the_distance_are_refused(studio):
    rng = np.random.default_rng(0)
    r_A, C_CA, sun_A = geometry(rng, studio.distance(60.0), 0.8, 0.01)
    seen = studio.shot(r_A, C_CA, sun_A, rng, r_A)
    known = measure_limb(seen, studio.predictor, model_px=0.1)
    assert isinstance(known, Fix)
    # Three pixels of a radius of thirty: what is refused is more than 2 % of the distance.
    poor = measure_limb(seen, studio.predictor, model_px=3.0)
    assert isinstance(poor, Rejected) and "does not determine" in poor.why


def test_horizons_of_ellipsoids_err_no_more_than_they_say():
    axes = np.array([1000.0, 700.0, 600.0])
    studio = Studio(*ball(5, tuple(axes)))
    rng = np.random.default_rng(5)
    for _ in range(5):
        r_A, C_CA, sun_A = geometry(rng, studio.distance(90.0), rng.uniform(0.5, 1.8), 0.01)
        off = 1e-3 * np.linalg.norm(r_A) * rng.normal(size=3)
        fix = measure_horizon(studio.shot(r_A, C_CA, sun_A, rng, r_A + off), studio.predictor, axes)
        assert isinstance(fix, Fix), fix
        error = fix.y + off
        assert error @ np.linalg.solve(fix.R, error) < chi2.isf(CHANCE, 3)


def limb_of(axes, r_A, C_CA, count, arc):
    """Lines of sight to the horizon of an ellipsoid, by conics, in C, shape (n, 3)."""
    scaled = r_A / axes
    u = scaled / np.linalg.norm(scaled)
    e1 = np.cross(u, [0.2, -0.4, 0.9])
    e1 /= np.linalg.norm(e1)
    angle = arc * (np.arange(count) / count - 0.5)
    d = np.linalg.norm(scaled)
    ring = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * np.cross(u, e1)
    touch = u / d + np.sqrt(1 - 1 / d**2) * ring
    return (touch * axes - r_A) @ C_CA.T


def test_the_horizon_gives_the_position_exactly_and_its_published_covariance():
    axes, r_A = np.array([1000.0, 800.0, 500.0]), np.array([4e3, -7e3, 3e3])
    C_CA = look_at(r_A, np.zeros(3), roll=0.3).C_CA
    A_C = C_CA @ np.diag(1.0 / axes**2) @ C_CA.T
    sights = limb_of(axes, r_A, C_CA, 60, np.radians(160.0))
    found = horizon_position(sights, A_C, 1e-5)
    assert np.allclose(C_CA.T @ found.r_C, r_A, rtol=1e-9)
    assert np.abs(horizon_residuals(sights, A_C, C_CA @ r_A)).max() < 1e-12
    # 3,000 draws of the noise scatter as the covariance says.
    rng, unit = np.random.default_rng(0), sights / np.linalg.norm(sights, axis=1, keepdims=True)
    errors = []
    for _ in range(3000):
        noisy = unit + 1e-5 * rng.normal(size=unit.shape)
        errors.append(horizon_position(noisy, A_C, 1e-5).r_C - C_CA @ r_A)
    white = np.linalg.solve(np.linalg.cholesky(found.P), np.array(errors).T)
    assert np.allclose(white @ white.T / 3000, np.eye(3), atol=0.1)
    assert np.abs(white.mean(axis=1)).max() < 0.1


def test_landmarks_find_the_way_back_close_to_rough_ground():
    vertices, faces = ball(5)
    rng = np.random.default_rng(3)
    rough = Studio(vertices * (1.0 + 0.01 * rng.normal(size=(len(vertices), 1))), faces)
    for _ in range(2):
        r_A, C_CA, sun_A = geometry(rng, rough.distance(500.0), rng.uniform(0.6, 1.4), 0.02)
        off = 4e-3 * np.linalg.norm(r_A) * rng.normal(size=3)
        fix = measure_landmarks(rough.shot(r_A, C_CA, sun_A, rng, r_A + off), rough.predictor, search_px=20.0)
        assert fix.used >= 6 and np.linalg.norm(fix.y + off) < 0.05 * np.linalg.norm(off)
        error = fix.y + off
        assert error @ np.linalg.solve(fix.R, error) < chi2.isf(CHANCE, 3)


def test_turns_of_the_camera_move_what_is_measured_as_it_says(studio):
    rng = np.random.default_rng(4)
    r_A, C_CA, sun_A = geometry(rng, studio.distance(40.0), 0.8)
    turn = 4e-4 * np.array([1.0, -0.7, 0.4])
    turned = (np.eye(3) - np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])) @ C_CA
    shots = [studio.shot(r_A, C, sun_A, None, r_A) for C in (C_CA, turned)]
    shots = [replace(shot, pose=CameraPose(r_A, C_CA)) for shot in shots]
    for way in (measure_centroid, measure_limb):
        plain, moved = (way(shot, studio.predictor) for shot in shots)
        # Along the line of sight a limb says little.
        across = np.eye(len(plain.y)) if way is measure_centroid else C_CA[:2]
        expected = across @ plain.turn @ turn
        assert np.linalg.norm(across @ (moved.y - plain.y) - expected) < 0.1 * np.linalg.norm(expected)


@pytest.mark.parametrize("way", [measure_centroid, measure_limb, measure_landmarks])
def test_nothing_is_made_of_sky_or_of_a_body_half_outside(studio, way):
    rng = np.random.default_rng(0)
    r_A, C_CA, sun_A = geometry(rng, studio.distance(60.0), 1.0)
    beside = look_at(r_A, r_A + np.cross(r_A, [1.0, 2.0, 3.0])).C_CA
    assert isinstance(way(studio.shot(r_A, beside, sun_A, rng, r_A), studio.predictor), Rejected)
    night = studio.shot(r_A, C_CA, -AU * r_A / np.linalg.norm(r_A), rng, r_A)
    assert isinstance(way(night, studio.predictor), Rejected)
    if way is measure_centroid:
        edge = look_at(r_A, 0.1 * np.linalg.norm(r_A) * C_CA[0]).C_CA
        cut = way(studio.shot(r_A, edge, AU * r_A / np.linalg.norm(r_A), rng, r_A), studio.predictor)
        assert isinstance(cut, Rejected) and "out of" in cut.why


def test_a_dark_picture_of_hot_pixels_is_not_called_saturated(studio):
    rng = np.random.default_rng(2)
    r_A, C_CA, _ = geometry(rng, studio.distance(60.0), 1.0)
    night = studio.shot(r_A, C_CA, -AU * r_A / np.linalg.norm(r_A), rng, r_A)
    hot = rng.random(night.signal.shape) < 1e-3
    night = replace(night, signal=np.where(hot, 1e5, night.signal), saturated=hot)
    found = measure(night, studio.predictor, OpticalNavigation(), 1.0)
    assert isinstance(found, Rejected) and "no light above the noise" in found.why
    day = studio.shot(r_A, C_CA, AU * r_A / np.linalg.norm(r_A), rng, r_A)
    full = measure(replace(day, saturated=day.signal > 0.0), studio.predictor, OpticalNavigation(), 1.0)
    assert isinstance(full, Rejected) and "saturated" in full.why


def test_the_size_on_the_picture_says_which_way(studio):
    asked = OpticalNavigation()
    assert suited(asked, 5.0) == ["centroid"] and suited(asked, 50.0)[0] == "limb"
    assert suited(asked, 900.0)[0] == "landmarks"
    assert suited(OpticalNavigation(methods=["centroid"]), 900.0) == []
    rng = np.random.default_rng(1)
    r_A, C_CA, sun_A = geometry(rng, studio.distance(10.0), 1.0)
    seen = studio.shot(r_A, C_CA, sun_A, rng, r_A)
    assert measure(seen, studio.predictor, asked, 1.0).kind == "centroid"
    none = measure(seen, studio.predictor, OpticalNavigation(methods=["landmarks"]), 1.0)
    assert isinstance(none, Rejected) and "no way" in none.why


def test_parts_whose_margins_meet_are_one_body_and_what_is_far_is_not():
    rows, columns = np.mgrid[0:128, 0:128] + 0.5

    def spot(x, y, light):
        return light * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 8.0)

    neck = find_region(spot(40.0, 50.0, 900.0) + spot(54.0, 50.0, 300.0), 25.0, 0.6)
    far = find_region(spot(40.0, 50.0, 900.0) + spot(90.0, 50.0, 300.0), 25.0, 0.6)
    assert neck.centre == pytest.approx([40.0 + 14.0 / 4.0, 50.0], abs=0.05)
    assert far.centre == pytest.approx([40.0, 50.0], abs=0.05)


def test_the_rim_of_a_body_is_that_of_a_distance_transform():
    rng = np.random.default_rng(3)
    solid = np.ascontiguousarray(ndimage.gaussian_filter(rng.normal(size=(60, 80)), 5.0) > 0.02)
    rim, (square, nearest) = np.zeros_like(solid), np.empty((2, *solid.shape), np.int32)
    mark_rim(solid, 6, square, nearest, rim)
    inside, outside = ndimage.distance_transform_edt(solid), ndimage.distance_transform_edt(~solid)
    assert np.array_equal(rim, np.where(solid, inside, outside) <= 6)
    rows, columns = np.nonzero(rim & ~solid)
    found = nearest[rows, columns]
    assert solid.ravel()[found].all()
    off = np.hypot(found // solid.shape[1] - rows, found % solid.shape[1] - columns)
    assert off == pytest.approx(outside[rows, columns])
    own = np.flatnonzero(rim & solid)
    assert np.array_equal(nearest.ravel()[own], own)
