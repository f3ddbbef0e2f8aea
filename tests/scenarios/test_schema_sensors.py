"""Attitude sensors in a scenario: by the name of a class, by single values, and what packaged scenarios fly."""

import pytest

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import fault_model_from
from swarm_mj.scenarios.loading import load_scenario, packaged_names
from swarm_mj.scenarios.schema_sensors import IDEAL, Sensors


def sensors_of(given, overrides=None):
    return load_scenario(
        {"name": "x", **({} if given is None else {"spacecraft": {"sensors": given}})}, overrides or {}
    )


def test_a_name_stands_for_the_values_of_a_class_and_single_values_differ_from_cubesat():
    assert [sensors_of(given).spacecraft.sensors.name for given in ("ideal", "cubesat", None)] == [
        "ideal",
        "cubesat",
        "cubesat",
    ]
    assert set(sensors_of("ideal").spacecraft.sensors.model_dump().values()) == {0.0}
    own = sensors_of({"star_tracker_noise_arcsec": 6}).spacecraft.sensors
    assert own.name == "own values" and own == Sensors(star_tracker_noise_arcsec=6.0)


def test_one_value_of_a_class_by_name_can_be_changed_by_its_dotted_key():
    late = sensors_of("ideal", {"spacecraft.sensors.delay_s": 1.5}).spacecraft.sensors
    assert late == IDEAL.model_copy(update={"delay_s": 1.5})
    again = load_scenario("eros-config1", {"spacecraft.sensors.gyro_bias_deg_h": 3}).spacecraft.sensors
    assert again == IDEAL.model_copy(update={"gyro_bias_deg_h": 3.0})


@pytest.mark.parametrize("overrides", [{}, {"spacecraft.sensors.delay_s": 1}])
def test_another_name_is_refused_with_the_classes(overrides):
    with pytest.raises(
        ScenarioError, match=r"spacecraft\.sensors.* = 'best': must be ideal or cubesat, or a mapping of"
    ):
        sensors_of("best", overrides)


def test_the_papers_scenarios_have_ideal_sensors_and_all_others_those_of_cubesats():
    flown = {name: load_scenario(name).spacecraft.sensors.name for name in packaged_names()}
    assert {name for name, sensors in flown.items() if sensors == "ideal"} == {
        "eros-config1",
        "eros-config2",
        "eros-literal",
    }
    assert set(flown.values()) == {"ideal", "cubesat"}


def test_sensors_that_err_are_no_reason_to_fly_on_without_who_hits_the_body():
    assert fault_model_from(sensors_of("ideal")) is None
    assert not fault_model_from(sensors_of("cubesat")).losses
    assert fault_model_from(sensors_of("cubesat", {"dispersions.mass_percent": 1})).losses
