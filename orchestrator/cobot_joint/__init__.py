"""Runs the joint test bench: units (FMUs) coupled as an SSP system, scenarios as data, results with provenance."""

__version__ = "0.1.0"
