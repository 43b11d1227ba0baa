"""What does not fit the system is refused when a campaign is loaded: what was given, what is allowed, where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.frequency.response import load_response
from cobot_joint.errors import UserError

CAMPAIGN = """system = "joint"
terms = ["motor_bldc.cogging"]
[tolerances]
"motor_bldc.winding.R" = "20 %"
[logged.w_motor]
unit = "rad/s"
causality = "output"
noise = 0.3
[[recording]]
file = "run.csv"
setup = "no_load"
initial = { "motor_bldc.w" = 1.0, "planetary_gear.phi_o" = "first sample of w_motor" }
"""
RUN = 'file = "run.csv"\n'
TOLERANCE = '"motor_bldc.winding.R" = "20 %"'
WRONG = [
    ("[logged.w_motor]", '[channels]\ni_motor = { to = "i_motor", mean = true }\n[logged.w_motor]',
     "[channels] 'i_motor': mean is given, for 'i_motor': a speed whose unit has its position as well is allowed"),
    (TOLERANCE, '"motor_bldc.winding.r" = "20 %"',
     "[tolerances] 'motor_bldc.winding.r': no such parameter, allowed are motor_bldc.winding."),
    (TOLERANCE, '"motor_bldc.w" = "20 %"', "[tolerances] 'motor_bldc.w': no such parameter, allowed are "),
    (TOLERANCE, '"motor_bldc.winding.R" = "0 %"', "'0 %' is given, \"20 %\" (more than 0 %) or [lower, upper]"),
    (TOLERANCE, '"motor_bldc.winding.R" = "-5 %"', "'-5 %' is given, \"20 %\" (more than 0 %) or [lower, upper]"),
    (TOLERANCE, '"motor_bldc.winding.R" = [0.3, 0.2]', "[0.3, 0.2] is given, \"20 %\" (more than 0 %) or"),
    (TOLERANCE, '"motor_bldc.winding.R" = [0, inf]', "[0, inf] is given, \"20 %\" (more than 0 %) or [lower, upper]"),
    (TOLERANCE, '"motor_bldc.winding.R" = [-1, 1]', "[-1, 1] is given, motor_bldc.fmu allows 1e-06 to 10000"),
    (TOLERANCE, '"motor_bldc.cogging.A" = "5 %"', "a share of its nominal value is given, which is 0; [lower, upper]"),
    ('terms = ["motor_bldc.cogging"]', 'terms = ["motor_bldc.coging"]',
     "terms: 'motor_bldc.coging' is given, motor_bldc.cogging"),
    ("noise = 0.3", "noise = -0.3", "logged.w_motor.noise: -0.3 is given; Input should be greater than 0"),
    ("noise = 0.3", "noise = nan", "logged.w_motor.noise: nan is given; Input should be a finite number"),
    ("noise = 0.3", "step = -1", "logged.w_motor.step: -1 is given; Input should be greater than or equal to 0"),
    ("noise = 0.3", 'setups = ["zz"]', "[logged] 'w_motor': setups: 'zz' is given, loaded, no_load is allowed"),
    ("noise = 0.3", "nosie = 0.3", "logged.w_motor.nosie: no such key, allowed are unit, causality, noise"),
    ("[logged.w_motor]", "[logged.w_moto]",
     "[logged] 'w_moto': no such connector of set-up 'loaded' (`setups` says which have it), allowed are w_motor"),
    ('unit = "rad/s"', 'unit = "V"', "[logged] 'w_motor': unit 'V' is given, one that converts to 'rad/s' is needed"),
    ('causality = "output"', 'causality = "input"', "[logged] 'w_motor': causality: 'input' is given, it is an output"),
    (RUN, RUN + "begin = true\n", "recording.0.begin: True is given; Input should be a valid number"),
    (RUN, RUN + 'begin = "2"\n', "recording.0.begin: '2' is given; Input should be a valid number"),
    (RUN, RUN + "begin = 2\nend = 1\n", "begin = 2, end = 1 is given, begin has to be before end"),
    (RUN, RUN + 'time = "time [V]"\n',
     "recording 'run.csv': time = 'time [V]': unit 'V' is given, one that converts to 's' is needed"),
    ('"motor_bldc.w" = 1.0', '"motor_bldc.winding.R" = 1.0',
     "initial 'motor_bldc.winding.R': a parameter is given, start values are allowed; parameters belong to"),
    ('"motor_bldc.w" = 1.0', '"motor_bldc.i" = 1.0', "initial 'motor_bldc.i': no start value of the system, allowed"),
    ('"motor_bldc.w" = 1.0', '"w_motor" = 1.0', "initial 'w_motor': no start value of the system, allowed are"),
    ('"motor_bldc.w" = 1.0', '"motor_bldc.w" = true', "recording.0.initial.motor_bldc.w"),
    (RUN, RUN + 'parameters = { "motor_bldc.k" = 1 }\n',
     "recording 'run.csv': parameters: motor_bldc.k: no variable of motor_bldc.fmu"),
]  # fmt: skip


def write(folder: Path, text: str) -> Path:
    rows = "\n".join(f"{a},{a},{a},{a}" for a in np.arange(50) * 1e-3)
    (folder / "run.csv").write_text(f"time,v_command,i_motor,w_motor\n{rows}\n")
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def test_a_campaign_that_fits_is_taken(tmp_path: Path) -> None:
    assert load_campaign(write(tmp_path, CAMPAIGN)).recordings[0].initial["motor_bldc.w"] == 1.0


@pytest.mark.parametrize(("old", "new", "told"), WRONG, ids=[f"{k}" for k in range(len(WRONG))])
def test_what_does_not_fit_the_system_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert old in CAMPAIGN
    path = write(tmp_path, CAMPAIGN.replace(old, new))
    (tmp_path / "run.csv").unlink()  # before a recording is read
    with pytest.raises(UserError) as refused:
        load_campaign(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


RESPONSE = """system = "joint_no_load"
[frequency_response]
input = "v_command"
amplitude = 0.3
output = "w_motor"
[[alternative]]
name = "one"
parameters = { "motor_bldc.bias.from" = "measured_speed" }
[[recording]]
file = "table.csv"
"""


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"v_command"', '"v"', "frequency_response.input: 'v' is given, v_command"),
        ('"w_motor"', '"w"', "frequency_response.output: 'w' is given, i_motor, w_motor"),
        ("0.3", "true", "frequency_response.amplitude: True is given; Input should be a valid number"),
        ("0.3", "0", "frequency_response.amplitude: 0 is given; Input should be greater than 0"),
        ("amplitude", "amplitud", "frequency_response.amplitud: no such key, allowed are input, amplitude"),
        ("measured_speed", "speed", "alternative 'one': motor_bldc.bias.from: 'speed' is given, measured_speed"),
        ("[[alt", '[tolerances]\n"motor_bldc.R" = "5 %"\n[[alt', "[tolerances] 'motor_bldc.R': no such parameter"),
        ("[[alt", '[parameters]\n"motor_bldc.R" = 5\n[[alt', "[parameters]: motor_bldc.R: no variable of motor_bldc"),
    ],
)
def test_a_frequency_response_that_does_not_fit_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    (tmp_path / "campaign.toml").write_text(RESPONSE.replace(old, new, 1))
    with pytest.raises(UserError) as refused:
        load_response(tmp_path)
    assert str(refused.value).startswith(f"{tmp_path / 'campaign.toml'}: ")
    assert told in str(refused.value)
