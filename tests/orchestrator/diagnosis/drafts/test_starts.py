"""Where drafted simulations begin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.drafts.campaign_text import Guess
from cobot_joint.diagnosis.drafts.chain import chain, with_data_sheet
from cobot_joint.diagnosis.drafts.starts import starts
from cobot_joint.system.model import Inputs, System
from tests.orchestrator.diagnosis.typed import Done

ARM = {"gear.N": "50", "gear.mesh.b": "0", "link.m": "2 kg", "link.r": "0.3 m"}


def arm(*, gravity: bool = True) -> System:
    sheet = ARM if gravity else ARM | {"link.m": "0 kg"}
    return with_data_sheet(chain(["motor", "gear", "link"]), sheet).system


def logged(connector: str, first: float, unit: str = "rad") -> Guess:
    t = 0.01 * np.arange(200)
    return Guess(Channel("q", unit, t, first + 0.2 * (1 - np.cos(t))), connector, "")


def test_all_that_turns_with_an_arm_begins_where_its_log_does() -> None:
    """It had begun hanging down, at 0, whatever the arm's log said, and gravity pulled at another place."""
    found = starts(arm(), [logged("phi_link", 0.8)])
    of_arm = "first sample of phi_link"
    assert found == {"link.phi_p": of_arm, "gear.phi_o": of_arm, "motor.phi": f"{of_arm} * 50"}


def test_of_a_motors_angle_the_shafts_behind_the_gear_have_their_part() -> None:
    found = starts(arm(), [logged("motor.phi", 40.0)])
    of_motor = "first sample of motor.phi"
    assert found == {"motor.phi": of_motor, "gear.phi_o": f"{of_motor} * 0.02", "link.phi_p": f"{of_motor} * 0.02"}


def test_a_log_that_begins_at_nought_and_two_angles_of_which_nobody_knows_the_zero_say_nothing() -> None:
    assert starts(arm(), [logged("phi_link", 0.0)]) == {}
    assert starts(arm(), [logged("phi_link", 0.8), logged("motor.phi", 3.0)]) == {}


def test_an_angle_that_begins_elsewhere_in_a_further_log_is_said_as_well() -> None:
    """Of three logs of a pendulum the second began at 20 degrees, and nothing stood in [initial]."""
    first, second = logged("phi_link", 0.0), logged("phi_link", 0.35)
    assert starts(arm(), [first], [[first.column]]) == {}
    assert "link.phi_p" in starts(arm(), [first], [[first.column], [second.column]])


def test_a_screws_way_begins_where_its_log_does() -> None:
    assert starts(chain(["motor", "screw"]).system, [logged("s", 0.05, "m")]) == {"screw.s": "first sample of s"}


def test_a_body_begins_at_the_speed_at_which_its_log_does() -> None:
    """One that coasts had no line in [initial], and neither had a wheel that a torque drives."""
    load = chain(["load"]).system
    t = 0.01 * np.arange(2000)
    speed = Guess(Channel("n", "rpm", t, 800 * np.exp(-t)), "w_load", "")
    assert starts(load, [speed]) == {"load.x_w": "first sample of w_load"}
    torque = Guess(Channel("tau", "N.m", t, np.sin(t)), "tau", "")
    assert starts(load, [speed, torque]) == {"load.x_w": "first sample of w_load"}
    at_rest = Guess(Channel("n", "rpm", t, np.sin(t)), "w_load", "")
    assert starts(load, [at_rest]) == {}
    swings = {"link.phi_p": "first sample of phi_link"}
    assert starts(chain(["link"]).system, [logged("phi_link", 0.8)]) == swings


def test_all_that_turns_with_a_motor_begins_at_its_speed() -> None:
    """A carriage's way is no angle: its screw has the speed."""
    geared = chain(["motor", "gear", "screw"]).system
    N = float(geared.component("gear").parameters.get("ratio.N", 113))
    t = 0.01 * np.arange(200)
    found = starts(geared, [Guess(Channel("n", "rpm", t, 300 + 0 * t), "w_motor", "")])
    of_motor = "first sample of w_motor"
    assert found == {
        "motor.w": of_motor,
        "gear.w_o": f"{of_motor} * {1 / N:.12g}",
        "screw.x_w": f"{of_motor} * {1 / N:.12g}",
    }


def test_no_spring_is_wound_up_where_a_drafted_simulation_begins() -> None:
    """Without gravity and drive, nothing moves; from the arm's angle alone the shaft would throw it back."""
    system = arm(gravity=False)
    drafted = {name: 0.8 * float(start.partition(" * ")[2] or 1) for name, start in
               starts(system, [logged("phi_link", 0.8)]).items()}  # fmt: skip
    ends = []
    for given in (drafted, {"link.phi_p": 0.8}):
        with Simulation(system) as simulation:
            record = ["link.phi_p", "motor.phi"]
            run = simulation.run(Experiment(Inputs(np.zeros(1)), 0.5, parameters=given, record=record)).signals
        ends.append(float(np.ptp(run["link.phi_p"])))
    assert ends[0] == pytest.approx(0.0, abs=1e-9)
    assert ends[1] > 0.1


@pytest.mark.parametrize(("parts", "coasts"), [("link", True), ("motor,gear,link", False)])
def test_only_a_body_alone_is_said_to_coast(
    tmp_path: Path, cobot_joint: Callable[..., Done], parts: str, coasts: bool
) -> None:
    """A motor whose voltage was not logged was to coast from the angle at which its log began."""
    assert cobot_joint("new", "--chain", parts, "--out", "m").returncode == 0
    t = 0.01 * np.arange(400)
    rows = np.column_stack([t, 0.8 + 0.1 * np.sin(3 * t)])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t [s],phi_link [rad]", comments="")
    done = cobot_joint("inspect", "run.csv", "--system", "m/system.ssd", "--out", "f")
    assert "first sample of phi_link" in (tmp_path / "f/campaign.toml").read_text()
    assert ("each run coasts" in done.stdout, "`diagnose` needs one" in done.stdout) == (coasts, not coasts)
