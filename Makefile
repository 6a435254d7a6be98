# `make demo` and `make test` set up all that they need in .venv and run.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo check unit test test-slow fuzz sbom bench validation benchmark benchmark-data docs pictures tutorial clean

# Images set this; compiled modules are kept all the same, or every process would compile all that it imports anew (4 s).
unexport PYTHONDONTWRITEBYTECODE

# One thread each: many small matrices, and as many processes as cores.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n auto --dist loadfile
MARKED := integration or mujoco or browser

demo: $(VENV)/.installed
	$(BIN)/steelyard demo --force

# Below a minute: style, types and the unit tier (tests without a mark).
check: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(PYTEST) -m "not (slow or $(MARKED))"

# The unit tier alone, for instance of another Python: make unit PYTHON=python3.13 VENV=.venv-3.13
unit: $(VENV)/.installed-test
	$(PYTEST) -m "not (slow or $(MARKED))"

# `check` first, then whole experiments, MuJoCo and a browser.
test: check
	$(PYTEST) -m "not slow and ($(MARKED))"

# What `test` leaves out since it takes long: examples, more designs, longer recordings. LONG=K/N runs one of N parts of
# the longest ones, SLOW=K/N of all others.
LONG ?= 0/1
SLOW ?= 0/1
test-slow: $(VENV)/.installed-test
	$(PYTEST) -m slow --long-part=$(LONG) --slow-part=$(SLOW)

# About ten minutes of changed files for every reader: at random, then guided by the code they reach. FUZZ_SEED draws others.
FUZZ_SEED ?= 0
fuzz: $(VENV)/.installed-fuzz
	$(BIN)/python tests/fuzz.py --seconds 360 --seed $(FUZZ_SEED) --keep fuzz-found
	$(BIN)/python tests/fuzz.py --guided 15 --seed $(FUZZ_SEED) --keep fuzz-found

# Every component that is installed with steelyard (CycloneDX), and whether their versions fit together; needs no network.
sbom: $(VENV)/.installed-test
	mkdir -p dist
	$(BIN)/python .ci/sbom.py dist/steelyard.cdx.json
	$(BIN)/python -m pip check

bench: $(VENV)/.installed
	$(BIN)/python benchmarks/run.py

# Draws the pages of docs/validation/ that are figures alone; goes on where it was ended, ANEW=1 makes all again.
validation: $(VENV)/.installed
	$(BIN)/python benchmarks/book.py --scale $(or $(SCALE),1) $(if $(ANEW),--anew) $(CHAPTERS)

# The public benchmark: recordings with truth, then all methods on them; BENCHMARK=full draws ten of `plain`, five of all else.
benchmark-data: $(VENV)/.installed-bench
	OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/public/generate.py --seeds $(if $(filter full,$(BENCHMARK)),10,1)

benchmark: benchmark-data
	$(BIN)/python benchmarks/public/run.py --processes 2

# Runs every command that a page shows; warnings are errors.
docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --nitpicky --fresh-env --jobs 2 docs docs/_build/html

# Draws the pictures of the README anew.
pictures: $(VENV)/.installed
	$(BIN)/python docs/pictures.py

# Does what the tutorial says, command by command, in an environment of its own.
tutorial:
	$(PYTHON) docs/follow.py docs/tutorial.md

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

# One installation each, with all that the smaller ones have. Modules are compiled when they are first needed.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml
	$(INSTALL) '.[all]'
	touch $@

$(VENV)/.installed-test: $(VENV)/bin/python pyproject.toml
	$(INSTALL) '.[all,test]'
	touch $(VENV)/.installed $@

$(VENV)/.installed-fuzz: $(VENV)/bin/python pyproject.toml
	$(INSTALL) '.[all,test,fuzz]'
	touch $(VENV)/.installed $(VENV)/.installed-test $@

$(VENV)/.installed-bench: $(VENV)/bin/python pyproject.toml
	$(INSTALL) '.[all,bench]'
	touch $(VENV)/.installed $@

$(VENV)/.installed-docs: $(VENV)/bin/python pyproject.toml
	$(INSTALL) '.[all,docs]'
	touch $(VENV)/.installed $@

clean:
	rm -rf $(VENV) .venv-* docs/_build steelyard-demo .pytest_cache .mypy_cache .ruff_cache
