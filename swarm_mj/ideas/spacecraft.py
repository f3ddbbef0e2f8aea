"""The spacecraft designer: the lightest CubeSat of each kind that can do what a requirement asks, or what forbids it.

For each size, imaging altitude and detector the camera follows from the resolution. The rest (wheels, radio, thrusters, panels,
batteries) is chosen by a mixed-integer linear program that minimises the mass and keeps the budgets of mass, volume, power,
energy and data.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import atan, ceil, degrees, log, pi, radians, sqrt, tan
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import LinearConstraint

from swarm_mj.dataflow.ground import stations_from
from swarm_mj.dataflow.link_budget import rates_bit_s
from swarm_mj.dataflow.radios import CATALOGUE
from swarm_mj.designer.exact import solve_program
from swarm_mj.ideas import sizing
from swarm_mj.ideas.components import (
    BATTERY,
    BATTERY_WH,
    CROSSLINK_SENDS_W,
    DETECTORS,
    EARTH_LINKS,
    PANEL,
    PANEL_CELLS_M2,
    PANEL_EFFICIENCY,
    PROPULSION,
    SIZES,
    WHEELS,
    Detector,
    EarthLink,
    Propulsion,
    Size,
    WheelSet,
    bus_of,
)
from swarm_mj.ideas.requirement import Requirement
from swarm_mj.io import interruption
from swarm_mj.observation.photometry import Surface, radiance_factor
from swarm_mj.observation.radiometry import electrons, signal_to_noise
from swarm_mj.scenarios.constants import AU, GREEN_LIGHT_M, STANDARD_GRAVITY
from swarm_mj.scenarios.schema import Scenario, Wheel
from swarm_mj.scenarios.schema_imaging import Camera
from swarm_mj.typing import Array

#: Wheels of a spacecraft; and how much more torque and momentum they have than they need.
WHEEL_COUNT, WHEEL_RESERVE = 3, 1.25
#: Angles at which the signal is told: incidence, emission, phase [deg].
LIT_AT_DEG = (45.0, 30.0, 60.0)
#: Smallest lens, narrowest barrel [m] and fastest focal ratio that are made here, and how many lenses are tried in between.
SMALLEST_LENS_M, BARREL_M, FASTEST, LENSES = 0.01, 0.05, 1.4, 12
#: Longest exposure, as `camera.exposure_s` allows [s], and shortest pulse of thrusters, as that of `Thrusters` [s].
LONGEST_S, PULSE_S = 60.0, 0.01
#: Programs whose answers are remembered: one spacecraft fits many requirements.
PROGRAMS = 4096
#: Most batteries of a spacecraft; and more panels than any carries, to tell how many are needed.
MOST_BATTERIES, MANY_PANELS = 20, 1000
#: Hottest that electronics may be, and what its sides emit, for the bound on power [K, -].
HOT_K, EMISSIVITY = 313.0, 0.8
#: Longest burn of thrusters that do not burn for days [h].
BURN_H = 1.0
#: Widest half-angle of a lens [deg].
WIDEST_DEG = 30.0
#: Time in which the camera takes pictures, panels not facing the Sun, where the body's shadow does not take longer [h].
IMAGING_H = 1.0


class Encounter(NamedTuple):
    """What a scenario says of the passage.

    Attributes:
        area_m2: Of the target.
        extent_m: Of the target, from its middle to both sides.
        speed: Of the spacecraft over it at the arrival [m/s].
        altitude_m: The scenario's.
        sun_m: Distance of the body from the Sun.
        earth_m: From Earth.
        surface: How it reflects.
        interval_s: Between two pictures; 0: the arrival alone counts.
        idle: Spacecraft that only communicate.
        senders: Spacecraft that send the pictures of all to Earth; 0: each sends its own.
        shadow_s: Longest time in which the body hides the Sun.
        cell_m2: Of the smallest cell of the target.
        min_pixels: That a cell must have in a picture.
        corrections_m_s: Velocity that corrections take in 99 of 100 flights, of whoever takes the most; 0: there are none.
    """

    area_m2: float
    extent_m: float
    speed: float
    altitude_m: float
    sun_m: float
    earth_m: float
    surface: Surface
    interval_s: float
    idle: int = 0
    senders: int = 0
    shadow_s: float = 0.0
    cell_m2: float = 0.0
    min_pixels: float = 0.0
    corrections_m_s: float = 0.0


class Payload(NamedTuple):
    """A camera for a resolution from an altitude; masses and volumes with its detector."""

    altitude_m: float
    detector: Detector
    pixel_rad: float  #: angle of a pixel [rad]
    aperture_m: float
    focal_m: float  #: focal length [m]
    length_m: float  #: of the optics, folded [m]
    exposure_s: float
    snr: float  #: signal to noise at `LIT_AT_DEG` [-]
    mass_kg: float
    volume_u: float
    half_angle_deg: float

    @property
    def power_w(self) -> float:
        """While it takes pictures [W]."""
        return self.detector.power_w


class Refusal(NamedTuple):
    """What forbids a spacecraft: the limit, what is needed, and in words."""

    cause: str
    allowed: float
    needed: float
    words: str

    @property
    def short(self) -> float:
        """By what factor what is needed and what is allowed lie apart; infinite where that is no number."""
        least, most = sorted((self.allowed, self.needed))
        return most / least if least > 0.0 else np.inf


class Mode(NamedTuple):
    """What is drawn and given in a mode, with margin.

    Attributes:
        name: Of the mode.
        hours: A day, or as long as it lasts.
        power_w: That is drawn.
        panels_w: That panels give.
        battery_wh: What batteries give in that time, at the least.
    """

    name: str
    hours: float
    power_w: float
    panels_w: float
    battery_wh: float


class Row(NamedTuple):
    """A line of the budgets; powers by mode [W]."""

    name: str
    number: float
    mass_kg: float
    volume_u: float
    power_w: float
    source: str


def kind_of(size: Size, altitude_m: float, detector: Detector) -> str:
    """What a kind of spacecraft is called."""
    return f"{size.units}U at {altitude_m:,.0f} m with a {detector.name} detector"


@dataclass(frozen=True)
class Spacecraft:
    """A sized spacecraft.

    Attributes:
        size: By the standard.
        payload: Its camera.
        wheels: Its wheels.
        link: Its transponder and antenna.
        propulsion: Its thrusters; None: it has none.
        propellant_kg: In the tank.
        panels: Deployed panels.
        batteries: Their number.
        rows: The budgets.
        mass_kg: With margin.
        volume_u: With what harness takes.
        power_w: Largest mean power of a day, with margin [W].
        available_w: What the panels give at the body's distance from the Sun [W].
        send_h: Time in which its pictures are sent, contacts of `contact_h` a day [h].
        pictures: That it takes in the passage, at most.
        modes: What it draws, mode by mode.
    """

    size: Size
    payload: Payload
    wheels: WheelSet
    link: EarthLink
    propulsion: Propulsion | None
    propellant_kg: float
    panels: int
    batteries: int
    rows: tuple[Row, ...]
    mass_kg: float
    volume_u: float
    power_w: float
    available_w: float
    send_h: float
    pictures: int
    modes: tuple[Mode, ...]

    @property
    def name(self) -> str:
        """Size, altitude and detector."""
        return kind_of(self.size, self.payload.altitude_m, self.payload.detector)

    def changes(self, asked: Requirement) -> dict[str, Any]:
        """Values of the requirement's scenario by dotted key that fly it."""
        payload, wheel, usual, propulsion = self.payload, self.wheels, Wheel(), self.propulsion
        # Of a shape and speed like those of the scenarios' own.
        inertia = wheel.momentum_n_m_s / (usual.max_speed_rpm * pi / 30.0)
        flat = usual.transverse_inertia_kg_m2 / usual.spin_inertia_kg_m2
        return {
            **asked.scenario_changes,
            "spacecraft.mjcf": None,
            "spacecraft.wheel_layout": "orthogonal",
            "spacecraft.mass_kg": round(self.mass_kg, 4),
            "spacecraft.size_m": list(self.size.size_m),
            "spacecraft.wheel.mass_kg": wheel.mass_kg,
            "spacecraft.wheel.max_torque_n_m": wheel.torque_n_m,
            "spacecraft.wheel.spin_inertia_kg_m2": inertia,
            "spacecraft.wheel.transverse_inertia_kg_m2": flat * inertia,
            "spacecraft.thrusters": None
            if propulsion is None
            else {
                "thrust_n": propulsion.thrust_n,
                "specific_impulse_s": propulsion.specific_impulse_s,
                "propellant_kg": self.propellant_kg,
                "min_impulse_bit_n_s": PULSE_S * propulsion.thrust_n,
            },
            # The whole section: nothing of the scenario's camera is left.
            "camera": {
                "half_angle_deg": payload.half_angle_deg,
                "detector_ifov_rad": payload.pixel_rad,
                "aperture_m": payload.aperture_m,
                "wavelength_m": GREEN_LIGHT_M,
                "quantum_efficiency": payload.detector.quantum_efficiency,
                "read_noise": payload.detector.read_noise,
            },
            "design.imaging_altitude_m": payload.altitude_m,
            "link.earth.radio": self.link.radio,
        }


def payload_for(
    asked: Requirement, seen: Encounter, size: Size, altitude_m: float, detector: Detector
) -> Payload | Refusal:
    """The camera that a resolution needs from an altitude, with the smallest lens that does; or what forbids it."""
    pixel = sizing.pixel_angle(asked.resolution_m, altitude_m, asked.margins.relief)
    # Nearer by, a longer lens than the resolution needs: wide ones distort, and dim towards their edges.
    pixel = min(pixel, 2.0 * tan(radians(WIDEST_DEG)) / detector.pixels)
    needed = sizing.aperture(pixel, GREEN_LIGHT_M)
    if needed > size.aperture_m:
        return Refusal(
            "diffraction",
            size.aperture_m,
            needed,
            f"{asked.resolution_m:g} m from {altitude_m:,.0f} m, with {asked.margins.relief:g} in hand for slants, need a "
            f"lens of {1e3 * needed:.3g} mm; {size.units}U take {1e3 * size.aperture_m:g} mm",
        )
    focal = sizing.focal_length(pixel, detector.pitch_m)
    most = min(size.aperture_m, focal / FASTEST)
    least = min(max(needed, SMALLEST_LENS_M), most)
    if most < needed:
        return Refusal(
            "lens",
            most,
            needed,
            f"its lens would be faster than f/{FASTEST:g}: {1e3 * needed:.3g} mm of {1e3 * focal:.3g} mm",
        )
    sharp = min(sizing.smear_exposure(pixel * altitude_m, asked.max_blur_px, max(seen.speed, 1e-6)), LONGEST_S)
    reached, aperture, exposure = 0.0, least, sharp
    mu0, mu, phase = (float(np.cos(np.radians(angle))) for angle in LIT_AT_DEG)
    # Ground at the angles of the signal, and facets that face the Sun, by which exposures end: their emission is the phase.
    factors = np.array(
        [radiance_factor(seen.surface, mu0, mu, phase), radiance_factor(seen.surface, 1.0, phase, phase)]
    )
    for aperture in np.geomspace(least, most, LENSES):
        camera = Camera(
            half_angle_deg=1.0,
            aperture_m=float(aperture),
            wavelength_m=GREEN_LIGHT_M,
            quantum_efficiency=detector.quantum_efficiency,
            read_noise=detector.read_noise,
            exposure_s=1.0,
        )
        light = electrons(camera, pixel, factors, seen.sun_m)
        well = camera.detector.exposure_share * camera.detector.full_well_e
        exposure = min(sharp, well / float(light[1]))
        reached = float(signal_to_noise(camera, exposure * light[:1])[0])
        if reached >= asked.min_snr:
            break
    if reached < asked.min_snr:
        return Refusal(
            "signal",
            reached,
            asked.min_snr,
            f"in {exposure:.3g} s, in which the ground moves by {asked.max_blur_px:g} px or less at {seen.speed:,.0f} m/s and "
            f"no pixel overflows, the largest lens of {1e3 * aperture:.3g} mm gives a signal to noise of {reached:.3g}, not "
            f"{asked.min_snr:g}",
        )
    length = sizing.optics_length(focal, float(aperture))
    if length > size.length_m:
        return Refusal(
            "length",
            size.length_m,
            length,
            f"optics of f = {1e3 * focal:,.0f} mm are {1e3 * length:.3g} mm long, {size.units}U have "
            f"{1e3 * size.length_m:g} mm",
        )
    volume = max(float(aperture) + 0.01, BARREL_M) ** 2 * length / 1e-3
    return Payload(
        altitude_m,
        detector,
        pixel,
        float(aperture),
        focal,
        length,
        exposure,
        reached,
        sizing.optics_mass(float(aperture)) + detector.mass_kg,
        volume + detector.volume_u,
        degrees(atan(0.5 * detector.pixels * pixel)),
    )


def pictures_in_passage(asked: Requirement, seen: Encounter, payload: Payload) -> int:
    """Pictures of a spacecraft, at most, that can show any of the target at the resolution, on a straight path."""
    if seen.interval_s <= 0.0:
        return 1
    # As far off as a pixel still samples the ground finely enough.
    reach = max(asked.resolution_m / payload.pixel_rad, payload.altitude_m)
    chord = 2.0 * sqrt(reach**2 - payload.altitude_m**2) + seen.extent_m
    return 1 + int(chord / max(seen.speed, 1e-9) / seen.interval_s)


def least_observers(asked: Requirement, seen: Encounter, payload: Payload) -> int:
    """Observers without which the target cannot be sampled, whatever their paths: by the pixels of all their pictures."""
    pictures = _pictures_needed(asked, seen, payload)
    return max(1, ceil(pictures / pictures_in_passage(asked, seen, payload) - 1e-9))


def least_swarm_kg(asked: Requirement, seen: Encounter, one: Spacecraft) -> float:
    """No swarm of a kind is lighter, those that only communicate included [kg]."""
    return (least_observers(asked, seen, one.payload) + seen.idle) * one.mass_kg


def _pictures_needed(asked: Requirement, seen: Encounter, payload: Payload) -> int:
    area = 0.01 * asked.share_percent * seen.area_m2
    return asked.looks * sizing.pictures_needed(area, payload.detector.pixels, asked.resolution_m)


def _pictures_sent(asked: Requirement, seen: Encounter, payload: Payload) -> int:
    """By the spacecraft that sends the most: a share of everybody's, or no more than it takes."""
    kept = ceil(asked.margins.overlap * _pictures_needed(asked, seen, payload))
    return ceil(kept / seen.senders) if seen.senders else min(pictures_in_passage(asked, seen, payload), kept)


def size_spacecraft(
    asked: Requirement, scenario: Scenario, seen: Encounter, size: Size, payload: Payload
) -> Spacecraft | Refusal:
    """The lightest spacecraft of a size with a camera; or what forbids it."""
    limit = asked.limits.spacecraft_kg or size.limit_kg
    inertia = sizing.box_inertia(limit, size.size_m)
    rate, acceleration = sizing.tracking(seen.speed, payload.altitude_m)
    torque, momentum = sizing.turning(inertia, pi, asked.turn_s)
    torque, momentum = (
        WHEEL_RESERVE * max(torque, inertia * acceleration),
        WHEEL_RESERVE * max(momentum, inertia * rate),
    )
    wheels = [w for w in WHEELS if w.torque_n_m >= torque and w.momentum_n_m_s >= momentum]
    if not wheels:
        largest = WHEELS[-1]
        return Refusal(
            "wheels",
            largest.momentum_n_m_s,
            momentum,
            f"turns need {1e3 * momentum:.3g} mN m s and {1e3 * torque:.3g} mN m of a wheel, the largest ({largest.name}) has "
            f"{1e3 * largest.momentum_n_m_s:g} and {1e3 * largest.torque_n_m:g}",
        )
    pictures = pictures_in_passage(asked, seen, payload)
    kept = _pictures_sent(asked, seen, payload)
    bits = kept * payload.detector.pixels**2 * scenario.data.bits_per_pixel / scenario.data.compression
    share, g_over_t = asked.contact_h / 24.0, max(s.g_over_t_db_k for s in stations_from(scenario.link.ground))
    links, hours = [], []
    fastest = 0.0
    for link in EARTH_LINKS:
        if not link.least_units <= size.units <= link.most_units:
            continue
        rate_bit_s = float(rates_bit_s(CATALOGUE[link.radio], g_over_t, seen.earth_m))
        fastest = max(fastest, rate_bit_s)
        if rate_bit_s > 0.0 and (send_h := bits / rate_bit_s / 3600.0 / share) <= asked.deliver_within_h:
            links.append(link)
            hours.append(send_h)
    if not links:
        return Refusal(
            "data",
            asked.deliver_within_h,
            bits / fastest / 3600.0 / share if fastest > 0.0 else np.inf,
            f"{bits / 1e6:,.0f} Mbit of {kept} pictures over {seen.earth_m / AU:.2f} au do not arrive within "
            f"{asked.deliver_within_h:g} h by any radio that {size.units}U carry",
        )
    best: Spacecraft | None = None
    lacking: list[str] = []
    options: list[Propulsion | None] = [None]
    if asked.delta_v_m_s:
        options = [one for one in PROPULSION if one.name in asked.limits.propulsion and size.units <= one.most_units]
        lacking += [] if options else [f"no thrusters of limits.propulsion are made for {size.units}U"]
    for propulsion in options:
        found = _lightest(asked, seen, size, payload, (wheels, links, hours), propulsion, (limit, pictures))
        if isinstance(found, str):
            lacking.append(found if propulsion is None else f"with {propulsion.name} {found}")
        elif best is None or found.mass_kg < best.mass_kg - 1e-9:
            best = found
    return Refusal("budgets", limit, np.nan, "; ".join(lacking)) if best is None else best


def _lightest(
    asked: Requirement,
    seen: Encounter,
    size: Size,
    payload: Payload,
    choices: tuple[list[WheelSet], list[EarthLink], list[float]],
    propulsion: Propulsion | None,
    given: tuple[float, int],
) -> Spacecraft | str:
    """Solve the program with one kind of thrusters; or which one of its limits, left out, would give it a solution."""
    wheels, links, hours = choices
    limit, pictures = given
    margins, share = asked.margins, asked.contact_h / 24.0
    away_h = max(IMAGING_H, seen.shadow_s / 3600.0)
    # Unknowns: which wheels, which link, panels, batteries; and what the tank holds, by the rocket equation of the rest.
    n_w, n_l = len(wheels), len(links)
    mass = np.array(
        [WHEEL_COUNT * w.mass_kg for w in wheels] + [x.mass_kg for x in links] + [PANEL.mass_kg, BATTERY.mass_kg]
    )
    volume = np.array(
        [WHEEL_COUNT * w.volume_u for w in wheels] + [x.volume_u for x in links] + [PANEL.volume_u, BATTERY.volume_u]
    )
    parts = bus_of(size) + (propulsion.parts if propulsion is not None else ())
    carried = asked.instruments
    fixed_kg = size.structure_kg + payload.mass_kg + carried.mass_kg + sum(part.mass_kg for part in parts)
    fixed_u = payload.volume_u + carried.volume_u + sum(part.volume_u for part in parts)
    built = (1.0 + margins.mass) * (1.0 + margins.integration)
    grown, per_dry, dense = built, 0.0, 0.0
    if propulsion is not None:
        fixed_kg, fixed_u = fixed_kg + propulsion.dry_kg, fixed_u + propulsion.volume_u
        delta_v = asked.delta_v_m_s or 0.0
        used = sizing.propellant(1.0, delta_v, propulsion.specific_impulse_s)
        # Propellant m_p = used (dry + tank m_p): the tank is carried along.
        if used * propulsion.tank_share >= 1.0:
            return f"{delta_v:g} m/s outweigh the tank"
        per_dry = used / (1.0 - used * propulsion.tank_share)
        dense = per_dry / propulsion.density
        grown *= 1.0 + per_dry * (1.0 + propulsion.tank_share)
    watt = sizing.panel_power(PANEL_CELLS_M2, PANEL_EFFICIENCY, seen.sun_m, margins.cells)
    bus_w = (1.0 + margins.power) * sum(part.power_w for part in parts)
    imaging_w = payload.power_w + carried.power_w + CROSSLINK_SENDS_W
    more = 1.0 + margins.power
    wheel_w = np.array([WHEEL_COUNT * w.power_w for w in wheels])
    one_w, one_l = np.ones(n_w), np.ones(n_l)
    sends, listens = (np.array([getattr(x, key) for x in links]) for key in ("transmits_w", "listens_w"))
    burning_w = propulsion.power_w if propulsion is not None else 0.0
    heard = asked.listen_share if propulsion is not None and propulsion.continuous else 1.0
    stored = 0.0 if propulsion is None or propulsion.continuous else margins.battery * BATTERY_WH / BURN_H

    def row(w: Any, x: Any, panels: float, batteries: float) -> Any:
        return np.concatenate((np.broadcast_to(w, n_w), np.broadcast_to(x, n_l), [panels, batteries]))

    mean = share * sends + (1.0 - share) * asked.listen_share * listens
    rows = [
        # Exactly one set of wheels, one link.
        (row(one_w, 0.0 * one_l, 0.0, 0.0), 1.0, 1.0),
        (row(0.0 * one_w, one_l, 0.0, 0.0), 1.0, 1.0),
        (grown * mass, -np.inf, limit - grown * fixed_kg),
        (
            volume + dense * built * mass,
            -np.inf,
            size.units * (1.0 - margins.volume) - fixed_u - dense * built * fixed_kg,
        ),
        # The mean of a day by panels.
        (row(more * wheel_w, more * mean, -watt, 0.0), -np.inf, -bus_w),
        # Thrusters, nothing being sent: for days by panels alone, the receiver now and then on, or for an hour with batteries.
        (
            row(more * wheel_w, more * heard * listens, -watt, -stored) * bool(burning_w),
            -np.inf,
            -bus_w - more * burning_w if burning_w else 0.0,
        ),
        # A contact, and the passage with panels turned away: batteries give what is missing.
        (
            row(
                more * wheel_w * asked.contact_h,
                more * sends * asked.contact_h,
                -watt * asked.contact_h,
                -margins.battery * BATTERY_WH,
            ),
            -np.inf,
            -bus_w * asked.contact_h,
        ),
        (
            row(more * wheel_w * away_h, more * listens * away_h, 0.0, -margins.battery * BATTERY_WH),
            -np.inf,
            -(bus_w + more * imaging_w) * away_h,
        ),
        # What is drawn at once becomes heat that the sides can radiate.
        (
            row(more * wheel_w, more * sends, 0.0, 0.0),
            -np.inf,
            sizing.radiated_power(size.size_m, HOT_K, EMISSIVITY) - bus_w,
        ),
        # What the tank of this class of thrusters takes.
        (
            per_dry * built * mass,
            -np.inf,
            propulsion.most_kg - per_dry * built * fixed_kg if propulsion is not None else 0.0,
        ),
    ]
    most = row(one_w, one_l, float(size.panels), float(MOST_BATTERIES))
    constraints = [LinearConstraint(np.atleast_2d(a), low, high) for a, low, high in rows]
    program = _Program.of(grown * mass, constraints, most)
    x = _solved(program)
    if x is None:
        return _lacking(program, size)
    wheel, k = wheels[int(x[:n_w].argmax())], int(x[n_w : n_w + n_l].argmax())
    link, panels, batteries = links[k], int(x[-2]), int(x[-1])
    dry = built * (fixed_kg + float(mass @ x))
    tank = per_dry * dry
    listed = [
        Row(f"structure {size.units}U", 1, size.structure_kg, 0.0, 0.0, "class of the ISISPACE CubeSat structures")
    ]
    optics = sizing.optics_mass(payload.aperture_m)
    listed += [
        Row("optics", 1, optics, payload.volume_u - payload.detector.volume_u, 0.0, "see ideas/sizing.py"),
        Row(
            f"detector {payload.detector.name}",
            1,
            payload.detector.mass_kg,
            payload.detector.volume_u,
            payload.power_w,
            payload.detector.source,
        ),
        *(Row(part.name, 1, *part[1:]) for part in parts),
        Row(
            f"wheels {wheel.name}",
            WHEEL_COUNT,
            WHEEL_COUNT * wheel.mass_kg,
            WHEEL_COUNT * wheel.volume_u,
            WHEEL_COUNT * wheel.power_w,
            wheel.source,
        ),
        Row(link.radio, 1, link.mass_kg, link.volume_u, link.transmits_w, link.source),
        Row("panels", panels, panels * PANEL.mass_kg, panels * PANEL.volume_u, 0.0, PANEL.source),
        Row("batteries", batteries, batteries * BATTERY.mass_kg, batteries * BATTERY.volume_u, 0.0, BATTERY.source),
    ]
    if any(value for _, value in carried):
        listed.append(
            Row(
                "other instruments",
                1,
                carried.mass_kg,
                carried.volume_u,
                carried.power_w,
                "instruments of the requirement",
            )
        )
    if propulsion is not None:
        tank_kg = propulsion.dry_kg + propulsion.tank_share * tank
        listed.append(
            Row(
                propulsion.name,
                1,
                tank_kg,
                propulsion.volume_u + tank / propulsion.density,
                propulsion.power_w,
                propulsion.source,
            )
        )
        listed.append(Row("propellant", 1, tank, 0.0, 0.0, f"rocket equation, {asked.delta_v_m_s:g} m/s"))
    parts_kg = fixed_kg + float(mass @ x)
    cables = margins.integration * parts_kg
    listed.append(Row("cables, brackets, thermal control", 1, cables, 0.0, 0.0, "margins.integration of the parts"))
    wet = dry + tank * (1.0 + (propulsion.tank_share if propulsion else 0.0))
    steady = more * float(wheel_w @ x[:n_w]) + bus_w
    power = steady + more * float(mean @ x[n_w : n_w + n_l])
    hearing, sunlit = steady + more * link.listens_w, panels * watt
    imaging = hearing + more * imaging_w
    rest_h = 24.0 - asked.contact_h
    modes = [("listening, a day", asked.listen_share * rest_h, hearing, sunlit)]
    modes += [("receiver off, a day", (1.0 - asked.listen_share) * rest_h, steady, sunlit)]
    modes += [("contact with Earth, a day", asked.contact_h, steady + more * link.transmits_w, sunlit)]
    modes += [("passage, in shadow or panels turned away", away_h, imaging, 0.0)]
    if propulsion is not None:
        burn_h = tank * propulsion.specific_impulse_s * STANDARD_GRAVITY / propulsion.thrust_n / 3600.0
        hearing_w = more * heard * link.listens_w
        modes.append(("thrusters, in all", burn_h, steady + hearing_w + more * propulsion.power_w, sunlit))
    return Spacecraft(
        size=size,
        payload=payload,
        wheels=wheel,
        link=link,
        propulsion=propulsion,
        propellant_kg=tank,
        panels=panels,
        batteries=batteries,
        rows=tuple(listed),
        mass_kg=wet,
        volume_u=(fixed_u + float(volume @ x) + dense * dry) / (1.0 - margins.volume),
        power_w=power,
        available_w=panels * watt,
        send_h=hours[k],
        pictures=pictures,
        modes=tuple(Mode(*mode, max(0.0, mode[2] - mode[3]) * mode[1]) for mode in modes if mode[1] > 0.0),
    )


#: What the rows of the program from the third on keep, in which unit, and how much of it counts as much as of the others where
#: several are exceeded.
KEPT = {
    "mass": ("kg", 1.0),
    "volume": ("U", 1.0),
    "the power that panels give in the mean of a day": ("W", 10.0),
    "the power while thrusters burn": ("W", 10.0),
    "the batteries in a contact with Earth": ("Wh", 30.0),
    "the batteries in the passage": ("Wh", 30.0),
    "the heat that its sides radiate": ("W", 10.0),
    "the propellant that tanks of this class take": ("kg", 1.0),
}


class _Program(NamedTuple):
    """Objective, ends of the whole numbers, rows and their bounds, as bytes: what was solved is not solved again."""

    table: bytes
    shape: tuple[int, int]

    @classmethod
    def of(cls, objective: Array, constraints: list[LinearConstraint], most: Array) -> _Program:
        rows = [np.concatenate((each.A[0], each.lb, each.ub)) for each in constraints]
        table = np.stack([np.append(objective, (0.0, 0.0)), np.append(most, (0.0, 0.0)), *rows])
        return cls(table.tobytes(), table.shape)

    def parts(self) -> tuple[Array, Array, LinearConstraint]:
        rows = np.frombuffer(self.table).reshape(self.shape)
        return rows[0, :-2], rows[1, :-2], LinearConstraint(rows[2:, :-2], rows[2:, -2], rows[2:, -1])


@lru_cache(maxsize=PROGRAMS)
def _solved(program: _Program) -> Array | None:
    """Whole numbers of the least objective; None: there are none."""
    objective, most, constraints = program.parts()
    x = solve_program(objective, [constraints], None, most=most).x
    return None if x is None else np.rint(x)


@lru_cache(maxsize=PROGRAMS)
def _lacking(program: _Program, size: Size) -> str:
    """By how much which limit must be exceeded at the least, or all of them together."""
    objective, most, constraints = program.parts()
    more = most.copy()
    more[-2] = MANY_PANELS
    free = solve_program(objective, [constraints], None, most=more).x
    if free is not None:
        return f"{free[-2]:.0f} panels are needed, {size.units}U carry {size.panels}"
    alone = [words for name in KEPT for words in _least_excess(most, constraints, [name])]
    if alone:
        return f"it exceeds {' or '.join(alone)} at the least"
    together = _least_excess(most, constraints, list(KEPT))
    return f"it exceeds {' and '.join(together)} at the least" if together else "several limits forbid it at once"


def _least_excess(most: Array, constraints: LinearConstraint, freed: list[str]) -> list[str]:
    """By how much some of the limits must be exceeded together, each that is in words; empty: that does not help."""
    n, scales = len(most), np.diag([scale for _, scale in KEPT.values()])
    beyond = np.vstack((np.zeros((2, len(KEPT))), -scales))
    rows = LinearConstraint(np.hstack((constraints.A, beyond)), constraints.lb, constraints.ub)
    weights = np.append(np.zeros(n), np.ones(len(KEPT)))
    ends = np.append(most, [100.0 * (name in freed) for name in KEPT])
    x = solve_program(weights, [rows], None, most=ends, whole=weights == 0.0).x
    excess = [] if x is None else (scales @ x[n:]).tolist()
    return [
        f"{name} by {value:.3g} {unit}"
        for (name, (unit, scale)), value in zip(KEPT.items(), excess, strict=False)
        if value > 1e-6 * scale
    ]


def altitudes_for(asked: Requirement, seen: Encounter) -> tuple[float, ...]:
    """Altitudes to choose from [m]."""
    return asked.limits.altitudes_m or tuple(share * seen.altitude_m for share in (0.25, 0.5, 1.0, 2.0))


def spacecraft_options(
    asked: Requirement, scenario: Scenario, seen: Encounter
) -> Iterator[tuple[Size, float, Detector, Spacecraft | Refusal]]:
    """Every size, altitude and detector with the lightest spacecraft, or what forbids it."""
    for units in asked.limits.units:
        for altitude in altitudes_for(asked, seen):
            for detector in DETECTORS:
                interruption.check()
                size = SIZES[units]
                payload = payload_for(asked, seen, size, altitude, detector)
                if isinstance(payload, Refusal):
                    yield size, altitude, detector, payload
                    continue
                least = least_observers(asked, seen, payload)
                if least > asked.limits.spacecraft:
                    shown = (detector.pixels * asked.resolution_m) ** 2 / 1e6
                    count = pictures_in_passage(asked, seen, payload)
                    words = (
                        f"{detector.pixels} x {detector.pixels} pixels of {asked.resolution_m:g} m show {shown:.3g} km^2, the "
                        f"target has {seen.area_m2 / 1e6:.4g} km^2, and a passage gives "
                        f"{count} {'picture' if count == 1 else 'pictures'}: {least} observers at least, "
                        f"{asked.limits.spacecraft} are allowed"
                    )
                    yield size, altitude, detector, Refusal("pixels", asked.limits.spacecraft, least, words)
                    continue
                yield size, altitude, detector, size_spacecraft(asked, scenario, seen, size, payload)


def closeness(asked: Requirement, other: Requirement) -> float:
    """How unlike two requirements are: the largest logarithm of a ratio of what they ask for; infinite for other missions."""
    alike = ("scenario", "changes", "quality", "probability", "network")
    if any(getattr(asked, key) != getattr(other, key) for key in alike):
        return np.inf
    pairs = [(asked.resolution_m, other.resolution_m), (asked.share_percent, other.share_percent)]
    pairs += [(asked.deliver_within_h, other.deliver_within_h)]
    # Of the same changes corrections take the same.
    pairs += [(1.0 + (asked.delta_v_m_s or 0.0), 1.0 + (other.delta_v_m_s or 0.0))]
    return max(abs(log(a / b)) for a, b in pairs)
