"""Co-simulation of FMI 2.0 units: experiments as data, schemes as data, the loop in native code (`master`)."""

from cobot_joint.cosim.experiment import Experiment, Feedback
from cobot_joint.cosim.instances import SimulationError
from cobot_joint.cosim.many import Advance, Outcome, simulate_many
from cobot_joint.cosim.schemes import DEFAULT, SCHEMES, STEPPED, Scheme
from cobot_joint.cosim.simulation import Simulation, simulate

__all__ = [
    "DEFAULT",
    "SCHEMES",
    "STEPPED",
    "Advance",
    "Experiment",
    "Feedback",
    "Outcome",
    "Scheme",
    "Simulation",
    "SimulationError",
    "simulate",
    "simulate_many",
]
