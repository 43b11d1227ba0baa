"""Systems of units: SSP 1.0 in and out, wiring checks, unit conversion, initial values."""

from orchestrator.system.initial import initial_order
from orchestrator.system.model import Component, Connection, Connector, Experiment, Inputs, Result, System
from orchestrator.system.parameters import with_parameters
from orchestrator.system.read import find_system, load_system
from orchestrator.system.wiring import Wiring, check
from orchestrator.system.write import write_ssd, write_ssp, write_ssv

__all__ = [
    "Component",
    "Connection",
    "Connector",
    "Experiment",
    "Inputs",
    "Result",
    "System",
    "Wiring",
    "check",
    "find_system",
    "initial_order",
    "load_system",
    "with_parameters",
    "write_ssd",
    "write_ssp",
    "write_ssv",
]
