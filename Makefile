# SPDX-License-Identifier: Apache-2.0
# Every target makes the environment .venv first if it is missing or out of date.

PYTHON ?= python3
VENV   := .venv
PY     := $(VENV)/bin/python
RUNS   := $(VENV)/runs
STAMP  := $(VENV)/ready

# With ROS sourced its own rclpy is used; without, the wheels from PyPI.
ROS := $(ROS_DISTRO)
ifdef PYTHONPATH
ROS := $(or $(ROS),$(shell $(PYTHON) -c \
  'from importlib.util import find_spec as find; print("ros" if find("rclpy") else "")'))
endif

ifeq ($(ROS),)
NEEDED     := .[ros]
ALL        := .[ros,test,dev]
else
NEEDED     := .
ALL        := .[test,dev]
VENV_FLAGS := --system-site-packages
endif

# Its name changes with the ROS and the Python asked for; so does the environment.
MADE := $(VENV)/made-for-$(or $(ROS),wheels)-$(subst /,-,$(PYTHON))

# The ROS wheels mark their environment with this; passed on to another Python, it breaks its rclpy.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help demo test test-all lint paper bench soak campaigns site clean

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' Makefile

demo: $(RUNS)  ## drive a simulated axis over ROS 2, record it, show what it did
	@$(VENV)/bin/stickslip demo --out demo

# A worker runs files in their order, so what a file prepares is prepared once. More workers than
# processors: many tests wait for programs and for DDS.
PYTEST := $(PY) -m pytest -n auto --dist worksteal

test: $(STAMP)  ## run the tests that come before each commit (ARGS="-k solver" for some of them)
	@$(PYTEST) -m 'not long' $(ARGS)

test-all: $(STAMP)  ## run all tests, also those that take long (ARGS="-m long" for these alone)
	@$(PYTEST) test validation/test_programs.py validation/paper validation/campaigns/tests $(ARGS)

lint: $(STAMP)  ## check format, style, types, tables of pages and packaging
	@$(PY) -m ruff format --check .
	@$(PY) -m ruff check .
	@echo "checking types: a minute or two the first time"
	@$(PY) -m mypy
	@$(PY) docs/tables.py --check
	@$(PY) docs/docstrings.py
	@$(PY) -m pytest -q -n 0 docs/checks/test_imports.py docs/checks/test_packaging.py \
	  docs/checks/test_pages.py

paper: $(STAMP)  ## simulate every figure and table of the paper and compare (ARGS="fig09" for some)
	@$(PY) -m validation.paper $(ARGS)

bench: $(VENV)/peers  ## measure speed and error against general solvers (ARGS="--quick")
	@$(PY) -m validation.benchmark $(ARGS)

soak: $(STAMP)  ## run axis and recorder for hours under random commands (ARGS="--hours 2")
	@$(PY) -m validation.soak $(ARGS)

campaigns: $(STAMP)  ## run long studies (ARGS="intervals drives" for some, ARGS=--help lists them)
	@$(PY) -m validation.campaigns $(ARGS)

site: $(STAMP)  ## build the documentation as pages and run what they print: docs/_build/site/index.html
	@rm -rf docs/_build/site
	@$(PY) -m sphinx -q -W -b html docs docs/_build/site
	@$(PY) -m pytest -n auto --dist loadfile docs/checks $(ARGS)
	@echo "open $(CURDIR)/docs/_build/site/index.html"

clean:  ## remove everything that make and the tools have made
	@rm -rf $(VENV) demo build docs/_build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(MADE):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "make: Python 3.11 or newer is needed, but $(PYTHON) is: $$($(PYTHON) --version 2>&1);" \
	       "try make PYTHON=python3.12" >&2; exit 1; }
ifneq ($(ROS),)
	@$(PYTHON) -c 'import rclpy' 2>/dev/null || { \
	  echo "make: this shell names ROS $(ROS), but $(PYTHON) cannot import rclpy: source its setup.bash," \
	       "use its Python (make PYTHON=/usr/bin/python3), or unset ROS_DISTRO to do without" >&2; \
	  exit 1; }
endif
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV_FLAGS) $(VENV)
	@touch $@

# What the package needs to run; what its tests and its site need comes on top, for who asks for them.
# Python compiles the files that it imports: all files of all packages would be ten seconds more.
$(RUNS): $(MADE) setup.py setup.cfg package.xml
	@echo "Installing into $(VENV): $$($(PY) --version), ROS $(or $(ROS),from PyPI);" \
	      "one to three minutes the first time"
	@$(PY) -m pip install -qq --no-compile --editable '$(NEEDED)'
	@touch $@

$(STAMP): $(RUNS)
	@echo "Installing what the tests need; about a minute the first time"
	@$(PY) -m pip install -qq --editable '$(ALL)'
	@touch $@

# One by one: a peer that cannot be installed here is reported, and missing, but spoils nothing.
PEERS := cyrk scijit scikit-sundae
$(VENV)/peers: $(STAMP)
	@echo "Installing what the solver is measured against: $(PEERS)"
	@for peer in $(PEERS); do \
	  $(PY) -m pip install -qq --prefer-binary $$peer || echo "make: $$peer is left out; to try again: rm $@" >&2; \
	done
	@touch $@
