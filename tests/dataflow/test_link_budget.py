"""Link budgets against numbers worked out by hand in watts, not decibels, and against MarCO's flight."""

from dataclasses import replace
from math import log2, pi, sqrt

import numpy as np
import pytest
from scipy.constants import c, k

from swarm_mj.dataflow.ground import G_OVER_T_34_M, G_OVER_T_70_M
from swarm_mj.dataflow.link_budget import (
    carrier_to_noise_db_hz,
    crosslink_range_m,
    free_space_loss_db,
    longest_range_m,
    rate_at,
    rate_table,
    rates_bit_s,
)
from swarm_mj.dataflow.radios import CATALOGUE, radio_from
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema_link import CrosslinkRadio, EarthRadio, Link

UHF, IRIS = CATALOGUE["uhf_omni"], CATALOGUE["iris_reflectarray"]
EVERY = pytest.mark.parametrize("radio", CATALOGUE.values(), ids=list(CATALOGUE))


def linear(decibel):
    return 10.0 ** (decibel / 10.0)


def received_over_density(radio, g_over_t, range_m):
    """C/N0 [Hz] from flux and effective area: P G / (4 pi r^2 L) times G' lambda^2 / (4 pi), over k T."""
    flux = radio.power_w * linear(radio.gain_dbi) / (4 * pi * range_m**2 * linear(radio.losses_db))
    area_over_temperature = linear(g_over_t) * (c / radio.frequency_hz) ** 2 / (4 * pi)
    return flux * area_over_temperature / k


@EVERY
def test_the_carrier_is_as_strong_as_flux_through_an_area_says(radio):
    for range_m in (1.0, 3e4, 1.57e11):
        found = linear(carrier_to_noise_db_hz(radio, -12.5, range_m))
        assert found == pytest.approx(received_over_density(radio, -12.5, range_m), rel=1e-9)


def test_numbers_of_textbooks():
    # 1 km at 1 GHz: 92.45 dB + 20 lg(km) + 20 lg(GHz), the engineer's form of Friis.
    assert free_space_loss_db(1e3, 1e9) == pytest.approx(92.4478, abs=1e-4)
    assert free_space_loss_db([1e3, 1e4], 1e9).tolist() == pytest.approx([92.4478, 112.4478], abs=1e-4)


@EVERY
def test_a_rate_closes_where_energy_per_bit_and_shannon_allow_it_and_nowhere_else(radio):
    g_over_t, margin = radio.g_over_t_db_k, linear(radio.margin_db)
    for rate in radio.rates_bit_s:
        limit = longest_range_m(radio, g_over_t, rate)
        for range_m, closes in ((0.999_999 * limit, True), (1.000_001 * limit, False)):
            signal = received_over_density(radio, g_over_t, range_m) / margin
            enough = signal / rate >= linear(radio.required_eb_n0_db)
            allowed = radio.bandwidth_hz * log2(1.0 + signal / radio.bandwidth_hz) >= rate
            assert (enough and allowed) is closes


@EVERY
def test_at_its_longest_range_a_rate_holds_and_beyond_it_the_next_slower_one(radio):
    steps = radio.rates_bit_s
    limits = np.array([longest_range_m(radio, 3.0, rate) for rate in steps])
    assert rates_bit_s(radio, 3.0, limits).tolist() == list(steps)
    assert rates_bit_s(radio, 3.0, np.nextafter(limits, np.inf)).tolist() == [0.0, *steps[:-1]]
    assert longest_range_m(radio, 3.0) == limits[0] and (np.diff(limits) < 0).all()
    assert rates_bit_s(radio, 3.0, [0.0, np.inf, np.nan]).tolist() == [steps[-1], 0.0, 0.0]


def test_a_narrow_band_caps_the_rate_by_shannon():
    narrow = replace(UHF, bandwidth_hz=10e3)
    limit = longest_range_m(narrow, -27.0, 115_200.0)
    signal = received_over_density(narrow, -27.0, limit) / linear(narrow.margin_db)
    assert 10e3 * log2(1.0 + signal / 10e3) == pytest.approx(115_200.0, rel=1e-9)
    assert limit < 0.2 * longest_range_m(UHF, -27.0, 115_200.0)
    assert longest_range_m(replace(UHF, bandwidth_hz=10.0), -27.0, 115_200.0) == 0.0


@EVERY
def test_compiled_code_and_arrays_give_the_same_rates(radio):
    table, limits = rate_table(radio, 1.0), [longest_range_m(radio, 1.0, rate) for rate in radio.rates_bit_s]
    rng = np.random.default_rng(3)
    ranges = [*limits, *np.nextafter(limits, np.inf), *10.0 ** rng.uniform(0, 14, 300), 0.0, np.inf, np.nan]
    assert [rate_at(table, r) for r in ranges] == rates_bit_s(radio, 1.0, ranges).tolist()


def test_a_range_in_the_scenario_stands_and_none_means_as_far_as_the_budget_closes():
    assert crosslink_range_m(Link(max_range_m=50e3)) == 50e3 and crosslink_range_m(Link(max_range_m=7.0)) == 7.0
    strong = CrosslinkRadio(power_w=4.0)
    ranges = [crosslink_range_m(Link(max_range_m=None, crosslink=radio)) for radio in (CrosslinkRadio(), strong)]
    assert ranges == [longest_range_m(UHF, UHF.g_over_t_db_k), pytest.approx(2.0 * ranges[0])]
    for reach in (None, 50e3):
        with pytest.raises(ScenarioError, match="link.crosslink.radio = 'smoke'"):
            crosslink_range_m(Link(max_range_m=reach, crosslink=CrosslinkRadio(radio="smoke")))


def test_twice_the_distance_costs_four_times_the_power():
    assert longest_range_m(replace(UHF, power_w=4.0), 0.0) == pytest.approx(2.0 * longest_range_m(UHF, 0.0))
    slower = [longest_range_m(UHF, 0.0, rate) for rate in (2400.0, 1200.0)]
    assert slower[1] == pytest.approx(sqrt(2.0) * slower[0])


def test_the_default_crosslink_closes_at_its_fastest_rate_over_the_papers_swarm():
    # By hand: -5 dB of losses, -27.0 dB/K, 228.6 dB of 1/k; 50.6 + 10 + 3 dB needed: 133.0 dB of free space, 245 km at 435 MHz.
    assert longest_range_m(UHF, UHF.g_over_t_db_k, 115_200.0) == pytest.approx(245e3, rel=0.01)


def test_marco_sends_eight_kilobits_from_mars_to_seventy_metres_and_not_to_thirty_four():
    # Hodges et al. 2017: 8 kbit/s from 157 million km to a dish of 70 m.
    assert rates_bit_s(IRIS, G_OVER_T_70_M, 1.57e11) == 8000.0
    assert rates_bit_s(IRIS, G_OVER_T_34_M, 1.57e11) < 8000.0
    by_hand = received_over_density(IRIS, G_OVER_T_70_M, 1.57e11) / 8000.0
    margin = carrier_to_noise_db_hz(IRIS, G_OVER_T_70_M, 1.57e11) - 39.03 - IRIS.required_eb_n0_db
    assert linear(margin) == pytest.approx(by_hand / linear(IRIS.required_eb_n0_db), rel=1e-3)
    assert IRIS.margin_db < margin < IRIS.margin_db + 4.0


def test_the_catalogue_says_where_its_numbers_are_from():
    for name, radio in CATALOGUE.items():
        assert name == radio.name and len(radio.source) > 20
    dish = CATALOGUE["dish_30cm"]
    assert linear(dish.gain_dbi) == pytest.approx(0.55 * (pi * 0.3 * dish.frequency_hz / c) ** 2, rel=0.01)
    assert IRIS.eirp_dbw == pytest.approx(35.22, abs=0.01)  # 4 W, 29.2 dBic


def test_a_scenario_puts_its_own_numbers_in_place_of_the_catalogues():
    radio = radio_from(
        CrosslinkRadio(power_w=2.0, rates_bit_s=(1e3, 2e3), margin_db=6, antenna="omnidirectional"), "link.crosslink"
    )
    assert radio == replace(UHF, power_w=2.0, rates_bit_s=(1e3, 2e3), margin_db=6.0)
    assert radio_from(EarthRadio(), "link.earth") == IRIS
    with pytest.raises(
        ScenarioError, match=r"link.earth.radio = 'irys_patch' .* did you mean 'iris_patch'\? there are dish_30cm"
    ):
        radio_from(EarthRadio(radio="irys_patch"), "link.earth")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"power_w": 0.0}, "power_w = 0.0: must be a finite number > 0"),
        ({"gain_dbi": float("nan")}, "gain_dbi = nan: must be a finite number"),
        ({"rates_bit_s": (2.0, 1.0)}, "rates_bit_s = .* must ascend"),
        ({"rates_bit_s": ()}, "rates_bit_s"),
    ],
)
def test_what_is_no_radio_is_refused(change, words):
    with pytest.raises(ScenarioError, match=words):
        replace(UHF, **change)
