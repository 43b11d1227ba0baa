"""Systems of units: SSP 1.0 in and out, wiring checks, unit conversion, initial values."""

from orchestrator.system.model import (
    Component,
    Connection,
    Connector,
    Experiment,
    Inputs,
    Result,
    System,
)

__all__ = ["Component", "Connection", "Connector", "Experiment", "Inputs", "Result", "System"]
