"""Two flights in one film: as wide as both, each half as its own film, and refused where none can be written."""

import av
import numpy as np
import pytest

from swarm_mj.errors import OutputError
from swarm_mj.rendering.side_by_side import make_side_by_side


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_two_flights_stand_beside_each_other(replay, tmp_path):
    made = make_side_by_side(replay, replay, tmp_path / "both.mp4", size=(160, 120), speed=400.0, notes=("one", "one"))
    with av.open(str(made.path)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == made.pictures and frames[0].shape == (120, 320, 3)
    left, right = frames[-1][:, :160].astype(int), frames[-1][:, 160:].astype(int)
    assert np.abs(left - right).mean() < 3.0 and left.std() > 5.0


def test_what_is_no_film_is_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(OutputError, match="must end in"):
        make_side_by_side(None, None, tmp_path / "film.png")
