# make reproduce   set-up, the study, its table, figures and report: on a machine with nothing but Python and make
# make test        linters and the fast tests: five minutes on two cores
# make test-all    all checks: also slow tests, known vulnerabilities, the site, clusters
# make coverage    the lines that tests of this process run: all tests, in an hour
# make chaos       a study under 106 kills and other disturbances: half an hour
# make bench       what the parts cost: results/benchmark and docs/benchmarks.md; leave the machine alone meanwhile
# make gallery     every picture of the documents whose data are there; trains the toy, and ict_s1 with CARIGS_DATA
# make lock        the lock and the bill of materials again, after an edit of pyproject.toml
# make cluster     the tests of docs/clusters.md, in an environment with executors for clusters and an S3 server
# make audit       known vulnerabilities of what is locked; skipped where their list cannot be reached
# make docs        the documentation as a site: site/index.html, in an environment with MkDocs
#
# make reproduce TORCH=lock                     torch with CUDA on Linux, also without an NVIDIA GPU; TORCH=cpu: never
# make reproduce CORES=8 HYDRA="study=ict"      another study; any Hydra overrides
# make reproduce WEIGHTS=1                      with the network weights of all columns, which are downloaded first

SHELL := /bin/bash
PYTHON ?= $(shell for python in python3.11 python3.12 python3.13 python3.14 python3; do \
	$$python -c "import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 15))" 2> /dev/null && echo $$python && break; \
	done)
TORCH ?= auto
CYCLONEDX := cyclonedx-bom==7.5.0
PIP_AUDIT := pip-audit==2.10.1
CLUSTER := snakemake-executor-plugin-kubernetes==0.5.1 snakemake-executor-plugin-slurm==2.8.0 \
	snakemake-storage-plugin-s3==0.3.6 moto[server]==5.2.5
DOCS := mkdocs==1.6.1 mkdocs-material==9.8.2 mkdocs-autorefs==1.4.5 mkdocstrings==1.0.8 mkdocstrings-python==2.0.11 \
	griffelib==2.4.1 Markdown==3.11.3 pymdown-extensions==13.1.2 Pygments==2.21.0
CORES ?= 2
HYDRA ?=

ROOT := $(dir $(abspath $(lastword $(MAKEFILE_LIST))))
export PATH := $(ROOT).venv/bin:$(PATH)
unexport PYTHONPATH VIRTUAL_ENV
# Bytecode is kept, also where the environment says otherwise: hundreds of short processes import the same modules.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: reproduce test test-more test-all coverage chaos bench lock cluster audit docs
.DEFAULT_GOAL := reproduce

reproduce: .venv/installed
	carigs run --cores $(CORES) $(if $(WEIGHTS),--weights) $(HYDRA)

# Files are handed out whole: their tests share what they make.
PYTEST := pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder
# In environments of their own.
CLUSTERS := slurm or s3

test: .venv/installed
	ruff check .
	ruff format --check .
	snakefmt --check Snakefile workflow
	lint-imports
	$(PYTEST) -m "not (slow or docs or browser or chaos or $(CLUSTERS))"

# What `test` leaves out, with the shapes of every call checked.
test-more: .venv/installed
	CARIGS_CHECK_ALL=1 $(PYTEST) -m "(slow or docs or browser or chaos) and not ($(CLUSTERS))"
	$(MAKE) audit docs
	pytest tests/test_site.py
	$(MAKE) cluster

test-all: test test-more

coverage: .venv/installed
	CARIGS_CHECK_ALL=1 $(PYTEST) -m "not ($(CLUSTERS))" --cov --cov-report term

chaos: .venv/installed
	CARIGS_CHAOS=106 pytest -m chaos -s

bench: .venv/installed
	snakemake --cores 1 -- benchmark
	cp results/benchmark/benchmarks.md docs/
	cp results/benchmark/images/*.png docs/images/

# Builds, checks and measures train.backend=cuda; each part has a time limit. PARTS chooses.
.PHONY: gpu
gpu:
	python -m evaluation.benchmarks.gpu results/gpu --device $(or $(DEVICE),cuda) $(if $(PARTS),--parts $(PARTS))

.PHONY: gallery
gallery: .venv/installed
	python -m evaluation.figures.make_gallery docs/images/commands.toml $(PICTURES)

lock: .venv/installed
	uv pip compile --quiet --no-header --universal --python-version 3.11 --generate-hashes --extra dev --extra diffusion --extra cuda --extra viewer pyproject.toml --output-file requirements.lock
	$(MAKE) .venv/installed TORCH=lock
	uv tool run --quiet --from $(CYCLONEDX) cyclonedx-py environment --pyproject pyproject.toml --output-reproducible \
		--output-format JSON --output-file sbom.cdx.json .venv/bin/python

cluster: .venv/cluster/installed
	.venv/cluster/bin/python -m pytest -m "slurm or s3"

# Beside the lock: Snakemake imports each installed plugin at every start, and boto3 needs older versions of packages.
.venv/cluster/installed: .venv/installed
	.venv/bin/python -m venv --clear .venv/cluster
	.venv/bin/python -c "import site; print(f'import site; site.addsitedir({site.getsitepackages()[0]!r})')" \
		> "$$(.venv/cluster/bin/python -c 'import site; print(site.getsitepackages()[0])')/locked.pth"
	.venv/cluster/bin/python -m pip install --quiet $(CLUSTER)
	touch $@

# A mirror may have an answer for pip alone: asked is what is locked. --strict: a package that is not found is a failure.
NUMPY = $(shell sed -n 's/^numpy==\([^ ]*\).*/\1/p' requirements.lock | head -1)
VULNERABILITIES = https://pypi.org/pypi/numpy/$(NUMPY)/json
audit: .venv/installed
	@if python -c "import urllib.request; urllib.request.urlopen('$(VULNERABILITIES)', timeout=20)" 2> /dev/null; then \
		uv tool run --quiet --from $(PIP_AUDIT) pip-audit --strict --requirement requirements.lock --require-hashes --disable-pip; \
	else \
		echo "audit skipped: $(VULNERABILITIES) cannot be read"; \
	fi

# Without carigs and what it needs: docstrings are read, never run.
docs: .venv/docs/installed
	NO_MKDOCS_2_WARNING=1 .venv/docs/bin/mkdocs build --quiet --strict

.venv/docs/installed: Makefile
	@test -n "$(PYTHON)" || { echo "the site needs Python 3.11 to 3.14 (make PYTHON=... names one)"; exit 1; }
	$(PYTHON) -m venv --clear .venv/docs
	.venv/docs/bin/python -m pip install --quiet $(DOCS)
	touch $@

# Hashes are checked. Without an NVIDIA GPU, torch comes without CUDA: TORCH=lock takes what the lock names anyway.
.venv/installed: requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "carigs needs Python 3.11 to 3.14 (make PYTHON=... names one)"; exit 1; }
	$(PYTHON) set_up.py --torch $(TORCH)
	touch $@
