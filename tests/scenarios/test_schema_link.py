"""Sections of radios and data: what they refuse, and that they name what the catalogues hold."""

import pytest

from swarm_mj.dataflow.ground import NETWORKS
from swarm_mj.dataflow.radios import CATALOGUE
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.scenarios.schema_link import CrosslinkRadio, Data, EarthRadio, Ground


def test_by_default_one_bit_per_pixel_is_sent_and_a_slot_divides_the_horizon():
    data = Data()
    assert data.sent_bits_per_pixel == 1.0 and data.horizon_s % data.slot_s == 0
    assert Data(bits_per_pixel=10.0, compression=4.0).sent_bits_per_pixel == 2.5


def test_descriptions_and_defaults_name_every_radio_and_network_that_there_is():
    told = " ".join(model.model_fields["radio"].description for model in (CrosslinkRadio, EarthRadio))
    assert all(name in told for name in CATALOGUE)
    assert all(name in Ground.model_fields["network"].description for name in NETWORKS)
    assert {CrosslinkRadio().radio, EarthRadio().radio} <= CATALOGUE.keys() and Ground().network in NETWORKS


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "link.crosslink.rates_bit_s=[2000, 1000]",
            r"link.crosslink.rates_bit_s.*must ascend; write \[1000.0, 2000.0\]",
        ),
        ("link.earth.required_eb_n0_db=-2", "link.earth.required_eb_n0_db.*-1.59"),
        ("link.crosslink.access=csma", "link.crosslink.access.*one_at_a_time"),
        ("link.ground.stations=[{name: roof}]", "link.ground.stations"),
        ("data.slot_s=1", "slot_s = 1: horizon_s = 172800 takes more than 100000 slots .*must be >= 1.728"),
        ("data.compression=0.5", "data.compression"),
        ("data.sensor_px=[640]", "data.sensor_px"),
        ("data.storage_bit=0", "data.storage_bit"),
        ("data.relays=2", "relays = 2: must be 1 with election: flight, .* k_medoids, delivery or first"),
        (
            "data={election: delivery, election_interval_s: 60}",
            "election_interval_s = 60: must be null with election: delivery, .* k_medoids",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_by_its_key(override, words):
    with pytest.raises(ScenarioError, match=words):
        load_scenario("eros-quick", parse_overrides([override]))


def test_sections_are_read_from_a_scenario():
    scenario = load_scenario(
        "eros-quick",
        {
            "link.max_range_m": None,
            "data.sensor_px": [2048, 1536],
            "data.election": "k_medoids",
            "link.earth.power_w": 2,
        },
    )
    assert scenario.link.max_range_m is None and scenario.data.sensor_px == (2048, 1536)
    assert scenario.data.election == "k_medoids" and scenario.link.earth.power_w == 2.0
