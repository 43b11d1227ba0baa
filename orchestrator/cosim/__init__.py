"""Co-simulation: masters over FMI 2.0 units, schemes as data, the loop in native code."""

from orchestrator.cosim.instances import SimulationError
from orchestrator.cosim.many import Advance, Outcome, Variation, simulate_many
from orchestrator.cosim.schemes import DEFAULT, SCHEMES, Scheme
from orchestrator.cosim.simulation import Simulation, simulate

__all__ = [
    "DEFAULT",
    "SCHEMES",
    "Advance",
    "Outcome",
    "Scheme",
    "Simulation",
    "SimulationError",
    "Variation",
    "simulate",
    "simulate_many",
]
