"""Compiled code that flies whole stretches of a flight on the memory of MuJoCo."""
