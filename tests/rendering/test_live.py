"""The live view: the flight in it is the flight of `swarm-mj fly`, and its window opens and closes."""

import os
import shutil
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from swarm_mj.errors import ObserverError, OutputError
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.rendering import viewer
from swarm_mj.rendering.live import SPEEDS, LiveFlight, Player, Trail, planned_path
from swarm_mj.rendering.transfers import words
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
    press = partial(viewer._press, player)
    press(ord(" "))
    press(ord("="))
    press(ord("R"))
    assert player.paused and player.speed == 20.0 and player.restart_asked
    press(ord("-"))
    press(ord(" "))
    assert not player.paused and player.speed == 10.0


def test_bad_speeds_are_refused():
    with pytest.raises(OutputError, match="speed 0.5: must be 1 to 100"):
        viewer.run_view(load_scenario("eros-quick"), speed=0.5)


def test_without_a_window_the_message_says_what_shows_the_flight(monkeypatch):
    monkeypatch.setattr(viewer, "make_plan", lambda _: pytest.fail("the flight was prepared"))
    glfw = pytest.importorskip("glfw")
    monkeypatch.setattr(glfw, "init", lambda: False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(ObserverError, match="cannot open a window here.*:4711.*report.*in a browser.*swarm-mj video"):
        viewer.run_view(load_scenario("eros-quick"))
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.delenv("MJPYTHON_BIN", raising=False)
    with pytest.raises(ObserverError, match="mjpython -m swarm_mj view"):
        viewer.run_view(load_scenario("eros-quick"))


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
