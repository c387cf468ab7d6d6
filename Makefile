# make run             start the haptic master, source sim (ARGS='-p source:=can ...' goes to it),
#                      and beside it the device in a browser (VIEW=0: not)
# make teleop          have a simulated surgeon lead a simulated slave, and print a summary
# make style           run ruff and mypy
# make lint            run ruff, mypy, ament_flake8 and ament_pep257
# make quick           run the tests without processes, builds and long computations
# make noble           run them with the library versions of Ubuntu 24.04
# make test            run the tests of what users rely on (TESTS=test/encoders: of one folder)
# make evidence        run the long tests and print their results (ARGS=--write: measure everything
#                      that docs/evidence.md states and write the page; with --resume,
#                      go on where that was interrupted)
# make mutants         change the code at random, count what quick tests detect (ARGS='ROOM ...')
# make bench           measure each function of the kinematics, a supervised sample and one of force
# make bench-pipeline  measure latency, CPU and loss of the nodes, into build/bench-pipeline
# make soak            run the nodes for minutes on a bus that fails (ARGS='--minutes 120')
# make faults          play healthy and faulty sensors, inject faults into the real chain, print both
# make paper           draw every figure of the paper again, into docs/paper
# make study           compute and draw what a fifth and a sixth sensor are worth, into docs/sensors
#                      (faults, paper and study fail where a verdict is not the committed one;
#                      ARGS=--accept writes the page with the new verdicts)
# make force           compute and draw force feedback in simulated time, into docs/force
# make feel            play a session with force feedback in simulated time, print and draw it
# make docs            generate what in docs, README and CONTRIBUTING.md follows from the code, and
#                      print which files changed
# make reference       render the reference of the public Python, into build/reference
# make release         check a checkout before it is tagged; ARGS=1.0.0 writes that version first
# make clean           remove .venv, caches and everything built
# Each target installs what it needs, with the ROS 2 client library, from PyPI into .venv.

PYTHON ?= python3
PIP = .venv/bin/python -m pip --disable-pip-version-check -qq
ARGS ?=
VIEW ?= 1
QUICK = not process and not packaging and not slow and not linter and not evidence
# What `make lint` and `make evidence` run.
LATER = not linter and not evidence
# Versions of Ubuntu 24.04 (noble), of what the installed package imports.
NOBLE = numpy==1.26.4 python-can==4.3.1 PyYAML==6.0.1
TESTS ?= test
# What other programs may import: rooms with an `__all__`, and the errors; not their submodules.
PUBLIC = $(addprefix spm_haptic_master.,kinematics supervision force exceptions) \
	'!spm_haptic_master\.\w+\.'

# Each module is compiled once, when it is used first: where the environment forbids to keep that,
# each of some hundred processes of the tests would compile all of them.
export PYTHONDONTWRITEBYTECODE =

# What is started here stays on this host, unless the user chooses otherwise: a simulation on a
# laptop is not to silence a rig.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: run teleop style lint quick noble test evidence mutants bench bench-pipeline soak faults paper study force feel docs reference release clean

# Beside a browser that takes all cores, the latency is kept by a real-time priority: where this
# user may have one.
PRIORITY = $$(chrt --fifo 10 true 2>/dev/null && echo -p realtime.priority:=10)

# The picture is a process of its own that comes after the device and ends with it: $$$$ is the
# number of the shell, which becomes master.
run: .venv/run.stamp
	@[ '$(VIEW)' = 0 ] || .venv/bin/python -m spm_haptic_master view -p view.process:=$$$$ & \
	exec .venv/bin/python -m spm_haptic_master master --params-file config/sim.yaml --params-file config/tour.yaml $(PRIORITY) $(ARGS)

teleop: .venv/run.stamp
	@exec .venv/bin/python -m benchmarks.teleop_demo $(ARGS)

# A worker for each core: one thread of the linear algebra in each.
ONE_THREAD = OPENBLAS_NUM_THREADS=1

# One more than there are cores: some tests wait for programs that they have started.
WORKERS := $(shell expr $$(nproc) + 1)

# A file runs in one worker, which computes once what its tests share; files in their order, so that
# none that is long comes last.
BY_FILE = --dist loadfile --no-loadscope-reorder

# Tests that start processes run three at a time, each run in a DDS domain and on a bus of its own:
# they wait more than they compute. Those that measure time have the machine to themselves.
test: .venv/test.stamp
	$(ONE_THREAD) .venv/bin/python -m pytest -q -n $(WORKERS) $(BY_FILE) -m 'not process and $(LATER)' $(TESTS) || [ $$? -eq 5 ]
	.venv/bin/python -m pytest -q -n 3 $(BY_FILE) -m 'process and not alone and $(LATER)' $(TESTS) || [ $$? -eq 5 ]
	.venv/bin/python -m pytest -m 'process and alone and $(LATER)' $(TESTS) || [ $$? -eq 5 ]

# One after the other: they measure.
evidence: .venv/test.stamp
	@.venv/bin/python -m benchmarks.evidence $(ARGS)

quick: .venv/test.stamp
	$(ONE_THREAD) .venv/bin/python -m pytest -q -n $(WORKERS) $(BY_FILE) -m '$(QUICK)' $(TESTS)

noble: .venv/noble.stamp
	PYTHONPATH=.venv/noble .venv/bin/python -m pytest -q -n $(WORKERS) -m '$(QUICK)' $(TESTS)

style: .venv/lint.stamp
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/mypy

# The ament linters beside ruff and mypy, which need one core each; all of them end.
lint: .venv/lint.stamp
	@.venv/bin/python -m pytest -q -n 2 --tb=short --show-capture=no -m linter test/test_linters.py & \
	$(MAKE) --no-print-directory style; style=$$?; wait $$! && exit $$style

mutants: .venv/test.stamp
	.venv/bin/python -m benchmarks.mutants $(ARGS)

bench: .venv/test.stamp
	.venv/bin/python -m benchmarks.kinematics

soak: .venv/run.stamp
	.venv/bin/python -m benchmarks.soak $(ARGS)

bench-pipeline: .venv/run.stamp
	.venv/bin/python -m benchmarks.pipeline $(ARGS)

faults: .venv/test.stamp
	.venv/bin/python -m benchmarks.integrity $(ARGS); first=$$?; \
	.venv/bin/python -m benchmarks.fault_matrix $(filter --accept,$(ARGS)) && exit $$first

paper: .venv/paper.stamp
	@.venv/bin/python -m paper $(ARGS)

study: .venv/paper.stamp
	@.venv/bin/python -m study $(ARGS)

force: .venv/paper.stamp
	@.venv/bin/python -m study.force $(ARGS)

feel: .venv/paper.stamp
	@.venv/bin/python -m study.force.feel $(ARGS)

docs: .venv/paper.stamp
	@.venv/bin/python -m docs

reference: .venv/reference.stamp
	.venv/bin/python -m pdoc --docformat numpy --math --output-directory build/reference $(PUBLIC)

release: .venv/test.stamp
	@.venv/bin/python -m release $(ARGS)

clean:
	rm -rf .venv build dist install log *.egg-info .*_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +

# A new pip installs all of it in half of the time that the one of Python 3.11 takes.
.venv/bin/python:
	@$(PYTHON) -m venv .venv
	@$(PIP) install --no-compile --upgrade pip || echo 'pip stays as it is'

.venv/run.stamp: setup.py package.xml | .venv/bin/python
	@echo 'Installing the package and the ROS 2 client library into .venv (about a minute) ...'
	@$(PIP) install --editable '.[ros,multicast]'
	@$(PIP) install --editable '.[ros,multicast,view]' 2> /dev/null \
	|| echo 'viser could not be installed: make run goes on without a picture in the browser'
	@touch $@

.venv/paper.stamp: .venv/run.stamp
	@echo 'Installing what the figures need into .venv ...'
	@$(PIP) install --editable '.[ros,paper]'
	@touch $@

.venv/reference.stamp: .venv/run.stamp
	@echo 'Installing what renders the reference into .venv ...'
	@$(PIP) install --editable '.[ros,reference]'
	@touch $@

.venv/lint.stamp: .venv/run.stamp
	@echo 'Installing the linters into .venv ...'
	@$(PIP) install --editable '.[ros,lint]'
	@touch $@

# All at once, the linters as well, and compiled when they are used: each saves half a minute.
.venv/test.stamp: setup.py package.xml | .venv/bin/python
	@echo 'Installing the package and what its tests need into .venv (about two minutes) ...'
	@$(PIP) install --no-compile --editable '.[ros,test,lint]'
	@touch .venv/run.stamp .venv/lint.stamp $@

.venv/noble.stamp: .venv/test.stamp
	@echo 'Installing the versions of Ubuntu 24.04 beside those of .venv ...'
	@$(PIP) install --target .venv/noble --upgrade --no-deps --only-binary :all: $(NOBLE)
	@touch $@
