"""Figures drawn by other processes: the same ones, for one run after another, and nothing of them stays when it ends badly."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from swarm_mj.errors import OutputError
from swarm_mj.io.atomic import FIGURES
from swarm_mj.results import drawing
from swarm_mj.results.drawing import compile_beside, draw_all, drawing_beside
from swarm_mj.results.figures import COMPOSERS, draw

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
def few(monkeypatch):
    """So many figures of a run are drawn, here and by other processes."""
    monkeypatch.setitem(FIGURES, "run", FEW)
    there = f"from swarm_mj.io.atomic import FIGURES; FIGURES['run'] = {FEW}; from swarm_mj"
    monkeypatch.setattr(drawing, "_SERVE", drawing._SERVE.replace("from swarm_mj", there, 1))


def test_other_processes_draw_the_same_for_one_run_after_another(flown, tmp_path, started, few):
    plan, telemetry, result = flown
    mine = replace(plan.environment, gravity=lambda: "no pickle")
    own = replace(plan, controller=lambda: "no pickle", environment=mine)  # plug-ins are not handed over
    told = []
    with drawing_beside(2):
        server = started()
        assert len(server) == 1
        compile_beside(plan)
        for name, flight in (("one", flown), ("two", (own, telemetry, result))):
            (tmp_path / name).mkdir()
            draw_all(tmp_path / name, *flight, progress=told.append)
        assert started() == server  # those that drew or compiled have gone
    assert started() == set()
    assert told == 2 * list(range(1, len(FEW) + 1))
    for name in FEW:
        draw(name, tmp_path, *flown)
        drawn = [(tmp_path / folder / f"{name}.png").read_bytes() for folder in (".", "one", "two")]
        assert drawn[0] == drawn[1] == drawn[2]


def test_an_error_of_another_process_is_told_with_its_figure_and_leaves_nothing_running(flown, tmp_path, started):
    (tmp_path / "footprints.png").mkdir()  # a figure cannot take its place
    with drawing_beside(2):
        with pytest.raises(IsADirectoryError) as raised:
            draw_all(tmp_path, *flown)
        assert "while footprints.png was drawn" in "".join(raised.value.__notes__)
        assert started() == set()


def test_a_process_that_dies_is_a_clear_error_and_what_cannot_be_handed_over_is_drawn_here(
    flown, tmp_path, monkeypatch
):
    plan, telemetry, result = flown
    monkeypatch.setattr("swarm_mj.results.figures.COMPOSERS", {"links": COMPOSERS["links"]})
    with drawing_beside(2):
        with pytest.raises(OutputError, match=r"ended before its time \(3\)"):
            draw_all(tmp_path, plan, telemetry, replace(result, note=Deadly()))
        draw_all(tmp_path, plan, telemetry, replace(result, note=lambda: "no pickle"))
    assert [path.name for path in tmp_path.iterdir()] == ["links.png"]


def test_with_one_core_nothing_is_started(started):
    with drawing_beside(1), drawing_beside(1):
        assert started() == set()
