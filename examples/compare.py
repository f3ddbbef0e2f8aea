"""Change one value and compare: how much a wider camera sees."""

import pandas as pd

import swarm_mj as sm

rows = []
for half_angle_deg in (2, 3, 4, 6, 8):
    scenario = sm.load("eros-quick", {"camera.half_angle_deg": half_angle_deg})
    flight = sm.fly(scenario)
    rows.append(
        {
            "half-angle [deg]": half_angle_deg,
            "observed in the passage [%]": round(flight.passage.percent, 2),
            "pictures": flight.summary["images"],
        }
    )
print(pd.DataFrame(rows).to_string(index=False))
