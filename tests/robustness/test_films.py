"""Many films of one flight: flat memory, and no file, thread or OpenGL context left behind."""

import pytest

from swarm_mj.cli.main import main

from .test_long import held, resident

pytestmark = [pytest.mark.robust, pytest.mark.gl]

#: Films after which encoder and driver have all they keep, about 35 MB more than after the first.
WARM = 12
#: What one film more may then cost [bytes]; a context that is not given back costs more.
GROWTH = 2**20
FILMS = 17


@pytest.mark.slow
def test_many_films_leave_nothing_behind(tmp_path):
    pytest.importorskip("av")
    from swarm_mj.rendering.film import make_film
    from swarm_mj.rendering.replay import load_replay

    run = tmp_path / "run"
    short = ["--set", "telemetry.interval_s=10", "--quiet", "--no-figures"]
    assert main(["fly", "eros-quick", *short, "--out", str(run)]) == 0
    replay, memory, before = load_replay(run), [], None
    for k in range(FILMS):
        path = make_film(replay, tmp_path / "film.mp4", fps=5.0, size=(160, 120), speed=2400.0).path
        assert path.stat().st_size > 1000
        memory.append(resident())
        before = held() if k == WARM else before
    assert held() == before
    # The least of the last few: single ones stand out by what the driver holds just then.
    assert (min(memory[-3:]) - memory[WARM]) / (FILMS - WARM) < GROWTH, [round(m / 2**20) for m in memory]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.mp4", "run"]
