"""Runs the joint test bench: units (FMUs) coupled as an SSP system, scenarios as data, results with provenance."""

from cobot_joint.version import __version__

__all__ = ["__version__"]
