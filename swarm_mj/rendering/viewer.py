"""The command `swarm-mj view`: a flight in MuJoCo's own viewer, with speed, pause and the drawing of the videos."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import closing, suppress
from functools import partial
from typing import Any

import mujoco
from rich.console import Console

from swarm_mj.errors import ObserverError, OutputError
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.coverage import percent_text
from swarm_mj.rendering.cameras import magnification_for, overview, reach_of
from swarm_mj.rendering.decorations import decorate
from swarm_mj.rendering.live import SPEEDS, LiveFlight, Player, pace, planned_path
from swarm_mj.rendering.model import DrawingModel, build_drawing_model
from swarm_mj.rendering.overlay import clock, roles
from swarm_mj.rendering.transfers import RADIUS, draw_transfers
from swarm_mj.scenarios.schema import Scenario

#: Time that the window may take to close [s].
CLOSING_S = 10.0
#: How far one may zoom out of the first view before things are cut off.
ZOOM_OUT = 10.0
#: Width of the window over its height, for which the first view is chosen.
ASPECT = 1.5
#: Keys of the native viewer, by GLFW's codes.
PAUSE, FASTER, SLOWER, RESTART = (32,), (61, 334), (45, 333), (82,)
HELP = "space pause, + and - speed, R restart, mouse turns and zooms, [ and ] cameras"


def run_view(scenario: Scenario, *, speed: float = 10.0) -> None:
    """Fly a scenario in MuJoCo's viewer until its window is closed.

    Args:
        scenario: What to fly.
        speed: Seconds of flight per second at the start.

    Raises:
        SwarmError: The scenario cannot be flown.
        ObserverError: No window can be opened here.
        OutputError: The speed is out of range.
    """
    if not SPEEDS[0] <= speed <= SPEEDS[-1]:
        raise OutputError(f"speed {speed:g}: must be {SPEEDS[0]:g} to {SPEEDS[-1]:g} seconds of flight per second")
    check_window()
    console = Console()
    console.print(f"{scenario.name}: preparing the flight (compiles on first use)", markup=False, highlight=False)
    plan = make_plan(scenario)
    path_N = planned_path(plan)
    view = overview(plan, path_N, ASPECT)
    reach = ZOOM_OUT * reach_of(path_N, view)
    model = build_drawing_model(plan, magnification_for(plan, view.distance), reach=reach)
    with closing(LiveFlight(plan)) as flight, suppress(KeyboardInterrupt):
        player = Player(flight, speed)
        model.place(player.now)
        console.print(HELP, markup=False, highlight=False)
        show_in_window(model, player, view.camera())


def check_window() -> None:
    """Refuse where no window can be opened; MuJoCo's viewer would end the process instead.

    Raises:
        ObserverError: There is no display, or, on macOS, the program was not started by MuJoCo's launcher.
    """
    if sys.platform == "darwin" and "MJPYTHON_BIN" not in os.environ:
        reason = "on macOS MuJoCo opens windows under its own launcher alone: mjpython -m swarm_mj view"
    else:
        try:
            import mujoco.viewer

            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if mujoco.viewer.glfw.init():
                    return
            reason = f"DISPLAY={os.environ.get('DISPLAY', '')!r}"
        except (ImportError, RuntimeError) as error:
            reason = str(error)
    raise ObserverError(
        f"MuJoCo's viewer cannot open a window here ({reason}); "
        "`swarm-mj fly` writes a report that replays the flight in a browser, `swarm-mj video` a film"
    )


def show_in_window(
    model: DrawingModel, player: Player, camera: mujoco.MjvCamera, go_on: Callable[[], bool] = lambda: True
) -> None:
    """Show a flight in MuJoCo's native viewer until its window is closed, or `go_on`, asked before every picture, says no."""
    import mujoco.viewer

    others = set(threading.enumerate())
    handle = mujoco.viewer.launch_passive(
        model.mjmodel, model.data, key_callback=partial(_press, player), show_left_ui=False, show_right_ui=False
    )
    try:
        with handle:
            with handle.lock():
                handle.cam.lookat[:], handle.cam.distance = camera.lookat, camera.distance
                handle.cam.azimuth, handle.cam.elevation = camera.azimuth, camera.elevation
            pace(player, lambda: handle.is_running() and go_on(), lambda: _update(handle, model, player))
    finally:
        # The window's thread still uses the model; if that is freed before the thread ends, the process crashes.
        for thread in set(threading.enumerate()) - others:
            thread.join(CLOSING_S)


def _press(player: Player, key: int) -> None:
    if key in PAUSE:
        player.paused = not player.paused
    elif key in FASTER:
        player.change_speed(1)
    elif key in SLOWER:
        player.change_speed(-1)
    elif key in RESTART:
        player.restart_asked = True


def _update(handle: Any, model: DrawingModel, player: Player) -> None:
    """Bring a window to what there is to draw now."""
    now, scene = player.now, handle.user_scn
    with handle.lock():
        changed = model.place(now)
        scene.ngeom = 0
        geoms = scene.geoms

        def next_geom() -> mujoco.MjvGeom | None:
            if scene.ngeom >= scene.maxgeom:
                return None
            scene.ngeom += 1
            return geoms[scene.ngeom - 1]

        decorate(next_geom, model, now)
        packet_m = RADIUS * model.magnification * max(player.flight.plan.properties.size)
        draw_transfers(next_geom, now, float(model.mjmodel.stat.extent), packet_m)
    if changed:
        handle.update_texture(model.texture)
    left, right = status(model, player)
    place, font = mujoco.mjtGridPos, mujoco.mjtFontScale.mjFONTSCALE_100
    handle.set_texts([(font, place.mjGRID_TOPLEFT, left, right), (font, place.mjGRID_BOTTOMLEFT, HELP, "")])
    handle.sync()


def status(model: DrawingModel, player: Player) -> tuple[str, str]:
    """Two columns of lines: time, speed, observed share, and what each spacecraft does."""
    now, plan = player.now, player.flight.plan
    share = 100.0 * float(plan.region.weighted_area[now.seen].sum() / plan.region.total_weighted_area)
    pace = "over" if player.flight.over else "paused" if player.paused else f"{player.speed:g} x"
    rows = [("time", clock(now.t)), ("speed", pace), ("observed", percent_text(share))]
    for text, _ in roles(now, plan.names):
        who, _, what = text.partition(" ")
        rows.append((who, what))
    rows.append(("drawn", f"{model.magnification:,.0f} times as large"))
    return "\n".join(row[0] for row in rows), "\n".join(row[1] for row in rows)
