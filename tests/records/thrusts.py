"""Telemetry as if its spacecraft had thrusters, for what is drawn and written of them."""

import numpy as np

SPEED = 65.0 * 9.80665


def with_thrust(telemetry, *, mass=8.0, tank=0.2, force_n=0.055):
    """A flight with the variables of thrusters that burn once each, one after another; nothing else changes."""
    times, n = telemetry["time"].values, telemetry.sizes["spacecraft"]
    start = times[-1] * (0.1 + 0.3 * np.arange(n) / n)
    burning = np.clip(times[:, None] - start, 0.0, 0.1 * times[-1])
    left = tank - force_n / SPEED * burning
    thrust = np.zeros((len(times), n, 3))
    thrust[..., 0] = force_n * ((times[:, None] >= start) & (times[:, None] < start + 0.1 * times[-1]))
    place = ("time", "spacecraft")
    return telemetry.assign(
        thrust_N=((*place, "xyz"), thrust),
        propellant_kg=(place, left),
        mass_kg=(place, mass - tank + left),
        delta_v_m_s=(place, SPEED * np.log(mass / (mass - tank + left))),
    )
