"""Paths and attitudes as files of other programs hold them: CCSDS messages, their frames and times, interpolation."""
