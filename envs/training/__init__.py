"""Training with stable-baselines3 (extra `rl`), and what several runs say together."""
