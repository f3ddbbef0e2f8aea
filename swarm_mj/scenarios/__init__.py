"""The packaged scenarios: YAML files that `swarm-mj scenarios` lists."""
