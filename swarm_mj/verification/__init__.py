"""The physics checks that `swarm-mj validate` runs on the installed program, each against something independent of it."""
