"""SwarmPointing-v0: attitude control by motor torques."""
