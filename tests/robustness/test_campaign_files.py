"""Any campaign file is read or refused."""

import json

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.errors import SwarmError

from .hostile_scenarios import EXTREME, JUNK
from .limits import bounded, examples

pytestmark = pytest.mark.robust

GOOD = {
    "name": "fuzzed",
    "runs": 4,
    "scenarios": ["eros-quick"],
    "parameters": {"camera.half_angle_deg": {"distribution": "uniform", "low": 3.0, "high": 6.0}},
}
KEYS = ["name", "runs", "scenarios", "parameters", "seed", "set", "sampling", "telemetry", "what"]


def read_or_refused(path):
    with bounded():
        try:
            load_campaign(path)
        except SwarmError as error:
            assert str(error).strip()
            assert len(str(error)) < 200_000


def test_the_unspoiled_campaign_is_read(tmp_path):
    (tmp_path / "good.yaml").write_text(yaml.safe_dump(GOOD))
    assert load_campaign(tmp_path / "good.yaml").campaign.runs == 4


@examples(80)
@given(changes=st.dictionaries(st.sampled_from(KEYS), JUNK | EXTREME, max_size=3))
def test_any_values_are_read_or_refused(tmp_path_factory, changes):
    path = tmp_path_factory.getbasetemp() / "fuzzed.yaml"
    path.write_text(yaml.safe_dump({**GOOD, **changes}), encoding="utf-8", errors="surrogatepass")
    read_or_refused(path)


PATHS = st.sampled_from(["seed", "camera", "camera.x", "design.visiting_points.0", "a.b.c", "."])
LAWS = st.fixed_dictionaries(
    {"distribution": st.sampled_from(["uniform", "normal", "choice", "nobody"])},
    optional=dict.fromkeys(["low", "high", "mean", "std", "values"], EXTREME | JUNK),
)


@examples(60)
@given(key=st.text(max_size=12) | PATHS, law=JUNK | LAWS)
def test_any_distribution_is_read_or_refused(tmp_path_factory, key, law):
    path = tmp_path_factory.getbasetemp() / "fuzzed.yaml"
    path.write_text(yaml.safe_dump({**GOOD, "parameters": {key: law}}), encoding="utf-8", errors="surrogatepass")
    read_or_refused(path)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"[1]", b"\xff\xfe", b"name: !!timestamp soon", b"name: &a [*a]", b"[" * 5000, b"x" * 2_000_000,
        json.dumps({**GOOD, "runs": 10**400}).encode(), json.dumps({**GOOD, "scenarios": ["../../etc/passwd"]}).encode(),
        json.dumps({**GOOD, "name": "../out"}).encode(), json.dumps({**GOOD, "scenarios": ["x" * 5000]}).encode(),
    ],
)  # fmt: skip
def test_a_broken_campaign_is_refused(tmp_path, content):
    (tmp_path / "broken.yaml").write_bytes(content)
    with bounded(), pytest.raises(SwarmError):
        load_campaign(tmp_path / "broken.yaml")


def test_a_wrong_value_of_any_length_is_shown_by_its_beginning(tmp_path):
    (tmp_path / "long.yaml").write_text(yaml.safe_dump({**GOOD, "runs": "x" * 500_000}))
    with pytest.raises(SwarmError, match="runs = 'xxx") as error:
        load_campaign(tmp_path / "long.yaml")
    assert len(str(error.value)) < 1_000
