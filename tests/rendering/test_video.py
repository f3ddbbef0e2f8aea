"""Films: what a decoder finds in them, and that they appear whole or not at all."""

import signal
import subprocess
import sys
import textwrap
from fractions import Fraction

import av
import numpy as np
import pytest
from PIL import Image

from swarm_mj.errors import OutputError
from swarm_mj.rendering.video import check_film, film

COLOURS = np.array([(200, 30, 30), (30, 180, 60), (40, 60, 220)], np.uint8)


def picture(k, width=96, height=64):
    """A plain ground with a white bar that moves four pixels a picture."""
    pixels = np.empty((height, width, 3), np.uint8)
    pixels[:] = COLOURS[k % 3]
    pixels[:, 4 * k : 4 * k + 8] = 255
    return pixels


def write(path, count=12, fps=25.0):
    with film(path, width=96, height=64, fps=fps, sample=map(picture, range(3))) as reel:
        for k in range(count):
            reel.add(picture(k))


def decoded(path):
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return stream, [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]


@pytest.mark.parametrize("fps", [25.0, 29.97, 10.0])
def test_an_mp4_holds_every_picture_in_h264_at_the_asked_rate_and_in_the_right_colours(tmp_path, fps):
    write(tmp_path / "a.mp4", fps=fps)
    stream, frames = decoded(tmp_path / "a.mp4")
    assert stream.codec_context.name == "h264" and stream.codec_context.pix_fmt == "yuv420p"
    assert abs(stream.average_rate - Fraction(fps).limit_denominator(1001)) < Fraction(1, 1000)
    assert len(frames) == 12 and frames[0].shape == (64, 96, 3)
    for k, frame in enumerate(frames):
        assert np.abs(frame[:, 70:].astype(int) - COLOURS[k % 3]).mean() < 8
        assert frame[:, 4 * k + 2 : 4 * k + 6].mean() > 225


def test_an_mp4_can_begin_to_play_before_it_is_loaded_whole(tmp_path):
    write(tmp_path / "a.mp4")
    content = (tmp_path / "a.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


def test_a_gif_holds_every_picture_in_its_colours_and_repeats(tmp_path):
    write(tmp_path / "a.gif", fps=20.0)
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 12 and image.size == (96, 64) and image.info["loop"] == 0
        assert image.info["duration"] == 50
        for k in range(12):
            image.seek(k)
            shown = np.asarray(image.convert("RGB"), int)
            assert np.abs(shown - picture(k)).max() <= 12


@pytest.mark.parametrize("name", ["a.mp4", "a.gif"])
def test_interrupted_work_leaves_the_earlier_film_and_nothing_else(tmp_path, name):
    (tmp_path / name).write_bytes(b"earlier")
    with (
        pytest.raises(KeyboardInterrupt),
        film(tmp_path / name, width=96, height=64, fps=25.0, sample=[picture(0)]) as reel,
    ):
        for k in range(40):
            reel.add(picture(k % 12))
        raise KeyboardInterrupt
    assert [p.name for p in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"earlier"


def test_what_cannot_be_encoded_or_written_is_a_clear_error(tmp_path):
    with pytest.raises(OutputError, match=r"a\.avi: the name of a film must end in \.mp4 or \.gif"):
        check_film(tmp_path / "a.avi", 96, 64, 25.0)
    with pytest.raises(OutputError, match="size 95x64: both sides of an MP4 must be even"):
        check_film(tmp_path / "a.mp4", 95, 64, 25.0)
    with pytest.raises(OutputError, match=r"fps 60: must be 0\.1 to 50 for \.gif"):
        check_film(tmp_path / "a.gif", 96, 64, 60.0)
    with pytest.raises(OutputError, match="nowhere.*cannot be written"):
        write(tmp_path / "nowhere" / "a.mp4")
    assert not list(tmp_path.iterdir())


#: Begins a film, says so, and never ends it.
ENDLESS = """
    import sys, time
    from pathlib import Path
    import numpy as np
    from swarm_mj.rendering.video import film
    with film(Path(sys.argv[1]), width=96, height=64, fps=25.0, sample=[np.zeros((64, 96, 3), np.uint8)]) as reel:
        for k in range(50):
            reel.add(np.full((64, 96, 3), k, np.uint8))
        print("filming", flush=True)
        time.sleep(600)
"""


@pytest.fixture
def filming():
    """Start a film in a process of its own that is still at it; it is killed at the end."""
    started = []

    def begin(path):
        command = [sys.executable, "-c", textwrap.dedent(ENDLESS), str(path)]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert started[-1].stdout.readline().strip() == "filming"
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.robust
@pytest.mark.parametrize("name", ["a.mp4", "a.gif"])
def test_what_a_killed_process_left_behind_is_cleared_by_the_next_film_of_that_name(tmp_path, filming, name):
    process = filming(tmp_path / name)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(list(tmp_path.glob(f".{name}.*.partial"))) == 1
    (tmp_path / ".b.mp4.01234567.partial").write_bytes(b"of another film")
    write(tmp_path / name)
    assert sorted(p.name for p in tmp_path.iterdir()) == [".b.mp4.01234567.partial", name]
    assert decoded(tmp_path / name)[1]


@pytest.mark.robust
def test_of_two_films_into_one_file_one_is_made_and_the_other_says_so(tmp_path, filming):
    process = filming(tmp_path / "a.mp4")
    with pytest.raises(
        OutputError, match=rf"a\.mp4: another run is writing there \(process {process.pid} on .*\); .*--out"
    ):
        write(tmp_path / "a.mp4")
    write(tmp_path / "b.mp4")
    assert list(tmp_path.glob(".a.mp4.*.partial")) and not (tmp_path / "a.mp4").exists()
    process.kill()
    process.wait()
    write(tmp_path / "a.mp4")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mp4", "b.mp4"]
