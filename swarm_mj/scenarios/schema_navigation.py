"""What spacecraft know of where they are: given, or found by pictures of the body."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarm_mj.scenarios.section import Section

Method = Literal["centroid", "limb", "landmarks"]


class OpticalNavigation(Section):
    """Pictures of the body for navigation, and what the filter believes; with `navigation.mode: optical` alone."""

    interval_s: float = Field(
        600.0, gt=0, le=1e7, description="longest time between two pictures for navigation of a spacecraft [s]"
    )
    interval_share: float = Field(
        0.2,
        gt=0,
        le=10,
        description="the same over the distance from the body's centre over the speed [-]: near the body pictures come more "
        "often, and at most one a second; default: some twenty from a hundred radii out to the closest approach",
    )
    delay_s: float = Field(
        0.0, ge=0, le=1e6, description="from a picture until what it told is known aboard: read-out and processing [s]"
    )
    initial_position_m: float | None = Field(
        None,
        gt=0,
        le=1e9,
        description="1 sigma of each component of the position that a spacecraft begins with [m]; null: 1 % of the distance, "
        "at most 100 km; assumed: pictures before, and far away an ephemeris",
    )
    initial_velocity_m_s: float | None = Field(
        None,
        gt=0,
        le=1e4,
        description="the same of its velocity [m/s]; null: 1 % of the speed, at most 0.1 m/s; assumed likewise",
    )
    velocity_walk_m_s_sqrt_h: float = Field(
        6e-5,
        ge=0,
        le=1e3,
        description="process noise: random walk of each component of the velocity by forces that the filter does not know, "
        "1 sigma [m/s/sqrt(h)]; assumed: 0.2 mm/s in half a day",
    )
    methods: tuple[Method, ...] = Field(
        ("centroid", "limb", "landmarks"),
        min_length=1,
        description="ways to measure that may be used; which one, the body's size on the picture decides",
    )
    limb_from_px: float = Field(
        20.0, ge=5, le=1e5, description="diameter of the body on the picture from which its limb is fitted [px]"
    )
    landmarks_from_px: float = Field(
        300.0, ge=30, le=1e6, description="the same from which landmarks are looked for first [px]"
    )
    centroid_model: float = Field(
        0.01,
        ge=0,
        le=1,
        description="error of the predicted centre of brightness over the body's apparent radius, 1 sigma [-]; assumed: albedo "
        "that varies and a law that is not quite the body's",
    )
    limb_model_px: float = Field(
        0.1,
        ge=0,
        le=100,
        description="error of the predicted limb, 1 sigma [px]; assumed: shape known to a tenth of a pixel",
    )
    landmark_model_px: float = Field(
        0.1, ge=0, le=100, description="error of a landmark's place on the body, 1 sigma [px]; assumed likewise"
    )
    model_faces: int | None = Field(
        None,
        ge=50,
        le=1_000_000,
        description="faces of the mesh by which pictures are predicted, simplified from the body's [-]; null: the body's own",
    )
    range_m: float | None = Field(
        None,
        gt=0,
        le=1e6,
        description="error of ranges by the crosslink radios, 1 sigma [m]: those in reach of each other range at every picture "
        "and share one filter; null: no ranges, a filter each",
    )
    gm_percent: float = Field(
        0.0, ge=0, le=100, description="error of the believed gravitational parameter, 1 sigma, drawn by the seed [%]"
    )
    rotation_deg: float = Field(
        0.0,
        ge=0,
        le=30,
        description="error of the believed orientation of the body about each axis, 1 sigma, likewise [deg]",
    )
    spin_percent: float = Field(0.0, ge=0, le=10, description="error of the believed spin rate, 1 sigma, likewise [%]")


class Navigation(Section):
    """What a spacecraft knows of its own state."""

    mode: Literal["assumed", "optical"] = Field(
        "assumed",
        description="assumed: the truth, but for position_m and velocity_m_s at corrections; optical: what its filter makes of "
        "pictures, by which it corrects, points and knows when to take pictures; docs/how-to/optical_navigation.md",
    )
    position_m: float = Field(
        0.0,
        ge=0,
        le=1e9,
        description="of mode assumed: 1 sigma of each component of its position in N at a correction, drawn anew for each [m]",
    )
    velocity_m_s: float = Field(0.0, ge=0, le=1e4, description="the same of its velocity [m/s]")
    optical: OpticalNavigation = Field(
        default_factory=OpticalNavigation, description="of mode optical: pictures and filter"
    )
