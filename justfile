# `just` alone lists these verbs.
_list:
    @just --list

# An environment with everything a developer needs
setup:
    python3 -m venv .venv
    .venv/bin/pip install -U pip
    .venv/bin/pip install -e . --group dev

# The first tier of tests: every rule of the program
test *ARGS:
    .venv/bin/pytest {{ARGS}}

# The thorough tier: live processes, browsers, wide sweeps
thorough *ARGS:
    .venv/bin/pytest -m thorough {{ARGS}}

# Formatting, lint, types, architecture
lint:
    .venv/bin/ruff format --check .
    .venv/bin/ruff check .
    .venv/bin/mypy
    .venv/bin/lint-imports

# Format and mend what can be mended
format:
    .venv/bin/ruff format .
    .venv/bin/ruff check --fix .

# Speed of the engine
bench:
    .venv/bin/python benchmarks/engine.py

# Parts of the documents that are made: pictures of the shipped missions, tables, the reference of commands
pictures:
    .venv/bin/python docs/gallery.py
    .venv/bin/python docs/tables.py
    .venv/bin/python docs/cli_reference.py

# What continuous integration runs
ci:
    .ci/run
