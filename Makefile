# The commands of the README.  Each sets up .venv when it is missing or out of date, and never again.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/ready

# Without coverage, which slows the interpreter; the tests after them count the lines of compare.
FIRST := tests/scene tests/closure tests/montecarlo rattle/scene rattle/closure rattle/montecarlo
# With the compiler off, for the lines of what it compiles; the other tests would take hours so.
INTERPRETED := tests/interpreted tests/scene

# Three files at a time on two cores, for many tests wait for processes that they have started; in their order, so that
# the many small files of the doctests come last and fill up.
WORKERS := --numprocesses=3 --dist=loadfile --no-loadscope-reorder

# Hundreds of processes import the same modules: byte code is kept, whatever the caller's environment says.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: report test docs audit pins clean

report: $(READY)
	$(RUN)/rattle validate --out reports/dat21 --overwrite

test: $(READY)
	sh setup-browser.sh
	$(RUN)/rattle warm-up & compiling=$$!; \
		$(RUN)/ruff check . && $(RUN)/ruff format --check . && $(RUN)/mypy && wait $$compiling
	$(RUN)/pytest $(WORKERS) $(FIRST)
	$(RUN)/pytest $(WORKERS) --cov --cov-report= $(FIRST:%=--ignore=%) --ignore=tests/interpreted tests rattle
	NUMBA_DISABLE_JIT=1 $(RUN)/pytest $(WORKERS) --cov --cov-append --cov-report= $(INTERPRETED)
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
	touch $@

clean:
	rm -rf $(VENV)
