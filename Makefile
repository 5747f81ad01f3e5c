# Everything a newcomer, a developer or an operator starts from. `make help` lists it.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help quickstart test test-all test-plain check faults fuzz mutate lerobot bench docs pictures serve lock

# The first of these that runs and is new enough builds the environment; PYTHON=... overrides.
PYTHONS := python3 python3.13 python3.12 python3.11
PYTHON ?= $(shell for p in $(PYTHONS); do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' >/dev/null 2>&1 && echo $$p && break; done)

BIN := .venv/bin
RUNS := .venv/.runs
READY := .venv/.ready

# Prefect and its server report to nobody.
export DO_NOT_TRACK := 1
export PREFECT_SERVER_ANALYTICS_ENABLED := false

help: ## list what make can do
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

# Packages as the lock $(1) pins them, told in one line that moves on instead of pip's many, which are in .venv/install.log.
define LOCKED
@set -o pipefail; $(BIN)/python -m pip install --disable-pip-version-check --no-deps --require-hashes --only-binary :all: \
	--no-compile --progress-bar off -r $(1) 2>&1 | awk -v of=$$(grep -c '^[A-Za-z].*==' $(1)) -v all=.venv/install.log '{ print > all } \
	/^Collecting/ { n++; printf "\r      %d of at most %d packages", n, of; fflush() } \
	/^Installing/ { printf "\n      unpacking them\n"; fflush() }' || { tail -20 .venv/install.log; exit 1; }
@$(BIN)/python -m compileall -qq -j 0 .venv/lib >> .venv/install.log 2>&1 || true  # on every core; pip does it on one
endef

$(RUNS): requirements-runtime.lock pyproject.toml setup.py
	@test -n "$(PYTHON)" || { echo "No Python from 3.11 to 3.14 found: install one, or say make PYTHON=/path/to/python3"; exit 1; }
	@echo "Once: 460 MB are downloaded, and 1.5 GB unpacked into .venv, in two to ten minutes."
	@echo "1/3 .venv with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv .venv
	@echo "2/3 packages, as requirements-runtime.lock pins them"
	$(call LOCKED,requirements-runtime.lock)
	@echo "3/3 upplied itself"
	@$(BIN)/python -m pip install --disable-pip-version-check --no-deps --no-build-isolation --quiet --editable .
	@touch $@

$(READY): $(RUNS) requirements.lock
	@echo "Once, for development: 265 MB more are downloaded, and 1.4 GB unpacked, as requirements.lock pins them."
	$(call LOCKED,requirements.lock)
	@touch $@

quickstart: $(RUNS) ## environment, sample fleet, every transfer, reports: the whole way once
	@$(BIN)/python -m upplied.flows.quickstart

TESTS ?= not slow
CORES ?= auto
ROOM ?=
EXCEPT ?=
# What is compiled is kept, whatever this machine says otherwise: else each process of a test compiles all of it.
unexport PYTHONDONTWRITEBYTECODE
# A file's tests stay together, since they share what they read and plan; else files with few tests, which are those
# of servers, would come last, and the whole run would wait for them (tests/conftest.py).
PYTEST = $(BIN)/python -m pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder

# What is compiled for this processor's instructions, and for the plainest: once, and not by each process of a test.
COMPILED := .venv/.compiled
PLAINLY := .venv/.compiled-plainly
JITTED := $(shell grep -rl --include=*.py njit upplied)

$(COMPILED): $(READY) $(JITTED)
	@echo "Once: functions are compiled for this processor, in about a minute."
	@$(BIN)/python tests/compiled.py && touch $@

$(PLAINLY): $(READY) $(JITTED)
	@echo "Once: functions are compiled for the plainest processor, in about a minute."
	@$(BIN)/python tests/plainly.py tests/compiled.py && touch $@

test: $(COMPILED) ## the tests of a developer, on every core or CORES=...; ROOM=catalog, or more, are those of a room
	@$(PYTEST) -m "$(TESTS)" $(EXCEPT:%=--ignore=%) $(ROOM:%=tests/%)

test-all: $(COMPILED) ## the test suite with the slow ones: faults, servers, benchmarks' smoke runs
	@$(PYTEST)

# Laws of planning that are fast, and figures that are kept: what another processor's last bit would move.
PLAIN := tests/bench/test_results.py tests/planning/test_plan.py tests/planning/test_laws_place.py \
	tests/planning/correspondence/test_partial.py

test-plain: $(PLAINLY) ## the planning laws with the plainest instructions that the libraries know
	@$(BIN)/python tests/plainly.py -m pytest --numprocesses $(CORES) --dist loadfile -q -m "not slow or ci" $(PLAIN)

check: $(READY) ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

fuzz: $(READY) ## coverage-guided fuzzing of the readers, ten minutes or FUZZ_SECONDS=... (Linux)
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --only-binary :all: "atheris>=3,<4"
	$(BIN)/python tests/faults/fuzz_logs.py --seconds $${FUZZ_SECONDS:-600}

# Two more than there are processors, one test after the other to whoever is free: those of the service wait for whole minutes.
faults: $(COMPILED) ## kill, fill and forbid: every fault test, the long ones too
	@$(BIN)/python -m pytest --numprocesses $$(($$(nproc) + 2)) --dist load --maxschedchunk 1 tests/faults

LEROBOT_PYTHON ?= $(shell for p in python3.13 python3.12 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 12))' >/dev/null 2>&1 && echo $$p && break; done)

lerobot: $(READY) ## the LeRobot export loaded by lerobot itself, in .venv-lerobot (Python 3.12; 5 GB, once)
	@test -n "$(LEROBOT_PYTHON)" || { echo "lerobot needs Python 3.12: say make lerobot LEROBOT_PYTHON=/path/to/python3.12"; exit 1; }
	@test -e .venv-lerobot/.ready || { $(LEROBOT_PYTHON) -m venv .venv-lerobot \
		&& .venv-lerobot/bin/python -m pip install --disable-pip-version-check --only-binary :all: "lerobot[dataset]==0.6.1" \
		&& touch .venv-lerobot/.ready; }
	$(BIN)/python -m pytest tests/outputs/test_lerobot.py

bench: $(READY) ## print the benchmarks' tables
	@for f in $$(grep -l __main__ bench/*.py); do echo "== $$f"; $(BIN)/python $$f || exit 1; done

mutate: $(READY) ## how many of 200 small faults the tests notice (an hour or two), or MUTANTS=... SEED=...
	$(BIN)/python tests/mutate.py --number $${MUTANTS:-200} --seed $${SEED:-0}

docs: $(READY) ## the documentation as a site: open site/index.html
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet && echo "open site/index.html"

pictures: $(READY) ## draw the documentation's pictures again, after a change of the method (minutes)
	$(BIN)/python docs/making/pictures.py

serve: $(RUNS) ## a Prefect server with the deployments and a worker, until Ctrl-C
	@$(BIN)/upplied serve

COMPILE = $(BIN)/uv pip compile pyproject.toml --python-version 3.11 --universal --generate-hashes --no-emit-index-url --no-header \
	--no-annotate --native-tls --quiet

lock: $(READY) ## resolve both locks again for every Python and platform: development's, and of it what runs
	$(BIN)/python -m pip install --disable-pip-version-check --quiet uv
	$(COMPILE) --extra dev --upgrade --output-file requirements.lock
	$(COMPILE) --extra service --constraint requirements.lock --upgrade --output-file requirements-runtime.lock
