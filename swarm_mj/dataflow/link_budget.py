"""How many bits a second a radio link carries over a distance: Friis, the required Eb/N0, and Shannon's bound.

In decibels, C/N0 = EIRP - losses - 20 lg(4 pi r / lambda) + G/T - 10 lg k (Friis 1946). A rate R closes where C/N0 less the
margin is at least Eb/N0 + 10 lg R, and where Shannon (1948) allows R within the radio's bandwidth. All of it falls with
distance, so each rate has one longest range, and rates are looked up in a table of them without logarithms, by arrays and by
compiled code alike.
"""

from __future__ import annotations

from math import e, inf, log2, log10, pi
from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.dataflow.radios import Radio, radio_from
from swarm_mj.scenarios.constants import BOLTZMANN, SPEED_OF_LIGHT
from swarm_mj.scenarios.schema_link import Link
from swarm_mj.typing import Array


class RateTable(NamedTuple):
    """Rates by range as compiled code takes them, fastest first."""

    range_m: Array  #: longest range of each rate, ascending, shape (k,) [m]
    rate_bit_s: Array  #: the rates, descending, shape (k,) [bit/s]


def free_space_loss_db(range_m: Array | float, frequency_hz: float) -> Array:
    """Loss between isotropic antennas, (4 pi r f / c)^2 [dB]; of the shape of `range_m`."""
    return 20.0 * np.log10(4.0 * pi * np.asarray(range_m, np.float64) * frequency_hz / SPEED_OF_LIGHT)


def carrier_to_noise_db_hz(transmitter: Radio, receiver_g_over_t_db_k: float, range_m: Array | float) -> Array:
    """C/N0 at the receiver [dB Hz]; of the shape of `range_m` [m]."""
    return _at_no_distance(transmitter, receiver_g_over_t_db_k) - free_space_loss_db(range_m, transmitter.frequency_hz)


def _at_no_distance(transmitter: Radio, receiver_g_over_t_db_k: float) -> float:
    """C/N0 without loss in free space [dB Hz]."""
    return transmitter.eirp_dbw - transmitter.losses_db + receiver_g_over_t_db_k - 10.0 * log10(BOLTZMANN)


def required_c_n0_db_hz(transmitter: Radio, rate_bit_s: float) -> float:
    """Least C/N0 at which a rate closes with the radio's margin [dB Hz]; infinite where no signal would do."""
    per_hertz = rate_bit_s / transmitter.bandwidth_hz
    if per_hertz > 1000.0:  # 2^x would overflow
        return inf
    by_shannon = 10.0 * log10(transmitter.bandwidth_hz * float(np.expm1(per_hertz / log2(e))))
    return transmitter.margin_db + max(transmitter.required_eb_n0_db + 10.0 * log10(rate_bit_s), by_shannon)


def longest_range_m(transmitter: Radio, receiver_g_over_t_db_k: float, rate_bit_s: float | None = None) -> float:
    """Farthest distance over which a rate closes with margin [m].

    Args:
        transmitter: Who sends.
        receiver_g_over_t_db_k: Figure of merit of who hears [dB/K].
        rate_bit_s: Any rate > 0 [bit/s]; None: the radio's slowest.
    """
    rate = transmitter.rates_bit_s[0] if rate_bit_s is None else rate_bit_s
    spare_db = _at_no_distance(transmitter, receiver_g_over_t_db_k) - required_c_n0_db_hz(transmitter, rate)
    return float(SPEED_OF_LIGHT / (4.0 * pi * transmitter.frequency_hz) * 10.0 ** (spare_db / 20.0))


def crosslink_range_m(link: Link) -> float:
    """Longest link between two spacecraft: what the scenario says, or else as far as the budget of its radio closes [m].

    Raises:
        ScenarioError: The catalogue does not have its radio.
    """
    radio = radio_from(link.crosslink, "link.crosslink")
    return longest_range_m(radio, radio.g_over_t_db_k) if link.max_range_m is None else link.max_range_m


def rate_table(transmitter: Radio, receiver_g_over_t_db_k: float) -> RateTable:
    """The radio's rates with their longest ranges, fastest first."""
    rates = transmitter.rates_bit_s[::-1]
    limits = [longest_range_m(transmitter, receiver_g_over_t_db_k, rate) for rate in rates]
    return RateTable(np.array(limits, np.float64), np.array(rates, np.float64))


def rates_bit_s(transmitter: Radio, receiver_g_over_t_db_k: float, range_m: Array | float) -> Array:
    """The fastest of the radio's rates that closes with margin [bit/s]; 0 where none does; of the shape of `range_m` [m]."""
    table = rate_table(transmitter, receiver_g_over_t_db_k)
    index = np.searchsorted(table.range_m, np.asarray(range_m, np.float64))  # not a number stands behind all limits
    return np.append(table.rate_bit_s, 0.0)[index]


@kernel
def rate_at(table: RateTable, range_m: float) -> float:
    """The fastest rate of a table that closes over a distance, 0 where none does [bit/s]."""
    for k in range(table.range_m.shape[0]):
        if range_m <= table.range_m[k]:
            return float(table.rate_bit_s[k])
    return 0.0
