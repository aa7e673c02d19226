# The commands of the README.  Each sets up .venv when it is missing or out of date, and never again.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
# The environment links each source by its name: a new name needs a new installation.
NAMES := $(shell find scene closure montecarlo compare src -type f -not -path '*__pycache__*' | sort | cksum | cut -d' ' -f1)
READY := $(VENV)/ready-$(NAMES)

# Folders whose tests are all marked slow (conftest.py): the first tier does not even import them.
SLOW := tests/faults tests/interpreted tests/page tests/security
# With the compiler off, for the lines of what it compiles; the other tests would take hours so.
PHYSICS := arithmetic drive impact rest
INTERPRETED := tests/interpreted $(PHYSICS:%=tests/scene/test_%.py)

# The lines that the first tier reaches are counted where both tiers run, for that slows the interpreter.
COUNT := --cov --cov-append --cov-report=
# Three files at a time on two cores, for many tests wait for processes that they have started; in their order, so that
# the many small files of the doctests come last and fill up.
TEST = $(RUN)/pytest --numprocesses=3 --dist=loadfile --no-loadscope-reorder
# The doctests are those of the package, under the name that it is imported by.
ALL = --pyargs tests rattle

# Hundreds of processes import the same modules: byte code is kept, whatever the caller's environment says.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: venv report test test-all docs audit pins clean

report: $(READY)
	$(RUN)/rattle validate --out reports/dat21 --overwrite

# The environment alone: after a file has been added or removed.
venv: $(READY)

# What finds a defect in minutes.
test: $(READY)
	rm -f .coverage
	$(RUN)/rattle warm-up & compiling=$$!; \
		$(RUN)/ruff check . && $(RUN)/ruff format --check . && $(RUN)/mypy && wait $$compiling
	$(TEST) $(ALL) -m "not slow" $(SLOW:%=--ignore=%) $(if $(filter test-all,$(MAKECMDGOALS)),$(COUNT))

# Both tiers, and how much of each package the first one and the interpreter reach.
test-all: test
	sh setup-browser.sh
	$(TEST) -m slow --ignore=tests/interpreted tests
	NUMBA_DISABLE_JIT=1 $(TEST) $(INTERPRETED) $(COUNT)
	for package in scene closure montecarlo compare; do \
		$(RUN)/coverage report --include="$$package/*" --skip-covered --fail-under=95 || exit 1; \
	done

# The documentation site, every example and gallery script run anew, warnings as errors; no network is used.
docs: $(READY)
	$(RUN)/sphinx-build -W --keep-going --quiet -b html docs docs/_build/html
	@echo "Site: docs/_build/html/index.html"

# Needs the network: the pinned versions against what is known of their vulnerabilities; fails if one cannot be looked up.
audit: $(READY)
	$(PYTHON) -m venv $(VENV)/audit
	$(VENV)/audit/bin/pip install --quiet --disable-pip-version-check pip-audit==2.10.1
	$(VENV)/audit/bin/pip-audit --requirement requirements.txt --no-deps --disable-pip --strict

# Needs the network: the hashes of the versions in requirements.txt, after a version has been changed there by hand.
pins:
	$(PYTHON) -m venv $(VENV)/pins
	$(VENV)/pins/bin/python .ci/hash_pins.py

$(READY): requirements.txt pyproject.toml setup-venv.sh
	PYTHON=$(PYTHON) sh setup-venv.sh $(VENV)
	rm -f $(VENV)/ready-*
	touch $@

clean:
	rm -rf $(VENV)
