"""Pictures of a flight: one instant through one of the cameras, with words; which view stands where in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import TracebackType
from typing import Self

import mujoco
import numpy as np

from swarm_mj.errors import OutputError
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.coverage import percent_text
from swarm_mj.rendering.cameras import (
    CHASE,
    OVERVIEW,
    SPLIT,
    FreeView,
    Span,
    chase,
    magnification_for,
    overview,
    reach_of,
    spacecraft_number,
)
from swarm_mj.rendering.canvas import LEAST_SIDE, MOST_SIDE, Box, Canvas, Projection
from swarm_mj.rendering.decorations import NextGeom, decorate, sights
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.model import build_drawing_model
from swarm_mj.rendering.navigation import BeliefOverlay, known_to
from swarm_mj.rendering.overlay import MAX_NAMED, Corner, Lettering, Line, clock, deed, roles
from swarm_mj.rendering.palette import MODES, PACKET, TEXT
from swarm_mj.rendering.transfers import RADIUS, draw_transfers, words
from swarm_mj.typing import Array, Pixels

#: Share of a split picture that the overview takes.
OVERVIEW_SHARE = 0.62
#: What lightens the third of its brightness to which the part beside a rectangular field of view is dimmed.
OUTSIDE = 24
#: What is left beside the square picture of one camera holds the overview from this share of the square's side on.
LEAST_BESIDE = 0.3
#: More cameras than these are too small to see anything in.
MAX_TILES = 12
#: Free pixels between the pictures of the cameras.
GAP = 4


@dataclass(frozen=True)
class Layout:
    """Parts of a picture.

    Attributes:
        main: Where the view of the swarm stands; None if there is none.
        chase: Whether that view moves with the swarm.
        cameras: Spacecraft, from 0, whose cameras are shown, and where.
    """

    main: Box | None
    chase: bool
    cameras: dict[int, Box]


def layout_of(camera: str, n: int, n_observers: int, width: int, height: int) -> Layout:
    """The parts of a picture of some width and height [pixel], of n spacecraft of which the first n_observers observe.

    `camera`: `overview`, `chase`, `split` with the pictures of observers, or `sc1`, `sc2`, ..., with the overview beside it if
    there is room.

    Raises:
        OutputError: There is no camera of that name.
    """
    number = spacecraft_number(camera, n)
    if camera in (OVERVIEW, CHASE):
        return Layout(Box(0, 0, width, height), camera == CHASE, {})
    if number is not None:
        side = min(width, height)
        beside = Box(0, 0, width - side, height) if width > height else Box(0, 0, width, height - side)
        main = beside if min(beside.width, beside.height) >= LEAST_BESIDE * side else None
        return Layout(main, False, {number: Box(width - side, height - side, side, side)})
    assert camera == SPLIT
    left = round(OVERVIEW_SHARE * width)
    boxes = _tiles(min(n_observers, MAX_TILES), left, width - left, height)
    return Layout(Box(0, 0, left, height), False, dict(enumerate(boxes)))


def _tiles(count: int, left: int, width: int, height: int) -> list[Box]:
    """Squares in rows, as large as they fit beside the overview."""
    columns = max(range(1, count + 1), key=lambda c: min(width // c, height // -(-count // c)))
    rows = -(-count // columns)
    side = min(width // columns, height // rows)
    margin_x, margin_y = width - columns * side, (height - rows * side) // 2
    left, top = left + margin_x // 2 + GAP // 2, margin_y + GAP // 2
    places = [divmod(k, columns) for k in range(count)]
    return [Box(left + column * side, top + row * side, side - GAP, side - GAP) for row, column in places]


#: Height of a picture in which lines have their nominal width [pixel].
NOMINAL_HEIGHT = 600
#: Brightness, of 255, of what a camera sees at least where it sees anything.
DARK = 8
#: A body smaller than this share of the picture's height is named, and shown once more in a corner on this share of its lesser
#: side, from where the body is a little smaller than that.
SPECK, ENLARGED, INSET_RADII = 0.15, 0.34, 4.6
#: Parts of a picture that stand in its corners.
PANEL, INSET = "panel", "inset"


class Drawing:
    """Draws instants of one flight; holds one OpenGL context until closed. A context manager.

    Args:
        plan: What is flown.
        path_N: Positions over the time that is shown, which the overview holds, shape (m, n, 3) [m].
        camera: `overview`, `chase`, `split`, or `sc1`, `sc2`, ...
        width: [pixel].
        height: [pixel].
        note: Stands beside the time.
        span_s: Begin and end of the time that is shown [s]; None: the whole flight.

    Raises:
        OutputError: There is no camera of that name, or the size is out of range.
        ObserverError: OpenGL cannot be loaded here.
    """

    def __init__(
        self,
        plan: Plan,
        path_N: Array,
        *,
        camera: str = OVERVIEW,
        width: int = 640,
        height: int = 480,
        note: str = "",
        span_s: Span | None = None,
    ) -> None:
        if not (LEAST_SIDE <= width <= MOST_SIDE and LEAST_SIDE <= height <= MOST_SIDE):
            raise OutputError(f"size {width}x{height}: both sides must be {LEAST_SIDE} to {MOST_SIDE} pixels")
        self._plan, self._path_N = plan, path_N
        self._layout = layout_of(camera, plan.n, plan.n_observers, width, height)
        main = self._layout.main
        self._overview = None if main is None else overview(plan, path_N, main.width / main.height, span_s)
        self._note = note
        distance = 1.0 if self._overview is None else self._overview.distance
        reach = reach_of(path_N, self._overview)
        self._model = build_drawing_model(plan, magnification_for(plan, distance), width, height, reach)
        self._canvas = Canvas(self._model, width, height)
        self._ruler = Lettering(np.zeros((height, width, 3), np.uint8))
        self._corners: dict[str, Corner] = {}
        self._line_scale = max(1.0, height / NOMINAL_HEIGHT)

    def draw(self, instant: Instant) -> Pixels:
        """A picture of an instant, shape (height, width, 3)."""
        view = None if self._layout.main is None else self._view(instant, self._layout.main)
        if view is not None and self._layout.chase:
            self._model = self._model.magnified(magnification_for(self._plan, view.distance))
        if self._model.place(instant):
            self._canvas.upload()
        self._canvas.clear()
        projection = inset = None
        if self._layout.main is not None and view is not None:
            projection = self._draw_swarm(instant, view, self._layout.main)
            inset = self._draw_speck(instant, projection)
        cameras = {
            j: self._canvas.view(self._camera_of(j), box, spacecraft=False) for j, box in self._layout.cameras.items()
        }
        return self._write(self._canvas.read(), instant, projection, inset, cameras)

    def close(self) -> None:
        """Release the OpenGL context; may be called again."""
        self._canvas.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _draw_swarm(self, instant: Instant, view: FreeView, box: Box) -> Projection:
        radius, packet_m = float(self._model.mjmodel.stat.extent), RADIUS * self._length_m

        def add(next_geom: NextGeom) -> None:
            decorate(next_geom, self._model, instant, self._line_scale)
            draw_transfers(next_geom, instant, radius, packet_m, self._line_scale)

        return self._canvas.view(view.camera(), box, decorate=add)

    def _is_speck(self, view: Projection) -> bool:
        radius, ahead = self._plan.shape.max_radius, float(view.position @ -view.axes[2])
        return ahead > 0.0 and 2.0 * radius * view.scale[1] < SPECK * view.box.height * ahead

    def _draw_speck(self, instant: Instant, main: Projection) -> Box | None:
        """The body once more, larger and from the same side, in a corner of a view in which it is too small; where."""
        side = round(ENLARGED * min(main.box.width, main.box.height))
        if not self._is_speck(main) or side < LEAST_SIDE:
            return None
        corner = self._corner(INSET, (side, side), main)
        box = self._ruler.corner_box((side, side), main.box, corner, self._legend(main.box))
        view = FreeView(np.zeros(3), -main.axes[2], INSET_RADII * self._plan.shape.max_radius)

        def add(next_geom: NextGeom) -> None:
            decorate(next_geom, self._model, instant, self._line_scale)

        self._canvas.view(view.camera(), box, spacecraft=False, decorate=add)
        return box

    @cached_property
    def _beliefs(self) -> BeliefOverlay:
        """Over the pictures of cameras, which are all of one size."""
        return BeliefOverlay(self._plan, next(iter(self._layout.cameras.values())).width)

    @property
    def _length_m(self) -> float:
        """Of a spacecraft as it is drawn."""
        return self._model.magnification * max(self._plan.properties.size)

    def _view(self, instant: Instant, box: Box) -> FreeView:
        if self._overview is None or self._layout.chase:
            return chase(self._plan, instant, box.width / box.height)
        return self._overview

    def _camera_of(self, j: int) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, int(self._model.cameras[j])
        return camera

    def _write(
        self,
        pixels: Pixels,
        instant: Instant,
        projection: Projection | None,
        inset: Box | None,
        cameras: dict[int, Projection],
    ) -> Pixels:
        belief = instant.belief
        for j, view in cameras.items():
            _shade_outside(pixels, view.box, self._plan.scenario.camera.sides)
            if belief is not None:
                pose = instant.r_BN_N[j], instant.cameras[j], instant.C_AN
                pixels = self._beliefs.draw(pixels, view, belief, j, *pose)
        lettering, names = Lettering(pixels), self._plan.names
        labels = list(zip(names, instant.colours, strict=True))
        lines, share = self._lines(instant), self._share(instant)
        box = Box(0, 0, pixels.shape[1], pixels.shape[0]) if projection is None else projection.box
        corner = Corner() if projection is None else self._corner(PANEL, lettering.panel_size(lines), projection)
        lettering.panel(lines, box, corner, share, self._legend(box))
        if inset is not None:
            lettering.inset(f"{self._plan.scenario.body.name}, {_across(self._plan.shape.max_radius)}", inset)
        if projection is not None:
            lettering.legend(self._scale, projection.box)
            if instant.n <= MAX_NAMED:
                points_N, named = self._named(instant, labels, projection)
                lettering.names(points_N, named, projection, dots=range(instant.n, len(named)))
            self._name_sights(lettering, instant, projection)
        for j, view in cameras.items():
            known = "" if belief is None else f", {known_to(belief, j)}"
            lettering.caption(f"{names[j]} {deed(instant, names, j)}{known}", view.box, labels[j][1])
            others = np.delete(np.arange(instant.n), j)
            lettering.names(instant.r_BN_N[others], [labels[k] for k in others], view, dots=range(len(others)))
            if _is_dark(pixels, view.box) and not view.place(instant.r_BN_N[others])[1].any():
                lettering.remark("nothing in view", view.box)
        return lettering.pixels

    def _named(self, instant: Instant, labels: list[Line], projection: Projection) -> tuple[Array, list[Line]]:
        """What gets its name beside it: the spacecraft, and the body where it is a speck."""
        if not self._is_speck(projection):
            return instant.r_BN_N, labels
        return np.vstack((instant.r_BN_N, np.zeros(3))), [*labels, (self._plan.scenario.body.name, TEXT)]

    def _name_sights(self, lettering: Lettering, instant: Instant, projection: Projection) -> None:
        """Say of lines of sight that end at nothing in the picture where they lead: those to Earth."""
        to_earth = (instant.kind == TargetKind.EARTH) & instant.works
        if instant.n <= MAX_NAMED and to_earth.any():
            starts, tips = instant.r_BN_N[to_earth], sights(instant, self._plan.shape.max_radius)[1][to_earth]
            label = ("to Earth", MODES[TargetKind.EARTH])
            lettering.line_names(starts, tips, label, projection, instant.r_BN_N)

    def _corner(self, part: str, size: tuple[int, int], view: Projection) -> Corner:
        """Where a part of the picture of some width and height hides least of the flight: a fixed corner for itself alone.

        At best that is the upper left one for the panel, the lower right one for the body's picture.
        """
        if self._layout.chase:
            return Corner(right=part == INSET)
        if part not in self._corners:
            places, _ = view.place(np.vstack((self._path_N.reshape(-1, 3), self._plan.shape.vertices)))

            def hidden(corner: Corner) -> int:
                box = self._ruler.corner_box(size, view.box, corner, self._legend(view.box))
                inside = (places >= (box.left, box.top)) & (places < (box.left + box.width, box.top + box.height))
                return int(inside.all(axis=1).sum())

            corners = [Corner(right, below) for below in (False, True) for right in (False, True)]
            free = [corner for corner in corners if corner not in self._corners.values()]
            self._corners[part] = min(free[:: -1 if part == INSET else 1], key=hidden)
        return self._corners[part]

    def _legend(self, box: Box) -> int:
        return self._ruler.legend_height(self._scale, box)

    @property
    def _scale(self) -> str:
        return f"spacecraft drawn {self._model.magnification:,.0f} times as large"

    def _share(self, instant: Instant) -> float:
        region = self._plan.region
        return float(region.weighted_area[instant.seen].sum() / region.total_weighted_area)

    def _lines(self, instant: Instant) -> list[Line]:
        title = f"{clock(instant.t)}   {self._note}"
        lines: list[Line] = [(title, TEXT), (f"{percent_text(100.0 * self._share(instant))} observed", TEXT)]
        lines += [(instant.note, TEXT)] if instant.note else []
        if self._layout.main is not None:
            lines += roles(instant, self._plan.names)
            lines += [(text, PACKET) for text in words(instant.traffic)] if instant.traffic is not None else []
        return lines


def _shade_outside(pixels: Pixels, box: Box, sides: tuple[float, float]) -> None:
    """Grey what a square picture shows beside a rectangular field of view; in place."""
    part = pixels[box.top : box.top + box.height, box.left : box.left + box.width]
    for axis, side in enumerate((sides[1], sides[0])):
        size = part.shape[axis]
        edge = round(0.5 * (1.0 - side) * size)
        for outside in (slice(0, edge), slice(size - edge, size)):
            strip = part[outside] if axis == 0 else part[:, outside]
            strip //= 3
            strip += OUTSIDE


def _is_dark(pixels: Pixels, box: Box) -> bool:
    """Whether a part of a picture shows nothing but the sky."""
    return int(pixels[box.top : box.top + box.height, box.left : box.left + box.width].max()) < DARK


def _across(radius_m: float) -> str:
    """How wide a body of some radius [m] is, in words."""
    width = 2.0 * radius_m
    return f"{width / 1e3:.3g} km across" if width >= 1e3 else f"{width:.3g} m across"
