# Terrapin's front door. The work is done by the scripts that each target names.
.DEFAULT_GOAL := help
export PATH := $(CURDIR)/.venv/bin:$(PATH)
.PHONY: help setup demo test test-all sandbox check bench campaigns claims sensitivity mutants fuzz attack proof firmware release docs wheel lock clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/make \1\t\2/p' Makefile | expand -t 16

setup: ## make .venv and build firmware and simulator for this machine
	@tests/setup/setup.sh runtime && tests/tools/build.sh host

demo: setup ## run the whole circle once: firmware, simulated robot, link, log, comparison; results under out/
	@.venv/bin/terrapin demo

test: ## set up what tests need, run those that a change needs (CHANGED=1: those that your last commit and your tree reach)
	@tests/setup/setup.sh test && .venv/bin/python tests/tools/suite.py $(if $(CHANGED),--changed,--tier test)

test-all: ## the tests that `make test` leaves out: every other build, the pages' blocks, the wheel, short campaigns
	@tests/setup/setup.sh test && UNITY_ROOT=$$(tests/setup/unity.sh) tests/tools/build.sh host \
		&& .venv/bin/python tests/tools/suite.py --tier rest

sandbox: ## build the kernel that the tests of real CAN and GPIO run in, once (some minutes); `make test-all` then runs them
	@tests/setup/setup.sh sandbox && tests/sandbox/kernel.sh build

check: ## formatting, types, static analysis, MISRA, hygiene; would tests see a slip in the C functions last changed?
	@tests/setup/setup.sh test && UNITY_ROOT=$$(tests/setup/unity.sh) tests/tools/build.sh host \
		&& .venv/bin/python tests/tools/gate.py \
		&& .venv/bin/python -m tests.mutation --changed

bench: ## speed of simulator and link, instructions of one step
	@tests/setup/setup.sh bench && tests/tools/build.sh host && .venv/bin/python tests/tools/bench.py

campaigns: ## how often discovery is right, and whether tests see slips: every bound, on known answers (hours, the mutants a day; ARGS="--cases 100")
	@tests/setup/setup.sh test && UNITY_ROOT=$$(tests/setup/unity.sh) tests/tools/build.sh host \
		&& .venv/bin/python -m tests.campaigns $(ARGS)

claims: ## which counts of docs/rates.md are of the program as it stands; writes its first table
	@tests/setup/setup.sh runtime && .venv/bin/python tests/tools/claims.py --write

sensitivity: ## what halving and doubling each number of discovery's decision does (an hour; docs/thresholds.md)
	@tests/setup/setup.sh test && UNITY_ROOT=$$(tests/setup/unity.sh) tests/tools/build.sh host \
		&& .venv/bin/python -m tests.campaigns.sensitivity --campaigns outside,pools $(ARGS) \
		&& .venv/bin/python -m tests.campaigns.sensitivity --write

mutants: ## would a slip be seen? in the firmware's C (1,000 of them; ARGS=--whole), Python, controller.toml, its generator (3 h)
	@tests/setup/setup.sh test && UNITY_ROOT=$$(tests/setup/unity.sh) tests/tools/build.sh host \
		&& .venv/bin/python -m tests.mutation $(ARGS) \
		&& .venv/bin/python -m tests.mutation.python --count 100 \
		&& .venv/bin/python -m tests.interface_mutations

fuzz: ## search every parser and the step for inputs that break them, MINUTES (10) each; goes on where it was stopped
	@tests/setup/setup.sh test && .venv/bin/python tests/tools/fuzz.py --minutes $(or $(MINUTES),10) $(ARGS)

attack: ## try what somebody hostile would: forged and old frames, requests, files; counts (ARGS="--short"; docs/safety.md has the last ones)
	@tests/setup/setup.sh test && UNITY_ROOT=$$(tests/setup/unity.sh) tests/tools/build.sh host \
		&& .venv/bin/python -m tests.attack $(ARGS)

proof: ## show what tests cannot: no overflow, nothing read or written outside, off when it must be (docs/proof.md)
	@tests/setup/setup.sh test && tests/tools/build.sh host \
		&& { .venv/bin/pip install -q --require-hashes -r tests/proof/requirements.txt \
		|| echo "make proof: z3 cannot be had here; what needs it is named as not run" >&2; } \
		&& .venv/bin/python -m tests.proof $(ARGS)

firmware: ## build the firmware for this machine and every image for the chip, with their sizes (ROBOT=NAME|FILE)
	@tests/setup/setup.sh firmware && tests/tools/build.sh $(if $(ROBOT),"robot=$(ROBOT)") host cortex-m4 && tests/tools/build.sh $(if $(ROBOT),"robot=$(ROBOT)") size

release: ## the core for somebody else's firmware, as an archive that needs no Python (ROBOT=NAME|FILE; docs/embedding.md)
	@tests/setup/setup.sh runtime && tests/tools/release.sh build/release $(if $(ROBOT),"$(ROBOT)")

docs: ## the pages of docs/ as a site: build/docs/index.html
	@tests/setup/setup.sh test && tests/tools/build.sh host && tests/tools/docs.sh

wheel: ## what others install with pip: dist/terrapin_robot-*.whl, with everything compiled (docs/install.md)
	@tests/setup/setup.sh test && tests/tools/wheel.sh dist

lock: ## renew the lock files from pyproject.toml
	@tests/setup/setup.sh test && tests/tools/lock.sh

clean: ## remove what was built; .venv and out/ stay
	rm -rf build
