"""How far the three-phase motor's averages are from the DC equivalent's: `python -m benchmarks.three_phase_sweep`.

The motor alone at a constant voltage and torque, load by load, as the monolithic loop has it and as the unit has it.
Currents: half the difference of the active legs' (the loop's `i_motor`); half the sum of the phases' magnitudes.
"""

import numpy as np
from rich.console import Console
from rich.table import Table as Printed

from benchmarks.monolith import SAMPLE, Setup, Table, three_phase
from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.system import Component, Connection, Connector, Inputs, System
from cobot_joint.units import find_fmu, load_unit

R, K, TAU_C, D, W_C = 0.209, 0.0232, 1.2e-3, 7.5e-6, 1.0  # the bench's motor, docs/bench.md
CURRENTS = (None, 1.0, 2.0, 3.4, 4.0, 5.0, 6.0, 8.0, 10.0)  # A of the DC equivalent; None: no load
VOLTAGES = (12.0, 24.0)
DURATION, SETTLED = 61.0, 1000  # s; samples. 1 kHz samples of a 500 Hz ripple need many turns to average
UNLIMITED = {"drive.w_max": 0.0, "drive.i_peak": 0.0, "drive.v_max": 0.0, "motor.level": 2}
OUTPUTS = ("i", "phi", "i_a", "i_b", "i_c")


def steady_state(v: float, i: float | None) -> tuple[float, float, float]:
    """(i, w, tau) of the DC equivalent: v = R i + k w, k i = tau_C sgn(w) + d w + tau."""
    if i is None:
        w = (K * v / R - TAU_C) / (D + K * K / R)
        return (v - K * w) / R, w, 0.0
    w = (v - R * i) / K
    return i, w, K * i - TAU_C * np.tanh(w / W_C) - D * w


def inputs(v: float, tau: float) -> Table:
    time = np.arange(round(DURATION / SAMPLE) + 1) * SAMPLE
    zero = np.zeros_like(time)
    return np.stack([v * np.clip(4 * time, 0, 1), zero, tau * np.clip(4 * time - 1, 0, 1)], axis=1)


def averages(signals: dict[str, Table]) -> tuple[float, float]:
    """(half the sum of the magnitudes [A], mean speed [rad/s]) once settled."""
    phases = np.stack([signals[name][SETTLED:] for name in ("i_a", "i_b", "i_c")])
    phi = signals["phi_motor"] if "phi_motor" in signals else signals["phi"]
    return float(np.abs(phases).sum(axis=0).mean() / 2), (phi[-1] - phi[SETTLED]) / ((len(phi) - 1 - SETTLED) * SAMPLE)


def motor_alone() -> System:
    path = find_fmu("motor_bldc.fmu")
    names = ("set_value", "tau")
    wires = [Connection(None, name, "motor", name) for name in names]
    wires += [Connection("motor", name, None, name) for name in OUTPUTS]
    ends = {name: Connector(name, "input") for name in names}, {name: Connector(name, "output") for name in OUTPUTS}
    return System("motor alone", (Component("motor", str(path), load_unit(path)),), tuple(wires), *ends)


def main() -> None:
    printed = Printed(title="three-phase against averaged, deviation in %")
    for heading in (
        "v [V]",
        "i [A]",
        "loop: legs",
        "loop: magnitudes",
        "loop: w",
        "unit: i",
        "unit: magnitudes",
        "unit: w",
    ):
        printed.add_column(heading, justify="right")
    with Simulation(motor_alone()) as simulation:
        for v in VOLTAGES:
            for wanted in CURRENTS:
                i, w, tau = steady_state(v, wanted)
                table = inputs(v, tau)
                loop = three_phase(table, 5e-5, Setup.MOTOR_ALONE, locate=True)
                legs = (loop["charge"][-1] - loop["charge"][SETTLED]) / ((len(table) - 1 - SETTLED) * SAMPLE)
                driven = Inputs(
                    np.arange(len(table), dtype=np.float64) * SAMPLE, {"set_value": table[:, 0], "tau": table[:, 2]}
                )
                unlimited = {f"motor.{name}": value for name, value in UNLIMITED.items()}
                unit = simulation.run(Experiment(driven, DURATION, parameters=unlimited)).signals
                figures = [legs / i, averages(loop)[0] / i, averages(loop)[1] / w]
                figures += [unit["i"][SETTLED:].mean() / i, averages(unit)[0] / i, averages(unit)[1] / w]
                printed.add_row(f"{v:g}", f"{i:.3g}", *(f"{100 * (figure - 1):+.3f}" for figure in figures))
    Console().print(printed)


if __name__ == "__main__":
    main()
