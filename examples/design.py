"""Find the fewest observers that see the whole target, with proof, and fly them."""

import swarm_mj as sm

# A narrow camera, and only the picture at the instant of the arrival counts.
problem = sm.load("eros-quick", {"camera.half_angle_deg": 5, "observation.criterion": "arrival"})
design = sm.design(problem)
print(design)
print(design.table.drop(columns="seconds").to_string())

flight = sm.fly(design.to_scenario())
print(f"promised {design.covered_percent:.2f} %, flown {flight.coverage.percent:.2f} %")
