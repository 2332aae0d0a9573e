# Every target sets up what it needs (tools/setup.sh), and does so again only when pyproject.toml has changed.
VENV := .venv
READY := $(VENV)/.ready
PYTHON_BIN := $(VENV)/bin/python

# The two halves of the Talk's figure, from one render: the composite, and the beams alone.
KEYHOLE := $(VENV)/bin/photonbeams render examples/keyhole/keyhole.usda \
	--passes 64 \
	-o out/keyhole.exr -o out/keyhole.png --picture beams=out/keyhole.beams.png

# What to hand to pytest, as in `make test ARGS=tests/test_quadrature.py`.
ARGS :=

.PHONY: help keyhole test lint bench docs

help:
	@echo 'make keyhole  render the example shot to out/: a layered EXR, a picture, and the beams alone'
	@echo 'make test     run the tests (make test ARGS="-k quadrature" for some of them)'
	@echo 'make lint     check the code with ruff and mypy'
	@echo 'make bench    measure, each figure beside its yardstick'
	@echo 'make docs     render the pictures of docs/'

keyhole: $(READY)
	@mkdir -p out
	$(KEYHOLE)

test: $(READY)
	$(PYTHON_BIN) -m pytest $(ARGS)

lint: $(READY)
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

bench: $(READY)
	$(PYTHON_BIN) -m benchmarks

docs: $(READY)
	$(PYTHON_BIN) docs/make_pictures.py

$(READY): pyproject.toml tools/setup.sh
	@tools/setup.sh $(VENV)
