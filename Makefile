# make run    start the haptic master (ARGS='--ros-args ...' goes to it)
# make test   run the tests
# make paper  draw every figure of the paper again, into docs/paper
# make docs   generate what README and docs quote of the code, and draw docs/figures
# All create .venv, with the ROS 2 client library from PyPI, where it is not there.

PYTHON ?= python3
PIP = .venv/bin/python -m pip --disable-pip-version-check -qq
ARGS ?=
TESTS ?= test

.PHONY: run test paper docs bench bench-pipeline faults clean

run: .venv/run.stamp
	@exec .venv/bin/python -m spm_haptic_master master $(ARGS)

test: .venv/test.stamp
	.venv/bin/python -m pytest $(TESTS)

paper: .venv/paper.stamp
	@.venv/bin/python -m paper

docs: .venv/paper.stamp
	@.venv/bin/python -m docs.generate_parameters
	@.venv/bin/python -m docs.generate_executables
	@.venv/bin/python -m docs.figures.mechanism

bench: .venv/test.stamp
	.venv/bin/python benchmarks/kinematics.py

bench-pipeline: .venv/bench.stamp
	.venv/bin/python -m spm_haptic_master benchmark --output build/bench-pipeline $(ARGS)

clean:
	rm -rf .venv build install log

.venv/bin/python:
	@$(PYTHON) -m venv .venv

.venv/run.stamp: setup.py | .venv/bin/python
	@echo 'Installing the package and the ROS 2 client library into .venv (about a minute) ...'
	@$(PIP) install --editable '.[ros]'
	@touch $@

.venv/paper.stamp: .venv/run.stamp
	@echo 'Installing what the figures need into .venv ...'
	@$(PIP) install --editable '.[ros,paper]'
	@touch $@

.venv/bench.stamp: .venv/run.stamp
	@echo 'Installing what the picture needs into .venv ...'
	@$(PIP) install --editable '.[ros,bench]'
	@touch $@

.venv/test.stamp: .venv/run.stamp
	@echo 'Installing what the tests need into .venv ...'
	@$(PIP) install --editable '.[ros,test]'
	@touch $@

faults: .venv/test.stamp
	.venv/bin/python benchmarks/fault_matrix.py
