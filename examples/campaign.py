"""Fly a Monte Carlo campaign: what is seen when spacecraft are lost. Needs the extra cluster."""

import swarm_mj as sm

table = sm.campaign("eros-losses", runs=4)  # enough to see it work; the page on robustness has 1,000
print(f"{len(table)} flights, of which {(table.status == 'ok').sum()} went through")
print(table.groupby("scenario")["coverage_percent"].describe()[["count", "min", "mean", "max"]].round(2).to_string())
