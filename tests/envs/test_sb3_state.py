"""Where a training stands is read back as it was kept, or refused in one line."""

import json
import math

import pytest
from swarm_mj.envs.training.sb3_state import TrainingState, read_state

from swarm_mj.errors import ScenarioError


def test_a_state_is_read_back_and_what_is_not_known_yet_stays_unknown(tmp_path):
    file = tmp_path / "state.json"
    TrainingState(300, 12.5, 0.25, 0.75).write(file)
    assert read_state(file) == TrainingState(300, 12.5, 0.25, 0.75)
    TrainingState(steps=7).write(file)
    assert json.loads(file.read_text()) == {"steps": 7, "seconds": 0.0}
    found = read_state(file)
    assert found.steps == 7 and math.isnan(found.start) and found.best == -math.inf


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"steps": "3"}', "steps = '3': must be a valid integer"),
        ('{"steps": -3}', "steps = -3: must be greater than or equal to 0"),
        ('{"best": NaN}', "best = nan: must be a finite number"),
        ("[]", "must be"),
        ("{", "no JSON"),
    ],
)
def test_what_is_no_state_is_refused_by_key_and_value(tmp_path, text, words):
    file = tmp_path / "state.json"
    file.write_text(text)
    with pytest.raises(ScenarioError) as told:
        read_state(file)
    assert words in str(told.value) and str(file) in str(told.value) and "\n" not in str(told.value)
    assert "without --resume" in str(told.value)


def test_a_key_of_another_version_is_not_looked_at(tmp_path):
    (tmp_path / "state.json").write_text('{"steps": 3, "points": 4}')
    assert read_state(tmp_path / "state.json").steps == 3
