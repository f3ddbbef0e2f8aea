"""The mission: target region, trajectories, behaviours and radio links."""
