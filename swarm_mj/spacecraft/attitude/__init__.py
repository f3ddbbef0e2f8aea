"""Attitude: Modified Rodrigues Parameters, guidance references and control laws."""
