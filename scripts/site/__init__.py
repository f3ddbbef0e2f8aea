"""What builds the site: pages generated from the code, formulas, and pages whose cells are run. `make docs` uses it."""
