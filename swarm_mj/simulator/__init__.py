"""The simulation loop and its telemetry."""
