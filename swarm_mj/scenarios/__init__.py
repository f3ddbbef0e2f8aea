"""The packaged scenarios: YAML files that `swarm-mj available` lists."""
