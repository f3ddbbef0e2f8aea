"""Radios by name: what a transceiver with its antenna radiates, needs and can send.

A value is marked "class" where radios of that kind have it but no single document is meant, and "assumed" where a link budget
needs a number that nobody publishes; both can be overridden in a scenario. Losses hold everything on the way besides free
space, of both ends, and are charged once, to the transmitter: line, pointing, polarisation, modulation and demodulator.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from math import isfinite, log10
from typing import Literal

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema_link import CrosslinkRadio, EarthRadio

Antenna = Literal["omnidirectional", "hemispherical", "directional"]


@dataclass(frozen=True, kw_only=True)
class Radio:
    """A transceiver with its antenna."""

    name: str  #: as scenarios say it
    band: str  #: UHF, S or X
    frequency_hz: float  #: of the carrier [Hz]
    power_w: float  #: radiated, at the transmitter's output [W]
    gain_dbi: float  #: of the antenna over the whole beam [dBi]; the same for sending and receiving
    losses_db: float  #: of a link from this transmitter, besides free space [dB]
    system_temperature_k: float  #: noise of the receiver and of what its antenna sees [K]
    coding: str  #: modulation and code, in words
    required_eb_n0_db: float  #: energy of an information bit over the noise density that the code needs [dB]
    margin_db: float  #: kept in hand [dB]
    bandwidth_hz: float  #: widest signal, which bounds the rate by Shannon's law [Hz]
    rates_bit_s: tuple[float, ...]  #: rates of information that the radio knows, ascending [bit/s]
    duplex: Literal["half", "full"]  #: whether it sends and hears at the same time (full) or not (half)
    antenna: Antenna  #: shape of the beam
    half_beam_deg: float  #: half of it [deg]
    source: str  #: where the numbers are from

    def __post_init__(self) -> None:
        """Refuse what is no radio.

        Raises:
            ScenarioError: A number is not finite or not positive where it has to be, or the rates do not ascend.
        """
        positive = ("frequency_hz", "power_w", "system_temperature_k", "bandwidth_hz", "half_beam_deg")
        for key in (*positive, "gain_dbi", "losses_db", "required_eb_n0_db", "margin_db"):
            value = getattr(self, key)
            if not isfinite(value) or (key in positive and value <= 0):
                allowed = "a finite number > 0" if key in positive else "a finite number"
                raise ScenarioError(f"radio {self.name!r}: {key} = {value!r}: must be {allowed}")
        steps = self.rates_bit_s
        if not steps or not 0 < steps[0] or not isfinite(steps[-1]) or sorted(set(steps)) != list(steps):
            raise ScenarioError(f"radio {self.name!r}: rates_bit_s = {list(steps)}: must ascend, all > 0, at least one")

    @property
    def eirp_dbw(self) -> float:
        """Equivalent isotropically radiated power, before the losses [dBW]."""
        return 10.0 * log10(self.power_w) + self.gain_dbi

    @property
    def g_over_t_db_k(self) -> float:
        """Figure of merit as a receiver [dB/K]."""
        return self.gain_dbi - 10.0 * log10(self.system_temperature_k)


def _binary(slowest: float, count: int) -> tuple[float, ...]:
    return tuple(slowest * 2.0**k for k in range(count))


#: Iris to Earth with one of its antennas: 8.4 GHz, 4 W of radio frequency (Kobayashi 2017, SSC17-II-04; Kobayashi et al. 2019,
#: IEEE AESM 34(9)). Bit rates on MarCO: 62.5 to 8,000 bit/s (Davarian et al. 2020, IEEE AESM 35(7), table 3); Iris goes on in
#: powers of two to 256 kbit/s, where SLS EM-1's links end (Kobayashi 2017). Turbo 1/6 in blocks of 8,920 bits: -0.1 dB at a
#: frame error rate of 1e-4 (CCSDS 130.1-G). Assumed: losses 4.3 dB = line 0.6, pointing 1.0, polarisation and atmosphere 0.5,
#: power left in the carrier 1.2, demodulator and decoder 1.0; 3 dB of margin, as deep-space projects plan; 8 MHz of the
#: 50 MHz band that deep space has at 8.4 GHz; 500 K, of the receiver of commands, which nothing here uses.
_IRIS = Radio(
    name="iris",
    band="X",
    frequency_hz=8.425e9,
    power_w=4.0,
    gain_dbi=0.0,
    losses_db=4.3,
    system_temperature_k=500.0,
    coding="BPSK, turbo 1/6, blocks of 8,920 bits (CCSDS 131.0-B)",
    required_eb_n0_db=-0.1,
    margin_db=3.0,
    bandwidth_hz=8e6,
    rates_bit_s=_binary(62.5, 13),
    duplex="full",
    antenna="directional",
    half_beam_deg=2.1,
    source="Kobayashi 2017 (SSC17-II-04); Davarian et al. 2020 (IEEE AESM 35(7)); CCSDS 130.1-G",
)

_RADIOS = (
    # UHF transceivers for CubeSats: 430 to 440 MHz, 1 W, half duplex, GFSK from 0.1 to 115.2 kbit/s (class of the GomSpace
    # NanoCom AX100, data sheet 1013823) with a deployed turnstile that radiates within about -1 and +1.5 dBi in all directions:
    # 0 dBi. Assumed: losses 5 dB = lines 1 + 1, circular against linear polarisation 3; 500 K = receiver of noise figure 3 dB
    # (290 K), sky at 435 MHz and the spacecraft's own noise (210 K); 10 dB for GFSK without a phase reference, with
    # Reed-Solomon (255,223), some 3 dB less than GFSK alone; 150 kHz, 1.3 times the fastest rate.
    Radio(
        name="uhf_omni",
        band="UHF",
        frequency_hz=435e6,
        power_w=1.0,
        gain_dbi=0.0,
        losses_db=5.0,
        system_temperature_k=500.0,
        coding="GFSK, Reed-Solomon (255,223)",
        required_eb_n0_db=10.0,
        margin_db=3.0,
        bandwidth_hz=150e3,
        rates_bit_s=(1200.0, 2400.0, 4800.0, 9600.0, 19_200.0, 38_400.0, 57_600.0, 115_200.0),
        duplex="half",
        antenna="omnidirectional",
        half_beam_deg=180.0,
        source="class of GomSpace NanoCom AX100 (data sheet 1013823) with a turnstile; noise, losses and Eb/N0 assumed",
    ),
    # S-band crosslinks between CubeSats, as flown by GOMX-4A and B (Perez et al. 2018, SSC18-VII-07): class 1 W at 2.2 GHz. A
    # patch has 6 to 7 dBi on its axis and some 0 dBi at the edge of its hemisphere; the edge holds for the whole beam here.
    # Convolutional 1/2 (7) with Reed-Solomon (255,223): 2.5 dB at a bit error rate of 1e-5 (CCSDS 130.1-G). Assumed: losses
    # 4 dB = lines 1 + 1, polarisation at the edge 1, demodulator 1; 400 K = noise figure 2 dB (170 K), lines and surroundings;
    # 2.5 MHz for 1 Mbit/s of coded QPSK.
    Radio(
        name="sband_patch",
        band="S",
        frequency_hz=2.25e9,
        power_w=1.0,
        gain_dbi=0.0,
        losses_db=4.0,
        system_temperature_k=400.0,
        coding="QPSK, convolutional 1/2 (7) and Reed-Solomon (255,223)",
        required_eb_n0_db=2.5,
        margin_db=3.0,
        bandwidth_hz=2.5e6,
        rates_bit_s=_binary(15_625.0, 7),
        duplex="full",
        antenna="hemispherical",
        half_beam_deg=90.0,
        source="class of the S-band crosslink of GOMX-4 (Perez et al. 2018, SSC18-VII-07); CCSDS 130.1-G; the rest assumed",
    ),
    # MarCO's reflectarray, 59.7 x 33.5 cm: 29.2 dBic at 8.425 GHz (Hodges et al. 2017, IEEE AP Magazine 59(2)). Half-power beam
    # of an aperture L: 70 deg lambda/L, 4.2 deg along its long side.
    replace(
        _IRIS,
        name="iris_reflectarray",
        gain_dbi=29.2,
        source=f"Hodges et al. 2017 (IEEE AP Magazine 59(2)); {_IRIS.source}; losses and margin assumed",
    ),
    # A single patch of Iris, class 6 dBi, half-power beam of some 80 deg.
    replace(
        _IRIS,
        name="iris_patch",
        gain_dbi=6.0,
        half_beam_deg=40.0,
        source=f"class of a single patch; {_IRIS.source}; losses and margin assumed",
    ),
    # An array of patches on a CubeSat's face as on NEA Scout, class 23 dBi; half-power beam b: 23 dBi = 41,253 x 0.65 / b^2.
    replace(
        _IRIS,
        name="iris_patch_array",
        gain_dbi=23.0,
        half_beam_deg=5.8,
        source=f"class of NEA Scout's medium-gain antenna; {_IRIS.source}; losses and margin assumed",
    ),
    # A dish of 30 cm: 0.55 (pi D / lambda)^2 = 25.9 dBi, half-power beam 70 deg lambda/D = 8.3 deg.
    replace(
        _IRIS,
        name="dish_30cm",
        gain_dbi=25.9,
        half_beam_deg=4.2,
        source=f"0.55 (pi D / lambda)^2 of a dish of 0.3 m; {_IRIS.source}; losses and margin assumed",
    ),
    # A transceiver on a board with a patch of 6 dBi: 2 W, as those of CubeSats in S band have (ISISPACE: 33 dBm of 13 W).
    # Convolutional 1/2 (7) with Reed-Solomon (255,223): 2.5 dB (CCSDS 130.1-G). Assumed: everything else as of Iris.
    replace(
        _IRIS,
        name="xband_patch",
        power_w=2.0,
        gain_dbi=6.0,
        half_beam_deg=40.0,
        coding="QPSK, convolutional 1/2 (7) and Reed-Solomon (255,223)",
        required_eb_n0_db=2.5,
        source="class of transceivers for CubeSats with a patch; CCSDS 130.1-G; the rest assumed, as of Iris",
    ),
)
#: All radios by name.
CATALOGUE: dict[str, Radio] = {radio.name: radio for radio in _RADIOS}


def radio_from(section: CrosslinkRadio | EarthRadio, key: str) -> Radio:
    """The radio that a section of a scenario names, with what the section gives put in its place.

    Args:
        section: `scenario.link.crosslink` or `scenario.link.earth`.
        key: Where it stands, for errors: `link.crosslink` or `link.earth`.

    Raises:
        ScenarioError: The catalogue has no such radio.
    """
    radio = CATALOGUE[known_name(section.radio, CATALOGUE, f"{key}.radio", "radio")]
    given = {field.name: getattr(section, field.name, None) for field in fields(Radio) if field.name != "name"}
    return replace(radio, **{name: value for name, value in given.items() if value is not None})


def known_name(name: str, catalogue: Iterable[str], key: str, what: str) -> str:
    """A name as it is, if a catalogue has it.

    Raises:
        ScenarioError: It has not; the message lists what there is.
    """
    known = sorted(catalogue)
    if name not in known:
        close = get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ScenarioError(f"{key} = {name!r} is no {what} of the catalogue: {hint}there are {', '.join(known)}")
    return name
