"""The command `video`: a film of a recorded run."""

import av
import numpy as np
import pytest
from PIL import Image

from swarm_mj.cli.main import main
from swarm_mj.cli.results import parse_size
from swarm_mj.errors import OutputError
from swarm_mj.records.run_files import write_results, write_summary
from swarm_mj.records.summary import summarise
from swarm_mj.rendering import film as film_module
from swarm_mj.rendering.film import make_film, picture_times, suitable_speed
from swarm_mj.rendering.picture import Drawing


@pytest.fixture(scope="module")
def run_folder(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    write_results(folder, *flown)
    write_summary(folder, summarise(*flown, {"simulate": 0.0}))
    return folder


def frames_of(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("camera", ["overview", "chase", "sc1", "split"])
def test_a_film_lasts_the_flight_over_the_speed_at_the_asked_size(run_folder, camera):
    asked = ["--camera", camera, "--fps", "5", "--size", "320x240", "--speed", "200", "--quiet"]
    assert main(["video", str(run_folder), *asked]) == 0
    frames = frames_of(run_folder / f"{camera}.mp4")
    assert len(frames) == 31 and frames[0].shape == (240, 320, 3)
    assert all(frame.std() > 5.0 for frame in frames)


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_an_interrupted_film_leaves_nothing(replay, monkeypatch, tmp_path):
    class Stopped(Drawing):
        drawn = 0

        def draw(self, instant):
            Stopped.drawn += 1
            if Stopped.drawn > 12:
                raise KeyboardInterrupt
            return super().draw(instant)

    monkeypatch.setattr(film_module, "Drawing", Stopped)
    for name in ("a.mp4", "a.gif"):
        Stopped.drawn = 0
        with pytest.raises(KeyboardInterrupt):
            make_film(replay, tmp_path / name, fps=5.0, size=(128, 96), speed=100.0)
    assert not list(tmp_path.iterdir())


def test_the_first_and_the_last_picture_show_the_ends_of_the_flight(replay):
    times = picture_times(replay, 25.0, 48.0)
    assert len(times) == 626 and times[0] == 0.0 and times[-1] == 1200.0
    assert np.allclose(np.diff(times), 48.0 / 25.0)


def test_an_unset_speed_gives_a_film_of_about_half_a_minute():
    for duration in (60.0, 1200.0, 5000.0, 1e6):
        assert 20.0 <= duration / suitable_speed(duration) <= 60.0
    assert suitable_speed(5.0) == 1.0


def test_what_cannot_be_filmed_is_a_clear_error(run_folder, tmp_path, capsys):
    for arguments, words in (
        (["--camera", "sc7"], "camera 'sc7' does not exist: use overview, chase, split or sc1 to sc2"),
        (["--size", "640"], "size '640': give WIDTHxHEIGHT"),
        (["--size", "641x480"], "size 641x480: both sides of an MP4 must be even"),
        (["--speed", "0"], "speed 0: must be above 0"),
        (["--speed", "1e-9"], "the film would have"),
        (["--out", str(tmp_path / "a.webm")], "must end in .mp4 or .gif"),
    ):
        assert main(["video", str(run_folder), "--quiet", *arguments]) == 2
        assert words in capsys.readouterr().err
    assert main(["video", str(tmp_path), "--quiet"]) == 2
    assert "is not a folder of `swarm-mj fly`" in capsys.readouterr().err
    assert parse_size("640X480") == (640, 480)
    with pytest.raises(OutputError):
        parse_size("640x-480")
    assert not list(tmp_path.iterdir())


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_stills_show_the_arrival_and_the_end_beside_each_other(run_folder, replay):
    path = make_film(replay, run_folder / "stills.png", size=(320, 240)).path
    with Image.open(path) as image:
        strip = np.asarray(image)
    assert strip.shape == (240, 648, 3)
    with Drawing(replay.plan, replay.path_N, width=320, height=240) as drawing:
        assert np.array_equal(strip[:, :320], drawing.draw(replay.at(600.0)))
        assert np.array_equal(strip[:, 328:], drawing.draw(replay.at(1200.0)))
    assert sorted(p.suffix for p in run_folder.glob(".*")) == []
