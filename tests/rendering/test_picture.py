"""Pictures: where things stand in them, against ray casting and plain projection."""

import os
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_erosion

from swarm_mj.errors import ObserverError, OutputError
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.rendering import canvas as canvas_module
from swarm_mj.rendering import overlay, picture
from swarm_mj.rendering.cameras import overview, view_direction
from swarm_mj.rendering.canvas import Box, Canvas
from swarm_mj.rendering.decorations import dashes, decorate
from swarm_mj.rendering.model import build_drawing_model
from swarm_mj.rendering.overlay import Lettering, clock, roles
from swarm_mj.rendering.picture import Drawing, layout_of

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("gl")]


@pytest.fixture(scope="module")
def drawn(replay):
    """Model and canvas of the quick flight."""
    model = build_drawing_model(replay.plan, 5000.0, 400, 400)
    canvas = Canvas(model, 400, 400)
    yield model, canvas
    canvas.close()


def is_blue(pixels):
    """Observed cells, filled or border: the only things on the body with more blue than red."""
    return pixels[..., 2].astype(int) > pixels[..., 0].astype(int) + 25


def camera(model, j):
    view = mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, int(model.cameras[j])
    return view


def shown_and_expected(model, canvas, plan, now):
    """Pixels painted as observed in spacecraft 1's camera, and those whose rays hit observed cells, shape (400, 400)."""
    if model.place(now):
        canvas.upload()
    canvas.clear()
    canvas.view(camera(model, 0), Box(0, 0, 400, 400), spacecraft=False)
    half = np.tan(np.radians(plan.scenario.camera.half_angle_deg))
    across = half * (2.0 * (np.arange(400) + 0.5) / 400 - 1.0)
    x, y = np.meshgrid(across, across)  # camera frame: x right, y down, z ahead
    rays_N = np.stack((x, y, np.ones_like(x)), axis=-1).reshape(-1, 3) @ now.C_BN[0]
    region = plan.region
    body = trimesh.Trimesh(region.vertices @ now.C_AN, region.faces, process=False)
    face = body.ray.intersects_first(np.broadcast_to(now.r_BN_N[0], rays_N.shape), rays_N)
    of_face = np.zeros(len(region.faces) + 1, bool)  # the last one for rays that miss, -1
    of_face[region.target] = now.seen
    return is_blue(canvas.read()), of_face[face].reshape(400, 400)


@pytest.mark.parametrize("t", [430.0, 600.0, 700.0])
def test_the_coloured_area_is_the_projected_area_of_the_observed_cells(replay, drawn, t):
    region = replay.plan.region
    west = region.centroid_A @ region.axes_A[0] < 500.0
    shown, expected = shown_and_expected(*drawn, replay.plan, replace(replay.at(t), seen=west))
    assert expected.sum() > 2000
    assert abs(shown.sum() - expected.sum()) < 0.02 * expected.sum()


@pytest.mark.parametrize("t", [430.0, 600.0, 700.0])
def test_each_cell_is_painted_where_rays_hit_it(replay, drawn, rng, t):
    chosen = rng.random(replay.plan.region.n_cells) < 0.4
    shown, expected = shown_and_expected(*drawn, replay.plan, replace(replay.at(t), seen=chosen))
    inside, outside = binary_erosion(expected, iterations=2), binary_erosion(~expected, iterations=2)
    assert inside.sum() > 500
    assert shown[inside].mean() > 0.995
    assert shown[outside].mean() < 0.001


def test_spacecraft_and_names_stand_where_the_projection_puts_them(replay, drawn):
    model, canvas = drawn
    now = replay.at(900.0)
    model.place(now)
    view = overview(replay.plan, replay.path_N, 1.0)
    pictures = []
    for spacecraft in (True, False):
        canvas.clear()
        projection = canvas.view(view.camera(), Box(0, 0, 400, 400), spacecraft=spacecraft)
        pictures.append(canvas.read().astype(int))
    rows, columns = np.nonzero(np.abs(pictures[0] - pictures[1]).max(axis=2) > 10)
    places, inside = projection.place(now.r_BN_N)
    assert inside.all()
    found = np.stack((columns, rows), axis=1)
    nearest = np.linalg.norm(found[:, None] + 0.5 - places, axis=2).min(axis=1)
    size_px = 5000.0 * 0.34 / view.distance * projection.scale[0]
    assert nearest.max() < 0.75 * size_px + 2.0
    for place in places:
        assert np.linalg.norm(found + 0.5 - place, axis=1).min() < 0.3 * size_px + 1.5


def test_the_overview_holds_body_and_flight_and_sees_the_day_side_of_the_target(replay):
    plan = replay.plan
    view = overview(plan, replay.path_N, 4 / 3)
    with Drawing(plan, replay.path_N, width=320, height=240):
        pass
    direction = view_direction(plan, replay.path_N, 4 / 3)
    normal_N = plan.region.axes_A[2] @ plan.environment.C_AN(plan.scenario.design.time_of_flight_s)
    assert direction @ normal_N > 0.2
    assert direction @ plan.environment.sun.position > 0.0
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    relative = np.vstack((replay.path_N.reshape(-1, 3), plan.shape.vertices @ plan.environment.C_AN(0.0))) - view.lookat
    depth = view.distance - relative @ direction
    tangent = np.tan(np.radians(16.0))
    assert (np.abs(relative @ up) < tangent * depth).all()
    assert (np.abs(relative @ right) < 4 / 3 * tangent * depth).all()


def test_fields_of_view_have_the_cameras_angle_and_reach_to_the_bodys_centre(replay, drawn):
    model, _ = drawn
    now = replay.at(500.0)
    geoms = []

    def next_geom():
        geoms.append(mujoco.MjvGeom())
        return geoms[-1]

    decorate(next_geom, model, now)
    sides = [g for g in geoms if g.type == mujoco.mjtGeom.mjGEOM_TRIANGLE]
    assert len(sides) == 4 * now.n
    half = np.tan(np.radians(replay.plan.scenario.camera.half_angle_deg))
    for k, geom in enumerate(sides):
        j = k // 4
        shear = np.array(geom.mat, float)
        corners_N = np.array([geom.pos, geom.pos + geom.size[0] * shear[:, 0], geom.pos + geom.size[1] * shear[:, 1]])
        corners_B = (corners_N - now.r_BN_N[j]) @ now.C_BN[j].T / np.linalg.norm(now.r_BN_N[j])
        assert np.allclose(corners_B[0], 0.0, atol=1e-4)
        assert np.allclose(np.abs(corners_B[1:]), (half, half, 1.0), atol=1e-3)
        outward_B = np.cross(corners_B[1], corners_B[2])
        assert outward_B @ (0.0, 0.0, 1.0) < 0.0  # its front looks away from the axis, and so backwards


def test_every_kind_of_target_has_its_colour_and_dashes_cover_half_of_a_line(replay, drawn):
    model, _ = drawn
    colours = set()
    for kind in TargetKind:
        geoms = []

        def next_geom(geoms=geoms):
            geoms.append(mujoco.MjvGeom())
            return geoms[-1]

        decorate(next_geom, model, replace(replay.at(900.0), kind=np.full(2, kind), tracked=np.array([1, 0])))
        lines = [g for g in geoms if g.type == mujoco.mjtGeom.mjGEOM_LINE]
        colours.add(tuple(np.round(lines[0].rgba, 3)))
    assert len(colours) == len(TargetKind) - 1  # the body's centre and a point of it share one
    for distance in (10.0, 95.0, 1e5):
        pieces = dashes(np.zeros(3), np.array([distance, 0.0, 0.0]), 10.0)
        assert pieces[0][0][0] == 0.0 and np.isclose(pieces[-1][1][0], distance)
        inked = sum(end[0] - start[0] for start, end in pieces)
        assert len(pieces) == 1 or 0.5 <= inked / distance < 0.7


def test_a_lost_spacecraft_is_said_to_be_lost_and_has_no_lines_and_a_blind_one_no_field_of_view(replay, drawn):
    model, _ = drawn
    counts = {}
    for name, states in {
        "all": {},
        "lost": {"lost": np.array([True, False])},
        "blind": {"blind": np.array([True, False])},
    }.items():
        now, geoms = replace(replay.at(500.0), **states), []

        def next_geom(geoms=geoms):
            geoms.append(mujoco.MjvGeom())
            return geoms[-1]

        decorate(next_geom, model, now)
        kinds = [g.type for g in geoms]
        triangles, lines = (kinds.count(k) for k in (mujoco.mjtGeom.mjGEOM_TRIANGLE, mujoco.mjtGeom.mjGEOM_LINE))
        counts[name] = triangles, lines, roles(now, replay.plan.names)[0][0]
    assert counts["lost"][0] == counts["blind"][0] == counts["all"][0] / 2 == 4
    assert counts["lost"][1] < 0.6 * counts["all"][1]
    assert counts["blind"][1] == counts["all"][1] - 4
    assert [words for _, _, words in counts.values()] == ["sc1 observes", "sc1 is lost", "sc1 has its camera off"]


@pytest.mark.parametrize("name", ["overview", "chase", "split", "sc2"])
def test_every_camera_gives_a_picture_that_changes_with_time_and_nothing_depends_on_what_was_drawn_before(replay, name):
    with Drawing(replay.plan, replay.path_N, camera=name, width=320, height=240) as drawing:
        first, second = drawing.draw(replay.at(300.0)), drawing.draw(replay.at(700.0))
        again = drawing.draw(replay.at(300.0))
    assert first.shape == (240, 320, 3) and first.dtype == np.uint8
    assert first.std() > 5.0 and not np.array_equal(first, second)
    assert np.array_equal(first, again)


@pytest.mark.parametrize(("width", "height", "beside"), [(640, 480, True), (480, 640, True), (480, 480, False)])
def test_beside_the_square_picture_of_a_camera_stands_the_overview(width, height, beside):
    layout = layout_of("sc1", 2, 2, width, height)
    picture = layout.cameras[0]
    assert picture.width == picture.height == min(width, height)
    assert (layout.main is not None) == beside
    if layout.main is not None:
        covered = np.zeros((height, width), int)
        for box in (picture, layout.main):
            covered[box.top : box.top + box.height, box.left : box.left + box.width] += 1
        assert (covered == 1).all()


def test_the_column_beside_a_cameras_picture_is_not_empty(replay):
    with Drawing(replay.plan, replay.path_N, camera="sc1", width=640, height=480) as drawing:
        column = drawing.draw(replay.at(600.0))[:, :160]
    assert (column[200:400].max(axis=2) > 30).mean() > 0.05  # the body


def test_a_camera_that_looks_into_space_says_so_and_one_that_sees_something_does_not(replay):
    plan = replay.plan
    sees = replay.at(600.0)
    away = replace(sees, C_BN=np.diag([1.0, -1.0, -1.0]) @ sees.C_BN)
    with Drawing(plan, replay.path_N, camera="sc1", width=400, height=400) as drawing:
        shown = [drawing.draw(now)[150:250, 100:300].astype(int) for now in (sees, away)]
    grey = (np.ptp(shown[1], axis=2) <= 2) & (shown[1].max(axis=2) > 100)
    assert 0.005 < grey.mean() < 0.2 and (shown[1][~grey].max() <= 150)
    assert not np.array_equal(shown[0], shown[1])


@pytest.mark.parametrize("most", [1, 0])
def test_a_camera_marks_spacecraft_in_view_in_a_swarm_too_large_for_names(replay, monkeypatch, most):
    for module in (picture, overlay):
        monkeypatch.setattr(module, "MAX_NAMED", most)
    with Drawing(replay.plan, replay.path_N, camera="split", width=640, height=480) as drawing:
        shown, box = drawing.draw(replay.at(replay.times[-1])), drawing._layout.cameras[1]
    inside = shown[box.top + 10 : box.top + box.height - 30, box.left + 10 : box.left + box.width - 10]
    assert 4 < (inside.max(axis=2) > 100).sum() < (1000 if most else 40)


def test_a_narrow_legend_takes_more_rows_and_none_runs_out_of_its_view():
    pixels = np.zeros((480, 640, 3), np.uint8)
    for width in (160, 250, 640):
        lettering = Lettering(pixels)
        box = Box(0, 0, width, 480)
        lettering.legend("spacecraft drawn 5,000 times as large", box)
        height = lettering.legend_height("spacecraft drawn 5,000 times as large", box)
        ink = lettering.pixels.max(axis=2) > 0
        assert ink[:, :width].any() and not ink[:, width:].any() and not ink[: 480 - height - 2].any()


def test_an_unknown_camera_and_an_impossible_size_are_clear_errors(replay):
    with pytest.raises(OutputError, match="camera 'sc3' does not exist: use overview, chase, split or sc1 to sc2"):
        Drawing(replay.plan, replay.path_N, camera="sc3")
    with pytest.raises(OutputError, match="size 20x480: both sides must be 64 to 8192"):
        Drawing(replay.plan, replay.path_N, width=20)


def test_contexts_are_released_by_closing_and_by_failing(replay, monkeypatch):
    alive = []
    make = canvas_module._gl_context

    class Counted:
        def __init__(self, width, height):
            self._context = make(width, height)
            alive.append(self)

        def make_current(self):
            self._context.make_current()

        def free(self):
            self._context.free()
            alive.remove(self)

    monkeypatch.setattr(canvas_module, "_gl_context", Counted)
    for _ in range(3):
        drawing = Drawing(replay.plan, replay.path_N, width=64, height=64)
        drawing.draw(replay.at(0.0))
        assert len(alive) == 1
        drawing.close()
        drawing.close()
        assert not alive
    with pytest.raises(ObserverError, match="closed"):
        drawing.draw(replay.at(0.0))

    def refuse(*_):
        raise mujoco.FatalError("no")

    monkeypatch.setattr(canvas_module.mujoco, "MjrContext", refuse)
    with pytest.raises(ObserverError, match="pictures need OpenGL.*FatalError: no"):
        Drawing(replay.plan, replay.path_N, width=64, height=64)
    assert not alive


FOREIGN = """
import os, threading
from swarm_mj.rendering.live import planned_path
from swarm_mj.rendering.picture import Drawing
from swarm_mj.errors import ObserverError
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario

plan = make_plan(load_scenario("eros-quick", {"observation.observer": "raycast"}))
make = lambda: Drawing(plan, planned_path(plan), width=64, height=64)
drawing, found = make(), []

def tried(word, attempt):
    try:
        attempt()
        found.append("nothing")
    except ObserverError as error:
        found.append(word if word in str(error) else error)

thread = threading.Thread(target=tried, args=("thread", drawing._canvas.clear))
thread.start()
thread.join()
child = os.fork()
if child == 0:
    tried("forked", make)
    tried("forked", drawing._canvas.clear)
    drawing.close()
    print(*found, flush=True)
    os._exit(0)
os.waitpid(child, 0)
drawing._canvas.clear()
drawing.close()
print("parent")
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_drawing_is_no_use_in_a_forked_child_or_another_thread_and_says_so(gl):
    done = subprocess.run([sys.executable, "-c", FOREIGN], capture_output=True, text=True, timeout=120)
    assert done.stdout.splitlines() == ["thread forked forked", "parent"], done.stderr


def test_the_clock_reads_minutes_and_hours():
    assert [clock(t) for t in (0.0, 59.99, 600.0, 3599.0, 3661.0)] == ["00:00", "00:59", "10:00", "59:59", "1:01:01"]


def test_a_large_swarm_is_counted_and_drawn(replay):
    now = replay.at(500.0)
    many = {name: np.repeat(getattr(now, name), 10, axis=0) for name in ("r_BN_N", "C_BN", "kind", "tracked", "lost")}
    now = replace(now, **many, link=None, trail_N=np.repeat(now.trail_N, 10, axis=1))
    assert [words for words, _ in roles(now, [f"sc{k}" for k in range(20)])] == ["20 x observes"]
