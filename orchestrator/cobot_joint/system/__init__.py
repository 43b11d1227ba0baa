"""Systems of units: SSP 1.0 in and out, wiring checks, unit conversion, initial values."""

from cobot_joint.system.initial import initial_order
from cobot_joint.system.model import Component, Connection, Connector, DefaultExperiment, Inputs, System
from cobot_joint.system.parameters import with_parameters
from cobot_joint.system.read import find_system, load_system
from cobot_joint.system.swap import with_units
from cobot_joint.system.wiring import Wiring, check
from cobot_joint.system.write import (
    with_fmus,
    without_own_wires,
    write_fmu,
    write_fmus,
    write_fmus_alone,
    write_ssd,
    write_ssp,
    write_ssv,
)

__all__ = [
    "Component",
    "Connection",
    "Connector",
    "DefaultExperiment",
    "Inputs",
    "System",
    "Wiring",
    "check",
    "find_system",
    "initial_order",
    "load_system",
    "with_fmus",
    "with_parameters",
    "with_units",
    "without_own_wires",
    "write_fmu",
    "write_fmus",
    "write_fmus_alone",
    "write_ssd",
    "write_ssp",
    "write_ssv",
]
