"""Co-simulation: masters over FMI 2.0 units, schemes as data, the loop in native code."""

from cobot_joint.cosim.instances import SimulationError
from cobot_joint.cosim.many import Advance, Outcome, Variation, simulate_many
from cobot_joint.cosim.schemes import DEFAULT, SCHEMES, Scheme
from cobot_joint.cosim.simulation import Simulation, simulate

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
