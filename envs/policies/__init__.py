"""Policies of SwarmObserve: scripted ones, networks, files of them, and how they are scored."""
