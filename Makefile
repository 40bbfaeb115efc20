# Everything runs in .venv, which `make setup` makes from requirements.lock. `make` lists the targets.
# PYTHON=... chooses the Python, VIEW=1 opens the live viewer, PAGE=1 the operator page, ARGS=... is handed to pytest or to the faults, UPGRADE=1 renews the lock.

BIN := .venv/bin
PYTHON ?=
VIEW ?=
PAGE ?=
ARGS ?=
UPGRADE ?=
PREFIX ?= $(CURDIR)/.lab
FUZZ ?= 3000
SEED ?= 1000
export PYTHON

STUDIES := excitation_against_time figure_3 figure_4 figure_5 'figure_7 figure_8 figure_9' \
	algorithms_on_random_plants reachable_floor \
	sensitivity braking_and_non_square input_side_errors stiff_rig detection_of_wear iterating_again rig_data_sheet rig_drawing rig_wear actuator_tuning aerospace_and_full_vehicle
# Every dependency at work: files, settings, the bus, each service's core, and campaigns from file to report.
LOWEST := libs/settings libs/bus/tests libs/loads services/operator_page/tests/test_accounts.py \
	$(addprefix duralab/tests/test_,formats.py foreign_files.py report.py command_line.py certificates.py) tests/test_whole_campaign.py
CHECKS := format lint language types imports generated contract changelog docs determinism

.DEFAULT_GOAL := help
.PHONY: help setup install demo demo-real bench faults endurance multihost security-table audit sbom dist lowest studies docs test test-all examples-rust fuzz coverage mutation check $(CHECKS:%=check-%) proto lock format clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-18s %s\n", $$1, $$2 }' Makefile

setup: ## make .venv, again only when the lock or a pyproject.toml changed
	@scripts/setup.sh

install: ## put the lab alone, without the tools of tests and docs, into PREFIX (.lab): 1.7 GB, `.lab/bin/duralab`
	@TOOLS=$(CURDIR)/.tools/install deploy/images/install.sh --tools
	@TOOLS=$(CURDIR)/.tools/install PREFIX=$(PREFIX) deploy/images/install.sh services/rig_sim services/file_rig services/identifier services/iterator services/sequencer services/recorder services/operator_page duralab

demo: setup ## run the shipped campaign into out/demo (VIEW=1, PAGE=1: watch it live)
	@$(BIN)/duralab run front_axle_demo --out out/demo --replace $(if $(VIEW),--view) $(if $(PAGE),--page)

demo-real: setup ## run a campaign through drive and response files, with a controller that plays them on a simulated rig
	@$(BIN)/python examples/file_exchange/rehearse.py out/demo_real

bench: setup ## measure everything beside peers into out/bench.json and docs/benchmarks.md (half an hour on two cores)
	@$(BIN)/python benchmarks/bench.py --out out/bench.json --page docs/benchmarks.md $(ARGS)

faults: setup ## kill, freeze, cut, fill, fuzz: 20 rounds of each and a soak of 30 min (ARGS="--fault 'kill rig_sim' --rounds 3")
	@$(BIN)/python -m tests.faults $(ARGS)
	@DURALAB_LONG_TESTS=1 $(BIN)/python -m pytest -q tests/security libs/bus/tests/long/test_rejoining.py

endurance: setup ## 20,000 repeats of an endurance test, a service killed every 500 (ARGS="--repeats 2000 --kill-every 100")
	@$(BIN)/python -m tests.endurance $(ARGS)

security-table: setup ## try every role on every key with every operation over a secured router, and print what came through
	@$(BIN)/python -m tests.security

audit: setup ## look the dependencies up in a database of vulnerabilities, where one is reached; check that the lock is whole
	@$(BIN)/python scripts/audit.py

sbom: setup ## write the bill of materials of what is installed, CycloneDX with licences, into out/sbom.cdx.json
	@mkdir -p out
	@$(BIN)/cyclonedx-py environment --output-reproducible --of JSON --output-file out/sbom.cdx.json $(BIN)/python

dist: setup ## build wheels and sdists of all distributions into dist/, try them in empty environments on each Python here (ARGS=--build-only)
	@$(BIN)/python scripts/dist.py $(ARGS)

lowest: setup ## install the lowest version of each dependency that is allowed, and run the tests that use them all
	@scripts/lowest.sh $(LOWEST)

multihost: setup ## the secured lab on four hosts (network namespaces): cables cut, slowed, the router killed; needs root
	@OMP_NUM_THREADS=1 $(BIN)/python -m tests.multihost $(ARGS)

# One thread each: sums in one order, so the same bytes, and two studies at a time; those in quotes share their campaigns.
studies: setup ## write the pictures and tables of docs/rigs and docs/studies again (a quarter of an hour on two cores)
	@printf '%s\n' $(STUDIES) | OMP_NUM_THREADS=1 xargs -P 2 -L 1 $(BIN)/python studies/several.py

docs: setup ## build the documentation's site into out/site; a warning is an error
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# One thread each, as a lab's services have it: threads of BLAS in several workers wait for one another most of the time.
# Four on two cores: half of its time a test waits, for a fault to be noticed or a lab to stand.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q --numprocesses=4 --dist=loadfile --no-loadscope-reorder

test: setup ## run the quick tests: units, the bus, a whole campaign, a resumed one, the READMEs (ARGS="-k name" for some)
	@$(PYTEST) -m "not long" $(ARGS)

test-all: setup ## run all tests, also those in folders of long ones (ARGS="-m long": only these)
	@$(PYTEST) $(ARGS)

examples-rust: setup ## build the Rust client of examples/bare_zenoh and run it against a lab (minutes, the first time)
	@cargo build --quiet --manifest-path examples/bare_zenoh/rust/Cargo.toml
	@$(BIN)/python -m pytest -q tests/long/test_examples.py -k rust

fuzz: setup ## damage files of every format and read them, long (FUZZ=20000 of each, SEED=1000: other ones)
	@DURALAB_FUZZ_EXAMPLES=$(FUZZ) DURALAB_FUZZ_SEED=$(SEED) $(BIN)/python -m pytest -q --numprocesses=2 duralab/tests/long/test_formats_fuzz.py

coverage: setup ## measure which lines of the pure cores unit tests run; less than 90 % of one is an error (ARGS="spectra --lines")
	@OMP_NUM_THREADS=1 $(BIN)/python scripts/quality/core_coverage.py $(ARGS)

mutation: setup ## change one thing at a time in estimators, updates and the RPC III codec, and name what no test notices
	@OMP_NUM_THREADS=1 $(BIN)/python scripts/quality/mutation.py $(ARGS)

check: $(CHECKS:%=check-%) ## format, lint, plain English, types, import contracts, generated code, contract, changelog, docs, determinism

check-format: setup
	@$(BIN)/ruff format --quiet --check . || { echo "Run: make format" >&2; exit 1; }

check-lint: setup
	@$(BIN)/ruff check --quiet .

check-language: setup ## pages, help, settings, error sentences and docstrings of faces against scripts/plain_english.yaml
	@$(BIN)/python scripts/plain_english.py

check-types: setup ## the second time for what also runs on Windows
	@$(BIN)/basedpyright
	@$(BIN)/basedpyright --pythonplatform Windows proto libs duralab services/file_rig

check-imports: setup
	@$(BIN)/lint-imports

check-generated: setup
	@$(BIN)/python proto/generate.py --check
	@$(BIN)/python deploy/router/generate.py --check

check-contract: setup
	@$(BIN)/python proto/check_breaking.py

check-changelog: setup ## BASE=main: the branch that the changes go into
	@$(BIN)/python scripts/changelog.py

check-docs: docs

check-determinism: setup ## two campaigns with one seed give the same bytes of drive and response
	@$(BIN)/python scripts/check_determinism.py

proto: setup ## generate duralab_proto.v1 from the contract, and the router's configuration from the access table
	@$(BIN)/python proto/generate.py
	@$(BIN)/python deploy/router/generate.py

lock: ## renew requirements.lock from requirements.in (UPGRADE=1: newest versions)
	@scripts/uv.sh pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
		--no-annotate --no-header $(if $(UPGRADE),--upgrade) --output-file requirements.lock requirements.in

format: setup ## format and mend what ruff can
	@$(BIN)/ruff check --quiet --fix-only .
	@$(BIN)/ruff format --quiet .

clean: ## remove .venv, tools, results and caches
	@rm -rf .venv .lab .tools out dist examples/bare_zenoh/rust/target .pytest_cache .ruff_cache .import_linter_cache .hypothesis .numba_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
