"""Candidates for a design: what a spacecraft sees that visits each of the visiting points."""
