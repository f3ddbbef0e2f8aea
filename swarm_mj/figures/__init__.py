"""Figures of a run and of a design, one PNG each; `run_figures` and `design_figures` list them."""
