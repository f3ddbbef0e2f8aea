"""MuJoCo's web viewer with a flight in it: the program computes, a browser draws.

The browser gets the model once and the state at each picture. What changes besides, the observed cells and the lines, is
sent along as geoms; the controls stand in a panel of the viewer's own.
"""

from __future__ import annotations

import copy
import socket
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco.studio import endpoints, launch_thread, messages, plugin, ux, viewer_protocol
from mujoco.studio.dear_imgui import dear_imgui as gui

from swarm_mj.errors import ObserverError, OutputError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.rendering.cameras import FreeView
from swarm_mj.rendering.decorations import NextGeom, decorate, triangle
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.live import SPEEDS, Player, pace, planned_path
from swarm_mj.rendering.model import DrawingModel
from swarm_mj.rendering.overlay import clock, roles
from swarm_mj.rendering.palette import SEEN, rgba
from swarm_mj.rendering.transfers import RADIUS, draw_transfers
from swarm_mj.typing import Array, Mask

#: Most geoms that the viewer sends besides the model.
MAX_GEOMS = 1024
#: Height of a painted cell above the ground over the body's radius, so that it is not hidden by that.
LIFT = 4e-3
#: Near clipping plane over the body's radius: a browser's depth buffer is too coarse for a nearer one.
NEAR = 1e-2
#: Distance of MuJoCo's own first camera over the extent of a model.
FIRST_DISTANCE = 1.5
#: Size of the panel, and its distance from the window's edge [pixel].
PANEL, MARGIN = (330.0, 330.0), 12.0
#: Only browsers on this machine can connect.
LOOPBACK = "127.0.0.1"
#: Highest number of a TCP port.
LAST_PORT = 65_535


class FlightPanel(plugin.ViewerPlugin):
    """Draws what the model does not hold, and the controls.

    Args:
        model: What is drawn.
        player: The flight.
        view: From where at first.

    Attributes:
        unpainted: Observed faces for which there is no room.
    """

    def __init__(self, model: DrawingModel, player: Player, view: FreeView) -> None:
        self._model, self._player, self._view = model, player, view
        self._updates, self._width, self.unpainted = 0, 0.0, 0
        self._seen: Mask | None = None
        self._patches: Array = np.empty((0, 3, 3))
        self._on_the_right = _is_busier_on_the_left(view, planned_path(player.flight.plan))

    @messages.handler
    def on_update(self, _: messages.UpdateEvent) -> None:
        """Before each picture: place the camera at the start, renew the geoms."""
        if self._updates == 0:
            ux.setup_theme(ux.GuiTheme.DARK)  # the colours of the modes are made for a dark ground
        elif self._updates == 1:
            # Only what the program changes between two pictures is its camera; before that, the first camera that a page
            # sends, also one that was loaded anew, counts as chosen by hand.
            camera, first = self.viewer.camera, self._view.camera()
            camera.lookat[:], camera.distance = first.lookat, first.distance
            camera.azimuth, camera.elevation = first.azimuth, first.elevation
        self._updates += 1
        geoms: list[mujoco.MjvGeom] = []

        def next_geom() -> mujoco.MjvGeom | None:
            if len(geoms) >= MAX_GEOMS:
                return None
            geoms.append(mujoco.MjvGeom())
            return geoms[-1]

        now = self._player.now
        decorate(next_geom, self._model, now)
        extent_m, size_m = float(self._model.mjmodel.stat.extent), max(self._player.flight.plan.properties.size)
        draw_transfers(next_geom, now, extent_m, RADIUS * self._model.magnification * size_m)
        if self._seen is None or not np.array_equal(now.seen, self._seen):
            self._seen = now.seen.copy()
            self._patches = observed_patches(self._player.flight.plan.region, now.seen)
        self.unpainted = max(0, len(self._patches) - (MAX_GEOMS - len(geoms)))
        paint_cells(next_geom, self._patches, now)
        self.viewer.extra_geoms[:] = geoms

    @messages.handler
    def on_build_gui(self, _: messages.BuildGuiEvent) -> None:
        """The panel: time, observed share, who does what, pause, speed, restart."""
        player = self._player
        now, plan = player.now, player.flight.plan
        width = float(gui.GetIO().DisplaySize.x)
        left = width - PANEL[0] - MARGIN if self._on_the_right else MARGIN
        # A page tells its size only after the first pictures, and anew when it changes.
        when = gui.Cond.FirstUseEver if width == self._width else gui.Cond.Always
        self._width = width
        gui.SetNextWindowPos(gui.Vec2(left, MARGIN), int(when))
        gui.SetNextWindowSize(gui.Vec2(*PANEL), int(gui.Cond.FirstUseEver))
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
            if self.unpainted:
                gui.TextUnformatted(f"{self.unpainted:,} observed faces not painted: too many for a browser")
        gui.End()


def _is_busier_on_the_left(view: FreeView, path_N: Array) -> bool:
    """Whether more of a flight, shape (m, n, 3) [m], is in the upper left of a view than in the upper right."""
    right, up = view.offsets(path_N.reshape(-1, 3)).T
    return bool(((right < 0.0) & (up > 0.0)).sum() > ((right > 0.0) & (up > 0.0)).sum())


def model_for_browser(model: DrawingModel, view: FreeView) -> mujoco.MjModel:
    """A copy of the model whose own first camera, which a page shows until it hears from the program, is a view."""
    shown, radius, camera = copy.deepcopy(model.mjmodel), float(model.mjmodel.stat.extent), view.camera()
    shown.stat.center[:], shown.stat.extent = camera.lookat, camera.distance / FIRST_DISTANCE
    shown.vis.global_.azimuth, shown.vis.global_.elevation = camera.azimuth, camera.elevation
    shown.vis.map.znear = NEAR * radius / shown.stat.extent
    return shown


def paint_cells(next_geom: NextGeom, patches_A: Array, now: Instant) -> None:
    """Cover the observed cells with triangles, corners in A, shape (k, 3, 3) [m]."""
    for corners in patches_A @ now.C_AN:
        triangle(next_geom, corners, rgba(SEEN))


def observed_patches(region: TargetRegion, seen: Mask) -> Array:
    """Triangles above the observed cells, one for a face of which all cells are, corners in A, shape (k, 3, 3) [m].

    A viewer takes few geoms, a target may have more cells.
    """
    whole = np.bincount(region.group, ~seen) == 0
    single = seen & ~whole[region.group]
    first = np.searchsorted(region.group, np.flatnonzero(whole))
    corners = np.concatenate(([face_corners(region, int(cell)) for cell in first], region.corners_A[single]), axis=None)
    normals = np.vstack((region.normal_A[first], region.normal_A[single]))
    return np.asarray(corners.reshape(-1, 3, 3) + LIFT * region.mesh.max_radius * normals[:, None])


def face_corners(region: TargetRegion, cell: int) -> Array:
    """Corners in A of the face of F_T that a cell lies in, counter-clockwise seen from outside, shape (3, 3) [m]."""
    points = region.corners_A[region.group == region.group[cell]].reshape(-1, 3)
    first = points[np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1))]
    second = points[np.argmax(np.linalg.norm(points - first, axis=1))]
    normals = np.cross(second - first, points - first)
    place = int(np.argmax(np.linalg.norm(normals, axis=1)))
    order = (first, second, points[place])
    return np.array(order if normals[place] @ region.normal_A[cell] > 0.0 else (order[1], order[0], order[2]))


def show_in_browser(
    model: DrawingModel,
    player: Player,
    view: FreeView,
    port: int,
    host: str = LOOPBACK,
    go_on: Callable[[], bool] = lambda: True,
) -> None:
    """Show a flight in MuJoCo's web viewer until interrupted.

    Args:
        model: What is drawn.
        player: The flight.
        view: From where at first.
        port: 0: the first free one from 8080.
        host: Address of this machine to listen on; by default nobody else can connect.
        go_on: Asked before every picture; False closes the viewer.

    Raises:
        ObserverError: The viewer cannot be started.
        OutputError: There is no such port.
    """
    check_address(host, port)
    config = viewer_protocol.ViewerConfig(title="swarm-mj", gfx="web", http_port=port, open_browser=True)
    mjmodel, data = model_for_browser(model, view), model.data

    def show() -> None:
        model.place(player.now)
        handle.sync(mjmodel, data)

    try:
        with _launch(config, host, FlightPanel(model, player, view)) as handle:
            pace(player, lambda: handle.is_running() and go_on(), show)
    except (OSError, RuntimeError) as error:  # of the server's thread
        raise ObserverError(f"MuJoCo's web viewer cannot be started: {error}") from error


def check_address(host: str, port: int) -> None:
    """Refuse an address that is not this machine's and a port that does not exist; MuJoCo would say that it is in use.

    Raises:
        OutputError: There is no such port.
        ObserverError: Nothing can be served on the address.
    """
    if not 0 <= port <= LAST_PORT:
        raise OutputError(f"--port {port}: must be 0, for the first free one from 8080, to {LAST_PORT}")
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
            probe.bind((host, 0))
    except (OSError, UnicodeError) as error:
        raise ObserverError(
            f"--host {host!r}: cannot be listened on ({error}); give {LOOPBACK} for browsers on this machine, 0.0.0.0 for "
            "everybody, or an address of this machine"
        ) from None


def _launch(config: viewer_protocol.ViewerConfig, host: str, panel: FlightPanel) -> Any:
    """As MuJoCo's `launch_web.launch`, but listening on one address; that listens on all."""

    def serve(endpoint: endpoints.ViewerEndpoint) -> None:
        viewer_protocol.run_viewer_loop(_viewer_on(host)(config, endpoint, plugins=[panel]))

    return launch_thread.launch_thread(serve, sim_plugins=[])


def _viewer_on(host: str) -> Any:
    """MuJoCo's web viewer with an address of our choice; it sets its own and then binds to it."""
    from mujoco.studio import web_viewer

    class Viewer(web_viewer.WebViewer):
        @property
        def _host(self) -> str:
            return host

        @_host.setter
        def _host(self, _: str) -> None:
            pass

    return Viewer
