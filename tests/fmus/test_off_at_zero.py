"""Parts that are off at zero: absent there whatever else they are set to, present elsewhere, and no candidates of a
diagnosis until they have been counted (docs/diagnosis-calibration.md)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cobot_joint.units import Unit
from tests.fmus.test_every_unit import excite

Make = Callable[..., Any]
Load = Callable[[str], Unit]

# unit, what switches the part on, a value that shows
PARTS = [
    ("motor_bldc", "mosfet.R_on", 0.02),
    ("motor_bldc", "diode_drop.V_d", 0.5),
    ("motor_bldc", "pwm.T", 2e-5),
    ("motor_bldc", "bus.C", 1e-3),
    ("motor_bldc", "magnet.beta", 5e-3),
    ("motor_bldc", "iron_loss.P", 5.0),
    ("planetary_gear", "mesh_error_1.A", 1e-5),
    ("planetary_gear", "mesh_error_2.A", 1e-5),
    ("planetary_gear", "mesh_error_3.A", 1e-4),
    ("torque_sensor", "quadratic.a", 0.01),
    ("torque_sensor", "cubic.a", 0.01),
    ("torque_sensor", "crosstalk.x", 0.01),
    ("torque_sensor", "zero_drift.z", 0.01),
    ("torque_sensor", "span_drift.s", 1e-3),
    ("mr_brake_belt", "coil.L", 0.2),
    ("mr_brake_belt", "remanence.i_h", 0.1),
    ("mr_brake_belt", "belt_tension.x", 100.0),
    ("mr_brake_belt", "belt_mesh.A", 1e-3),
]
# what a diagnosis of the joint may name; each has been counted
CANDIDATES = {
    "motor_bldc": "winding_heating torque_saturation dead_time supply_sag cogging torque_ripple stribeck "
    "sublinear_viscous windage friction_asymmetry viscous_warmup presliding",
    "planetary_gear": "load_friction backlash transmission_error stiffness_hardening stribeck sublinear_viscous "
    "windage friction_asymmetry viscous_warmup presliding",
    "torque_sensor": "offset gain low_pass hysteresis misalignment_ripple",
    "mr_brake_belt": "brake_hysteresis brake_release_lag brake_fade pulley_eccentricity imbalance position_friction "
    "belt_creep external_torque",
    "acquisition": "current_offset speed_delay torque_delay",
}


@pytest.mark.parametrize(("name", "amplitude"), [row[:2] for row in PARTS])
def test_part_that_is_not_counted_is_no_candidate_and_the_page_says_so(
    load: Load, root: Path, name: str, amplitude: str
) -> None:
    part = amplitude.split(".")[0]
    assert part not in [term.name for term in load(name).terms]
    page = (root / "docs/diagnosis-calibration.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{name}` |")]
    assert f"`{part}`" in row


@pytest.mark.parametrize("name", CANDIDATES)
def test_candidates_of_a_diagnosis_are_the_counted_terms(load: Load, name: str) -> None:
    assert [term.name for term in load(name).terms] == CANDIDATES[name].split()


def others(unit: Unit, amplitude: str) -> dict[str, float]:
    """The part's other real parameters, each moved off its start value."""
    part, found = amplitude.split(".")[0], {}
    for name, v in unit.variables.items():
        if name.startswith(f"{part}.") and name != amplitude and v.type == "Real":
            _, high = unit.bounds_of(name)
            found[name] = min(1.3 * float(v.start) + 0.1, float("inf") if high is None else high)
    return found


@pytest.mark.parametrize(("name", "amplitude"), [row[:2] for row in PARTS])
def test_part_at_zero_leaves_the_outputs_bit_identical(load: Load, make: Make, name: str, amplitude: str) -> None:
    neutral = {**others(load(name), amplitude), amplitude: 0.0}
    np.testing.assert_array_equal(excite(make(name, neutral)), excite(make(name)))


@pytest.mark.parametrize(("name", "amplitude", "on"), PARTS)
def test_part_shows_and_can_set_in_while_the_run_goes_on(make: Make, name: str, amplitude: str, on: float) -> None:
    plain, slave = excite(make(name)), make(name)
    before = excite(slave, end=0.2)
    np.testing.assert_array_equal(before, plain[:, : before.shape[1]])
    slave.set({amplitude: on})
    after = excite(slave, end=0.2)
    assert np.all(np.isfinite(after))
    assert not np.array_equal(after[:, 1:], plain[:, before.shape[1] :])
