# Each target does all of its own set-up; the second time it is quick.
VENV := .venv
BIN := $(VENV)/bin
# The Python of the environment that is there, else python3; make PYTHON=python3.12 demo takes another.
ifeq ($(origin PYTHON),undefined)
PYTHON := $(if $(wildcard $(VENV)/ready),$(BIN)/python,python3)
endif
JOBS ?= 3 # some tests wait for ROS: two workers leave a fifth of two cores idle
OUT ?= out

SUPPORTED := $(patsubst %,CPython-%-Linux-x86_64-glibc,3.10 3.11 3.12 3.13)
PLATFORM := $(shell $(PYTHON) -c 'import platform as p, sys; print("%s-%d.%d-%s-%s-%s" % \
  ((p.python_implementation(),) + sys.version_info[:2] + (p.system(), p.machine(), p.libc_ver()[0])))' \
  2>/dev/null)
VERSION := $(word 2,$(subst -, ,$(PLATFORM)))
VENV_VERSION := $(shell sed -n 's/^version = \([0-9]*\.[0-9]*\).*/\1/p' $(VENV)/pyvenv.cfg 2>/dev/null)
OTHER_VERSION := $(if $(VENV_VERSION),$(filter-out $(VERSION),$(VENV_VERSION)))
CONSTRAINTS := constraints/python$(VERSION).txt
# Python writes the bytecode of what it imports; only where it may not does pip write all of it.
PIP := PIP_CONSTRAINT=$(CONSTRAINTS) PIP_BUILD_CONSTRAINT=$(CONSTRAINTS) \
  $(BIN)/python -m pip install --quiet --disable-pip-version-check --use-pep517 \
  $(if $(PYTHONDONTWRITEBYTECODE),,--no-compile)

define CHECK_PYTHON
@$(if $(filter $(PLATFORM),$(SUPPORTED)),:,$(error are_ros needs Python 3.10 to 3.13 on Linux x86-64 \
  with glibc, but $(PYTHON) is $(or $(PLATFORM),not there): make PYTHON=python3.12 takes another))
endef

# A ROS that was sourced stays outside: the environment has its own.
ifdef AMENT_PREFIX_PATH
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH RMW_IMPLEMENTATION
endif

.PHONY: setup demo test test-long lint oldest colcon constraints clean another-python

setup: $(VENV)/ready-for-ros # what the commands need, ROS 2's Python included; nothing is run
	@if test -e $<; then $(BIN)/python scripts/build_messages.py; fi

# The kernels compile while the rest is installed and the messages of ROS are built.
ifeq ($(MAKECMDGOALS),demo)
MAKEFLAGS += --jobs=2
endif
demo: $(VENV)/ready-for-ros $(VENV)/kernels
	@if test -e $<; then $(BIN)/are demo --params config/nav2_are.yaml --out $(OUT)/demo; \
	else echo 'Instead of the live demo, the drive is replayed, which needs no ROS; artefacts that the robot touches move aside.'; \
	$(BIN)/are replay bags/sample_office.mcap --params bags/sample_office.yaml --params config/nav2_are.yaml --out $(OUT)/demo; fi

# The project's own path comes first: pip replaces the installed one meanwhile.
$(VENV)/kernels: $(VENV)/core
	@PYTHONPATH=. nice $(BIN)/python scripts/compile_kernels.py
	@touch $@

# The tests start hundreds of processes: their bytecode is kept, though not beside the sources.
PYTEST := PYTHONDONTWRITEBYTECODE= PYTHONPYCACHEPREFIX=$(CURDIR)/$(VENV)/bytecode $(BIN)/pytest

test: $(VENV)/ready-for-tests
	$(PYTEST) -n $(JOBS) --dist worksteal

test-long: $(VENV)/ready-for-tests
	$(PYTEST) -n $(JOBS) --dist worksteal -m long

lint: $(VENV)/ready-for-tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

colcon: # builds with colcon as the README says, and tests what ros2 run and ros2 launch would find
	$(CHECK_PYTHON)
	$(PYTHON) scripts/check_colcon.py

oldest: # runs the commands with the oldest packages that pyproject.toml allows
	$(CHECK_PYTHON)
	$(PYTHON) scripts/check_oldest.py

$(VENV)/core: pyproject.toml setup.py $(wildcard constraints/*.txt) $(if $(OTHER_VERSION),another-python)
	$(CHECK_PYTHON)
	$(if $(OTHER_VERSION),@echo '$(VENV) was made with Python $(OTHER_VERSION): it is made anew with $(VERSION).')
	@{ test -z '$(OTHER_VERSION)' && $(BIN)/python -m pip --version >/dev/null 2>&1; } \
	  || $(PYTHON) -m venv --clear $(VENV)
	@echo 'installing what the kernels need, into $(VENV)'
	@$(PIP) --editable .
	@touch $@

$(VENV)/ready: $(VENV)/core
	@echo 'installing what the replay needs'
	@$(PIP) --editable '.[replay,view]'
	@touch $@

# Without a compiler there is no ROS: the sentence that says so is kept, for the tests to skip with.
$(VENV)/ready-for-ros: $(VENV)/ready scripts/build_messages.py $(shell find msg_defs -type f)
	@rm -f $@
	@if $(BIN)/python scripts/build_messages.py --check 2>$(VENV)/without-ros; then \
	  rm $(VENV)/without-ros && \
	  echo 'installing rclpy, and what builds messages for it' && \
	  $(PIP) --editable '.[replay,view,ros,ros-build]' && \
	  $(BIN)/python scripts/build_messages.py tf2_msgs map_msgs are_msgs && \
	  touch $@; \
	else cat $(VENV)/without-ros >&2; fi

$(VENV)/ready-for-tests: $(VENV)/ready | $(VENV)/ready-for-ros
	@echo 'installing what tests and lint need'
	@$(PIP) --editable '.[replay,view,test,lint]'
	@if test -e $(VENV)/ready-for-ros; then $(BIN)/python scripts/build_messages.py; fi
	@touch $@

constraints: # writes the exact versions that pip finds today, for the Python at hand; KEEP=yes: only new ones
	@rm -rf build/constraints && $(PYTHON) -m venv build/constraints
	build/constraints/bin/python scripts/pin_packages.py $(if $(KEEP),--keep) $(CONSTRAINTS)

clean:
	rm -rf $(VENV) build install log $(OUT) *.egg-info
