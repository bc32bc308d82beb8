# The chores of the project: the same names for people and for CI. `make` lists them.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
WORKERS ?= 2
# Options of pip: constraints, for instance.
PIP_OPTIONS ?=
# Seed of the random examples; without one they are the same in every run.
SEED ?=
# With FULL=1 the suite simulates all runs of the longest tables on pages, not a sample of them, and
# `make docs` runs the notebooks of the site.
FULL ?=
# Interpreters of `make test-pythons`: those on the path that start.
PYTHONS ?= $(foreach v,3.11 3.12 3.13 3.14,$(shell python$(v) -c "import sys; print(sys.executable)" 2>/dev/null))
# Parts of `make fuzz` (all by default), minutes for each, and 1 to write the counts to docs/reliability.md.
PART ?=
MINUTES ?= 10
WRITE ?=
# Files or tests of `make suite`, and 1 to include the thorough ones.
TESTS ?=
ALL ?=
# For packages of the system; empty for the user root.
AS_ROOT := $(if $(filter-out 0,$(shell id -u)),sudo)
# Numerical libraries that start a thread per core slow each other down beside parallel tests.
export OPENBLAS_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help demo test test-all suite kernels pytest conformance interpreted test-lowest test-pythons test-numba dist docs lint format browser bench fuzz kills mutants peers gallery clean

help: ## list the chores
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 15

# One environment for users' and developers' chores; rebuilt when the dependencies change.
$(VENV)/.ready-demo: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	FLEXARM_BUILD=pure $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.ready-dev: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	FLEXARM_BUILD=pure $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_OPTIONS) --editable ".[dev]"
	touch $@

# What the site needs, and no more.
$(VENV)/.ready-docs: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	FLEXARM_BUILD=pure $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	touch $@

# The programs that `make peers` compares with; their tests then run in `make test` too.
$(VENV)/.ready-peers: $(VENV)/.ready-dev
	FLEXARM_BUILD=pure $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[peers]"
	touch $@

demo: $(VENV)/.ready-demo ## reproduce the paper's example: figures in out/paper
	$(BIN)/flexarm paper --out out/paper

# The checks of types keep one core busy for a minute, in which the other compiles kernels.
test: $(VENV)/.ready-dev ## lint, and the tests of every feature, without the thorough ones
	$(MAKE) --jobs=2 lint kernels
	$(MAKE) pytest

test-all: ## lint, and all tests, also long ones: pages, browsers, compilers, statistics, all parameters
	$(MAKE) test ALL=1

# Once, before parallel workers compile the same kernels each.
kernels: $(VENV)/.ready-dev
	$(BIN)/flexarm warmup

suite: kernels ## the tests of `make test` alone; ALL=1 runs all, SEED=7 draws other examples, FULL=1 runs all of the long pages
	$(MAKE) pytest

pytest:
	FULL_PAGES=$(FULL) $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(TESTS) \
		$(if $(ALL),,-m "not thorough") \
		$(if $(SEED),--hypothesis-profile=random --hypothesis-seed=$(SEED))

test-lowest: ## the tests of `make test` with the lowest versions of all dependencies; ALL=1 runs all
	mkdir -p .venv-lowest
	$(PYTHON) tests/lowest_versions.py > .venv-lowest/constraints.txt
	$(MAKE) suite VENV=.venv-lowest PIP_OPTIONS="--constraint .venv-lowest/constraints.txt"

test-pythons: ## the same with every Python at hand, and with the lowest versions; ALL=1 runs all
	@test -n "$(strip $(PYTHONS))" || { echo "no python3.11 to python3.14 on the path; name some: PYTHONS=..."; exit 1; }
	for python in $(PYTHONS); do \
		$(MAKE) suite PYTHON=$$python VENV=.venv-$$(basename $$python) || exit 1; \
	done
	$(MAKE) test-lowest PYTHON=$(firstword $(PYTHONS))

test-numba: ## the same with the next Numba, pre-releases included, whatever pyproject.toml allows
	$(MAKE) .venv-numba/.ready-dev VENV=.venv-numba
	.venv-numba/bin/python -m pip install --quiet --disable-pip-version-check --pre --upgrade --no-deps numba llvmlite
	$(MAKE) suite VENV=.venv-numba

dist: $(VENV)/.ready-dev ## build the wheel and the source archive into dist
	$(BIN)/python -m hatchling build --clean

docs: $(VENV)/.ready-docs ## build the documentation site: out/site/html/index.html; FULL=1 also runs its notebooks
	$(BIN)/python docs/site $(if $(FULL),,--run "")

conformance: $(VENV)/.ready-dev ## after an addition: which parts are missing in the code, the tests and the pages?
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal \
		tests/conformance tests/docs/test_docs_reference.py tests/fuzz/test_calls.py \
		tests/benchmarks/test_controllers_run.py tests/unit/studio/test_state.py

# Compiled code does not check indices of arrays; Python does.
interpreted: $(VENV)/.ready-dev ## the tests of kernels without compilation, so that wrong indices of arrays are errors
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal \
		tests/unit/kernels tests/unit/stations tests/unit/contacts tests/unit/loads tests/oracle_comparison

lint: $(VENV)/.ready-dev ## formatting, style, types and import layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.ready-dev ## put the code into the project's format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

fuzz: $(VENV)/.ready-dev ## random calls, files, arms and faults, ten minutes for each part: make fuzz PART=arms SEED=2 WRITE=1
	$(BIN)/python tests/fuzz/farm.py $(PART) --seed $(or $(SEED),0) --minutes $(MINUTES) $(if $(WRITE),--write)

kills: $(VENV)/.ready-dev ## 10,000 runs on two processes, killed 20 times: is the store that of an undisturbed study? Ten minutes
	$(BIN)/python tests/studies/kills.py

mutants: $(VENV)/.ready-dev ## put small errors into copies of the code: do the tests notice nine in ten? An hour
	$(BIN)/python -m mutants --workers $(WORKERS)

# Debian has it as a package; elsewhere Playwright fetches its own.
browser: $(VENV)/.ready-dev ## install headless Chromium, for the tests that open pages
	if command -v apt-get > /dev/null && $(AS_ROOT) apt-get update --quiet && \
		apt-cache show chromium-headless-shell > /dev/null 2>&1; \
	then $(AS_ROOT) apt-get install --yes --no-install-recommends chromium-headless-shell fonts-dejavu-core; \
	else $(BIN)/python -m playwright install --only-shell chromium; fi

bench: $(VENV)/.ready-dev ## measure speed; tables and figures in docs/performance
	$(BIN)/python -m benchmarks

peers: $(VENV)/.ready-peers ## compare trajectories with Exudyn and MuJoCo; fetches all peers from PyPI (some hundred MB)
	$(BIN)/python -m peers

gallery: $(VENV)/.ready-dev ## compare with known answers, and draw all pictures: docs/gallery, docs/cards, docs/images
	$(BIN)/python -m gallery
	$(BIN)/python docs/images/drawings.py

clean: ## forget the environment and everything made
	rm -rf .venv .venv-* dist out .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
