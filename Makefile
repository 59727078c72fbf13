# Two commands do everything from a clean clone, without root:
#   make demo    two simulated people in a room, every node in its own process, a report at the end
#   make test    the tests (make test-all: also the long ones)
VENV ?= .venv
PYTHON ?= python3
# A worker per core; files are not split between them (test/conftest.py).
PARALLEL = -n logical --no-loadscope-reorder
STAMP = $(VENV)/.handwave-setup
export PIP_CONSTRAINT = $(CURDIR)/constraints.txt
# One thread per pool: at these sizes second threads only fight, and results stay the same bit for bit.
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
# Compiled modules are kept, whatever the shell says: without, each of some hundred processes of the tests compiles all of them anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: blender docs help demo test test-all coverage stability mutations setup lint docs pictures figures figures-check bench clean
help:
	@sed -n 's/^## //p' $(MAKEFILE_LIST)

## make setup      create .venv, install pinned dependencies, build the messages into it, compile the loops (under 3 s when done already)
setup: $(STAMP)
$(STAMP): pyproject.toml constraints.txt CMakeLists.txt benchmarks/setup.cfg package.xml scripts/check_system.sh scripts/setup.sh $(wildcard cmake/*) $(wildcard cmake/*/*) $(wildcard msg/*.msg) $(wildcard srv/*.srv)
	@VENV=$(VENV) PYTHON=$(PYTHON) sh scripts/setup.sh
	@touch $@

## make demo       the whole graph on a simulated room (options: make demo ARGS="--headless --duration 20")
demo: setup
	$(VENV)/bin/handwave demo $(ARGS)

## make test       the usual tests, on all cores (options: make test ARGS="test/core -x")
test: setup
	$(VENV)/bin/python -m pytest $(PARALLEL) $(ARGS)

## make test-all   those, and the ones that take long (`.ci/run` calls this)
test-all: setup
	$(VENV)/bin/python -m pytest $(PARALLEL) -m "not slow" $(ARGS)

## make coverage   all tests, traced for coverage: takes half as long again
coverage: setup
	$(VENV)/bin/python -m pytest $(PARALLEL) -m "not slow" --cov --cov-report=term --cov-fail-under=85 $(ARGS)

## make stability  the numerically hard cases alone (test/stability/README.md lists them)
stability: setup
	$(VENV)/bin/python -m pytest $(PARALLEL) -m "not slow" test/stability $(ARGS)

## make mutations  take every numerical guard out of the code, one at a time, and see that a test fails (make mutations ARGS="--some 10")
mutations: setup
	$(VENV)/bin/python test/stability/mutations.py $(ARGS)

## make blender    bodies beside Blender's, and by its way; it is a Python module, in an environment of its own because it wants an older numpy (Python 3.11)
blender: setup
	test -x build/blender/bin/python || $(PYTHON) -m venv build/blender
	env -u PIP_CONSTRAINT build/blender/bin/pip install --quiet --disable-pip-version-check 'bpy>=4.5,<4.6' 'numpy<2' scipy numba finufft pydantic pyyaml \
		joblib scikit-learn threadpoolctl typing-extensions pytest pytest-timeout hypothesis
	PYTHONPATH=$(CURDIR) build/blender/bin/python -m pytest test/sim/test_blender.py test/sim/test_blender_route.py $(ARGS)

## make lint       ruff and mypy
lint: setup
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

## make docs       the pages of docs/ for a browser, in build/docs; every link is checked
docs: setup
	$(VENV)/bin/mkdocs build --strict --quiet

## make pictures   every picture of docs/ that this machine can make (ARGS="--only view"; HANDWAVE_DATA names the recordings)
pictures: setup
	$(VENV)/bin/python docs/research/make_all.py $(ARGS)

## make figures  run the studies whose stored results are missing or of other code (ARGS="living probe": only these); it goes on where it stopped
figures: setup
	$(VENV)/bin/python -m benchmarks.figures $(ARGS)

## make figures-check  which stored results are of other code, and why, and which pages quote them (RELEASE=1: fails when there is one)
figures-check: setup
	$(VENV)/bin/python -m benchmarks.figures --check $(if $(RELEASE),--release) $(ARGS)

## make bench      the accuracy and the time of every choice, as tables
bench: setup
	for name in simulator dsp tracking gestures hand hand_velocity graph budget effects boards; do $(VENV)/bin/python -m benchmarks $$name || exit 1; done

## make clean      remove what make made
clean:
	rm -rf $(VENV) build out
