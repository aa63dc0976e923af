# Two commands for everybody: `make demo` runs the main job on the shipped site, `make test` the tests.
# Each builds the environment it needs in .venv the first time. Only Python 3.11 to 3.14, git and make are needed.

ENVIRONMENT := .venv
BIN := $(ENVIRONMENT)/bin
DEMO := demo

.PHONY: help demo test test-quick test-thorough test-all validate fuzz bench study plugin wheel publish docs notebooks lint clean

help:
	@echo "make demo      the whole workflow on the shipped site, into $(DEMO)/ (under two minutes after the installation)"
	@echo "make test      the tests of every command, solver, effect and format (the first time with minutes of compiling)"
	@echo "make test-quick  the part of make test without commands, solvers and maps, for the time between two edits"
	@echo "make test-thorough  the tests that make test leaves out: whole scenes, notebooks, kills, QGIS, rare kernels"
	@echo "make test-all  both: all tests but the long validation"
	@echo "make validate  the long validation tests"
	@echo "make fuzz      20 000 damaged inputs, one after the other (half an hour)"
	@echo "make bench     the benchmark table"
	@echo "make study     what accuracy costs on the shipped cases, into study/ (AVAFRAME=2.1: beside AvaFrame's)"
	@echo "make plugin    the toolbox for QGIS, dist/mpmgis_qgis.zip"
	@echo "make wheel     wheel and sdist in dist/, checked as the package index does"
	@echo "make publish   both, to upload; refused where pyproject.toml has no public addresses"
	@echo "make docs      the website: guide, reference, theory, notebooks, functions; docs/index.html"
	@echo "make notebooks run all notebooks and store their results in them"
	@echo "make lint      style and format"
	@echo "make clean     remove the environment and what was made"

demo: $(ENVIRONMENT)/installed
	@$(BIN)/mpmgis demo -o $(DEMO) --overwrite

# A worker for each core; a file's tests stay together, because they share what they set up.
# Bytecode is kept whatever the environment says, because tests start many processes.
PYTEST = PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test: $(ENVIRONMENT)/installed-test
	@$(PYTEST) -m "not slow and not thorough"

QUICK = bench conversion laws terrain system frames exchange qgis_plugin scene seeding studies test_architecture.py
LONGER = compiled/test_kernel_cache.py laws/test_material_compiled.py seeding/test_seed_command.py

test-quick: $(ENVIRONMENT)/installed-test
	@$(PYTEST) -m "not slow and not thorough" $(addprefix tests/,$(QUICK)) $(addprefix --ignore=tests/,$(LONGER))

test-thorough: $(ENVIRONMENT)/installed-test
	@$(PYTEST) -m "thorough and not slow"

test-all: $(ENVIRONMENT)/installed-test
	@$(PYTEST) -m "not slow"

validate: $(ENVIRONMENT)/installed-test
	@$(BIN)/python -m pytest -m slow

fuzz: $(ENVIRONMENT)/installed-test
	@$(BIN)/python tests/fuzz/fuzzer.py

bench: $(ENVIRONMENT)/installed-test
	@$(BIN)/python tests/bench/run.py

# With AVAFRAME=2.1 that version of AvaFrame, in an environment of its own, is a point in the plots of two cases.
AVAFRAME_PYTHON = $(if $(AVAFRAME),.venv-avaframe-$(AVAFRAME)/bin/python)

study: $(ENVIRONMENT)/installed-test $(AVAFRAME_PYTHON)
	@$(BIN)/python tests/bench/study.py $(if $(AVAFRAME),--avaframe $(AVAFRAME_PYTHON))

.venv-avaframe-%/bin/python: | $(ENVIRONMENT)/installed-test
	@$(BIN)/python -m venv .venv-avaframe-$*
	@$@ -m pip install --quiet avaframe==$* || { rm -rf .venv-avaframe-$*; exit 1; }

plugin: $(ENVIRONMENT)/installed
	@$(BIN)/mpmgis qgis-plugin -o dist/mpmgis_qgis.zip --overwrite

wheel: $(ENVIRONMENT)/installed-test
	@rm -f dist/mpmgis-*.whl dist/mpmgis-*.tar.gz
	@$(BIN)/python -m build --outdir dist .
	@$(BIN)/twine check --strict dist/mpmgis-*

publish: $(ENVIRONMENT)/installed-test
	@$(BIN)/mpmgis qgis-plugin -o dist/mpmgis_qgis.zip --overwrite --publish
	@$(MAKE) --no-print-directory wheel

docs: $(ENVIRONMENT)/installed-docs
	@$(BIN)/python .ci/docs/build.py docs
	@echo docs/index.html

notebooks: $(ENVIRONMENT)/installed-test
	@$(BIN)/python .ci/docs/run_notebooks.py

lint: $(ENVIRONMENT)/installed-test
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check

# The stamps say what is installed, so that the second call is quick; a change of pyproject.toml installs again.
$(ENVIRONMENT)/installed: pyproject.toml .ci/environment
	@PYTHON="$(PYTHON)" .ci/environment $(ENVIRONMENT)
	@touch $@

$(ENVIRONMENT)/installed-test: pyproject.toml .ci/environment
	@PYTHON="$(PYTHON)" .ci/environment $(ENVIRONMENT) test
	@touch $@ $(ENVIRONMENT)/installed

$(ENVIRONMENT)/installed-docs: pyproject.toml .ci/environment
	@PYTHON="$(PYTHON)" .ci/environment $(ENVIRONMENT) docs
	@touch $@ $(ENVIRONMENT)/installed

clean:
	rm -rf $(ENVIRONMENT) .venv-avaframe-* $(DEMO) study docs build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +
