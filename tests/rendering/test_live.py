"""The live view: the flight in it is the flight of `swarm-mj run`, and its window opens and closes."""

import json
import os
import shutil
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from mujoco.studio import messages

from swarm_mj.errors import ObserverError, OutputError
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.rendering import viewer
from swarm_mj.rendering.cameras import overview
from swarm_mj.rendering.decorations import decorate
from swarm_mj.rendering.live import SPEEDS, LiveFlight, Player, Trail, planned_path
from swarm_mj.rendering.model import build_drawing_model
from swarm_mj.rendering.transfers import words
from swarm_mj.rendering.web_viewer import (
    LIFT,
    MAX_GEOMS,
    FlightPanel,
    model_for_browser,
    observed_patches,
    paint_cells,
    show_in_browser,
)
from swarm_mj.scenarios.loading import load_scenario

WINDOW = """
from swarm_mj.rendering.cameras import magnification_for, overview
from swarm_mj.rendering.live import LiveFlight, Player, planned_path
from swarm_mj.rendering.model import build_drawing_model
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.rendering.viewer import show_in_window

plan = make_plan(load_scenario("eros-quick"))
player = Player(LiveFlight(plan), 100.0)
view = overview(plan, planned_path(plan), 1.5)
pictures = iter(range(20))
show_in_window(
    build_drawing_model(plan, magnification_for(plan, view.distance)), player, view.camera(), lambda: next(pictures) < 19
)
print("flown to", player.now.t)
"""


def test_a_live_flight_is_the_recorded_one_and_sees_what_that_saw(flown, replay):
    plan, telemetry, result = flown
    flight = LiveFlight(plan)
    senders = set()
    while not flight.over:
        flight.step()
        if flight.time % 30.0 == 0.0:
            closed = flown[1]["link_closed"].sel(time=flight.time).values == 1
            now = flight.instant()
            assert np.array_equal(now.link, closed)
            for sender, receiver in () if now.traffic is None else now.traffic.links:
                senders.add(sender)
                assert closed[sender] and now.kind[sender] == (
                    TargetKind.EARTH if receiver < 0 else TargetKind.SPACECRAFT
                )
        if flight.time in (300.0, 630.0, 900.0):
            now, recorded = flight.instant(), replay.at(flight.time)
            assert np.allclose(now.r_BN_N, recorded.r_BN_N, atol=1e-6)
            assert np.allclose(now.C_BN, recorded.C_BN, atol=1e-9)
            assert np.array_equal(now.kind, recorded.kind)
            assert np.allclose(now.sight_length, recorded.sight_length)
            assert np.array_equal(now.seen, recorded.seen)
    assert flight.time == plan.scenario.duration_s
    flight.step()
    assert flight.time == plan.scenario.duration_s
    assert np.array_equal(flight.instant().seen, result.coverage.seen)
    assert senders == {0, 1} and words(flight.instant().traffic) == []


def test_the_planned_path_is_the_one_flown(flown, replay):
    plan, _, _ = flown
    assert np.abs(planned_path(plan) - replay.path_N).max() < 1.0


def test_a_player_keeps_to_its_speed_pauses_and_begins_again(flown):
    player = Player(LiveFlight(flown[0]), 10.0)
    for _ in range(8):
        player.advance(0.25, budget=60.0)
    assert player.now.t == 20.0
    player.paused = True
    player.advance(5.0, budget=60.0)
    assert player.now.t == 20.0
    player.paused, player.restart_asked = False, True
    player.advance(0.1, budget=60.0)
    assert player.now.t == 1.0 and len(player.now.trail_N) <= 3
    player.change_speed(1)
    assert player.speed == 20.0
    player.change_speed(-9)
    assert player.speed == SPEEDS[0]


def test_a_trail_forgets_the_future_when_time_goes_back(flown):
    trail = Trail(flown[0])
    for t in np.arange(0.0, 600.0, 7.0):
        points = trail.to(t, np.full((2, 3), t))
    assert points[0, 0, 0] == 0.0 and points[-1, 0, 0] == 595.0
    back = trail.to(100.0, np.full((2, 3), 100.0))
    assert back.max() == 100.0 and (np.diff(back[:, 0, 0]) > 0.0).all()


def test_the_status_tells_time_speed_share_and_roles(flown):
    class Model:
        magnification = 5000.0

    player = Player(LiveFlight(flown[0]), 10.0)
    labels, values = viewer.status(Model(), player)
    shown = dict(zip(labels.split("\n"), values.split("\n"), strict=True))
    assert shown["time"] == "00:00" and shown["speed"] == "10 x" and shown["observed"].endswith("%")
    assert shown["sc1"] == "observes" and shown["drawn"] == "5,000 times as large"
    player.paused = True
    assert "paused" in viewer.status(Model(), player)[1]


def test_keys_pause_and_change_speed(flown):
    player = Player(LiveFlight(flown[0]), 10.0)
    press = viewer._keys(player)
    press(ord(" "))
    press(ord("="))
    press(ord("R"))
    assert player.paused and player.speed == 20.0 and player.restart_asked
    press(ord("-"))
    press(ord(" "))
    assert not player.paused and player.speed == 10.0


def test_without_a_display_the_browser_is_used_and_bad_speeds_are_refused(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not viewer.has_display()
    monkeypatch.setenv("DISPLAY", ":1")
    assert viewer.has_display()
    with pytest.raises(OutputError, match="speed 0.5: must be 1 to 100"):
        viewer.run_view(load_scenario("eros-quick"), speed=0.5)


def test_a_display_that_cannot_be_opened_is_a_clear_error(flown, monkeypatch):
    glfw = pytest.importorskip("glfw")
    monkeypatch.setattr(glfw, "init", lambda: False)
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(ObserverError, match="cannot open a window here.*:4711.*--web"):
        viewer.show_in_window(None, None, None)


def browser_view(flown, port, go_on, **where):
    plan, _, _ = flown
    player = Player(LiveFlight(plan), 100.0)
    view = overview(plan, planned_path(plan), 1.5)
    show_in_browser(build_drawing_model(plan, 5000.0), player, view, port, go_on=go_on, **where)
    return player


def free_port():
    with socket.socket() as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


def test_the_web_viewer_serves_its_page_while_the_flight_goes_on(flown):
    port, pages = free_port(), []

    def go_on():
        # The server starts in a thread of its own.
        with suppress(urllib.error.URLError), urllib.request.urlopen(f"http://localhost:{port}/", timeout=20) as answer:
            pages.append(answer.read())
        return len(pages) < 5

    player = browser_view(flown, port, go_on)
    assert b"<html" in pages[0].lower()
    assert player.now.t > 0.0


def lies_at(camera, view):
    wanted = view.camera()
    return np.allclose([*camera.lookat, camera.distance], [*wanted.lookat, wanted.distance], rtol=1e-6) and np.allclose(
        [camera.azimuth, camera.elevation], [wanted.azimuth, wanted.elevation], atol=1e-4
    )


def test_a_page_that_is_loaded_anew_does_not_move_the_web_viewers_camera(flown, monkeypatch):
    client_camera = pytest.importorskip("mujoco.studio.web.client_camera")
    state_payload = pytest.importorskip("mujoco.studio.web.state_payload")
    plan, _, _ = flown
    view, player = overview(plan, planned_path(plan), 1.5), Player(LiveFlight(plan), 10.0)
    panel = FlightPanel(build_drawing_model(plan, 5000.0), player, view)
    panel.viewer = SimpleNamespace(camera=mujoco.MjvCamera(), extra_geoms=[])
    monkeypatch.setattr("swarm_mj.rendering.web_viewer.ux.setup_theme", lambda _: None)  # crashes without a window
    pages = client_camera.ClientCameraSync()
    for _ in range(3):
        panel.on_update(messages.UpdateEvent())
        pages.update_generation(panel.viewer.camera)
    assert lies_at(panel.viewer.camera, view)
    # A page begins with the first camera of the model and with the number 0 for changes that it has heard of.
    own = mujoco.MjvCamera()
    own.distance = 20_000.0
    assert not pages.apply(panel.viewer.camera, state_payload.serialize_client_camera(own, 0))
    assert lies_at(panel.viewer.camera, view)


def test_the_web_viewers_first_picture_is_the_overview_and_cells_clear_its_depth_buffer(flown):
    plan, _, _ = flown
    view = overview(plan, planned_path(plan), 1.5)
    model = build_drawing_model(plan, 5000.0)
    shown, first = model_for_browser(model, view), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(shown, first)
    assert lies_at(first, view)
    near = shown.vis.map.znear * shown.stat.extent
    far_side = view.distance + plan.shape.max_radius
    assert far_side**2 / (near * 2**24) < 0.1 * LIFT * plan.shape.max_radius
    assert model.mjmodel.stat.extent == plan.shape.max_radius  # lines are drawn to this scale


#: Shows a flight and prints whether another address of this machine answered. MuJoCo's web viewer can be opened once a process.
LISTENING = """
import json, socket, sys
from contextlib import suppress
from swarm_mj.rendering.cameras import overview
from swarm_mj.rendering.live import LiveFlight, Player, planned_path
from swarm_mj.rendering.model import build_drawing_model
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.rendering.web_viewer import show_in_browser

port, where = int(sys.argv[1]), json.loads(sys.argv[2])
plan, answers = make_plan(load_scenario("eros-quick", ["observation.observer=raycast"])), []

def answered(address):
    with suppress(OSError), socket.create_connection((address, port), timeout=5):
        return True
    return False

def go_on():
    if answered("127.0.0.1"):
        answers.append(answered("127.0.0.2"))
    return len(answers) < 3

view = overview(plan, planned_path(plan), 1.5)
show_in_browser(build_drawing_model(plan, 5000.0), Player(LiveFlight(plan), 100.0), view, port, go_on=go_on, **where)
print("answered", *answers)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other addresses of the loopback are not set up elsewhere")
@pytest.mark.parametrize(("where", "reached"), [({}, False), ({"host": "0.0.0.0"}, True)])
def test_the_web_viewer_listens_on_this_machine_alone_unless_asked_for_more(where, reached):
    command = [sys.executable, "-c", LISTENING, str(free_port()), json.dumps(where)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert f"answered {reached} {reached} {reached}" in done.stdout, done.stderr


def test_an_address_of_another_machine_is_refused_by_name(flown):
    with pytest.raises(ObserverError, match="--host '192.0.2.1': cannot be listened on.*127.0.0.1"):
        browser_view(flown, 0, lambda: False, host="192.0.2.1")


@pytest.mark.parametrize("port", [-5, 65_536])
def test_a_port_that_does_not_exist_is_refused_before_the_flight_is_prepared(port, monkeypatch):
    monkeypatch.setattr("swarm_mj.rendering.viewer.make_plan", lambda _: pytest.fail("the flight was prepared"))
    with pytest.raises(OutputError, match=f"--port {port}: must be 0.* to 65535"):
        viewer.run_view(load_scenario("eros-quick"), web=True, port=port)


def test_an_address_of_another_machine_is_refused_before_the_flight_is_prepared(monkeypatch):
    monkeypatch.setattr("swarm_mj.rendering.viewer.make_plan", lambda _: pytest.fail("the flight was prepared"))
    with pytest.raises(ObserverError, match="--host '192.0.2.1'"):
        viewer.run_view(load_scenario("eros-quick"), web=True, host="192.0.2.1")


@pytest.mark.parametrize("where", [{"port": 8123}, {"host": "127.0.0.1"}])
def test_an_address_for_the_browser_asks_for_the_browser(where, flown, monkeypatch):
    shown, plan = [], flown[0]
    monkeypatch.setenv("DISPLAY", ":1")
    monkeypatch.setattr("swarm_mj.rendering.viewer.make_plan", lambda _: plan)
    monkeypatch.setattr("swarm_mj.rendering.web_viewer.show_in_browser", lambda *given: shown.append(given[3:]))
    viewer.run_view(plan.scenario, **where)
    assert shown == [(where.get("port", 0), "127.0.0.1")]


def test_a_port_in_use_is_a_clear_error(flown):
    with socket.socket(socket.AF_INET6) as taken:
        taken.bind(("::", 0))
        taken.listen()
        with pytest.raises(ObserverError, match="web viewer cannot be started.*in use"):
            browser_view(flown, taken.getsockname()[1], lambda: True)


def test_a_target_of_many_cells_leaves_room_for_the_lines_and_shows_all_that_was_observed(monkeypatch):
    plan = make_plan(load_scenario("eros-faults"))
    region, flight = plan.region, LiveFlight(plan)
    assert region.n_cells > MAX_GEOMS
    player = Player(flight, 10.0)
    player.now = replace(flight.instant(), seen=np.ones(region.n_cells, bool))
    model = build_drawing_model(plan, 5000.0)
    panel = FlightPanel(model, player, overview(plan, planned_path(plan), 1.5))
    panel.viewer = SimpleNamespace(camera=mujoco.MjvCamera(), extra_geoms=[])
    monkeypatch.setattr("swarm_mj.rendering.web_viewer.ux.setup_theme", lambda _: None)  # crashes without a window
    panel.on_update(messages.UpdateEvent())
    geoms, lines = panel.viewer.extra_geoms, []
    decorate(lambda: lines.append(mujoco.MjvGeom()) or lines[-1], model, player.now)
    kinds = [geom.type for geom in geoms]
    assert (
        kinds.count(mujoco.mjtGeom.mjGEOM_LINE) == [geom.type for geom in lines].count(mujoco.mjtGeom.mjGEOM_LINE) > 0
    )
    patches = geoms[len(lines) :]
    area = sum(0.5 * np.linalg.norm(np.cross(*np.array(geom.mat, float).T[:2])) for geom in patches)
    assert len(patches) == region.n_faces and area == pytest.approx(region.total_area, rel=1e-5)
    # Where there is no room for all, the panel says how many are missing.
    assert panel.unpainted == 0
    panel._patches = np.tile(panel._patches, (1 + 2 * MAX_GEOMS // len(patches), 1, 1))
    panel.on_update(messages.UpdateEvent())
    assert len(panel.viewer.extra_geoms) == MAX_GEOMS
    assert panel.unpainted == len(panel._patches) - (MAX_GEOMS - len(lines)) > 0


def test_patches_cover_just_the_observed_cells_outward(rng):
    region = make_plan(load_scenario("eros-quick", ["target.cell_size_m=600"])).region
    seen = rng.random(region.n_cells) < 0.8
    patches = observed_patches(region, seen)
    double = np.cross(patches[:, 1] - patches[:, 0], patches[:, 2] - patches[:, 0])
    assert len(patches) < seen.sum()
    assert 0.5 * np.linalg.norm(double, axis=1).sum() == pytest.approx(region.area[seen].sum(), rel=1e-9)
    assert (np.einsum("ij,ij->i", double, patches.mean(axis=1)) > 0.0).mean() > 0.95  # few faces lean inwards


def test_observed_cells_are_painted_a_little_above_the_ground_facing_out(flown):
    plan, _, _ = flown
    now = replace(LiveFlight(plan).instant(), seen=np.arange(plan.region.n_cells) % 3 == 0)
    geoms = []

    def next_geom():
        geoms.append(mujoco.MjvGeom())
        return geoms[-1]

    paint_cells(next_geom, observed_patches(plan.region, now.seen), now)
    assert len(geoms) == now.seen.sum()
    for geom, corners, normal in zip(
        geoms, plan.region.corners_A[now.seen], plan.region.normal_A[now.seen], strict=True
    ):
        shear, centre = np.array(geom.mat, float), corners.mean(axis=0) @ now.C_AN
        middle = np.array(geom.pos, float) + (shear[:, 0] + shear[:, 1]) / 3.0
        normal_N = normal @ now.C_AN
        assert 0.0 < (middle - centre) @ normal_N < 200.0
        front = np.cross(shear[:, 0], shear[:, 1])
        assert front @ normal_N > 0.999 * np.linalg.norm(front)


@pytest.mark.gl
@pytest.mark.slow
def test_the_window_opens_flies_and_closes(tmp_path):
    if shutil.which("Xvfb") is None:
        pytest.skip("needs Xvfb, a display server without a display")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "800x600x24"], pass_fds=(write,), stderr=subprocess.DEVNULL
    )
    try:
        os.close(write)
        display = f":{os.read(read, 16).decode().strip()}"
        environment = {**os.environ, "DISPLAY": display}
        environment.pop("MUJOCO_GL", None)
        done = subprocess.run(
            [sys.executable, "-c", WINDOW], env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=180
        )
    finally:
        os.close(read)
        server.terminate()
        server.wait()
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split("flown to ")[1]) > 0.0
