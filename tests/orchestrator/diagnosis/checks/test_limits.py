"""A drive's limit that holds the simulation alone, and a start elsewhere, are said before anything is fitted."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.checks.limits import beyond_limits
from cobot_joint.diagnosis.checks.starts import begin_elsewhere
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.drafts.chain import chain, with_data_sheet
from cobot_joint.system.read import load_system

TIME = np.arange(0, 4, 1e-3)


@pytest.mark.parametrize(
    ("reached", "held", "own", "said"),
    [
        pytest.param(1000.0, 640.0, None, True, id="held"),
        pytest.param(1000.0, 1000.0, 0.0, False, id="no limit"),
        pytest.param(640.0, 640.0, None, False, id="both held"),
        pytest.param(1000.0, 300.0, None, False, id="slow for another reason"),
    ],
)
def test_a_limit_that_holds_the_simulation_alone_is_said(
    reached: float, held: float, own: float | None, said: bool
) -> None:
    """A 48 V motor was held at the 628 rad/s of the bench's drive, which its data sheet left as it was."""
    rise = np.minimum(TIME, 1.0)
    initial = {} if own is None else {"motor_bldc.drive.w_max": own}
    r = Recording("a", "train", "joint", TIME, {}, {"w_motor": reached * rise}, {"w_motor": "rad/s"}, initial=initial)
    system = load_system("joint")
    found = list(beyond_limits([r, r], lambda r: {"w_motor": held * rise}, {"joint": system}))
    assert [s.kind for s in found] == ["limit"] * said
    if said:
        assert found[0].wrong
        assert "motor_bldc.drive.w_max = 628.3 holds the simulation" in found[0].evidence


@pytest.mark.parametrize(
    ("reached", "held", "supply", "said"),
    [
        pytest.param(330.0, 190.0, None, True, id="held by 24 V"),
        pytest.param(330.0, 330.0, None, False, id="driven by something else"),
        pytest.param(330.0, 190.0, 48.0, False, id="its own supply"),
        pytest.param(210.0, 190.0, None, False, id="a constant that is a tenth off"),
    ],
)
def test_a_supply_that_holds_the_simulation_alone_is_said(
    reached: float, held: float, supply: float | None, said: bool
) -> None:
    """A conveyor's drive on 48 V, of whose data sheet the supply had been left out: the unit's 24 V held it, and an
    effect on no list was answered."""
    made = chain(["motor", "load"]).system
    rise = np.minimum(TIME, 1.0)
    initial = {"motor.winding.k": 0.125} | ({} if supply is None else {"motor.inverter.v_bus": supply})
    r = Recording("a", "train", "axis", TIME, {}, {"w_motor": reached * rise}, {"w_motor": "rad/s"}, initial=initial)
    found = list(beyond_limits([r, r], lambda r: {"w_motor": held * rise}, {"axis": made}))
    assert [s.kind for s in found] == ["limit"] * said
    if said:
        assert found[0].wrong
        assert "its back-EMF is 41.25 V, and motor.inverter.v_bus = 24 V holds the simulation" in found[0].evidence


@pytest.mark.parametrize(
    ("names", "output", "unit", "per_motor"),
    [("motor,gear,load", "w_load", "rad/s", 1 / 50), ("motor,screw", "screw.v", "m/s", 8e-4)],
)
def test_a_supply_is_held_against_what_turns_with_the_motor_where_its_own_speed_was_not_recorded(
    names: str, output: str, unit: str, per_motor: float
) -> None:
    made = with_data_sheet(chain(names.split(",")), {"gear.N": "50"} if "gear" in names else {}).system
    rise, initial = per_motor * np.minimum(TIME, 1.0), {"motor.winding.k": 0.125}
    r = Recording("a", "train", "axis", TIME, {}, {output: 330.0 * rise}, {output: unit}, initial=initial)
    (found,) = beyond_limits([r], lambda r: {output: 190.0 * rise}, {"axis": made})
    assert "its back-EMF is 41.25 V, and motor.inverter.v_bus = 24 V holds the simulation" in found.evidence


@pytest.mark.parametrize(
    ("begins", "initial", "said"),
    [
        pytest.param(0.1, {}, True, id="elsewhere"),
        pytest.param(0.1, {"screw.s": 0.1}, False, id="given"),
        pytest.param(0.1, {"s": 0.1}, False, id="given by its connector"),
        pytest.param(0.01, {}, False, id="there"),
    ],
)
def test_a_position_that_begins_elsewhere_is_said_with_what_sets_it(
    begins: float, initial: dict[str, float], said: bool
) -> None:
    made = chain(["motor", "screw"]).system
    r = Recording("a", "train", "axis", TIME, {}, {"s": begins + 0.1 * TIME}, {"s": "m"}, initial=initial)
    found = list(begin_elsewhere([r, r], lambda r: {"s": np.zeros(len(r.time))}, {"axis": made}))
    assert [s.kind for s in found] == ["start"] * said
    if said:
        assert '[initial] "screw.s" = "first sample of s"' in found[0].evidence
        assert 'if only its zero lies elsewhere, offset = "-0.1 m" in [channels]' in found[0].evidence
        assert not found[0].wrong


@pytest.mark.parametrize(("initial", "said"), [({}, True), ({"motor.w": 60.0}, False)])
def test_a_speed_that_a_log_begins_with_is_said_with_all_that_turns_with_it(
    initial: dict[str, float], said: bool
) -> None:
    """A wheel that was logged from 60 rad/s on was 500 times its noise off, and no explanation stood out."""
    geared = with_data_sheet(chain(["motor", "gear", "sensor", "load"]), {"gear.N": "50"}).system
    r = Recording("a", "train", "axis", TIME, {}, {"w_motor": 60 - 2 * TIME}, {"w_motor": "rad/s"}, initial=initial)
    found = list(begin_elsewhere([r], lambda r: {"w_motor": np.zeros(len(r.time))}, {"axis": geared}))
    assert [s.kind for s in found] == ["start"] * said
    if said:
        assert '"gear.w_o" = "first sample of w_motor * 0.02"' in found[0].evidence
        assert '"load.x_w" = "first sample of w_motor * 0.02"' in found[0].evidence


def test_an_angle_behind_a_gear_is_said_with_all_that_turns_with_it() -> None:
    """Of a table half a radian from zero its own angle alone was said: the gear would have been wound up by as much."""
    geared = with_data_sheet(chain(["motor", "harmonic", "load"]), {"harmonic.N": "100"}).system
    r = Recording("a", "train", "axis", TIME, {}, {"load.phi": 0.5 + TIME}, {"load.phi": "rad"})
    (found,) = begin_elsewhere([r], lambda r: {"load.phi": np.zeros(len(r.time))}, {"axis": geared})
    assert '"load.phi" = "first sample of load.phi"' in found.evidence
    assert '"harmonic.phi_o" = "first sample of load.phi"' in found.evidence
    assert '"motor.phi" = "first sample of load.phi * 100"' in found.evidence


@pytest.mark.parametrize(("begins", "said"), [(0.37, True), (1e-4, False)])
def test_an_angle_that_begins_clearly_elsewhere_is_said_however_far_it_goes(begins: float, said: bool) -> None:
    """A rotary table's motor went through 96 rad, from 0.37 on: its log was drift to the fit, and nobody said why."""
    time = 1e-3 * np.arange(8000)
    noise = 1e-5 * np.random.default_rng(1).standard_normal(len(time))
    angle = begins + 96 * np.sin(np.pi * np.maximum(time - 1.0, 0.0) / 14) ** 2 + noise
    r = Recording("a", "train", "axis", time, {}, {"phi": angle}, {"phi": "rad"})
    system = chain(["motor"]).system
    found = list(begin_elsewhere([r], lambda r: {"phi": np.zeros(len(r.time))}, {"axis": system}))
    assert [s.kind for s in found] == ["start"] * said


@pytest.mark.parametrize(
    ("sheet", "volts", "said"),
    [({}, 30.0, True), ({}, 24.5, False), ({"motor.v_bus": "48 V"}, 30.0, False),
     ({"motor.drive.mode": "current"}, 30.0, False)],
)  # fmt: skip
def test_a_voltage_that_the_supply_has_not_is_said(sheet: dict[str, str], volts: float, said: bool) -> None:
    system = with_data_sheet(chain(["motor", "load"]), sheet).system
    r = Recording("a", "train", "axis", TIME, {"v_command": volts * np.sin(TIME)}, {}, {"v_command": "V"})
    found = list(beyond_limits([r, r], lambda r: {}, {"axis": system}))
    assert [s.kind for s in found] == ["limit"] * said
    if said:
        assert "and motor.inverter.v_bus = 24 V holds the simulation there" in found[0].evidence
        assert not found[0].wrong
