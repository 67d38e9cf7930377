# Two commands do everything on a fresh machine that has only Python: make demo, make test.
# Both set up .venv first; afterwards .venv/bin/python -m ogm_mcmc ... works.

# The newest of the supported Pythons that runs here; PYTHON=... names another.
PYTHON ?= $(shell for p in python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null \
	&& echo $$p && break; done)
VENV := .venv
PY := $(VENV)/bin/python
PIP := $(PY) -m pip install --quiet
RUNS := $(VENV)/.runs
READY := $(VENV)/.ready
INPUT ?=

export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: setup demo test kernels test-fast test-ros test-full fuzz lint types imports bench clean-cache clean

setup: $(READY)

# What runs: the package and ROS 2; kernels are compiled while the rest arrives. The pip of the Python at hand
# serves if it can (22.3 on): to give a venv its own first takes 8 s. Bytecode is made of what is imported, where
# Python may not write it (PYTHONDONTWRITEBYTECODE), too: every start would take 2 s more.
$(RUNS): setup.py
	@test -n "$(PYTHON)" || { echo 'error: expected Python 3.11 or 3.12; name one: make PYTHON=...'; exit 2; }
	$(PYTHON) -m venv --without-pip $(VENV)
	export PYTHONDONTWRITEBYTECODE=; \
	pip='$(PYTHON) -m pip --python $(PY)'; \
	$$pip --version > /dev/null 2>&1 || { $(PYTHON) -m venv $(VENV) && pip='$(PY) -m pip'; } || exit; \
	install="$$pip install --quiet --no-compile"; here='--use-pep517 --no-build-isolation --editable'; \
	$$install 'setuptools<80' wheel && $$install $$here . || exit; \
	$(PY) -m ogm_mcmc warm-up & \
	$$install pip $$here '.[ros]' && \
	$(PY) -c 'import ogm_mcmc.cli.demo, ogm_mcmc.ros.demo_client, ogm_mcmc.ros.replay, \
		ogm_mcmc.ros.online_mapper, ogm_mcmc.ros.refine_server'; status=$$?; \
	wait; exit $$status
	@touch $@

# And what tests and figures need.
$(READY): $(RUNS)
	$(PIP) --use-pep517 --no-build-isolation --editable '.[ros,test]'
	-$(PY) -m compileall -qq -j 0 $(VENV)/lib
	@touch $@

# The picture first; then matplotlib, for the curves of `evaluate` and `experiment`.
demo: $(RUNS)
	$(PY) -m ogm_mcmc demo $(INPUT) -o out/demo
	-@$(PY) -c 'import matplotlib' 2> /dev/null || $(PIP) --use-pep517 --no-build-isolation --editable '.[plots]'

# A worker more than cores; files go to workers whole, those that take long first.
WORKERS := -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder
# Files with tests that measure waiting times: those run after the others.
ALONE = $(shell grep -rl --include='test_*.py' 'mark\.alone' test)

# Checks and compiling of kernels side by side; then all tests, whether or not some fail.
test: $(READY)
	$(MAKE) --jobs 3 --output-sync=target lint types imports kernels
	failed=0; \
	$(PY) -m pytest $(WORKERS) -m 'not full and not alone' || failed=1; \
	$(PY) -m pytest -m 'alone and not full' $(ALONE) || failed=1; \
	exit $$failed

# What several workers would otherwise compile each for itself; tests say what is wrong with it.
kernels: $(READY)
	-$(PY) test/support/kernel_caches.py

test-fast: kernels
	$(PY) -m pytest $(WORKERS) -m 'not full and not slow and not ros and not alone'
	$(PY) -m pytest -m 'alone and not full and not slow and not ros' $(ALONE)

test-ros: $(READY)
	$(PY) -m pytest -m 'ros and not full'

# Everything, and once more with bounds checks in the kernels and with plain Python in their place
# (not of commands and experiments, which would take hours).
test-full: $(READY) lint types imports fuzz
	$(PY) -m pytest
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(VENV)/boundscheck $(PY) -m pytest -m 'not full and not slow and not ros' test
	NUMBA_DISABLE_JIT=1 $(PY) -m pytest -m 'not full and not slow and not ros and not jit' \
		--ignore test/cli --ignore test/lab/experiments --ignore test/lab/benchmarks test

# COUNT messages and files with changes at random, through every method and every loader.
COUNT ?= 20000
SEED ?= 1

fuzz: $(READY)
	OGM_MCMC_FUZZ_COUNT=$(COUNT) OGM_MCMC_FUZZ_SEED=$(SEED) $(PY) -m pytest $(WORKERS) \
		test/engine/test_mutated_messages.py test/io/test_damaged_files.py test/io/test_damaged_texts.py

lint: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

types: $(READY)
	$(VENV)/bin/mypy

imports: $(READY)
	$(VENV)/bin/lint-imports

bench: $(READY)
	$(PY) -m ogm_mcmc bench online

# Numba's cache does not notice an edit in another module's kernel.
clean-cache:
	find . -name '*.nb[ic]' -not -path './$(VENV)/*' -delete

clean: clean-cache
	rm -rf $(VENV) build install log out
