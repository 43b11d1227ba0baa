"""Scenarios: what is done to a system, as data, and the experiments that need more than one run."""

from cobot_joint.scenario.model import Scenario, load_scenario, scenario_names

__all__ = ["Scenario", "load_scenario", "scenario_names"]
