"""Reinforcement-learning environments of swarm_mj."""
