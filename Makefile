# Two commands do it all on a machine that has only Python 3.11, make and the package registries:
#   make run    sets up and drives the sliding-door task      make test    sets up and runs every test
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
STAMP := .venv/.ready
# As many as this process may use: tied to two cores of four, four workers would share them.
JOBS ?= $(shell nproc 2>/dev/null || echo auto)
# Compiled modules are kept whatever the shell says: the tests start some hundred processes, each would compile everything anew.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help setup run test faults lint check bench golden kernel lock clean

help:  ## this list
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## (.*)/  make \1\t\2/' | expand -t 16

setup: $(STAMP)  ## the virtual environment .venv with everything pinned

$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { echo "canipulator: needs Python 3.11, found $$($(PYTHON) --version 2>&1) (set PYTHON=/path/to/python3.11)" >&2; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing what requirements.lock pins into .venv (about 2 GB, a few minutes the first time) ..."
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

run: $(STAMP)  ## sets up, then drives the sliding-door task over CAN
	@$(BIN)/canipulator run sliding-door

test: $(STAMP)  ## sets up, then runs every test; those that live in real time by themselves
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist loadgroup -m "not socketcan and not faults"
	@$(BIN)/python -m pytest -q -m socketcan

faults: $(STAMP)  ## the long part of the tests: faults in every task, 200,000 strange frames, 50 kills, more doors and hands
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist loadgroup -m faults

lint: $(STAMP)  ## format, lint, import contracts, types
	@$(BIN)/ruff format --check . && $(BIN)/ruff check .
	@$(BIN)/lint-imports
	@$(BIN)/mypy

check: lint  ## lint, and the fast tests: under a minute
	@$(BIN)/python -m pytest -n $(JOBS) --dist loadgroup -q --hypothesis-profile=quick -m "not slow and not socketcan and not viewer and not faults"

bench: $(STAMP)  ## each hot path as a ratio against a stated reference
	@$(BIN)/python -m benchmarks

golden: $(STAMP)  ## records the golden runs of the tests anew (say why in the commit)
	@$(BIN)/python -m tests.golden.record

kernel:  ## a kernel with CAN and several processors: real time in the tests on vcan0
	@tests/socketcan/kernel/build

lock: $(STAMP)  ## refreshes requirements.lock from pyproject.toml
	@$(BIN)/pip-compile --quiet --upgrade --generate-hashes --allow-unsafe --strip-extras --extra dev --no-emit-index-url --no-emit-find-links --no-emit-trusted-host --no-header --output-file requirements.lock pyproject.toml

clean:  ## removes runs and caches, keeps .venv
	@rm -rf runs .cache .pytest_cache .mypy_cache .ruff_cache .hypothesis
