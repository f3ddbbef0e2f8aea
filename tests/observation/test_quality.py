"""Quality classes: areas against closed forms and exact polygons, what each condition asks, one look more, dilution, noise."""

import re
from functools import cache, reduce
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import constants
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2

from swarm_mj.mission.target import whole_body
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.capture import ground_sampling_distance, limits_of, observe, sight
from swarm_mj.observation.observer import make_observer
from swarm_mj.observation.quality import PictureLooks, figures_of, gather, looks_in_picture, mapped, usable
from swarm_mj.observation.radiometry import electrons, signal_to_noise, solar_irradiance
from swarm_mj.scenarios.loading import scenario_from
from swarm_mj.scenarios.schema_imaging import Camera, Observation
from swarm_mj.scenarios.schema_quality import PACKAGED, Demand, QualityClass
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from tests.sample_missions.flights import dumbbell

from .oracle import Oracle, Patch, View
from .scenes import plain

#: Area of a class against the exact one, share of it.
CLOSE = 2e-3
CAMERA = CameraModel(half_angle_deg=40.0, resolution_px=256)


def own(*demands, **keys):
    return QualityClass(name="own", demands=demands, **keys)


def unit(*v):
    return np.array(v, dtype=float) / np.linalg.norm(v)


@cache
def sphere():
    points, faces = geodesic_icosahedron(80)
    return whole_body(ShapeModel(1e3 * points, faces, "sphere"))


def looks_of(region, places, suns, cells=None):
    """Looks of a camera of CAMERA's pixels that faces away from nothing, at each place [m] under each Sun."""
    limits, found = limits_of(plain(), CAMERA, region), []
    for taker, (r_A, sun_A) in enumerate(zip(places, suns, strict=True)):
        up = np.flatnonzero(sight(region, r_A)[1] > 0.0) if cells is None else cells[taker]
        found.append(
            looks_in_picture(region, taker, r_A, sun_A, up, ground_sampling_distance(limits, *sight(region, r_A, up)))
        )
    return gather(found, region.normal_A)


def cap(angle):
    return 2.0 * np.pi * 1e6 * (1.0 - np.cos(angle))


def mapped_area(region, quality_class, looks):
    return region.area[mapped(quality_class, looks)].sum() * 4e6 * np.pi / region.total_area


def lens(a, b, apart):
    """Area that two caps of a sphere of 1 km of the radii a and b have in common, their centres `apart`, by Gauss-Bonnet."""
    cos = np.cos
    at_a = np.arccos((cos(b) - cos(a) * cos(apart)) / (np.sin(a) * np.sin(apart)))
    at_b = np.arccos((cos(a) - cos(b) * cos(apart)) / (np.sin(b) * np.sin(apart)))
    corner = np.arccos((cos(apart) - cos(a) * cos(b)) / (np.sin(a) * np.sin(b)))
    return 2e6 * (np.pi - corner - at_a * cos(a) - at_b * cos(b))


def test_the_lens_of_two_caps_is_a_known_one():
    assert lens(np.pi / 2, np.pi / 2, np.pi / 3) == pytest.approx(4e6 * np.pi / 3)  # a lune
    assert lens(0.7, 0.7, 1e-6) == pytest.approx(cap(0.7), rel=1e-5)


def test_an_emission_limit_on_a_sphere_maps_the_cap_of_the_law_of_sines():
    looks = looks_of(sphere(), [[0.0, 2.5e3, 0.0]], [[0.0, 1.0, 0.0]])
    for least, most in ((0.0, 50.0), (20.0, 50.0)):
        inner, outer = (e - np.arcsin(np.sin(e) / 2.5) for e in np.radians((least, most)))
        found = mapped_area(sphere(), own(Demand(emission_deg=(least, most))), looks)
        assert found == pytest.approx(cap(outer) - cap(inner), rel=CLOSE)


def test_a_ground_sampling_distance_on_a_sphere_maps_the_cap_that_keeps_it():
    limit = 14.0

    def gsd(angle):
        distance = np.sqrt(1e6 + 6.25e6 - 5e6 * np.cos(angle))
        return CAMERA.pixel_angle * distance**2 / (2.5e3 * np.cos(angle) - 1e3)

    looks = looks_of(sphere(), [[0.0, 2.5e3, 0.0]], [[0.0, 1.0, 0.0]])
    expected = cap(brentq(lambda t: gsd(t) - limit, 0.0, 1.0))
    for quality_class in (
        own(Demand(max_gsd_m=limit)),
        own(Demand(), max_gsd_m=limit),
        own(Demand(max_gsd_m=99.0), max_gsd_m=limit),
    ):
        assert mapped_area(sphere(), quality_class, looks) == pytest.approx(expected, rel=CLOSE)


def test_incidence_and_emission_on_a_sphere_map_a_lens():
    camera, sun = unit(0.0, 1.0, 0.0), unit(np.sin(0.9), np.cos(0.9), 0.0)
    looks = looks_of(sphere(), [1e9 * camera], [sun])
    quality_class = own(Demand(emission_deg=(0.0, 60.0), incidence_deg=(0.0, 45.0)))
    expected = lens(np.radians(60.0), np.radians(45.0), 0.9)
    assert mapped_area(sphere(), quality_class, looks) == pytest.approx(expected, rel=CLOSE)


def test_stereo_of_two_far_cameras_on_a_sphere_maps_a_lens_where_convergence_and_light_are_within_bounds():
    places, sun = [1e9 * unit(x, 1.0, 0.0) for x in (-0.4, 0.4)], unit(0.0, 1.0, 0.2)
    apart = 2.0 * np.arctan(0.4)
    later = [sun, unit(0.0, 1.0, 0.9)]  # 30.7 deg on
    e, stereo = np.radians(60.0), {"emission_deg": (0.0, 60.0)}
    for convergence, alike, suns, maps in (
        ((40.0, 50.0), 180.0, [sun, sun], True),
        ((10.0, 40.0), 180.0, [sun, sun], False),
        ((45.0, 90.0), 180.0, [sun, sun], False),
        ((40.0, 50.0), 32.0, later, True),
        ((40.0, 50.0), 30.0, later, False),
    ):
        quality_class = own(Demand(convergence_deg=convergence, alike_light_deg=alike, **stereo))
        found = mapped_area(sphere(), quality_class, looks_of(sphere(), places, suns))
        assert found == (pytest.approx(lens(e, e, apart), rel=CLOSE) if maps else 0.0)


def test_convergence_is_that_at_the_face_and_not_at_the_centre_of_the_body():
    # Cameras above each other: lines of sight to a face converge by what the law of sines says of its distance from below.
    heights = np.array([1.6e3, 4e3])

    def converge(angle):
        slant = [np.arctan2(1e3 * np.sin(angle), h - 1e3 * np.cos(angle)) for h in heights]
        return np.degrees(slant[0] - slant[1])

    horizon = np.arccos(1e3 / heights[0])
    bounds = [brentq(lambda t, c=c: converge(t) - c, 0.0, 0.8) for c in (3.0, 25.0)]
    assert max(bounds) < horizon
    looks = looks_of(sphere(), [[0.0, h, 0.0] for h in heights], [[0.0, 1.0, 0.0]] * 2)
    found = mapped_area(sphere(), own(Demand(convergence_deg=(3.0, 25.0))), looks)
    assert found == pytest.approx(cap(bounds[1]) - cap(bounds[0]), rel=CLOSE)


def test_varied_light_is_between_suns_of_two_looks_within_the_limits():
    suns = [unit(x, 1.0, 0.0) for x in (-0.5, 0.5)]  # 53 deg
    looks = looks_of(sphere(), [[0.0, 1e9, 0.0]] * 2, suns)
    for light, maps in (((40.0, 90.0), True), ((54.0, 90.0), False), ((0.0, 52.0), False)):
        found = mapped_area(sphere(), own(Demand(incidence_deg=(0.0, 60.0), light_varied_deg=light)), looks)
        e = np.radians(60.0)
        assert found == (pytest.approx(lens(e, e, 2.0 * np.arctan(0.5)), rel=CLOSE) if maps else 0.0)


@pytest.mark.parametrize(
    "normal", [unit(0.3, -0.5, 0.4), unit(-0.8, 0.1, -0.5), unit(0.0, 0.0, 1.0), unit(0.0, 0.0, -1.0)]
)
def test_sectors_are_quadrants_of_the_face_s_horizon_with_north_towards_plus_z(normal):
    north = (
        np.array([1.0, 0.0, 0.0]) if abs(normal[2]) == 1.0 else unit(*(np.array([0.0, 0.0, 1.0]) - normal[2] * normal))
    )
    east = np.cross(north, normal)
    tilt = np.radians(30.0)

    def looks(*azimuths_deg):
        views = [
            np.cos(tilt) * normal + np.sin(tilt) * (np.cos(a) * north + np.sin(a) * east)
            for a in np.radians(azimuths_deg)
        ]
        cells = np.array([0])
        return gather([PictureLooks(j, cells, u[None], normal, np.ones(1)) for j, u in enumerate(views)], normal[None])

    for azimuths, number in (
        ((0, 90, 180, 270), 4),
        ((44, 46, 136, 226), 4),
        ((44, -44, 10), 1),
        ((46, 134, 100), 1),
        ((0, 180), 2),
    ):
        for asked in range(5):
            assert mapped(own(Demand(sectors=asked)), looks(*azimuths))[0] == (number >= asked)
    zenith = gather([PictureLooks(0, np.array([0]), normal[None], normal, np.ones(1))], normal[None])
    assert not mapped(own(Demand(sectors=1)), zenith)[0]


# ---- Facetted bodies with shadows and hidden ground against exact polygons -------------------------------------------


def mesh_of(name):
    points, faces = geodesic_icosahedron(6)
    return {
        "ellipsoid": lambda: trimesh.Trimesh(points * (900.0, 600.0, 500.0), faces, process=False),
        "torus": lambda: trimesh.creation.torus(800.0, 300.0, major_sections=24, minor_sections=12),
        "dumbbell": dumbbell,
    }[name]()


@pytest.mark.parametrize("name", ["ellipsoid", "torus", "dumbbell"])
def test_stereo_on_bodies_of_all_kinds_maps_what_exact_polygons_leave_of_it(name):
    mesh = mesh_of(name)
    shape = ShapeModel(np.asarray(mesh.vertices), np.asarray(mesh.faces), name)
    places, sun = [4.5e3 * unit(x, 1.0, 0.7) for x in (-0.25, 0.3)], unit(0.5, 0.8, 0.9)
    quality_class = own(Demand(emission_deg=(0.0, 65.0), convergence_deg=(20.0, 60.0), max_gsd_m=50.0))
    exact = exact_stereo_area(shape, places, sun, emission_deg=65.0, max_gsd_m=50.0)

    region = whole_body(shape, cell_size_m=28.0)
    observer = make_observer(region, CAMERA, kind="raycast")
    criterion = Observation(max_emission_deg=90.0, min_pixels=0.0, max_incidence_deg=90.0)
    seen = []
    for r_A in places:
        pose = look_at(r_A, [0.0, 0.0, 0.0])
        seen.append(np.flatnonzero(observe(observer, pose.r_A, pose.C_CA, criterion, sun)))
    looks = looks_of(region, places, [sun] * 2, seen)
    assert (
        figures_of(looks).convergence_deg[mapped(quality_class, looks)].min() > 20.0
    )  # bounds there are of both cameras
    assert region.area[mapped(quality_class, looks)].sum() == pytest.approx(exact, rel=CLOSE)


def surface(shape):
    """A shape without the lines and points that cutting leaves of it."""
    parts = shapely.get_parts(shape)
    return shapely.multipolygons(parts[shapely.get_dimensions(parts) == 2])


def exact_stereo_area(shape, places, sun, *, emission_deg, max_gsd_m):
    """Area that both cameras and the Sun see, and both within a limit of emission and of ground sampling distance [m^2]."""
    faces = np.arange(len(shape.faces))
    oracle = Oracle(shape.vertices, shape.faces, [Patch(k, shape.vertices[shape.faces[k]]) for k in faces])
    everything = shapely.box(-5.0, -5.0, 5.0, 5.0)
    cameras = [View(np.array(p), look_at(p, [0.0, 0.0, 0.0]).C_CA, everything) for p in places]
    views = [*cameras, View(1e6 * sun, look_at(1e6 * sun, [0.0, 0.0, 0.0]).C_CA, everything)]
    parts = [[oracle._on_face(k, part, view) for k, part in enumerate(oracle.visible_parts(view))] for view in views]
    total = 0.0
    for k in faces:
        a, b, c = shape.vertices[shape.faces[k]]
        normal, e1 = unit(*np.cross(b - a, c - a)), unit(*(b - a))
        pieces = [part[k] for part in parts]
        for r_A in places:
            height, foot = normal @ (r_A - a), (r_A - a) @ np.array([e1, np.cross(normal, e1)]).T
            # d^2 pixel / h <= g, and h / d >= cos e: discs about the camera's foot.
            reach = min(
                height * np.tan(np.radians(emission_deg)),
                np.sqrt(max(max_gsd_m * height / CAMERA.pixel_angle - height**2, 0.0)),
            )
            pieces.append(shapely.Point(foot).buffer(reach, quad_segs=128))
        total += reduce(lambda x, y: shapely.intersection(surface(x), surface(y), grid_size=1e-6), pieces).area
    return total


# ---- All conditions against a plain reading of them, and monotony ----------------------------------------------------


def random_looks(seed, cells=40, pictures=9):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(cells, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = []
    for taker in range(pictures):
        which = np.flatnonzero(rng.random(cells) < 0.6)
        to_camera = normal[which] + 0.8 * rng.normal(size=(len(which), 3))
        to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
        sun, gsd = unit(*rng.normal(size=3)), rng.random(len(which))
        found.append(PictureLooks(taker, which, to_camera, sun, gsd, rng.random(len(which)), rng.random(len(which))))
    return found, normal


def degrees_between(a, b):
    return np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0)))


def fulfils(demand, normal, looks):
    """What a demand says, read word by word, of the looks (PictureLooks, place in it) of one face."""

    def within(angle, bounds):
        return bounds is None or bounds[0] <= angle <= bounds[1]

    good = []
    for picture, k in looks:
        u, s = picture.to_camera_A[k], picture.to_sun_A
        if (
            (demand.max_gsd_m is None or picture.gsd_m[k] <= demand.max_gsd_m)
            and (demand.max_motion_blur_px is None or picture.motion_blur_px[k] <= demand.max_motion_blur_px)
            and (demand.min_snr is None or picture.snr[k] >= demand.min_snr)
            and within(degrees_between(normal, u), demand.emission_deg)
            and within(degrees_between(normal, s), demand.incidence_deg)
            and within(degrees_between(u, s), demand.phase_deg)
        ):
            good.append((u, s))
    pairs = list(combinations(good, 2))
    stereo = demand.convergence_deg is None or any(
        within(degrees_between(a[0], b[0]), demand.convergence_deg)
        and degrees_between(a[1], b[1]) <= demand.alike_light_deg
        for a, b in pairs
    )
    varied = demand.light_varied_deg is None or any(
        within(degrees_between(a[1], b[1]), demand.light_varied_deg) for a, b in pairs
    )
    return len(good) >= demand.looks and stereo and varied


angles = st.tuples(st.floats(0, 180), st.floats(0, 180)).map(lambda pair: tuple(sorted(pair)))
demands = st.builds(
    Demand,
    looks=st.integers(1, 4),
    max_gsd_m=st.none() | st.floats(0.1, 1),
    emission_deg=st.none() | angles,
    incidence_deg=st.none() | angles,
    phase_deg=st.none() | angles,
    max_motion_blur_px=st.none() | st.floats(0.1, 1),
    min_snr=st.none() | st.floats(0.1, 1),
    convergence_deg=st.none() | angles,
    alike_light_deg=st.floats(0, 180),
    sectors=st.integers(0, 3),
    light_varied_deg=st.none() | angles,
)


@settings(max_examples=60, deadline=None)
@given(demands, st.integers(0, 10**6))
def test_a_class_maps_what_its_demands_say_word_by_word(demand, seed):
    pictures, normal = random_looks(seed)
    found = mapped(own(demand.model_copy(update={"sectors": 0})), gather(pictures, normal))
    for cell in range(len(normal)):
        looks = [(p, int(np.flatnonzero(p.cells == cell)[0])) for p in pictures if cell in p.cells]
        assert found[cell] == fulfils(demand, normal[cell], looks)


@settings(max_examples=60, deadline=None)
@given(st.lists(demands, min_size=1, max_size=3), st.integers(0, 10**6), st.integers(0, 8))
def test_one_look_more_never_unmaps_a_face_and_chosen_takers_are_those_alone(own_demands, seed, dropped):
    pictures, normal = random_looks(seed)
    quality_class, looks = own(*own_demands), gather(pictures, normal)
    fewer = mapped(quality_class, gather([p for p in pictures if p.taker != dropped], normal))
    assert not (fewer & ~mapped(quality_class, looks)).any()
    assert np.array_equal(fewer, mapped(quality_class, looks, np.arange(9) != dropped))


def test_usable_looks_are_those_that_a_demand_of_one_look_would_take():
    pictures, normal = random_looks(3)
    looks, demand = gather(pictures, normal), Demand(emission_deg=(10.0, 60.0), max_gsd_m=0.7)
    cell = np.repeat(np.arange(len(normal)), np.diff(looks.start))
    assert np.array_equal(np.bincount(cell, usable(demand, looks), len(normal)) > 0, mapped(own(demand), looks))
    assert 0 < usable(demand, looks).sum() < len(cell)


def test_a_face_without_a_look_is_mapped_by_no_class_and_has_no_figures():
    looks = gather([], sphere().normal_A[:5])
    assert not any(mapped(QualityClass(name=name), looks).any() for name in PACKAGED)
    found = figures_of(looks)
    assert not found.looks.any() and all(np.isnan(values).all() for values in found[1:])


def test_shape_needs_stereo_of_steep_views_under_a_high_sun_and_straight_views_in_low_light_from_two_sides():
    normal = np.array([[0.0, 0.0, 1.0]])

    def look(emission_deg, azimuth_deg, incidence_deg, sun_azimuth_deg=0.0):
        u, s = (
            np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
            for t, a in np.radians([(emission_deg, azimuth_deg), (incidence_deg, sun_azimuth_deg)])
        )
        return PictureLooks(0, np.array([0]), u[None], s, np.ones(1))

    whole = [look(42, 0, 10), look(42, 180, 10), look(5, 0, 40), look(5, 0, 40, 180)]
    shape = QualityClass(name="shape")
    assert mapped(shape, gather(whole, normal))[0]
    for k in range(4):
        assert not mapped(shape, gather(whole[:k] + whole[k + 1 :], normal))[0]
    stereo = [look(42, 60, 10), look(52, 180, 10), look(42, 180, 25)]
    albedo = [look(25, 0, 40, 180), look(5, 0, 40, 45), look(5, 0, 25, 180)]
    for k, other in [(1, other) for other in stereo] + [(3, other) for other in albedo]:
        assert not mapped(shape, gather([*whole[:k], other, *whole[k + 1 :]], normal))[0]


def test_figures_are_the_best_of_each_cell_s_looks():
    pictures, normal = random_looks(11)
    found = figures_of(gather(pictures, normal))
    for cell in range(len(normal)):
        looks = [(p, int(np.flatnonzero(p.cells == cell)[0])) for p in pictures if cell in p.cells]
        u, s = np.array([p.to_camera_A[k] for p, k in looks]), np.array([p.to_sun_A for p, _ in looks])
        assert found.looks[cell] == len(looks)
        assert found.best_gsd_m[cell] == pytest.approx(min(p.gsd_m[k] for p, k in looks), rel=1e-6)
        for name, values in (("least_emission_deg", u), ("least_incidence_deg", s)):
            assert getattr(found, name)[cell] == pytest.approx(
                min(degrees_between(normal[cell], v) for v in values), abs=0.05
            )
        for name, values in (("convergence_deg", u), ("light_varied_deg", s)):
            most = max((degrees_between(a, b) for a, b in combinations(values, 2)), default=np.nan)
            assert getattr(found, name)[cell] == pytest.approx(most, abs=0.05, nan_ok=True)


# ---- Dilution of precision against recovery from noisy pictures of a rough patch -------------------------------------

DRAWS = 600


@cache
def rough_patch():
    """Ground of 6 x 6 cells of 10 m with heights of 3 m rms, at the side of a body: its faces as cells."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(7) * 10.0, np.arange(7) * 10.0, indexing="ij")
    ground = np.stack([500.0 + 3.0 * rng.normal(size=(7, 7)), x - 30.0, y - 30.0], axis=-1).reshape(-1, 3)
    at = np.arange(49).reshape(7, 7)
    a, b, c, d = (at[i : i + 6, j : j + 6].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return whole_body(ShapeModel(ground, faces, "patch"))


VIEWS = [np.array([1500.0, 300.0, -200.0]), np.array([1300.0, -500.0, 100.0]), np.array([1800.0, 200.0, 700.0])]
SUNS = [unit(1.0, 0.6, 0.1), unit(1.0, -0.3, 0.5), unit(1.0, -0.2, -0.6), unit(1.0, 0.1, 0.2)]


def within_95_percent(squares):
    """Whether a sum of squares of normal deviates over their predicted deviations is what chance gives."""
    low, high = chi2.ppf([0.025, 0.975], squares.size)
    return low < squares.sum() < high


def test_the_height_recovered_from_noisy_pictures_scatters_as_its_dilution_says():
    region, rng = rough_patch(), np.random.default_rng(1)
    looks = looks_of(region, VIEWS, SUNS[:3], [np.arange(region.n_cells)] * 3)
    found = figures_of(looks)
    poses = [look_at(r_A, [500.0, 0.0, 0.0]) for r_A in VIEWS]

    def pixels(point):
        seen = [pose.to_camera(point) for pose in poses]
        return np.concatenate([p[:2] / p[2] for p in seen]) / CAMERA.pixel_angle

    squares = []
    for cell in (3, 40):
        truth = region.centroid_A[cell]
        sigma = found.height_dop[cell] * found.best_gsd_m[cell]
        for _ in range(DRAWS // 2):
            measured = pixels(truth) + 0.05 * rng.normal(size=6)
            point = least_squares(lambda p, m=measured: pixels(p) - m, truth + 1.0).x
            squares.append(((point - truth) @ region.normal_A[cell] / (0.05 * sigma)) ** 2)
    assert within_95_percent(np.array(squares))


def test_slopes_and_albedo_recovered_from_rendered_pictures_scatter_as_their_dilution_says():
    region, rng, noise, albedo = rough_patch(), np.random.default_rng(2), 1e-2, 0.2
    looks = looks_of(region, [VIEWS[0]] * 4, SUNS, [np.arange(region.n_cells)] * 4)
    found, suns = figures_of(looks), np.array(SUNS)
    camera = CameraModel(half_angle_deg=3.0, resolution_px=256)
    face = draw(region, camera, look_at(VIEWS[0], [500.0, 0.0, 0.0]))
    slopes, albedos = [], []
    for cell in range(0, region.n_cells, 24):
        normal, pixels = region.normal_A[cell], (face == cell).sum()
        assert pixels > 100
        frame = np.array([*np.linalg.svd(normal[None])[2][1:], normal])
        # Each picture of a draw: Lambert shading and noise in every pixel of the face, of which the mean is measured.
        image = albedo * (suns @ normal)[:, None, None] + noise * albedo * rng.normal(size=(4, DRAWS, pixels))
        # Lambert's law is linear in albedo times normal.
        scaled = np.linalg.lstsq(suns, image.mean(axis=2), rcond=None)[0]
        p, q, r = frame @ scaled
        of_mean = noise / np.sqrt(pixels)
        slopes.append(((p / r) ** 2 + (q / r) ** 2) / (of_mean * found.slope_dop[cell]) ** 2)
        albedos.append(((np.linalg.norm(scaled, axis=0) / albedo - 1.0) / (of_mean * found.albedo_dop[cell])) ** 2)
    assert within_95_percent(np.array(albedos))
    # Two slopes of unlike deviations: the mean of their sum of squares is one, its spread at most that of a single one.
    assert abs(np.mean(slopes) - 1.0) < 1.96 * np.sqrt(2.0 / np.size(slopes))


def draw(region, camera, pose):
    """The cell that each pixel of a picture shows, by the drawing of faces in compiled code; -1: none."""
    observer = make_observer(region, camera, kind="raster")
    try:
        return observer.face_ids(pose).astype(np.int64) - 1
    finally:
        observer.close()


def test_the_page_tells_the_limits_of_the_packaged_classes_and_its_example_loads():
    page = (Path(__file__).parents[2] / "docs/how-to/quality_classes.md").read_text("utf-8")
    scenario = scenario_from(yaml.safe_load(re.findall(r"^```yaml\n(.*?)^```", page, re.DOTALL | re.MULTILINE)[0]))
    assert [each.name for each in scenario.observation.classes] == ["resolved", "stereo", "five_views"]
    assert scenario.observation.classes[1].all_demands[0].max_gsd_m == 50
    rows = [
        [cell.strip() for cell in row.split("|")[1:-1]]
        for row in page.split("|---|---|---|---|---|---|\n")[1].split("\n\n")[0].splitlines()
    ]
    told = [[int(n) for n in re.findall(r"\d+", " ".join(row[2:5]))] for row in rows]
    demands = [demand for each in PACKAGED.values() for demand in each]
    keys = ("emission_deg", "incidence_deg", "convergence_deg", "light_varied_deg")
    for numbers, row, demand in zip(told, rows, demands, strict=True):
        asked = [round(angle) for key in keys for angle in getattr(demand, key) or ()]
        assert numbers == asked + [round(demand.alike_light_deg)] * (demand.alike_light_deg < 180.0)
        paired = demand.convergence_deg is not None or demand.light_varied_deg is not None
        assert int(row[5]) == max(demand.looks, 2 * paired)


def test_one_line_of_sight_or_suns_in_one_plane_determine_nothing():
    region = rough_patch()
    cells = [np.arange(region.n_cells)]
    one = figures_of(looks_of(region, VIEWS[:1], SUNS[:1], cells))
    assert np.isnan(one.height_dop).all() and np.isnan(one.slope_dop).all()
    same = figures_of(looks_of(region, VIEWS[:1] * 3, [SUNS[0]] * 3, cells * 3))
    assert np.isnan(same.height_dop).all() and np.isnan(same.albedo_dop).all()
    plane = [unit(1.0, t, 0.0) for t in (-0.5, 0.0, 0.4)]
    flat = figures_of(looks_of(region, VIEWS, plane, cells * 3))
    assert np.isnan(flat.slope_dop).all() and np.isfinite(flat.height_dop).all()


def test_two_views_of_45_deg_from_opposite_sides_dilute_the_height_by_root_half():
    # Both measure across their line of sight in the plane of the two: twice a pixel's noise in height over root two each way.
    u = np.array([[np.sin(t), 0.0, np.cos(t)] for t in np.radians([-45.0, 45.0])])
    looks = gather(
        [PictureLooks(j, np.array([0]), u[j : j + 1], unit(0, 0, 1), np.full(1, np.sqrt(2.0))) for j in range(2)],
        np.array([[0.0, 0.0, 1.0]]),
    )
    # Pixels 1 m wide across the lines of sight: a normal matrix of diag(1, 2, 1) along x, y, z.
    assert figures_of(looks).height_dop[0] == pytest.approx(1.0 / np.sqrt(2.0), rel=1e-5)


# ---- Signal to noise -------------------------------------------------------------------------------------------------


def test_the_sun_s_irradiance_is_that_measured_within_a_tenth_and_sums_up_to_the_solar_constant():
    assert solar_irradiance(550e-9) == pytest.approx(1.86e9, rel=0.1)
    wavelength = np.geomspace(1e-7, 1e-3, 4000)
    total = np.trapezoid([solar_irradiance(w) for w in wavelength], wavelength)
    assert total == pytest.approx(1361.0, rel=2e-3)


def test_signal_to_noise_is_that_of_drawn_photons_and_read_noise():
    camera = Camera(exposure_s=1e-6, read_noise=12.0)
    signal = electrons(camera, 1e-4, np.array([0.04]), 1.2 * constants.au)
    irradiance = solar_irradiance(550e-9) / 1.2**2 * 300e-9 * np.pi / 4 * 0.094**2 * 1e-8 * 0.04 / np.pi
    assert signal[0] == pytest.approx(irradiance * 1e-6 * 0.4 / (constants.h * constants.c / 550e-9))
    rng = np.random.default_rng(4)
    drawn = rng.poisson(signal[0], 200_000) + 12.0 * rng.normal(size=200_000)
    assert signal_to_noise(camera, signal)[0] == pytest.approx(drawn.mean() / drawn.std(), rel=0.01)
    assert signal_to_noise(camera.model_copy(update={"read_noise": 0.0}), np.zeros(1))[0] == 0.0


# ---- What is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("classes", "words"),
    [
        (["sterio"], "must be one of seen, resolved, stereo, shape, or give the class its demands"),
        (["stereo", "stereo"], "stereo is there twice"),
        ([{"name": "shape", "demands": [{}]}], "is a packaged class"),
        ([{"name": "own", "demands": [{"emission_deg": [50, 40]}]}], "least angle must not exceed the largest"),
        ([{"name": "own", "demands": [{"max_gsd": 1}]}], "Extra inputs are not permitted"),
    ],
)
def test_classes_that_cannot_be_are_refused_with_what_is_allowed(classes, words):
    with pytest.raises(ValidationError, match=words):
        Observation(classes=classes)
