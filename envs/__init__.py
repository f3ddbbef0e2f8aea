"""Reinforcement-learning environments of swarm_mj; importing this registers them with gymnasium."""

from .registration import register_environments

register_environments()
