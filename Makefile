# Every target sets up the virtual environment first, when it is missing or older than what it is made from: what users need, and
# for `test`, `lint` and the like what developers need beside it.
PYTHON ?= python3
VENV   := .venv
PY     := $(VENV)/bin/python
READY  := $(VENV)/.ready
DEV    := $(VENV)/.ready-dev
PIP    := $(PY) -m pip install --quiet --disable-pip-version-check
PINNED := $(PIP) --no-deps --require-hashes --requirement
RUN    := $(PY) pipeline.py
ARGS   ?=

# make dataset SOURCE=DIR, make stage STAGE=mask_densify, make inspect RECORDING=DIR
SOURCE    ?=
STAGE     ?=
RECORDING ?= artifacts/recordings
STORE     ?= artifacts
EXTRA     ?=

.DEFAULT_GOAL := help
.PHONY: help setup constraints all dataset stage report train benchmark ablation negative-affordance grasp sor3d demo weights test test-all check lint format types inspect bench clean distclean

help: ## show this list
	@if [ -t 1 ]; then bold=$$(printf '\033[1m') plain=$$(printf '\033[0m'); fi; \
	awk -F ':.*## ' -v bold="$$bold" -v plain="$$plain" '/^[a-z0-9-]+:.*## / {printf "  %s%-20s%s %s\n", bold, $$1, plain, $$2}' $(MAKEFILE_LIST)

$(READY): pyproject.toml constraints.txt constraints-torch.txt install/backend.py install/_afford_gymnasium.py install/landmark_files.py install/segment_files.py install/image_encoder.py install/published_files.py
	@$(PYTHON) install/preflight.py
	@echo "setting up $(VENV) (first time: a few minutes)"
	@test -x $(PY) || $(PYTHON) -m venv $(VENV)
	@$(PINNED) constraints.txt
	@$(PIP) --requirement constraints-torch.txt
	@$(PIP) --no-deps --no-build-isolation --editable .
	@rm -rf afford.egg-info build
	@$(PY) install/landmark_files.py
	@$(PY) install/segment_files.py
	@$(PY) install/image_encoder.py
	@touch $@

$(DEV): $(VENV)/.ready-film $(VENV)/.ready-ray

$(VENV)/.ready-%: constraints-%.txt $(READY)
	@$(PINNED) $<
	@touch $@

setup: $(READY) $(if $(EXTRA),$(VENV)/.ready-$(EXTRA)) ## make .venv, with `afford` in it (EXTRA=gpu: mujoco-warp, film: RecordVideo, ray: clusters, dev: tests and lint)

constraints: $(READY) ## pin and hash what is installed, show that it resolves on each Python (ARGS=--check, --upgrade)
	@$(PY) -m uv --version > /dev/null 2>&1 || $(PIP) uv
	@$(PY) install/constraints.py $(ARGS)

dataset: $(READY) ## build the data set (SOURCE=DIR: from your own or an EPIC-format root)
	@$(RUN) run dataset --store "$(STORE)" $(if $(SOURCE),--source "$(SOURCE)") $(ARGS)

stage: $(READY) ## run one stage of any target again on its last inputs, record it, say where to look (STAGE=mask_densify)
	@test -n "$(STAGE)" || { echo "say which: make stage STAGE=mask_densify"; exit 2; }
	@$(RUN) run --store "$(STORE)" --only "$(STAGE)" --record $(if $(SOURCE),--source "$(SOURCE)") $(ARGS)

all: $(READY) ## dataset, train, benchmark, negative-affordance, sor3d and grasp as one graph (hours; stop and go on at will)
	@$(RUN) run all --store "$(STORE)" $(ARGS)

report: $(READY) ## score every extraction stage against synthetic ground truth
	@$(RUN) run extraction-report --store "$(STORE)" $(ARGS)

train: $(READY) ## train a two-hand model on rendered stills (SOURCE=DIR: on a data set or on videos)
	@$(RUN) run train --store "$(STORE)" $(if $(SOURCE),--source "$(SOURCE)") $(ARGS)

benchmark: $(READY) ## score the trained model and the baselines on held-out stills (SOURCE=DIR: on ActAffordance)
	@$(RUN) run benchmark --store "$(STORE)" $(if $(SOURCE),--source "$(SOURCE)") $(ARGS)

ablation: $(READY) ## train every row of the ablation, three seeds each (stops after 75 minutes; run it again to go on)
	@$(RUN) run ablation --store "$(STORE)" $(ARGS)

negative-affordance: $(READY) ## where a hand must not go on objects, scored (SOURCE=DIR: on a folder of your meshes)
	@$(RUN) run negative-affordance --store "$(STORE)" $(if $(SOURCE),--source "$(SOURCE)") $(ARGS)

grasp: $(READY) ## a hand that grasps and keeps off what must not be touched: prior, teachers, examinations
	@$(RUN) run grasp --store "$(STORE)" $(ARGS)

sor3d: $(READY) ## where things afford what, from RGB-D video of their use (SOURCE=DIR: on a root in the layout of SOR3D-AFF)
	@$(RUN) run sor3d --store "$(STORE)" $(if $(SOURCE),--source "$(SOURCE)") $(ARGS)

demo: $(READY) ## a page at http://127.0.0.1:8000 where the trained model is asked (ARGS="--model DIR --port N")
	@$(RUN) demo --store "$(STORE)" $(ARGS)

weights: $(DEV) ## train the models in weights/ again and write them there (hours; stop and run again: finished stages are kept)
	@$(PY) install/cycles.py
	@PYTHONPATH=. $(PY) benchmarks/hands/photographs.py
	@PYTHONPATH=. $(PY) benchmarks/shipped/ship.py --store "$(STORE)" --photographs ../photographs/surface $(ARGS)
	@PYTHONPATH=. $(PY) benchmarks/shipped/calibrate.py --store "$(STORE)"
	@PYTHONPATH=. $(PY) benchmarks/shipped/presence.py --store "$(STORE)"
	@PYTHONPATH=. $(PY) benchmarks/shipped/score.py --store "$(STORE)"

test: $(DEV) ## run every law on small cases (not the tests marked slow, npm or mediapipe)
	@$(PY) -m pytest -n auto --dist loadfile -m "not slow and not npm and not mediapipe" $(ARGS)

test-all: $(DEV) ## run every test: full sizes, browsers, npm, MediaPipe and fuzzing too; prints how long it took
	@$(PY) -m pytest -n auto --dist loadfile --durations=20 $(ARGS)

check: lint types test ## what CI runs

lint: $(DEV) ## ruff and import-linter: style, and which room may import which; warns where weights/ was made by other code
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/lint-imports
	@PYTHONPATH=. $(PY) benchmarks/shipped/ship.py --check

format: $(DEV) ## ruff: sort imports and mend what can be mended
	@$(VENV)/bin/ruff check --fix .

types: $(DEV) ## mypy
	@$(VENV)/bin/mypy

inspect: $(READY) ## summarise the recordings (RECORDING=PATH)
	@$(RUN) inspect "$(RECORDING)" $(ARGS)

bench: $(DEV) ## run every benchmark; each writes its own Markdown table
	@for script in benchmarks/bench_*.py benchmarks/hands/photographs.py benchmarks/hands/score.py benchmarks/runner/all.py; do echo "$$script"; PYTHONPATH=. $(PY) $$script || exit 1; done

clean: ## delete everything that can be made again (artifacts), keep .venv
	@find artifacts -mindepth 1 -maxdepth 1 ! -name README.md -exec chmod -R u+w {} + -exec rm -rf {} +
	@rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis
	@find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

distclean: clean ## clean, and .venv too
	@rm -rf $(VENV)
