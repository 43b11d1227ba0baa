"""Runs the joint test bench: units (FMUs) coupled as an SSP system, scenarios as data, results with units and provenance."""
