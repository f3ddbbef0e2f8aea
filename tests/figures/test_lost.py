"""A spacecraft that fails is shown as lost, in grey, from then on, and the instants of faults are marked."""

import json

import numpy as np
import pytest
from matplotlib.colors import to_hex

from swarm_mj.figures.modes import EVENT
from swarm_mj.figures.palette import MODE_STYLES
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.figures.scene import axis_tips, scene_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.records.modes import LOST, events_of, modes_shown, runs
from swarm_mj.simulator.telemetry import MODES

from .sheets import swarm_of

#: When the relay fails [s].
LOSS_S = 1000.0


@pytest.fixture(scope="module")
def crippled(flown):
    """The quick flight, of which spacecraft 1, the relay, is lost at `LOSS_S`."""
    plan, telemetry, result = flown
    works = np.ones((telemetry.sizes["time"], plan.n), np.int8)
    works[telemetry["time"].values >= LOSS_S, 0] = 0
    changed = telemetry.assign(operational=(("time", "spacecraft"), works))
    events = [
        {"time_s": 120.0, "spacecraft": "sc2", "kind": "wheel_friction", "detail": ""},
        {"time_s": LOSS_S, "spacecraft": "sc1", "kind": "communications_lost", "detail": ""},
    ]
    return plan, changed.assign_attrs(events=json.dumps(events)), result


def texts(figure):
    return {text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")) if text.get_text()}


def test_lost_comes_after_the_modes_of_the_telemetry_and_has_a_colour_of_its_own():
    assert len(MODES) == len(TargetKind) == LOST == len(MODE_STYLES) - 2
    for colours in ([look.colour for look in MODE_STYLES], [look.line_colour for look in MODE_STYLES]):
        assert len(set(colours)) == len(colours)
        red, green, blue = (int(colours[LOST][k : k + 2], 16) for k in (1, 3, 5))
        assert red == green == blue


def test_a_lost_spacecraft_tracks_nothing(crippled):
    _, telemetry, _ = crippled
    mode = modes_shown(telemetry)
    late = telemetry["time"].values >= LOSS_S
    assert (mode[late, 0] == LOST).all()
    assert np.array_equal(mode[~late], telemetry["mode"].values[~late])
    assert [run for run in runs(telemetry, 0) if run.mode == LOST] == [(LOSS_S, telemetry["time"].values[-1], LOST)]


@pytest.mark.parametrize("name", ["links", "pointing_error", "behaviors"])
def test_figures_name_the_loss(crippled, flown, name):
    assert "lost" in texts(COMPOSERS[name](*crippled))
    assert "lost" not in texts(COMPOSERS[name](*flown))


def test_the_operation_draws_no_line_from_a_lost_relay_to_earth(crippled, flown):
    plan, telemetry, _ = crippled
    before, after = COMPOSERS["operation"](*flown), COMPOSERS["operation"](*crippled)
    assert "to Earth" in texts(before)
    assert "to Earth" not in texts(after)
    assert "lost spacecraft" in texts(after)
    grey = MODE_STYLES[LOST].line_colour.lower()
    assert grey in {to_hex(line.get_color()) for line in after.axes[1].lines if line.get_marker() == "X"}
    scene = scene_from(plan, telemetry)
    assert np.array_equal(axis_tips(telemetry, scene, plan.region.mesh, -1, 1e4)[0], scene.r_A[-1, 0])


def test_panels_mark_the_instants_of_each_spacecrafts_own_events(crippled):
    plan, telemetry, _ = crippled
    figure = COMPOSERS["pointing_error"](*crippled)
    for j, ax in enumerate(figure.axes[: plan.n]):
        marks = [line.get_xdata()[0] * 60.0 for line in ax.lines if to_hex(line.get_color()) == EVENT["color"].lower()]
        assert marks == pytest.approx(events_of(telemetry, j))
    assert "fault or what followed from it" in texts(figure)


def test_abbreviations_fit_into_their_stretches(flown):
    plan, telemetry, result = swarm_of(flown, 5)
    mode = telemetry["mode"] * 0
    times = telemetry["time"].values
    for start, kind in ((700.0, 1), (770.0, 0), (840.0, 1), (1000.0, 0)):
        mode.values[times >= start] = kind
    telemetry = telemetry.assign(mode=mode)
    figure = COMPOSERS["pointing_error"](plan, telemetry, result)
    figure.draw_without_rendering()
    for j, ax in enumerate(figure.axes[: plan.n]):
        edges = [ax.transData.transform((t / 60.0, 1.0))[0] for run in runs(telemetry, j) for t in run[:2]]
        assert [text.get_text() for text in ax.texts] == ["TO", "CT", "TO"]
        for text in ax.texts:
            box = text.get_window_extent()
            assert not any(box.x0 < edge < box.x1 for edge in edges), text.get_text()
