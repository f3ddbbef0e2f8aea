"""Figures drawn by other processes: the same ones, for one run after another, and nothing of them stays when it ends badly."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from swarm_mj.errors import SwarmError
from swarm_mj.figures import drawing
from swarm_mj.figures.drawing import compile_in_background, draw_all, prepare_drawing
from swarm_mj.figures.run_figures import draw
from swarm_mj.io.atomic import FIGURES

#: One figure of each kind: a scene, a map, a page of many axes, and histories.
FEW = ("trajectories", "footprints", "operation", "links", "propulsion")


class Deadly:
    """Ends the process that reads it."""

    def __reduce__(self):
        return os._exit, (3,)


def processes_below(parent):
    """Numbers of the processes that a process has started and that still run."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, rest = status.read_text().split(" ", 1)
        except OSError:  # it has ended meanwhile
            continue
        state, of = rest.rsplit(")", 1)[1].split()[:2]
        if int(of) == parent and state != "Z":
            found |= {int(number)} | processes_below(int(number))
    return found


@pytest.fixture
def started():
    """The processes that a test has started and that still run."""
    before = processes_below(os.getpid())
    return lambda: processes_below(os.getpid()) - before


@pytest.fixture
def two_cores(monkeypatch):
    """Figures are drawn by two processes, whatever the machine."""
    monkeypatch.setattr(drawing, "usable_cores", lambda: 2)


def test_other_processes_draw_the_same_for_one_run_after_another(flown, tmp_path, started, two_cores, monkeypatch):
    monkeypatch.setitem(FIGURES, "run", FEW)
    plan, telemetry, result = flown
    mine = replace(plan.environment, gravity=lambda: "no pickle")
    own = replace(plan, controller=lambda: "no pickle", environment=mine)  # plug-ins are not handed over
    told = []
    prepare_drawing()
    before = started()
    for name, flight in (("one", flown), ("two", (own, telemetry, result))):
        (tmp_path / name).mkdir()
        draw_all(tmp_path / name, *flight, progress=told.append)
    assert started() == before  # those that drew have gone
    assert told == 2 * list(range(1, len(FEW) + 1))
    for name in FEW:
        draw(name, tmp_path, *flown)
        drawn = [(tmp_path / folder / f"{name}.png").read_bytes() for folder in (".", "one", "two")]
        assert drawn[0] == drawn[1] == drawn[2]


def test_an_error_of_another_process_is_told_with_its_figure_and_leaves_nothing_running(
    flown, tmp_path, started, two_cores
):
    (tmp_path / "footprints.png").mkdir()  # a figure cannot take its place
    prepare_drawing()
    before = started()
    with pytest.raises(IsADirectoryError) as raised:
        draw_all(tmp_path, *flown)
    assert "while footprints.png was drawn" in "".join(raised.value.__notes__)
    assert started() == before


def test_a_process_that_dies_is_a_clear_error_and_what_cannot_be_handed_over_is_drawn_here(
    flown, tmp_path, monkeypatch, two_cores
):
    plan, telemetry, result = flown
    monkeypatch.setitem(FIGURES, "run", ("links", "contacts"))
    with pytest.raises(SwarmError, match="died with exit status 3"):
        draw_all(tmp_path, plan, telemetry, replace(result, note=Deadly()))
    draw_all(tmp_path, plan, telemetry, replace(result, note=lambda: "no pickle"))
    assert {path.name for path in tmp_path.iterdir()} == {"links.png", "contacts.png"}


def test_with_one_core_nothing_is_started(flown, tmp_path, started, monkeypatch):
    monkeypatch.setattr(drawing, "usable_cores", lambda: 1)
    monkeypatch.setitem(FIGURES, "run", ("links",))
    monkeypatch.setattr(drawing.workers, "begin", None)
    prepare_drawing()
    compile_in_background(flown[0])
    draw_all(tmp_path, *flown)
    assert started() == set()
