"""Fly a packaged scenario and print what was observed."""

import numpy as np

import swarm_mj as sm

flight = sm.fly(sm.load("eros-quick", {"camera.half_angle_deg": 4}))
print(flight)
print(flight.spacecraft[["visiting_point", "observed_percent", "delta_v_m_s"]].round(3).to_string())

# Telemetry is an xarray.Dataset, with units and frame on every variable.
error_deg = np.degrees(flight.telemetry["pointing_error"])
for t in (0, 60, 120, 600, 1200):
    print(f"{t:5d} s: pointing errors {error_deg.sel(time=t).values.round(4)} deg")
