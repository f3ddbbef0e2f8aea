"""Measure pictures and navigation by them, and write docs/results/optical.md.

Run: python -m scripts.pages.optical [--pictures 1000]; the comparison with Mitsuba needs the extra `reference`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from scipy import ndimage
from scipy.special import chdtri
from scipy.stats import chi2

import swarm_mj as sm
from scripts.pages import RESULTS
from scripts.pages.filter_flights import CASES as CASES_OF_FILTER
from scripts.pages.filter_flights import row_of as row_of_filter
from swarm_mj.flight.environment import load_body_shape
from swarm_mj.io.atomic import write_text
from swarm_mj.io.machine import usable_cores
from swarm_mj.navigation.centroid import measure_centroid
from swarm_mj.navigation.filter import GATE
from swarm_mj.navigation.landmarks import FLOOR, measure_landmarks
from swarm_mj.navigation.limb import EDGE_FLOOR, SQUARE_PX, measure_horizon, measure_limb
from swarm_mj.navigation.picture import FEWEST_SAMPLES, TAKEN_SAMPLES, Fix, Predictor, Rejected, SeenPicture
from swarm_mj.observation.camera import CameraModel, CameraPose, look_at
from swarm_mj.observation.detector import DetectorModel
from swarm_mj.observation.lens import lens_of
from swarm_mj.observation.photometry import body_surface, surface_of
from swarm_mj.observation.shading import ShadedBody
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_imaging import Camera
from swarm_mj.scenarios.schema_photometry import Photometry
from swarm_mj.typing import Array

PAGE = RESULTS / "optical.md"
#: Pictures of 512 x 512 pixels by a camera of 10 deg half-angle.
MODEL = CameraModel(half_angle_deg=10.0, resolution_px=512)
LENS = lens_of(MODEL)
CAMERA = Camera(half_angle_deg=10.0, resolution_px=512, aperture_m=0.02)
#: Bodies by name: the packaged scenario whose body is meant; None: a sphere by Lambert's law.
BODIES = {
    "sphere": None,
    "Eros": "eros-config2",
    "Bennu": "bennu-slow",
    "dumb-bell": "dumbbell-global",
    "Itokawa": "itokawa-slow",
}
#: That by which no number was chosen.
CHECK = "Itokawa"


class Case(NamedTuple):
    """What is measured.

    Attributes:
        way: By which.
        sizes: Diameters on the picture [px].
        phases: Phase angles [deg].
        aside: By how much the camera looks beside the centre, over its half-angle.
        words: What is special about it.
    """

    way: str
    sizes: tuple[float, float]
    phases: tuple[float, float] = (0.0, 120.0)
    aside: float = 0.0
    words: str = ""


CASES = (
    Case("centroid", (5.0, 40.0)),
    Case("limb", (20.0, 100.0)),
    Case("limb", (100.0, 400.0)),
    Case("landmarks", (300.0, 500.0)),
    Case("limb", (100.0, 400.0), (80.0, 120.0), 0.0, ", half in shadow"),
    Case("limb", (100.0, 400.0), (0.0, 120.0), 1.0, ", half out of the picture"),
    Case("landmarks", (500.0, 900.0), (0.0, 120.0), 1.0, ", half out of the picture"),
)
#: Flights of the filter alone, of each case.
FILTERED = 1000
#: Error of the believed position over the distance, 1 sigma of each component.
PRIOR = 1e-3
#: A wider camera for Bennu.
BENNU = {"camera.half_angle_deg": 8.0, "camera.resolution_px": 256}
#: Flights that are flown with perfect knowledge and by pictures.
FLIGHTS: dict[str, dict[str, Any]] = {
    "eros-config1": {},
    "eros-config2": {},
    "bennu-slow": {},
    "bennu-slow, camera of 8 deg": BENNU,
    "bennu-slow, camera of 8 deg, model of 2,000 faces": {**BENNU, "navigation.optical.model_faces": 2000},
    "itokawa-slow": {},
    "fast-flyby": {"navigation.optical.interval_s": 3600},
    "fast-flyby, camera of 1 deg": {"navigation.optical.interval_s": 3600, "camera.half_angle_deg": 1.0},
}


PAGE_TEXT = """# Pictures and navigation by them, measured

Written by `python -m scripts.pages.optical --pictures {plain}`. How it works: [Light and pictures](../theory/light.md),
[Navigate by pictures](../how-to/optical_navigation.md).

## Pictures

{speed}

{mitsuba}

## Measurements

{count} pictures a row, of 512 x 512 pixels and a half-angle of 10 deg, by the detector `cubesat`, at 1 au from the Sun and
phases of 0 to 120 deg, from believed positions that err by 0.1 % of the distance in each component, 1.45 pixels. From how far
off pictures can still be matched is not told here; flights are often farther off. Pictures have {taken} samples along a pixel
at least, as in flights, the predictions they are held against {predicted}; of bodies below some 170 pixels both have more,
and the same. Attitudes are exact. The model is the body itself: what a shape, an albedo or a law that is not quite the body's
adds is `centroid_model`, `limb_model_px` and `landmark_model_px` of flights, and left out here. *Diameter* is that of the
sphere about the body. *chi-square* is the sum of the squared errors over the covariances that measurements say, a component;
in brackets where 95 % of right ones lie. Above it, measurements promise too much; below, too little. *Worst picture* is that
of a single one. *Half in shadow* has phases of 80 to 120 deg. *Half out of the picture* has the body's centre half the
picture's width off the middle, in any direction: of what is up to 400 pixels wide some three fifths are in the picture, of what
is wider two fifths. *Why not* has the two most frequent causes. *Median across* is of errors across the line of sight, *of
distance* of those along it, over the distance. Not used is also what a filter that knows the position as well would refuse,
as that of flights does.

| body | way | diameter [px] | used | median across [px] | of distance | chi-square | worst picture | why not |
|---|---|---|---|---|---|---|---|---|
{table}

{outside}

What pictures err by as they are drawn is small beside noise, since samples that an edge of the mesh parts share their areas
as the edge divides them; shadows have none of that. Limbs allow for what is left by one number for a size of the body on the
picture, whatever its shape and light; and where what a fit leaves pulls it by more than noise would, square by square of
{square} x {square} pixels, by that, and by more where much is left. Landmarks have an own error of {floor} px, and horizons of
{edge} px and more where they curve. These numbers were chosen by pictures of the first four bodies, most of them those above,
so that limbs come out right in the mean, and horizons those of the sphere: the table shows how far one set of numbers carries.
Itokawa, of 100 pixels and more, took no part in that.

## Filter

{filtered} short flights of two spacecraft past a body, from 31 km past 10 km to 14 km, of the filter alone: measurements are
drawn, and err by what the filter is told (`scripts/pages/filter_flights.py`). NEES and NIS are the squared errors of the
estimates at the end and of the innovations over what the filter says of them, a component; in brackets where 95 % of right
ones lie. *Far off* are estimates whose squared error is beyond what one in a hundred right ones exceeds. Ranges known to 1 m
between places known much worse are not linear: they are believed less, by which innovations come out smaller than said. Of
near spacecraft two and a half times as many as should are far off all the same.

| case | flights | NEES | far off | NIS |
|---|---|---|---|---|
{filter}

## Flights

One flight each of five packaged scenarios with perfect knowledge, and one by pictures (`navigation.mode: optical`), of the
scenario's seed. P_TO by the scenario's criterion and over the whole passage; delivered where the scenario says how. Errors, 3
sigma and NEES are each the largest of all observers at their arrivals, not of the same one. NEES is the squared error over
the covariance, a component: of one spacecraft right ones stay below 2.6 in 95 of 100 flights, the largest of five below 3.8.
NIS is the same of all innovations that were used, together: below 1, since covariances allow for errors of the body's model
that are not there, and since what the filter refused is left out. *Aim* is by how much the direction to the body was wrong.
Sensors are the scenario's. *Time* is over that of the plain flight, both flown in a process that flew the scenario before, so
that what follows from target and Sun alone is known. `eros-config1` and `eros-config2` are the same paths with the same
camera. `fast-flyby` takes a picture an hour (`navigation.optical.interval_s: 3600`); "of 8 deg" and "of 1 deg" are
half-angles, the first with `camera.resolution_px: 256`. That P_TO stays at 100 % does not say that all aimed well: of
`itokawa-slow` one observer sees all, while the other's camera looks past the body; and one flight is one draw, see [the
campaigns](../how-to/optical_navigation.md).

Shape, law, GM and pole of the body are known exactly in these flights, but for the one with a model of fewer faces: by that
no landmark is found, limbs leave more than noise and are believed less, as its NIS shows; what that costs shows beside the
row above it. What a wrong shape is off by stays from picture to picture, where the filter takes it for noise.

| scenario | P_TO, passage [%] | by pictures | delivered | error [m] | 3 sigma [m] | NEES | NIS | aim [deg] | pictures | time |
|---|---|---|---|---|---|---|---|---|---|---|
{flown}
"""


class Studio:
    """A body before a camera."""

    def __init__(self, scenario: str | None) -> None:
        if scenario is None:
            ball = trimesh.creation.icosphere(5)
            grown = 2.0 - float(np.linalg.norm(ball.triangles_center, axis=1).mean())
            vertices, faces = 1000.0 * grown * np.array(ball.vertices), np.array(ball.faces)
            surface = surface_of(Photometry(law="lambert"))
        else:
            body = load_scenario(scenario).body
            shape, found = load_body_shape(body), body_surface(body)
            assert found is not None
            vertices, faces, surface = np.array(shape.vertices), np.array(shape.faces), found
        self.vertices, self.faces = vertices, faces
        self.body, self.radius = ShadedBody(vertices, faces, surface), float(np.linalg.norm(vertices, axis=1).max())
        self.predictor = Predictor(ShadedBody(vertices, faces, surface), self.radius)
        self.detector = DetectorModel(CAMERA, 1.0 / LENS.focal_px, (512, 512))

    def shot(self, r_A: Array, C_CA: Array, sun_A: Array, rng: np.random.Generator, believed_A: Array) -> SeenPicture:
        """A picture from a pose, believed to be taken from elsewhere."""
        psf_px = CAMERA.detector.psf_sigma_px
        factor = self.body.draw_spread(LENS, CameraPose(r_A, C_CA), sun_A, psf_px, fewest=TAKEN_SAMPLES)
        exposed = self.detector.expose(factor, float(np.linalg.norm(sun_A)), rng)
        diameter_px = self.predictor.diameter_at(float(np.linalg.norm(r_A)), LENS)
        return SeenPicture.of(exposed, LENS, psf_px, diameter_px, CameraPose(believed_A, C_CA), sun_A)


def geometry(rng: np.random.Generator, distance: float, case: Case) -> tuple[Array, Array, Array]:
    """A camera at a random place that looks near the centre or beside it, and the Sun at some phase."""
    to_camera = rng.normal(size=3)
    to_camera /= np.linalg.norm(to_camera)
    across = np.cross(to_camera, rng.normal(size=3))
    across /= np.linalg.norm(across)
    phase, r_A = np.radians(rng.uniform(*case.phases)), distance * to_camera
    sun_A = AU * (np.cos(phase) * to_camera + np.sin(phase) * across)
    aim = 0.01 * distance * rng.uniform(-1, 1, 3)
    turn = rng.uniform(0.0, 2.0 * np.pi)
    beside = np.cos(turn) * across + np.sin(turn) * np.cross(to_camera, across)
    aim = aim + case.aside * MODEL.tan_half_angle * distance * beside
    return r_A, look_at(r_A, aim, roll=float(rng.uniform(0, 6))).C_CA, sun_A


def measured(studio: Studio, way: Callable[[SeenPicture], Fix | Rejected], case: Case, count: int) -> str:
    """A row of the table: how errors compare with what they are said to be."""
    name, sizes = case.way + case.words, case.sizes
    rng, total, dof, errors, why = np.random.default_rng(0), 0.0, 0, [], Counter[str]()
    along, worst = [], 0.0
    for _ in range(count):
        distance = 2.0 * studio.radius * LENS.focal_px / float(np.exp(rng.uniform(*np.log(sizes))))
        r_A, C_CA, sun_A = geometry(rng, distance, case)
        off = PRIOR * distance * rng.normal(size=3)
        fix = way(studio.shot(r_A, C_CA, sun_A, rng, r_A + off))
        if isinstance(fix, Rejected):
            why[fix.why] += 1
            continue
        # Left out, as the filter does: what is too unlikely where so much is known beforehand.
        S = (PRIOR * distance) ** 2 * fix.H @ fix.H.T + fix.R
        if not float(fix.y @ np.linalg.solve(S, fix.y)) < chdtri(len(fix.y), GATE):
            why["wild, which the filter refuses"] += 1
            continue
        error = fix.y + fix.H @ off
        squares = float(error @ np.linalg.solve(fix.R, error))
        total, dof, worst = total + squares, dof + len(error), max(worst, squares / len(error))
        across = error if len(error) == 2 else (C_CA @ error)[:2] / distance * LENS.focal_px
        errors.append(float(np.linalg.norm(across)))
        if len(error) == 3:
            along.append(abs(float((C_CA @ error)[2])) / distance)
    if not errors:
        return f"{name} | {sizes[0]:g} to {sizes[1]:g} | 0 of {count} | | | | | {_reasons(why)} |"
    far = f"{np.median(along):.1e}" if along else "-"
    low, high = chi2.ppf([0.025, 0.975], dof) / dof
    return (
        f"{name} | {sizes[0]:g} to {sizes[1]:g} | {len(errors)} of {count} | {np.median(errors):.3g} | {far} | "
        f"{total / dof:.2f} ({low:.2f} to {high:.2f}) | {worst:.1f} | {_reasons(why)} |"
    )


def _outside(rows: list[str]) -> str:
    """How many rows promise too much or too little, and which do so most."""
    shown: list[tuple[float, float, float, str]] = []
    for row in rows:
        found = re.search(r"\| ([\d.]+) \(([\d.]+) to ([\d.]+)\) \|", row)
        if found is not None:
            value, low, high = map(float, found.groups())
            shown.append((value, low, high, ", ".join(map(str.strip, row.split("|")[1:4]))))
    above, below = sum(value > high for value, _, high, _ in shown), sum(value < low for value, low, _, _ in shown)
    most, least = max(shown), min(shown)
    return (
        f"Of {len(shown)} rows, as they are printed, {above} lie above their brackets and {below} below; by chance one or two "
        "would. The highest is "
        f"{most[0]} ({most[3]} px), the lowest {least[0]} ({least[3]} px)."
    )


def _reasons(why: Counter[str]) -> str:
    """The two most frequent ones, and how many there are of others."""
    others = why.total() - sum(count for _, count in why.most_common(2))
    told = [f"{count} × {words}" for words, count in why.most_common(2)]
    return "; ".join(told + [f"{others} × others"] * (others > 0))


@cache
def studio_of(name: str) -> Studio:
    """The body of a name, made once in a process."""
    return Studio(BODIES[name])


def cases_of(name: str) -> list[Case]:
    """What is measured of a body."""
    if name == CHECK:
        return [each for each in CASES if each.sizes[0] >= 100.0]
    if BODIES[name] is not None:
        return list(CASES)
    horizons = [Case("horizon", (30.0, 100.0)), Case("horizon", (100.0, 400.0))]
    return [each for each in CASES if each.way != "landmarks"] + horizons


def row_of(name: str, case: Case, count: int) -> str:
    """A row of the table of measurements."""
    predictor = studio_of(name).predictor
    ways: dict[str, Callable[[SeenPicture], Fix | Rejected]] = {
        "centroid": lambda seen: measure_centroid(seen, predictor),
        "limb": lambda seen: measure_limb(seen, predictor),
        "landmarks": lambda seen: measure_landmarks(seen, predictor, search_px=8.0),
        "horizon": lambda seen: measure_horizon(seen, predictor, np.full(3, 1000.0)),
    }
    return f"| {name} | {measured(studio_of(name), ways[case.way], case, count)}"


def measurements(count: int) -> list[str]:
    """Rows of the table of measurements, on all cores."""
    jobs = [(name, case, count) for name in BODIES for case in cases_of(name)]
    rows = []
    with ProcessPoolExecutor(usable_cores(), multiprocessing.get_context("spawn")) as pool:
        for row in pool.map(row_of, *zip(*jobs, strict=True)):
            print(row, flush=True)
            rows.append(row)
    return rows


def pictures() -> tuple[str, str]:
    """How fast pictures are drawn, and what Mitsuba makes of one."""
    studio = Studio("eros-config2")
    pose, sun = look_at([2.7e4, 8.1e4, 1.8e4], [0.0, 0.0, 0.0]), np.array([1.0, -0.2, 0.5])
    studio.body.draw(LENS, pose, sun)
    begun, rounds = time.perf_counter(), 100
    for k in range(rounds):
        studio.body.draw(LENS, pose, sun + 1e-3 * k)
    each = (time.perf_counter() - begun) / rounds
    faces = len(studio.faces)
    speed = f"Eros with {faces:,} faces, as long as the picture is wide, 512 x 512 pixels of which it takes a third, half of "
    speed += "that lit, 2 x 2 samples each, cast shadows, the Sun a little farther in each, one core: "
    speed += f"{1.0 / each:.0f} pictures a second (the mean of {rounds} on this machine)."
    try:
        import mitsuba as mi
    except ImportError:
        return speed, "Mitsuba is not installed here, so that nothing was compared."
    mi.set_variant("scalar_rgb")
    white = ShadedBody(studio.vertices, studio.faces, surface_of(Photometry(law="lambert", albedo=1.0)))
    begun = time.perf_counter()
    ours = white.draw(LENS, pose, sun, samples=8).astype(np.float64)
    ours_s = time.perf_counter() - begun
    C = pose.C_CA
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.ply"
        trimesh.Trimesh(studio.vertices, studio.faces, process=False).export(path)
        frame = mi.ScalarTransform4f().look_at(
            origin=pose.r_A.tolist(), target=(pose.r_A + 1e3 * C[2]).tolist(), up=(-C[1]).tolist()
        )
        film = {"type": "hdrfilm", "width": 512, "height": 512, "rfilter": {"type": "box"}, "pixel_format": "luminance"}
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
                "sensor": {
                    "type": "perspective",
                    "fov": 20.0,
                    "fov_axis": "x",
                    "near_clip": 1e3,
                    "far_clip": 1e6,
                    "to_world": frame,
                    "film": film,
                    "sampler": {"type": "stratified", "sample_count": 64},
                },
                "sun": {
                    "type": "directional",
                    "direction": (-sun / np.linalg.norm(sun)).tolist(),
                    "irradiance": {"type": "rgb", "value": 1.0},
                },
                "body": {
                    "type": "ply",
                    "filename": str(path),
                    "face_normals": True,
                    "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}},
                },
            }
        )
        begun = time.perf_counter()
        theirs = np.pi * np.array(mi.render(scene, spp=64))[:, :, 0]
        theirs_s = time.perf_counter() - begun
    on = (ours > 0.0) | (theirs > 0.0)
    lit = white.labels(LENS, pose, sun).lit
    edges = ndimage.maximum_filter(lit, 3) & ~ndimage.minimum_filter(lit, 3)
    off = np.abs(ours - theirs)[on] / theirs.max()
    at_edges = edges[on][off >= 0.01].mean()
    total, median, near = abs(ours.sum() / theirs.sum() - 1.0), np.median(off), (off < 0.01).mean()
    return speed, (
        f"Mitsuba {mi.__version__} (direct light, 64 stratified samples a pixel) against ours with 8 x 8, of one view "
        f"of Eros as a white Lambert body: the sum of all "
        f"light differs by {100.0 * total:.3f} %, the median pixel by {100.0 * median:.3f} % of the brightest, and "
        f"{100.0 * near:.1f} % of the pixels by less than 1 %; of the others {100.0 * at_edges:.0f} % lie at an edge of "
        f"what is lit, where 64 samples fall on both sides by chance. Mitsuba took {theirs_s / ours_s:.0f} times as long (its "
        "scalar variant, which is its slowest, on all cores; ours on one)."
    )


def flights() -> list[str]:
    """Rows of the table of flights."""
    rows = []
    sm.fly("eros-quick", {"navigation.mode": "optical"})  # loads what there is to load
    for title, changes in FLIGHTS.items():
        name, took, flown = title.split(",")[0], [], []
        sm.fly(name, changes)
        for mode in ("assumed", "optical"):
            begun = time.perf_counter()
            flown.append(sm.fly(name, {**changes, "navigation.mode": mode}))
            took.append(time.perf_counter() - begun)
        plain, seen = flown
        told = seen.summary["optical"]
        ways = ", ".join(f"{count} {way}" for way, count in told["used"].items()) or "none"
        sent = [flight.summary.get("delivered_percent") for flight in flown]
        shares = " | ".join(f"{one.coverage.percent:.2f}, {one.passage.percent:.2f}" for one in flown)
        error, sigma, nees = (
            max(told[key].values())
            for key in ("position_error_m_arrival", "position_3_sigma_m_arrival", "nees_per_component_arrival")
        )
        missed = sum(one["count"] for one in told["not_used"])
        aim = max(told["aim_error_deg_arrival"].values())
        row = (
            f"| `{name}`{title[len(name) :]} | {shares} | {_number(sent[0])}, {_number(sent[1])} | {error:.3g} | {sigma:.3g} | "
            f"{nees:.2f} | {told['nis_per_component'] or 0.0:.2f} | {aim:.2g} | {ways}; {missed} not used | "
            f"{took[1] / took[0]:.1f} |"
        )
        print(row, flush=True)
        rows.append(row)
    return rows


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=1000)
    count = parser.parse_args().pictures
    speed, mitsuba = pictures()
    print(speed, mitsuba, sep="\n", flush=True)
    table, flown = measurements(count), flights()
    write_text(
        PAGE,
        PAGE_TEXT.format(
            count=f"{count:,}",
            plain=count,
            taken=TAKEN_SAMPLES,
            predicted=FEWEST_SAMPLES,
            floor=FLOOR,
            square=SQUARE_PX,
            edge=EDGE_FLOOR,
            speed=speed,
            mitsuba=mitsuba,
            table="\n".join(table),
            outside=_outside(table),
            filtered=f"{FILTERED:,}",
            filter="\n".join(row_of_filter(case, FILTERED) for case in CASES_OF_FILTER),
            flown="\n".join(flown),
        ),
    )
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()
