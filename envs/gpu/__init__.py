"""Flights on a GPU, by the same kernel sources as on the processor; needs the extra `gpu`."""
