"""Scenarios: what is done to a system, as data, and the experiments that need more than one run."""
