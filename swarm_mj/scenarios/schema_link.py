"""Sections of a scenario about radios and data: links, the network on Earth, and what becomes of the pictures.

Radios and networks are named here and known in `swarm_mj.dataflow`, which refuses other names and lists its own.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from swarm_mj.scenarios.section import Section, Vector3

#: Rates of a radio [bit/s].
Rate = Annotated[float, Field(ge=1e-3, le=1e12)]
#: Slots of a contact plan that are held at once, each with a matrix of spacecraft by spacecraft.
MAX_SLOTS = 100_000


class _RadioChoice(Section):
    """A radio by name, and numbers of one's own in place of the catalogue's."""

    power_w: float | None = Field(
        None, gt=0, le=1e6, description="radiated power at the transmitter's output [W]; null: the radio's"
    )
    gain_dbi: float | None = Field(
        None, ge=-50, le=100, description="of the antenna over the whole beam [dBi]; null: the radio's"
    )
    rates_bit_s: tuple[Rate, ...] | None = Field(
        None,
        min_length=1,
        max_length=100,
        description="rates that the radio knows, ascending [bit/s]; the fastest that the link budget closes is taken; null: "
        "the radio's",
    )
    required_eb_n0_db: float | None = Field(
        None,
        ge=-1.59,
        le=50,
        description="energy of an information bit over the noise density that modulation and code need [dB]; Shannon's bound "
        "is -1.59; null: the radio's",
    )
    margin_db: float | None = Field(None, ge=0, le=50, description="kept in hand [dB]; null: the radio's, 3 dB")
    duplex: Literal["half", "full"] | None = Field(
        None, description="whether it sends and hears at the same time (full) or not (half); null: the radio's"
    )

    @field_validator("rates_bit_s")
    @classmethod
    def _rates_ascend(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and sorted(set(value)) != list(value):
            raise ValueError(f"= {list(value)}: must ascend; write {sorted(set(value))}")
        return value


class CrosslinkRadio(_RadioChoice):
    """The radio between spacecraft of the swarm."""

    radio: str = Field(
        "uhf_omni",
        min_length=1,
        max_length=100,
        description="name in the catalogue of swarm_mj.dataflow.radios: uhf_omni (435 MHz, 1 W, up to 115.2 kbit/s; the paper "
        'says "low-frequency data transfer") or sband_patch (up to 1 Mbit/s)',
    )
    antenna: Literal["omnidirectional", "hemispherical"] = Field(
        "omnidirectional",
        description="omnidirectional: a link closes by range and where the body is not in between, and everybody may speak to "
        "everybody; hemispherical: a talker points its dish, and the other hears in one hemisphere only",
    )
    access: Literal["one_at_a_time", "tdma", "parallel"] = Field(
        "one_at_a_time",
        description="who may send when: one transmitter of the whole swarm; each spacecraft in its own share of the frame, "
        "needed or not; or a channel for each link",
    )


class EarthRadio(_RadioChoice):
    """The radio that sends to Earth."""

    radio: str = Field(
        "iris_reflectarray",
        min_length=1,
        max_length=100,
        description="name in the catalogue of swarm_mj.dataflow.radios: iris_reflectarray (MarCO's: 8.4 GHz, 4 W, 29.2 dBic), "
        "iris_patch_array, iris_patch, dish_30cm or xband_patch (a transceiver on a board: 2 W, 6 dBi)",
    )


class GroundStation(Section):
    """A station of one's own."""

    name: str = Field(min_length=1, max_length=100, description="what plans and tables call it")
    latitude_deg: float = Field(ge=-90, le=90, description="geodetic latitude, WGS 84 [deg]")
    longitude_deg: float = Field(ge=-360, le=360, description="east longitude [deg]")
    height_m: float = Field(0.0, ge=-1000, le=10_000, description="above the ellipsoid [m]")
    diameter_m: float = Field(34.0, gt=0, le=1000, description="of the antenna, for tables [m]")
    g_over_t_db_k: float = Field(
        ge=-50, le=100, description="figure of merit as a receiver of the Earth radio's band [dB/K]; a 34 m dish: 54"
    )


class Ground(Section):
    """The stations on Earth that listen."""

    network: str = Field(
        "dsn",
        min_length=1,
        max_length=100,
        description="name of a network in swarm_mj.dataflow.ground: dsn (three dishes of 70 m), dsn34 (three of 34 m) or "
        "estrack (three of 35 m)",
    )
    stations: tuple[GroundStation, ...] = Field(
        (), max_length=100, description="stations of one's own instead of a network's"
    )
    min_elevation_deg: float = Field(
        10.0,
        ge=0,
        lt=90,
        description="a station hears what stands higher [deg]; DSN's dishes follow down to 6 deg, but below 10 deg the "
        "atmosphere adds noise that a link budget at one elevation leaves out",
    )
    channels: int = Field(1, ge=1, le=100, description="spacecraft that the stations together hear at the same time")


class Link(Section):
    """Radio links: a directional antenna along +z, the antenna between spacecraft, and the stations on Earth."""

    dish_half_angle_deg: float = Field(5.0, gt=0, le=90, description="half the beam of the antenna along +z [deg]")
    hemispherical_boresight_B: Vector3 = Field(
        (0.0, 0.0, -1.0),
        description="axis of the inter-satellite antenna in B [-]: on the face opposite the dish, so that a relay on the "
        "Earthward side looks back on the swarm; from the swarm's middle a hemisphere cannot hear all of it",
    )
    hemispherical_half_angle_deg: float = Field(
        90.0, gt=0, le=180, description="half the beam of the inter-satellite antenna [deg]; 180: two back to back"
    )
    max_range_m: float | None = Field(
        None,
        gt=0,
        description="of an inter-satellite link [m]; null: as far as the link budget of link.crosslink closes",
    )
    crosslink: CrosslinkRadio = Field(default_factory=CrosslinkRadio)
    earth: EarthRadio = Field(default_factory=EarthRadio)
    ground: Ground = Field(default_factory=Ground)

    @field_validator("hemispherical_boresight_B")
    @classmethod
    def _boresight_points_somewhere(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if max(map(abs, value)) < 1e-9:
            raise ValueError(f"= {list(value)}: must not be zero")
        return value


class Data(Section):
    """What becomes of the pictures: bits, storage, relays, and how long is sent."""

    bits_per_pixel: float = Field(
        12.0, gt=0, le=64, description="of a raw picture; small cameras digitise to 10 or 12 bits [bit]"
    )
    compression: float = Field(
        12.0,
        ge=1,
        le=1e4,
        description="raw bits over sent bits [-]; default: one bit per pixel is left, where ICER (Kiely and Klimesh 2003) and "
        "CCSDS 122.0 still look lossless to the eye",
    )
    sensor_px: tuple[Annotated[int, Field(ge=1, le=100_000)], Annotated[int, Field(ge=1, le=100_000)]] | None = Field(
        None,
        description="width and height of the real detector [px]; null: camera.detector_px, those of "
        "camera.detector_ifov_rad, or camera.resolution_px; only bits follow from it, what a picture shows does not",
    )
    pictures: Literal["best", "first", "all"] = Field(
        "best",
        description="by which picture a spacecraft keeps a cell that several of its own show: the one of the finest ground "
        "sampling distance (within a tenth, the nearest to the arrival); the first that counts; or the best, and the others "
        "are sent beside it",
    )
    product: Literal["frame", "window", "cells"] = Field(
        "frame",
        description="what is sent of a picture: all of it, as cameras give it; the rectangle of the detector around the cells "
        "that are kept by it; or their pixels alone, which takes a mask that the spacecraft works out by itself",
    )
    storage_bit: int = Field(
        32_000_000_000,
        ge=1,
        le=2**53,
        description="that a spacecraft holds [bit]; default: 4 GB, a class of flash memory on CubeSat computers",
    )
    horizon_s: float = Field(
        172_800.0,
        ge=0,
        le=30 * 86_400.0,
        description="how long after the end of the flight data are sent [s]; default: two days, so that each station on Earth "
        "rises at least once",
    )
    slot_s: float = Field(
        60.0,
        ge=1,
        le=86_400.0,
        description="step of the contact plan [s], looked at every 15 s, at least four times; longer where pictures are taken "
        "for days, and growing to half an hour after the last of them",
    )
    relays: int = Field(
        1,
        ge=1,
        le=1000,
        description="spacecraft that may send to Earth after the flight, where election is first, k_medoids or delivery; where "
        "fewer work, all that do",
    )
    election: Literal["flight", "first", "medoid", "k_medoids", "delivery"] = Field(
        "flight",
        description="who they are: those that the behaviour chose in flight; the lowest numbers; the one or the several "
        "nearest to all others; or those with which most of the map is delivered. Held when the flight is over, which it does "
        "not touch: in flight the behaviour elects",
    )
    election_interval_s: float | None = Field(
        None,
        gt=0,
        le=30 * 86_400.0,
        description="time between two elections, at the starts of slots [s]; null: once, at the end of the flight; relays that "
        "are lost are replaced at the next",
    )
    hysteresis: float = Field(
        0.1,
        ge=0,
        le=1,
        description="part by which the sum of distances to the relays must be less with others to elect them instead [-]: a "
        "change costs turning the dishes",
    )

    @model_validator(mode="after")
    def _slots_can_be_held(self) -> Self:
        if self.horizon_s > MAX_SLOTS * self.slot_s:
            raise ValueError(
                f"slot_s = {self.slot_s:g}: horizon_s = {self.horizon_s:g} takes more than {MAX_SLOTS} slots (MAX_SLOTS); "
                f"must be >= {self.horizon_s / MAX_SLOTS:g}"
            )
        return self

    @model_validator(mode="after")
    def _elections_can_be_held(self) -> Self:
        if self.relays > 1 and self.election in ("flight", "medoid"):
            raise ValueError(
                f"relays = {self.relays}: must be 1 with election: {self.election}, which chooses by itself how many; for more "
                "give election: k_medoids, delivery or first"
            )
        if self.election_interval_s is not None and self.election == "delivery":
            raise ValueError(
                f"election_interval_s = {self.election_interval_s:g}: must be null with election: delivery, which chooses once "
                "for the whole window; for elections again and again give election: k_medoids"
            )
        return self

    @property
    def sent_bits_per_pixel(self) -> float:
        """After compression."""
        return self.bits_per_pixel / self.compression
