# make train   set up .venv and run the training script
# make install set up .venv with the tools for tests and lint
# make test    the same, and run the tests          (make test ARGS='-m slow' for the long ones)
# make docs    the same, and build the documentation's site in docs/_build
# make web     the same, and write the JavaScript package into dist/passive-walker, ready for npm
# make test-matrix  the fast tests on each Python, with the oldest libraries allowed and the newest
# make lint    style, import rules, words of the prose, types
# make clean   remove .venv and every cache; what training wrote under runs/ stays

PYTHON ?= python3
VENV := .venv
ARGS :=
BIN := $(VENV)/bin
EXTRAS = train,render,figures
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e ".[$(EXTRAS)]"
# pip compiles on one core. Some files of libraries are no Python 3, and are left.
COMPILE = $(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true

.PHONY: train install test test-matrix docs web lint clean

train: $(VENV)/.installed-train
	$(BIN)/python train.py $(ARGS)

install: $(VENV)/.installed-dev

test: export SDL_VIDEODRIVER = dummy
test: export MPLBACKEND = Agg
# Tests run in a process for each core: threads of BLAS in each would wait for each other, and take twice the time.
test: export OMP_NUM_THREADS = 1
test: $(VENV)/.installed-dev
	$(BIN)/python -m tests.ahead
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist worksteal $(ARGS)

# A warning is an error.
docs: export SDL_VIDEODRIVER = dummy
docs: $(VENV)/.installed-dev
	$(BIN)/python docs/render.py
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build

web: $(VENV)/.installed-dev
	$(BIN)/python -c 'from gym_passive_walker.devices import web; web.build("dist/passive-walker")'

test-matrix: $(VENV)/.installed-dev
	$(BIN)/nox $(ARGS)

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff check --extend-select D103 gym_passive_walker agents examples validation
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/python -m tests.words
	$(BIN)/pyright --pythonpath $(BIN)/python

$(VENV)/.created:
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.installed-train: pyproject.toml constraints.txt | $(VENV)/.created
	$(INSTALL)
	$(COMPILE)
	touch $@

$(VENV)/.installed-dev: EXTRAS = train,render,figures,dev
$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/.created
	$(INSTALL)
	$(COMPILE)
	touch $(VENV)/.installed-train $@

clean:
	rm -rf $(VENV) build dist docs/_build docs/_generated *.egg-info
	rm -f docs/reference.md docs/notebooks/*.ipynb
	rm -rf .pytest_cache .ruff_cache .hypothesis .import_linter_cache .nox
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
