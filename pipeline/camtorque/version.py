"""The version of the package, apart so that a room that writes it needs nothing else."""

__version__ = "0.1.0"
