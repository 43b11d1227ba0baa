"""The version, for the package, its build and the provenance of results alike."""

__version__ = "0.1.0"
