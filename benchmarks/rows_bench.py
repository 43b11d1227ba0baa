"""Rows against monolithic loops of the same physics."""

from functools import partial

import numpy as np

from benchmarks import bench
from benchmarks.measure import Row, alternate, at_least, at_most, median, ratio, rms, summary, timed
from benchmarks.monolith import averaged, three_phase
from benchmarks.ours import Ours
from cobot_joint.cosim import Simulation

ROUNDS = 9
MOTOR, PHASES = "motor_bldc", ("i_a", "i_b", "i_c")
FIXED = "gauss_seidel_extrapolated"  # the torque ripple of every commutation would keep adaptive steps short
SIMSCAPE = {f"{MOTOR}.motor.level": 2}


def averaged_level() -> list[Row]:
    """`load_mr_brake`, 20 s, at the accuracy that is asked for, against RK4 at 20 us and at 200 us in one C loop."""
    system, inputs = bench.joint(), bench.inputs()
    table = bench.table_of(inputs)
    right = bench.answer(table)

    with Simulation(system) as simulation:
        ours = Ours(simulation, inputs)
        loops = {f"{us} us": partial(timed, partial(averaged, table, us * 1e-6)) for us in (20, 200)}
        times = alternate({"ours": ours, **loops}, ROUNDS)
        signals = ours.result.signals
    errors = {name: rms(signals[name] - right[name]) for name in bench.ACCURACY}
    accurate = all(errors[name] <= limit for name, limit in bench.ACCURACY.items())
    note = f"{median(times['ours']) * 1e3:.3g} ms for 20 s; rms " + ", ".join(f"{n} {e:.1e}" for n, e in errors.items())
    if not accurate:
        note += ": NOT as accurate as asked for"
    details = {"seconds": summary(times), "rms errors": errors, "counters": simulation.counters}
    titles = {"20 us": "averaged, 20 s, against RK4 at 20 us in one C loop", "200 us": "... against RK4 at 200 us"}
    limits = {"20 us": 0.75, "200 us": 8.0}
    rows = [at_most(titles[n], ratio(times, "ours", n), limits[n], "x", note, **details) for n in titles]
    return [row if accurate else Row(**{**row.__dict__, "met": False}) for row in rows]


def three_phase_level() -> list[Row]:
    """`load_mr_brake`, 20 s, three-phase motor, against RK4 at 1 us in one C loop, phase currents at least as good."""
    system, inputs = bench.joint(), bench.inputs()
    table = bench.table_of(inputs)
    right = bench.answer(table, "three_phase")
    crawl = three_phase(table, 1e-6)
    with Simulation(system) as simulation:
        ours = Ours(
            simulation, inputs, scheme=FIXED, parameters=SIMSCAPE, record=[f"{MOTOR}.{name}" for name in PHASES]
        )
        times = alternate({"ours": ours, "loop": partial(timed, partial(three_phase, table, 1e-6))}, 3)
        signals = ours.result.signals
    error = rms(np.stack([signals[f"{MOTOR}.{name}"] - right[name] for name in PHASES]))
    allowed = rms(np.stack([crawl[name] - right[name] for name in PHASES]))
    note = f"{FIXED}, {ours.result.step * 1e3:g} ms; rms of phase currents {error:.1e} A, the loop's {allowed:.1e} A"
    details = {"seconds": summary(times), "rms phase current": {"ours": error, "RK4 1 us": allowed}}
    gain = at_least("simscape level, 20 s, RK4 at 1 us / ours", ratio(times, "loop", "ours"), 20, "x", note, **details)
    if error > allowed:
        gain = Row(**{**gain.__dict__, "met": False, "note": note + ": NOT as accurate"})
    speed = bench.DURATION / median(times["ours"])
    return [gain, at_least("simscape level, bench time / time it takes", speed, 50, "x", "", **details)]
