# The two commands of the README.  Each sets up .venv when it is missing or out of date, and never again.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/ready

.PHONY: report test clean

report: $(READY)
	$(RUN)/rattle validate --out reports/dat21 --overwrite

test: $(READY)
	sh setup-browser.sh
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy
	$(RUN)/pytest

$(READY): requirements.txt pyproject.toml setup-venv.sh
	PYTHON=$(PYTHON) sh setup-venv.sh $(VENV)
	touch $@

clean:
	rm -rf $(VENV)
