"""Observation: cameras, face-ID buffers, ray casting and the observed area."""
