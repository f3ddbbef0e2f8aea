"""The report's words on how the mothership comes."""

from __future__ import annotations

from typing import Any

from swarm_mj.results.report.markup import Html, join, tag

#: Axes of the angles, in words.
AXES = {"ecliptic": "of the ecliptic", "equatorial": "of EME2000", "body_equator": "of the body's equator"}


def way_in_words(summary: dict[str, Any]) -> Html | None:
    """A paragraph; None where the run does not tell."""
    way = summary.get("mothership") or {}
    if not way:
        return None
    words = f"The mothership begins {_km(way['distance_m'])} from the centre, at {_speed(way['speed_m_s'])}. "
    if way.get("orbit") == "hyperbola":
        return join([tag("p", words + _hyperbola(way))])
    if "orbit" in way:
        words += (
            f"Its orbit, osculating then, is an {way['orbit']} of eccentricity {way['eccentricity']:.4g} with periapsis "
            f"{_km(way['periapsis_radius_m'])} from the centre."
        )
    return join([tag("p", words)])


def _hyperbola(way: dict[str, Any]) -> str:
    axes = AXES.get(way["axes"], way["axes"])
    b_plane = "" if way["b_t_m"] is None else f", B·T = {_km(way['b_t_m'])} and B·R = {_km(way['b_r_m'])}"
    late = way["closest_approach_s"]
    when = f"{abs(late):,.5g} s {'after' if late >= 0.0 else 'before'} the epoch"
    return (
        f"Its orbit, osculating then, is a hyperbola: v∞ = {_speed(way['v_infinity_m_s'])} towards longitude "
        f"{way['v_infinity_longitude_deg']:.2f}°, latitude {way['v_infinity_latitude_deg']:.2f}° in the axes {axes}{b_plane}; "
        f"periapsis {_km(way['periapsis_radius_m'])} from the centre, {when}; the body turns the velocity by "
        f"{way['turn_angle_deg']:.3g}°."
    )


def _km(metres: float) -> str:
    return f"{metres / 1e3:,.5g} km"


def _speed(metres_per_second: float) -> str:
    return f"{metres_per_second:,.4g} m/s" if metres_per_second < 1e3 else f"{metres_per_second / 1e3:.4g} km/s"
