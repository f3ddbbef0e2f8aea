# Conventional targets; every one sets up its own virtual environment first. Needs Python >= 3.11 and nothing else.
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python; do \
	command -v $$p >/dev/null 2>&1 && $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
BIN := $(VENV)/bin
# Tests start hundreds of processes, which load the package faster from bytecode, even where the shell says to keep none.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --numprocesses auto --dist loadfile --no-loadscope-reorder

.DEFAULT_GOAL := help
.PHONY: help run fresh-kernels test test-all test-fast lint format types check wheel-test bench agreement docs docs-serve images pages pixel-to-earth convergence reproduction robustness swarm-classes learning mutants audit shape gl setup setup-dev clean

help: ## list the targets
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "swarm_mj needs Python >= 3.11; none was found. Install it, or name it: make run PYTHON=/path/to/python"; exit 1; }
	@sh scripts/make-venv.sh "$(PYTHON)" "$(VENV)"

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@echo "Installing swarm_mj into $(VENV) (once; about 850 MB) ..."
	@# Without bytecode of all modules, 230 MB and a third of the time: few of them are ever imported.
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(BIN)/python
	@echo "Installing swarm_mj and its development tools into $(VENV) (once) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable ".[all]"
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-all: $(VENV)/.installed-dev
	@echo "Installing what trains policies, PyTorch for processors alone, and a browser (once; about 1 GB) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --extra-index-url https://download.pytorch.org/whl/cpu torch
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable ".[all,rl,onnx]" onnx
	@sh scripts/install-chromium.sh
	@touch $@

setup: $(VENV)/.installed gl
setup-dev: $(VENV)/.installed-dev gl

gl: ## install the OpenGL libraries for offscreen rendering, or say how
	@sh scripts/install-gl.sh

run: setup ## fly both configurations of the paper
	@$(BIN)/swarm-mj fly $(ARGS)

fresh-kernels: setup-dev
	@$(BIN)/python -m scripts.import_graph

test: fresh-kernels ## run the tests
	@$(PYTEST) $(ARGS)

test-all: $(VENV)/.installed-all test ## the same with what trains policies and a browser, so that nothing is skipped for want of them

test-fast: fresh-kernels ## run the tests that take less than a few seconds
	@$(PYTEST) -m "not slow" $(ARGS)

lint: setup-dev ## check style
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

format: setup-dev ## format the code
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

types: setup-dev ## check types
	@$(BIN)/mypy

check: test lint types ## tests, style and types

audit: setup-dev ## look for known vulnerabilities of what is installed, where an advisory service can be reached
	@sh scripts/audit.sh $(BIN)

bench: setup ## measure how fast the program is on this machine
	@$(BIN)/python -m benchmarks.performance --quick $(ARGS)
	@$(BIN)/python -m benchmarks.basilisk

agreement: setup ## fly and read our flights by Orekit, brahe, SPICE and Basilisk, rewrite docs/results/agreement.md
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[agreement]"
	@$(BIN)/python -m benchmarks.agreement $(ARGS)

docs: setup-dev ## build the site into site/: offline, warnings are errors
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict $(ARGS)

docs-serve: setup-dev ## show the site while it is written, at http://127.0.0.1:8000
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs serve $(ARGS)

images: setup-dev ## redraw the pictures of flights and designs in README and on the site
	@$(BIN)/python -m scripts.pages.images

pixel-to-earth: setup ## rewrite docs/results/pixel_to_earth.md: what of the paper's mission reaches Earth
	@$(BIN)/python -m scripts.pages.pixel_to_earth

pages: images ## the same, and rewrite the measured pages that take minutes: validation, dependencies, corrections, scenarios
	@$(BIN)/swarm-mj validate --markdown docs/results/validation.md
	@$(BIN)/python -m scripts.pages.dependencies
	@$(BIN)/python -m scripts.pages.corrections
	@$(BIN)/python -m scripts.pages.scenarios

convergence: setup ## rewrite docs/results/convergence.md: how answers depend on steps, picture and mesh
	@$(BIN)/python -m scripts.pages.convergence

reproduction: setup ## rewrite docs/results/reproduction.md: the fewest observers under every reading
	@$(BIN)/python -m scripts.pages.reproduction

swarm-classes: setup-dev ## rewrite docs/results/swarm_classes.md: what each swarm class buys
	@$(BIN)/python -m scripts.pages.swarm_classes

robustness: setup-dev ## rewrite docs/results/robustness.md: what losses and faults cost
	@$(BIN)/python -m scripts.pages.robustness

learning: setup ## train policies by stock algorithms (needs the extra rl) and rewrite docs/results/learning.md
	@$(BIN)/python -m scripts.pages.learning

mutants: setup-dev ## plant faults in copies of the code, see whether tests notice, rewrite docs/results/mutants.md
	@$(BIN)/python -m scripts.mutants $(ARGS)

shape: setup ## rebuild assets/eros.obj from its harmonics
	@$(BIN)/swarm-mj build-shape --out assets/eros.obj

clean: ## remove what the targets made
	rm -rf $(VENV) build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache results
