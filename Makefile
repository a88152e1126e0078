# The two commands a newcomer needs: `make demo` and `make test`. Both need only Python 3.11 or newer and make.
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
# One thread per process: the services run side by side, and small matrices gain nothing from more.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# How many processes share the tests. A file's tests stay in one of them, with the fixtures that they share; the folders
# with the longest files come first, so that no process ends long before the others. Contract tests mostly wait, so one
# more process runs them beside the others. End-to-end tests follow, because an installation is seven processes; those
# that hold safety deadlines are the last, one after the other.
WORKERS ?= 2
# A quarter of the time of unit tests is waiting: one process more than processors fills it.
UNIT_WORKERS ?= 3
PYTEST := $(BIN)/python -m pytest -q
PARALLEL := -n $(WORKERS) --dist loadfile --no-loadscope-reorder
T ?= tests/unit
# Sources of kernels: workers must find them compiled, or each would compile all of them.
KERNELS := $(shell grep -rlE --include='*.py' 'njit|compiled' services shared simulation)
COMPILED := .venv/.compiled
# Bytecode of what is run in place, as pip makes it of what it installs: also where Python must not write it later.
PACKAGES := distalock services shared simulation baselines benchmarks tools
CONSOLE := .venv/.console

.PHONY: help setup demo test check lint console tests contract-tests e2e-tests long-tests search quick-tests unit attacks fuzz examples model-check mutation faults bench lock version release containers screenshots \
	generated wheel-check clean

help:
	@echo "make demo    the whole procedure in the virtual operating room"
	@echo "make test    all tests but the long ones; CI runs those and more"
	@echo "make long-tests  those; pieces of benchmarks, and more seeds, parameters and processes"
	@echo "make search  new examples for what is to hold for all inputs"
	@echo "make check   lint, types, import contracts, unit tests"
	@echo "make unit    unit tests; of one file or folder with T=tests/unit/..."
	@echo "make attacks  tries to get past the controls of a running system, and rewrites docs/attacks.md"
	@echo "make fuzz     generated requests as each role against a running system, and rewrites docs/benchmarks/rest-fuzz.md"
	@echo "make examples  records new and changed examples of openapi.json from a simulation (all: ARGS=--all)"
	@echo "make model-check  every order of events between robot service and gateway, and what each seeded mutation breaks"
	@echo "make mutation  which changes of the safety modules the unit tests notice; one module with M=guard"
	@echo "make faults  every fault at every step of the procedure; a tenth of them with ARGS=\"--tenth --seed 1\""
	@echo "make bench   the full statistics; results go to docs/"
	@echo "make screenshots  pictures and a film of the console for the README, and what its tests compare with"
	@echo "make containers  builds all images, starts them with the virtual room and drills, the robot's container killed once"
	@echo "make generated  rewrites message schemas, openapi.json and printed pages"
	@echo "make wheel-check  builds the wheel and runs its commands in an empty environment"
	@echo "make version  the next version of what is committed: changelog, number, commit and tag, VERSION=0.2.0; docs/releases.md"
	@echo "make release  a signed release in OUT=FOLDER with the key KEY=FILE; docs/releases.md"
	@echo "make setup   only the environment in .venv, with the command at .venv/bin/distalock"

setup: $(COMPILED) $(CONSOLE)

$(INSTALLED): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "distalock needs Python 3.11 or newer; $(PYTHON) is " + sys.version.split()[0] + ". Call: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

$(COMPILED): $(INSTALLED) $(KERNELS)
	$(BIN)/python -m distalock.prepare
	$(BIN)/python -m compileall -q -j $(WORKERS) $(PACKAGES)
	@touch $@

# Whether it is up to date, the command itself finds out, by the content of the files.
$(CONSOLE): $(INSTALLED) FORCE
	@$(BIN)/python -m tools.console build
	@touch $@

FORCE:

demo: $(COMPILED) $(CONSOLE)
	$(BIN)/distalock demo $(ARGS)

# Each part prints little unless it fails, so that they can run at the same time. How the tests of requirements ended is
# kept for the last step: every control of the risk file needs tests that ran and passed.
test: export REQUIREMENTS_RESULTS := $(CURDIR)/.test-results
test: setup
	@rm -rf $(REQUIREMENTS_RESULTS)
	@$(MAKE) --no-print-directory --jobs=3 lint console contract-tests tests
	@$(MAKE) --no-print-directory e2e-tests
	@$(BIN)/distalock risk check

check: setup
	@$(MAKE) --no-print-directory --jobs=3 lint console contract-tests quick-tests

lint: setup
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check .
	@contracts=$$($(BIN)/lint-imports --no-logo 2>&1) || { echo "$$contracts"; exit 1; }
	@$(BIN)/python -m tools.generate --check
	@$(BIN)/mypy

# Types, lint and tests of the console.
console: setup
	@$(BIN)/python -m tools.console check

tests: $(COMPILED)
	$(PYTEST) $(PARALLEL) -n $(UNIT_WORKERS) -m "not long" tests/accuracy tests/model tests/property tests/unit

contract-tests: $(COMPILED)
	$(PYTEST) tests/contract

e2e-tests: $(COMPILED)
	$(PYTEST) $(PARALLEL) -m "not alone and not long" tests/e2e
	$(PYTEST) -m "alone and not long" tests/e2e

# What `make test` leaves out: pieces of benchmarks, and more seeds, parameters or processes of what a test beside shows.
# After it on the same sources, `distalock risk check --with-long-tests` judges the results of both.
long-tests: export REQUIREMENTS_RESULTS := $(CURDIR)/.test-results
long-tests: $(COMPILED)
	$(PYTEST) $(PARALLEL) -m "long and not alone" tests/accuracy tests/e2e tests/unit
	$(PYTEST) -m "long and alone" tests/e2e

# New examples for what is to hold for all inputs; `make test` takes the same ones each time.
search: $(COMPILED)
	$(PYTEST) $(PARALLEL) --hypothesis-profile search $$(grep -rl "from hypothesis import" --include="test_*.py" tests)

quick-tests: $(COMPILED)
	$(PYTEST) $(PARALLEL) -n $(UNIT_WORKERS) -m "not long" tests/property tests/unit

unit: $(COMPILED)
	$(PYTEST) $(T)

attacks: $(COMPILED)
	$(BIN)/python -m tests.attacks $(ATTACK)

# Schemathesis is installed for this purpose only.
fuzz: $(COMPILED)
	$(BIN)/python -m pip install --quiet "schemathesis>=4,<5"
	nice -n 10 $(BIN)/python -m tests.fuzz $(ARGS)

# The client that plays the procedure is generated, too.
examples: $(COMPILED)
	$(BIN)/python -m tools.generate
	$(BIN)/python -m tools.examples $(ARGS)
	$(BIN)/python -m tools.generate

model-check: $(COMPILED)
	$(BIN)/python -m tests.model $(ARGS)

# mutmut is installed for this purpose only.
mutation: $(COMPILED)
	$(BIN)/python -m pip install --quiet "mutmut>=3.8,<4"
	nice -n 10 $(BIN)/python -m tools.mutation $(M)

faults: $(COMPILED)
	$(BIN)/distalock bench faults $(ARGS)

# Needs a Chromium: Debian's package, or its file in CHROMIUM.
screenshots: $(COMPILED) $(CONSOLE)
	$(BIN)/python -m benchmarks.console.screenshots $(ARGS)

# Needs docker and root or its group; where no registry can be reached, debootstrap for the base image.
containers: $(COMPILED)
	$(BIN)/python -m tools.containers $(ARGS)

bench: setup
	$(BIN)/distalock bench all

# Needs uv (installed into .venv for this purpose only); the lock carries hashes and no server addresses.
lock: setup
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes \
		--no-emit-index-url --no-emit-find-links --no-header --upgrade --output-file requirements.lock --quiet

wheel-check: setup
	$(BIN)/python -m tests.packaging.wheel_check

version: setup
	$(BIN)/python -m tools.version $(VERSION)

release: setup
	$(BIN)/python -m tools.release --key $(KEY) --out $(OUT)

generated: setup
	$(BIN)/python -m tools.generate

clean:
	rm -rf services/ui_api/console/node_modules services/ui_api/console/dist .venv .test-results .mypy_cache .ruff_cache .pytest_cache \
		.hypothesis .import_linter_cache build *.egg-info
