# Two commands suffice: `make dataset` and `make test`. Both make the environment where it is missing.

VENV := .venv
STAMP := $(VENV)/.installed
BIN := $(CURDIR)/$(VENV)/bin
export PATH := $(BIN):$(PATH)
export DVC_NO_ANALYTICS := 1
unexport PYTHONPATH

# The parameters of two examples: the default size, but with sight learned, which a GPU answers in batches, and
# with fewer features, so that a file is half as large.
EXAMPLE_PARAMETERS := .objectfolder/examples.yaml
KNOWN_EXAMPLE := --overwrite --size default --source "ObjectFolder Factory starter set" --licence CC0-1.0 \
	--attribution "ObjectFolder Factory contributors" --output objectfolder/examples
EXAMPLE := --params $(EXAMPLE_PARAMETERS) $(KNOWN_EXAMPLE)

GALLERY := .objectfolder/gallery
COMPILE := UV_CUSTOM_COMPILE_COMMAND="make lock" uv pip compile --quiet --no-annotate --python-version 3.11

.DEFAULT_GOAL := help
# Stamps of purposes are kept, though only a pattern names them.
.PRECIOUS: $(VENV)/.installed-%
.PHONY: help environment dataset hundred learn learn-small metaworld wheel examples test test-all reality lint docs stages lock

help: ## Say what can be made
	@echo "make dataset [OBJECTS=path/to/objects.csv] [ONLY=id,id]"
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  \1\t/' | expand -t 16

environment: $(STAMP) ## Make the environment in .venv, with the system libraries it needs

$(STAMP): pyproject.toml requirements.lock environment.sh
	@bash environment.sh $(VENV)
	@touch $@

# What a purpose needs beyond making: test, learn, docs, cluster.
environment-%: $(VENV)/.installed-%
	@:

$(VENV)/.installed-%: requirements-%.lock $(STAMP)
	@bash environment.sh $(VENV) requirements-$*.lock
	@touch $@

dataset: $(STAMP) ## Make the data set: what is missing or out of date
	@objectfolder select $(if $(OBJECTS),--table "$(OBJECTS)") --only "$(ONLY)"
	@python -m pipeline.cli.reproduce && status=0 || status=$$?; objectfolder report --summary; exit $$status

hundred: $(STAMP) ## Fetch the hundred objects of ObjectFolder 1.0 and make the data set of them
	objectfolder fetch --table data/objects.csv
	$(MAKE) --no-print-directory dataset OBJECTS=data/objects.csv

learn: $(VENV)/.installed-learn ## Evaluate the learning tasks on the data set: reports/learning.html
	python -m pipeline.cli.reproduce learning/dvc.yaml

learn-small: $(VENV)/.installed-learn ## Evaluate all learning tasks on 20 objects, smaller: reports/learning_small/learning.html
	python -m learning all --objects 20 --params learning/small.yaml --results reports/learning_small \
		--page reports/learning_small/learning.html

# Meta-World pins a MuJoCo that is older than ours.
metaworld: $(VENV)/.installed-test ## Do Meta-World's tasks with the objects of the data set, in .venv-metaworld
	uv venv --quiet --allow-existing --python 3.11 .venv-metaworld
	uv pip sync --quiet --python .venv-metaworld learning/metaworld/requirements.txt
	objectfolder export --format mjcf --overwrite -o .objectfolder/assets
	.venv-metaworld/bin/python -W ignore -m learning.metaworld .objectfolder/assets

wheel: $(VENV)/.installed-test ## Build the wheel in dist/, with its kernels compiled: first queries compile none
	python -m pipeline.publish.wheel

examples: $(STAMP) ## Make the Object Files inside the package again
	objectfolder starter
	sed -e 's/^        material: known.*/        material: learned\n        grid_corners: 55000/' \
		-e 's/^      training_views: 24$$/      training_views: 100/' params.yaml > $(EXAMPLE_PARAMETERS)
	objectfolder build data/starter/mug/model.obj --id mug --name "Mug with a handle" --material ceramic $(EXAMPLE)/mug.safetensors
	objectfolder build data/starter/bell/model.obj --id bell --name "Bell with a knob" --material iron $(EXAMPLE)/bell.safetensors
	objectfolder build data/starter/bowl/model.obj --id bowl --name "Speckled bowl" --material ceramic $(KNOWN_EXAMPLE)/bowl.safetensors
	objectfolder build data/starter/plate/model.obj --id plate --name "Dotted plate" --material glass $(KNOWN_EXAMPLE)/plate.safetensors

# One process more than there are processors: tests of clusters wait most of their time.
test: $(VENV)/.installed-test ## Check style, types and imports, and run the tests that protect a change
	$(MAKE) --no-print-directory lint
	pytest -n $$(($$(getconf _NPROCESSORS_ONLN) + 1)) --release "$(RELEASE)"

test-all: RELEASE := all
test-all: test ## The same, and the tests that protect a release

reality: $(VENV)/.installed-test ## Compare the product with measurements of real things: docs/reality.md
	python -m bench.reality $(if $(BUNDLE),--bundle "$(BUNDLE)")

lint: $(VENV)/.installed-test ## Check style, types and imports
	ruff check .
	ruff format --check --exclude '*.md' .
	mypy
	lint-imports --no-logo

docs: $(VENV)/.installed-docs $(GALLERY)/index.html ## Build these pages as a site that opens from disk: site/index.html
	mkdocs build --strict --clean --quiet

# Of the data set where it is made, else of the package's own objects.
$(GALLERY)/index.html: $(or $(wildcard data/object_files/*.safetensors),$(wildcard objectfolder/examples/*.safetensors)) \
		| $(VENV)/.installed-docs
	objectfolder gallery $^ --overwrite -o $(GALLERY)

stages: $(STAMP) ## Write into dvc.yaml what the stages declare
	python -m pipeline.cli.declare

lock: $(VENV)/.installed-test ## Write the locks: what stands in them stays as far as pyproject.toml allows
	$(COMPILE) --extra factory --output-file requirements.lock pyproject.toml
	$(COMPILE) --all-extras --constraint requirements.lock --output-file requirements-test.lock pyproject.toml
	$(COMPILE) --extra factory --extra learning --constraint requirements-test.lock \
		--output-file requirements-learn.lock pyproject.toml
	$(COMPILE) --extra factory --extra docs --constraint requirements-test.lock \
		--output-file requirements-docs.lock pyproject.toml
	$(COMPILE) --extra factory --extra dashboard --extra s3 --extra ssh --extra slurm --extra kubernetes \
		--constraint requirements-test.lock --output-file requirements-cluster.lock pyproject.toml
	$(COMPILE) --output-file learning/metaworld/requirements.txt learning/metaworld/requirements.in
