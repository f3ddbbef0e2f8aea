"""Checks of the installed program: its physics (`swarm-mj validate`) and its speed (`swarm-mj bench`)."""
