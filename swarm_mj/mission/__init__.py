"""The mission: target region, trajectories, behaviours, radio links, corrections and their covariance."""
