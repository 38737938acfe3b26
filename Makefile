# make demo and make test do everything from a fresh clone; all they need is Python 3.11 or later.
# Another Python: make test PYTHON=/path/to/python3.13 (after make distclean, if .venv was made with another one).

.POSIX:
.DELETE_ON_ERROR:
PYTHON ?= python3
PYTEST_ARGS ?=
VENV = .venv
BIN = $(VENV)/bin
PIP = $(BIN)/python -m pip --disable-pip-version-check -q
DEMO = src/solen/spec/examples/solen-860.toml
DEMO_OUT = demo-out

.PHONY: help demo test kernels page lint types contracts docs pins check evidence setup clean distclean

help:
	@echo "make demo       design, trace and report the example sensor: $(DEMO_OUT)/report.html"
	@echo "make test       the tests (PYTEST_ARGS=... adds pytest options)"
	@echo "make check      lint, types, contracts, docs, pins and test"
	@echo "make evidence   the long demonstrations, with what they print"
	@echo "make setup      only .venv, with everything for development"
	@echo "make page       build the studio's page anew (Node), and fail where that makes a difference"
	@echo "make clean      remove what was built; make distclean removes .venv too"

demo: $(VENV)/.run-ready
	$(BIN)/solen run $(DEMO) --out $(DEMO_OUT)

# One process more than there are cores: tests of the bench wait, for simulated instruments, more than they compute.
test: $(VENV)/.dev-ready
	$(BIN)/python -m pytest -n $$(($$($(BIN)/python -c 'import os; print(os.cpu_count())') + 1)) --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

# Tests side by side in a fresh clone would each compile the tracer's kernels; these few do it beforehand, once.
KERNELS = tests/agreement/test_colours_and_histograms.py tests/agreement/test_space.py tests/trace/test_many.py \
  tests/explore/test_sweep.py::test_batch_point_does_not_depend_on_other_points \
  tests/sensor/test_batched.py::test_powers_in_space_agree_with_integration
kernels: $(VENV)/.dev-ready
	@$(BIN)/python -m pytest -q --no-header -p no:cacheprovider $(KERNELS) > /dev/null

evidence: $(VENV)/.dev-ready
	$(BIN)/python -m pytest -m evidence -s $(PYTEST_ARGS)

lint: $(VENV)/.dev-ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/codespell *.md docs examples src tools benchmarks

# The studio's page is committed as built; without Node it stays so.
page:
	@if ! command -v npm >/dev/null 2>&1; then echo "no npm: the studio's page is not built anew"; exit 0; fi; \
	set -e; cd web; npm ci --silent; npm run --silent types; npm run --silent build; cd ..; \
	changed=$$(git status --porcelain -- src/solen/studio/page src/solen/report/design/player.html); \
	if [ -n "$$changed" ]; then echo "$$changed"; echo "the built page differs: commit it" >&2; exit 1; fi

types: $(VENV)/.dev-ready
	$(BIN)/mypy

contracts: $(VENV)/.dev-ready
	$(BIN)/lint-imports

docs: $(VENV)/.dev-ready
	$(BIN)/sphinx-build -q -W --keep-going -n docs docs/_build

pins: $(VENV)/.dev-ready
	$(BIN)/python tools/pins.py --wheels

check: lint types contracts docs pins page test

setup: $(VENV)/.dev-ready

# Each stamp is written last, so an interrupted set-up is taken up again.
# A usable .venv is kept: no Python is needed then but its own.
$(VENV)/.python-ready:
	@set -e; \
	if $(BIN)/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then touch $@; exit 0; fi; \
	for python in $(PYTHON) python3.13 python3.12 python3.11; do \
	  if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	    echo "Creating $(VENV) with $$python"; \
	    $$python -m venv --clear $(VENV) || { echo "$$python cannot make a virtual environment; does it lack its venv package? On Debian: apt install python3-venv" >&2; exit 1; }; \
	    touch $@; exit 0; \
	  fi; \
	done; \
	echo "solen needs Python 3.11 or later, and $(PYTHON) is not; name one: make PYTHON=/path/to/python3.13" >&2; exit 1

# With the extras that README, quickstart and tutorials use. Built with the pinned setuptools rather than the newest: hence
# --no-build-isolation.
$(VENV)/.run-ready: $(VENV)/.python-ready pyproject.toml requirements.lock
	@echo "Installing solen into $(VENV); pip says nothing for a minute or two"
	@$(PIP) install -c requirements.lock setuptools
	@$(PIP) install -c requirements.lock --no-build-isolation -e ".[mechanics,netcdf]"
	@touch $@

$(VENV)/.dev-ready: $(VENV)/.python-ready pyproject.toml requirements.lock
	@echo "Installing solen, its tests and its docs into $(VENV); pip says nothing for some minutes"
	@$(PIP) install -c requirements.lock setuptools
	@$(PIP) install -c requirements.lock --no-build-isolation -e ".[dev,docs]"
	@touch $(VENV)/.run-ready $@

clean:
	rm -rf $(DEMO_OUT) docs/_build docs/api build dist src/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

distclean: clean
	rm -rf $(VENV)
