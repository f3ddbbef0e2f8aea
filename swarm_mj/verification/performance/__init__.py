"""How fast the installed program is, as ratios measured side by side in one run; `swarm-mj bench` and `benchmarks/` use it."""
