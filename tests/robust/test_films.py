"""Many films of one flight: flat memory, and no file, thread or OpenGL context left behind."""

import pytest

from swarm_mj.cli.main import main

from .test_long import held, resident

pytestmark = [pytest.mark.robust, pytest.mark.gl]

#: Films after which encoder and driver have all they keep, about 10 MB more than after the first.
WARM = 12
#: What one film more may then cost [bytes]; a context that is not given back costs more.
GROWTH = 2**19
FILMS = 100


@pytest.mark.slow
def test_a_hundred_films_leave_nothing_behind(tmp_path):
    pytest.importorskip("av")
    from swarm_mj.cli.video_runner import run_video

    run = tmp_path / "run"
    short = ["--set", "telemetry.interval_s=10", "--quiet", "--no-figures"]
    assert main(["run", "eros-quick", *short, "--out", str(run)]) == 0
    memory, before = [], None
    for k in range(FILMS):
        path = run_video(run, fps=5.0, size="160x120", speed=600.0, quiet=True, out=tmp_path / "film.mp4")
        assert path.stat().st_size > 1000
        memory.append(resident())
        before = held() if k == WARM else before
    assert held() == before
    assert (memory[-1] - memory[WARM]) / (FILMS - WARM) < GROWTH, [round(m / 2**20) for m in memory]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.mp4", "run"]
