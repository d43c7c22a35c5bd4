# Each target does all of its own set-up; the second time it is quick.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CONSTRAINTS = constraints/python$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])').txt
JOBS ?= 2
OUT ?= out

.PHONY: demo test test-long lint bench constraints clean

demo: $(VENV)/ready
	$(BIN)/are replay bags/sample_office.mcap --params bags/sample_office.yaml --out $(OUT)/demo
	@echo 'picture: $(OUT)/demo/overview.png'

test: $(VENV)/ready-for-tests
	$(BIN)/pytest -n $(JOBS)

test-long: $(VENV)/ready-for-tests
	$(BIN)/pytest -n $(JOBS) -m long

lint: $(VENV)/ready-for-tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

$(VENV)/ready: pyproject.toml setup.py $(wildcard constraints/*.txt)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint $(CONSTRAINTS) --editable '.[replay]'
	touch $@

$(VENV)/ready-for-tests: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint $(CONSTRAINTS) --editable '.[replay,test,lint]'
	touch $@

constraints: # writes the exact versions that pip finds today, for the Python at hand
	rm -rf build/constraints && $(PYTHON) -m venv build/constraints
	build/constraints/bin/python -m pip install --quiet --disable-pip-version-check '.[replay,test,lint]'
	build/constraints/bin/python -m pip freeze --disable-pip-version-check --exclude are_ros > $(CONSTRAINTS)

clean:
	rm -rf $(VENV) build $(OUT) *.egg-info
