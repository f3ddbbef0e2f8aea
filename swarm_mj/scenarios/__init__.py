"""Scenarios: their schema, reading and checking, constants, and the packaged ones, which `swarm-mj available` lists."""
