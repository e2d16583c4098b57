# Two commands: `make demo` shows the whole system at work, `make test` checks it. Both set up
# what they need, once, in a virtual environment inside this folder.

PYTHON ?= python3
BAGS ?=
DEMO_OPTIONS ?=
OUTPUT ?= output/demo
TESTS ?= test
DATA ?=
PARTS ?=
FIGURES ?=

# A sourced ROS 2 Jazzy is used as it is: the environment sees the system's packages, and numpy
# stays at the version that ROS was compiled for. Elsewhere ROS's wheels come into the environment.
ROS := $(shell [ "$$ROS_DISTRO" = jazzy ] && $(PYTHON) -c 'import rclpy' 2>/dev/null && echo yes)
ifeq ($(ROS),yes)
VENV := .venv-ros
VENV_OPTIONS := --system-site-packages
EXTRAS := test
KEPT := numpy scipy matplotlib
else
VENV := .venv
VENV_OPTIONS :=
EXTRAS := ros,tf,test
KEPT :=
endif
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

OLDEST := .venv-oldest
OLDEST_PYTHON := $(shell for p in python3.10 python3.11 $(PYTHON); do \
                     $$p -c 'import venv' 2>/dev/null && echo $$p && break; done)

SOURCES := setup.py setup.cfg package.xml $(wildcard config/* launch/*) \
           $(shell find somfusion_ros -name '*.py' -o -name '*.json' -o -name py.typed)

.PHONY: demo test test-fast oldest figures calibrate lint setup tf2_msgs clean
.DEFAULT_GOAL := demo

demo: $(VENV)/.package
	@$(BIN)/python -m somfusion_ros.ros.apps.demo --output $(OUTPUT) $(DEMO_OPTIONS) $(BAGS)

test: $(VENV)/.package
	ROS_PYTHON_CHECK_FIELDS=1 $(BIN)/python -m pytest $(TESTS)

# What to run after every change: a minute and a half.
test-fast: $(VENV)/.package
	$(BIN)/python -m pytest -m 'not slow and not newest' test/unit

# The core and the commands without ROS, with the oldest versions of all that they need.
oldest: $(OLDEST)/.dependencies
	env -u CI $(OLDEST)/bin/python -m pytest -m 'not system and not newest' test/unit

# Every table of README and doc/ anew, from recorded data (benchmarks/DATASETS.md) or, where there
# is none, from simulated worlds: make figures DATA=... PARTS="slam team" FIGURES=--quick
figures: $(VENV)/.package
	$(BIN)/python -m benchmarks.figures $(if $(DATA),--data $(DATA)) $(if $(PARTS),--parts $(PARTS)) \
	    $(FIGURES)

# The weights of the verdict, learned anew, with the table of all cases and what they reach, from
# folders of pairs of maps and of replayed teams: make calibrate DATA=... REPLAYS="out1 out2"
# (nine cases a second on a core, begun again where it was stopped; SHARE=0.01 for a look at a
# hundredth of the drawn cases, JOBS=1 for one process)
calibrate: $(VENV)/.package
	$(BIN)/python -m benchmarks.fusion.calibration $(DATA) \
	    $(if $(REPLAYS),--replays $(REPLAYS)) $(if $(SHARE),--share $(SHARE)) \
	    $(if $(JOBS),--jobs $(JOBS)) --write

lint: $(VENV)/.package
	$(BIN)/python -m pytest test/unit/test_style.py test/unit/test_types.py \
	    test/unit/test_architecture.py

setup: $(VENV)/.package

clean:
	rm -rf .venv .venv-ros .venv-oldest build install log dist output *.egg-info .pytest_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +

# The dependencies, once; the package itself, again whenever a source of it changed.
$(VENV)/.dependencies: setup.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || \
	    { echo 'Python 3.10 or newer is needed; name one with: make PYTHON=/path/to/python3'; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	    { echo 'Python has no venv here; on Debian and Ubuntu: apt install python3-venv'; exit 1; }
	@echo 'Setting up $(VENV) (once, a few minutes) ...'
	@$(PYTHON) -m venv $(VENV_OPTIONS) $(VENV)
	@rm -rf build/lib build/bdist.* *.egg-info
	@for name in $(KEPT); do $(BIN)/python -c "from importlib.metadata import version; \
	    print('$$name==' + version('$$name'))" 2>/dev/null; done > $(VENV)/kept.txt || true
	@$(PIP) install --quiet '.[$(EXTRAS)]' -c $(VENV)/kept.txt || \
	    { $(BIN)/python -V; echo 'pip could not install this, see above. Some dependencies come' \
	      'as wheels for Python 3.10 to 3.13 only; name one with: make PYTHON=python3.12'; exit 1; }
	@$(MAKE) --no-print-directory tf2_msgs
	@touch $@

# TF's message type, once; a ROS installation has it. Without a C++ compiler all else works.
tf2_msgs:
	@$(BIN)/python scripts/make_tf2_msgs.py || [ -z "$$CI" ]

$(VENV)/.package: $(VENV)/.dependencies $(SOURCES)
	@rm -rf build/lib build/bdist.* *.egg-info
	@$(PIP) install --quiet --no-deps --force-reinstall .
	@touch $@

$(OLDEST)/.dependencies: setup.py test/versions/oldest.txt
	@[ -n '$(OLDEST_PYTHON)' ] || \
	    { echo 'Python has no venv here; on Debian and Ubuntu: apt install python3-venv'; exit 1; }
	@echo 'Setting up $(OLDEST) with $(OLDEST_PYTHON) (once) ...'
	@$(OLDEST_PYTHON) -m venv $(OLDEST)
	@$(OLDEST)/bin/python -m pip --disable-pip-version-check install --quiet '.[test]' \
	    -c test/versions/oldest.txt
	@$(OLDEST)/bin/python -m pip check
	@touch $@
