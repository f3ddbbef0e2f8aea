"""The asteroid: its shape, its gravity, its rotation and its place in the solar system."""
