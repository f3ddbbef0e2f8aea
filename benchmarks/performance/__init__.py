"""How fast the installed program is, as ratios measured side by side in one run."""
