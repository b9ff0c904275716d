"""Independent rig simulator for truth-in/truth-out tests; see README.md. ``tests/conftest.py`` makes it importable."""
