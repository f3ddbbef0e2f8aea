"""Attitude: quaternions, Modified Rodrigues Parameters, references of guidance, slews, and estimation by sensors."""
