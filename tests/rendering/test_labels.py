"""Labels of spacecraft and lines: all are there, clear of each other, and tell what they name."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.rendering import picture
from swarm_mj.rendering.canvas import Box
from swarm_mj.rendering.overlay import Corner, Lettering, Rect, groups, place_label
from swarm_mj.rendering.picture import Drawing

VIEW = Rect(0.0, 0.0, 640.0, 480.0)
NOBODY = np.empty((0, 2))
ORANGE = (255, 120, 40)


def calm(_):
    return True


class Flat:
    """A projection whose points are pixels already."""

    def __init__(self, width, height):
        self.box = Box(0, 0, width, height)

    def place(self, points):
        places = np.asarray(points, float)[:, :2]
        inside = (places >= 0).all(axis=1) & (places < (self.box.width, self.box.height)).all(axis=1)
        return places, inside


class Recorded(Lettering):
    """Keeps what it writes, and the last one that was made."""

    last = None

    def __init__(self, pixels):
        super().__init__(pixels)
        self.written = []
        Recorded.last = self

    def _words(self, x, y, text, colour):
        self.written.append(text)
        super()._words(x, y, text, colour)


def draw(replay, monkeypatch, camera, instant):
    monkeypatch.setattr(picture, "Lettering", Recorded)
    with Drawing(replay.plan, replay.path_N, camera=camera, width=640, height=360) as drawing:
        drawing.draw(instant)
    return Recorded.last


def test_points_that_coincide_make_groups_and_chains_belong_together():
    points = np.array([[0.0, 0.0], [50.0, 0.0], [4.0, 0.0], [8.0, 0.0], [50.0, 5.0]])
    assert groups(points, 5.0) == [[0, 2, 3], [1, 4]]
    assert groups(points, 1.0) == [[0], [1], [2], [3], [4]]
    assert groups(NOBODY, 1.0) == []


def test_a_label_stands_beside_its_point_or_on_a_leader_and_never_where_something_is():
    point = np.array([300.0, 200.0])
    first = place_label(point, 40.0, 16.0, 14.0, VIEW, [], NOBODY, calm)
    assert not first.leader and first.rect.distances(point) < 16.0
    taken = [Rect(250.0, 160.0, 350.0, 240.0)]
    other = place_label(point, 40.0, 16.0, 14.0, VIEW, taken, NOBODY, calm)
    assert other.leader and not other.rect.overlaps(taken[0])
    assert place_label(point, 40.0, 16.0, 14.0, VIEW, [VIEW], NOBODY, calm) is None


def test_a_label_is_nearest_to_what_it_names_and_its_leader_passes_by_the_others():
    point, others = np.array([300.0, 200.0]), np.array([[318.0, 192.0], [284.0, 212.0]])
    place = place_label(point, 40.0, 16.0, 14.0, VIEW, [], others, calm)
    if place.leader:
        end = np.array(place.rect.nearest(*point))
        line = end + np.linspace(0.0, 1.0, 200)[:, None] * (point - end)
        assert np.linalg.norm(line[:, None] - others, axis=2).min() > 6.0
    else:
        assert (place.rect.distances(others) > place.rect.distances(point)).all()


def test_a_calm_place_goes_before_a_nearer_one_unless_it_is_far():
    point = np.array([300.0, 200.0])
    below = place_label(point, 40.0, 16.0, 14.0, VIEW, [], NOBODY, lambda rect: rect.top > 220.0)
    assert below.rect.top > 220.0
    far = place_label(point, 40.0, 16.0, 14.0, VIEW, [], NOBODY, lambda rect: rect.top > 450.0)
    assert not far.leader


@pytest.mark.parametrize("spread", [0.0, 6.0, 15.0, 40.0])
def test_a_dozen_names_are_all_written_however_near_the_points_are(spread):
    points = 320.0 + spread * np.random.default_rng(3).standard_normal((12, 2))
    names = [f"sc{k + 1}" for k in range(12)]
    lettering = Recorded(np.zeros((640, 640, 3), np.uint8))
    lettering.names(points, [(name, ORANGE) for name in names], Flat(640, 640))
    written = [word.strip(", ") for word in lettering.written]
    assert sorted(written) == sorted(names)
    assert not any(a.overlaps(b) for a, b in combinations(lettering._taken, 2))


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("t", [0.0, 20.0, 60.0, 150.0, 600.0])
@pytest.mark.parametrize("camera", ["overview", "chase"])
def test_every_spacecraft_is_named_from_the_release_on(replay, monkeypatch, camera, t):
    lettering = draw(replay, monkeypatch, camera, replay.at(t))
    assert {"sc1", "sc2"} <= {word.strip(", ") for word in lettering.written}
    assert not any(a.overlaps(b) for a, b in combinations(lettering._taken, 2))


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("camera", ["overview", "chase", "split"])
def test_lines_of_sight_to_earth_are_named_though_they_leave_the_picture(replay, monkeypatch, camera):
    now = replay.at(1150.0)
    assert (now.kind == TargetKind.EARTH).any()
    assert "to Earth" in draw(replay, monkeypatch, camera, now).written
    everyone = replace(now, kind=np.full(now.n, TargetKind.EARTH))
    assert "to Earth" in draw(replay, monkeypatch, camera, everyone).written
    nobody = replace(now, kind=np.full(now.n, TargetKind.ASTEROID))
    assert "to Earth" not in draw(replay, monkeypatch, camera, nobody).written


def test_like_ends_of_lines_share_a_label_and_the_panel_is_kept_clear():
    lettering, projection = Recorded(np.zeros((480, 640, 3), np.uint8)), Flat(640, 480)
    lettering._taken.append(Rect(0.0, 0.0, 150.0, 150.0))  # a panel
    starts = np.array([[300.0, 200.0, 0.0], [310.0, 215.0, 0.0], [300.0, 400.0, 0.0]])
    ends = np.array([[-100.0, -200.0, 0.0], [-90.0, -185.0, 0.0], [300.0, 900.0, 0.0]])
    lettering.line_names(starts, ends, ("to Earth", ORANGE), projection, starts)
    assert lettering.written == ["to Earth"] * 2
    assert not any(a.overlaps(b) for a, b in combinations(lettering._taken, 2))


def test_the_panel_stays_where_it_is_while_what_spacecraft_do_changes():
    lettering, view = Lettering(np.zeros((480, 640, 3), np.uint8)), Box(0, 0, 640, 480)
    head = [("10:00   50 x", ORANGE), ("5.0 % observed", ORANGE)]
    deeds = ("observes", "turns to sc2", "linked to sc2", "turns to Earth", "linked to Earth", "is lost")
    sizes = [lettering.panel_size([*head, (f"sc1 {deed}", ORANGE)]) for deed in deeds]
    panels = {lettering.corner_box(size, view, Corner(right=True), 20) for size in sizes}
    assert len(panels) == 1
