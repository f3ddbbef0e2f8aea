"""MuJoCo's web viewer with a flight in it: the program computes, a browser draws.

The browser gets the model once and the state at each picture. What changes besides, the observed cells and the lines, is
sent along as geoms; the controls stand in a panel of the viewer's own.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
from mujoco.studio import launch_web, messages, plugin, ux, viewer_protocol
from mujoco.studio.dear_imgui import dear_imgui as gui

from swarm_mj.drawing.cameras import FreeView
from swarm_mj.drawing.decorations import NextGeom, decorate, triangle
from swarm_mj.drawing.instant import Instant
from swarm_mj.drawing.lettering import clock, roles
from swarm_mj.drawing.live import SPEEDS, Player, pace
from swarm_mj.drawing.model import DrawingModel
from swarm_mj.drawing.palette import SEEN, rgba
from swarm_mj.errors import ObserverError
from swarm_mj.mission.target import TargetRegion

#: Most geoms that the viewer sends besides the model.
MAX_GEOMS = 1024
#: Height of a painted cell above the ground over the body's radius, so that it is not hidden by that.
LIFT = 4e-3


class FlightPanel(plugin.ViewerPlugin):
    """Draws what the model does not hold, and the controls.

    Args:
        model: What is drawn.
        player: The flight.
        view: From where at first.
    """

    def __init__(self, model: DrawingModel, player: Player, view: FreeView) -> None:
        self._model, self._player, self._view = model, player, view
        self._placed = False

    @messages.handler
    def on_update(self, _: messages.UpdateEvent) -> None:
        """Before each picture: place the camera once, renew the geoms."""
        if not self._placed:
            ux.setup_theme(ux.GuiTheme.DARK)  # the colours of the modes are made for a dark ground
            camera, first = self.viewer.camera, self._view.camera()
            camera.lookat[:], camera.distance = first.lookat, first.distance
            camera.azimuth, camera.elevation = first.azimuth, first.elevation
            self._placed = True
        geoms: list[mujoco.MjvGeom] = []

        def next_geom() -> mujoco.MjvGeom | None:
            if len(geoms) >= MAX_GEOMS:
                return None
            geoms.append(mujoco.MjvGeom())
            return geoms[-1]

        now = self._player.now
        paint_cells(next_geom, self._player.flight.plan.region, now)
        decorate(next_geom, self._model, now)
        self.viewer.extra_geoms[:] = geoms

    @messages.handler
    def on_build_gui(self, _: messages.BuildGuiEvent) -> None:
        """The panel: time, observed share, who does what, pause, speed, restart."""
        player = self._player
        now, plan = player.now, player.flight.plan
        gui.SetNextWindowPos(gui.Vec2(12, 12), int(gui.Cond.FirstUseEver))
        gui.SetNextWindowSize(gui.Vec2(330, 330), int(gui.Cond.FirstUseEver))
        if gui.Begin("Flight")[0]:
            share = float(plan.region.area[now.seen].sum() / plan.region.total_area)
            gui.TextUnformatted(f"{plan.scenario.name}   {clock(now.t)}{'   over' if player.flight.over else ''}")
            gui.ProgressBar(share, gui.Vec2(-1, 0), f"{100.0 * share:.1f} % observed")
            if gui.Button("Go on" if player.paused else "Pause"):
                player.paused = not player.paused
            gui.SameLine()
            if gui.Button("Restart"):
                player.restart_asked = True
            _, player.speed = gui.SliderFloat("x real time", player.speed, SPEEDS[0], SPEEDS[-1], "%.0f")
            for text, colour in roles(now, plan.names):
                gui.TextColored(gui.Vec4(*rgba(colour)), text)
            gui.TextUnformatted(f"spacecraft drawn {self._model.magnification:,.0f} times as large")
        gui.End()


def paint_cells(next_geom: NextGeom, region: TargetRegion, now: Instant) -> None:
    """Cover the observed cells with triangles, a little above the ground."""
    lift = LIFT * region.mesh.max_radius
    for corners in ((region.corners_A + lift * region.normal_A[:, None]) @ now.C_AN)[now.seen]:
        triangle(next_geom, corners, rgba(SEEN))


def show_in_browser(
    model: DrawingModel, player: Player, view: FreeView, port: int, go_on: Callable[[], bool] = lambda: True
) -> None:
    """Show a flight in MuJoCo's web viewer until interrupted.

    Args:
        model: What is drawn.
        player: The flight.
        view: From where at first.
        port: 0: the first free one from 8080.
        go_on: Asked before every picture; False closes the viewer.

    Raises:
        ObserverError: The viewer cannot be started.
    """
    config = viewer_protocol.ViewerConfig(title="swarm-mj", gfx="web", http_port=port, open_browser=True)
    mjmodel, data = model.mjmodel, model.data

    def show() -> None:
        model.place(player.now)
        handle.sync(mjmodel, data)

    try:
        with launch_web.launch(config, plugins=[FlightPanel(model, player, view)]) as handle:
            pace(player, lambda: handle.is_running() and go_on(), show)
    except (OSError, RuntimeError) as error:  # of the server's thread
        raise ObserverError(f"MuJoCo's web viewer cannot be started: {error}") from error
