"""A bench that conceals cogging, and diagnoses of an engine that knows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.store import Store
from cobot_joint.system.read import load_system

R, A, ONSET = 0.215, 2e-3, 1.0
CONCEALED = {"motor_bldc.winding.R": R, "motor_bldc.cogging.A": A}
UNITS = {"i_motor": "A", "w_motor": "rad/s", "tau_sensor": "N.m"}
NOISE = {"i_motor": 4e-3, "w_motor": 0.3, "tau_sensor": 5e-3}
LOADED, NO_LOAD = ("i_motor", "w_motor", "tau_sensor"), ("i_motor", "w_motor")


def record(folder: Path, name: str, setup: str, seed: int, concealed: dict[str, float] = CONCEALED) -> None:
    """A short run of the bench with what is concealed, as a logger writes it."""
    rng = np.random.default_rng(seed)
    t = np.arange(2001) * 1e-3
    inputs = {"v_command": np.interp(t, [0.3, 0.6, 1.4, 1.8], [0, 8 + seed, 8 + seed, -3])}
    if setup == "loaded":
        inputs["i_brake"] = np.interp(t, [0.9, 1.0], [0, 0.3])
    outputs = {n: np.zeros(len(t)) for n in (LOADED if setup == "loaded" else NO_LOAD)}
    system = load_system("joint_logged" if setup == "loaded" else "joint_no_load_logged")
    late = {name: ONSET for name in concealed if "cogging" in name}
    with Simulator({setup: system}, concealed, late) as bench:
        signals = bench(Recording(name, "train", setup, t, inputs, outputs, UNITS))
    measured = {n: x + NOISE[n] * rng.standard_normal(len(t)) for n, x in signals.items()}
    units = UNITS | {"v_command": "V", "i_brake": "A"}
    columns = {f"{n} [{units[n]}]": x for n, x in (inputs | measured).items()}
    pa.parquet.write_table(pa.table({"time [s]": t} | columns), folder / f"{name}.parquet")


def estimate(value: float, unit: str) -> Estimate:
    return Estimate(value, unit, (0.95 * value, 1.05 * value))


WHERE = {
    "recording": "noload",
    "channel": "i_motor",
    "time": [0.0, 1.0],
    "by_recording": {"noload": 1.0},
    "by_channel": {"i_motor": 1.0},
    "by_regime": [],
}


def explained() -> Diagnosis:
    finding = Finding(
        term="motor_bldc.cogging",
        equivalent=(),
        confidence=0.98,
        onset=ONSET,
        parameters={"A": estimate(A, "N.m")},
        where=WHERE,
        gain=1e4,
    )
    calibrated = {"motor_bldc.winding.R": estimate(R, "Ohm")}
    repaired = calibrated | {"motor_bldc.cogging.A": estimate(A, "N.m")}
    return Diagnosis("explained", [finding], calibrated, repaired)


def unlisted(formula: bool) -> Diagnosis:
    """The same effect as something that no list names: -A*sin(n*phi) at the rotor, or a table of nothing."""
    n = float(load_system("joint").component("motor_bldc").unit.variables["cogging.n"].start)
    form = Form(
        port="motor_bldc.tau_add",
        unit="N.m",
        signals=("phi",),
        features=(Feature(Product((Factor("phi", "sin", n),)), estimate(-A, "N.m")),) if formula else (),
        explains=0.9,
        signal="phi",
        table=None if formula else (np.array([0.0, 1.0]), np.array([0.0, 0.0])),
    )
    finding = Finding("motor_bldc.unlisted", (), 0.9, ONSET, {}, WHERE, 1e4, form)
    calibrated = {"motor_bldc.winding.R": estimate(R, "Ohm")}
    return Diagnosis("unlisted", [finding], calibrated, calibrated)


def knows(diagnosis: Diagnosis):
    def diagnose(campaign: Campaign, *, progress=None, store: Store | None = None) -> Diagnosis:
        return diagnosis

    return lambda baseline, budget: diagnose
