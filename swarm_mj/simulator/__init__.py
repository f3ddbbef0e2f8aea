"""The simulation loop, what it drives (wheels, sensors, thrusters, faults), and its telemetry."""
