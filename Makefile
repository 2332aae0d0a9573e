# Every target sets up what it needs (tools/setup.sh), and does so again only when pyproject.toml has changed.
VENV := .venv
READY := $(VENV)/.ready
PYTHON_BIN := $(VENV)/bin/python

# The two halves of the Talk's figure, from one render: the composite, and the beams alone.
KEYHOLE := $(VENV)/bin/photonbeams render examples/keyhole/keyhole.usda \
	--passes 5 --denoise \
	-o out/keyhole.exr -o out/keyhole.png --picture beams=out/keyhole.beams.png

# Frames that are there already are not rendered again: `make flight` goes on where it was stopped.
FLIGHT := $(VENV)/bin/photonbeams render examples/keyhole/keyhole.usda -cam Flight --frames 1:101 \
	--set /World/Light/Key.photonbeams:count=2048 \
	--res 640 0 --passes 16 --skip-existing -o out/flight/flight.\#\#\#\#.exr

# What to hand to pytest, as in `make test ARGS=tests/test_quadrature.py`. Without it, all tests run in several processes:
# one compiles kernels, which takes one thread and nearly half of the time, while another renders.
ARGS :=
PROCESSES := --numprocesses logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

.PHONY: help keyhole flight studio blender test soak quick lint page wheel bench docs pictures

help:
	@echo 'make keyhole  render the example shot to out/: a layered EXR, a picture, and the beams alone'
	@echo 'make flight   render the flight through the beams (a quarter of an hour), as a film and a contact sheet'
	@echo 'make studio   open the example shot in the browser, live, with every control beside it'
	@echo 'make blender  build the extension for Blender, a render engine, as a zip in out/'
	@echo 'make test     run the tests (make test ARGS="-k quadrature" for some of them)'
	@echo 'make soak     run the tests with the whole of long sweeps, and note it in tests/soak.json'
	@echo 'make quick    run the tests that a change most likely breaks: a minute'
	@echo 'make lint     check the code with ruff and mypy, its size, and the words with codespell and proselint'
	@echo 'make page     build and test the page of the studio, and check that the committed one is the same (needs npm)'
	@echo 'make wheel    build a wheel, and check that it contains the files of src/'
	@echo 'make bench    measure, each figure beside its yardstick'
	@echo 'make docs     build the documentation'"'"'s site, warnings are errors'
	@echo 'make pictures render the pictures of docs/, and execute its notebooks (an hour)'

keyhole: $(READY)
	@mkdir -p out
	$(KEYHOLE)

flight: $(READY)
	@mkdir -p out/flight
	$(FLIGHT)
	$(PYTHON_BIN) examples/keyhole/film.py 'out/flight/flight.####.exr' out/flight.mp4

studio: $(READY)
	@mkdir -p out
	$(VENV)/bin/photonbeams studio examples/keyhole/keyhole.usda --layer out/look.usda

blender: $(READY)
	$(PYTHON_BIN) tools/extension.py

test: $(READY)
	$(PYTHON_BIN) -m pytest $(or $(ARGS),$(PROCESSES))

soak: $(READY)
	$(PYTHON_BIN) tools/soak.py $(PROCESSES)

quick: $(READY)
	$(PYTHON_BIN) -m pytest $(PROCESSES) @tests/quick.txt

lint: $(READY)
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/codespell
	$(PYTHON_BIN) tools/prose.py
	$(PYTHON_BIN) tools/budget.py
	$(VENV)/bin/mypy

page:
	tools/page.sh

wheel: $(READY)
	$(PYTHON_BIN) tools/wheel.py

bench: $(READY)
	$(PYTHON_BIN) -m benchmarks

docs: $(READY)
	$(VENV)/bin/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	@echo 'the site is in docs/_build/html'

pictures: $(READY)
	$(PYTHON_BIN) docs/scripts/make_pictures.py

$(READY): pyproject.toml tools/setup.sh
	@tools/setup.sh $(VENV)
