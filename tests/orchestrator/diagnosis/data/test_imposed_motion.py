"""Recorded motion drives what it is wired to as it moved, less the noise that can be told from motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.conditioning import smoothed, with_place
from cobot_joint.diagnosis.data.parameters import imposed, moving_starts
from cobot_joint.diagnosis.drafts.chain import chain, with_data_sheet
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.system.write import write_ssp

T = np.arange(5000) * 2e-3
SIGMA = 0.02


@pytest.mark.parametrize(
    ("parts", "starts"),
    [
        (["motion", "sensor", "load"], {"load.x_w": 2.0}),
        (["motion", "elastic", "link"], {"link.w_p": 2.0}),
        (["motion", "gear", "sensor", "load"], {"gear.w_o": 0.04, "load.x_w": 0.04}),
        (["motor", "gear", "sensor", "load"], {}),
    ],
)
def test_what_recorded_motion_drives_turns_with_it_at_the_first_sample(
    parts: list[str], starts: dict[str, float]
) -> None:
    given = {"gear.N": "50"} if "gear" in parts and "motion" in parts else {}
    system = with_data_sheet(chain(parts), given).system
    assert moving_starts(system, {"w": 2.0 * np.cos(T)}) == pytest.approx(starts)


def test_what_begins_at_rest_is_left_at_rest() -> None:
    system = chain(["motion", "sensor", "load"]).system
    w = 2.0 * np.sin(T) + np.random.default_rng(1).normal(0, 1e-3, len(T))
    assert moving_starts(system, {"w": w}) == {}


def test_a_log_that_begins_in_motion_does_not_ring(tmp_path: Path) -> None:
    """A healthy axis was said to have an effect on no list at its sensor, 95 % sure: a load that was left at rest rang
    on its spring."""
    system = with_data_sheet(chain(["motion", "sensor", "load"]), {"load.J": "0.05 kg.m2"}).system
    write_ssp(system, tmp_path / "axis.ssp")
    tau = -0.05 * 2 * np.sin(T)  # J dw/dt
    rows = np.column_stack([T, 2 * np.cos(T), tau])
    head = "time [s],w [rad/s],tau_sensor [N.m]"
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=head, comments="")
    own = 'system = "axis.ssp"\n[channels]\nw = "w"\ntau_sensor = "tau_sensor"\n[[recording]]\nfile = "run.csv"\n'
    (tmp_path / "campaign.toml").write_text(own)
    (tmp_path / "given.toml").write_text(own + 'initial = { "load.x_w" = 0.0 }\n')
    left = {}
    for name in ("campaign", "given"):
        campaign = load_campaign(tmp_path / f"{name}.toml")
        (recording,) = campaign.recordings
        with FmuPlant(campaign.systems()) as plant:
            left[name] = np.std(plant.simulate({}, recording)["tau_sensor"] - tau)
        assert any("begins in motion" in note for note in recording.notes) == (name == "campaign")
    assert left["campaign"] < 0.05 * np.std(tau) < left["given"]


@pytest.mark.parametrize(("frequency", "most"), [(0.3, 0.4), (2.0, 0.6)])
@pytest.mark.parametrize("colour", [0.0, 0.4])
def test_a_speed_loses_noise_and_no_motion(frequency: float, most: float, colour: float) -> None:
    rng = np.random.default_rng(2)
    white = rng.normal(0, SIGMA, len(T) + 50)
    noise = np.convolve(white, colour ** np.arange(50), "valid")[: len(T)] * np.sqrt(1 - colour**2)
    w = np.sin(2 * np.pi * frequency * T)
    found, width = smoothed(w + noise)
    assert width > 1
    assert np.std(found - w) < most * np.std(noise) * (1 + 2 * colour)


def test_a_speed_without_noise_that_a_cubic_follows_or_that_is_all_motion_is_left_as_it_is() -> None:
    quick = np.sign(np.sin(2 * np.pi * 40 * T))
    assert smoothed(quick)[1] == 1
    np.testing.assert_array_equal(smoothed(quick)[0], quick)
    np.testing.assert_array_equal(smoothed(np.zeros(len(T)))[0], np.zeros(len(T)))
    w = np.sin(2 * np.pi * 0.5 * T)
    np.testing.assert_allclose(smoothed(w)[0], w, atol=1e-4)


def test_only_inputs_that_are_motion_are_smoothed() -> None:
    assert imposed(chain(["motion", "sensor", "load"]).system, {"w": T, "x": T}) == ["w"]
    assert imposed(chain(["motor", "load"]).system, {"v_command": T}) == []


def test_the_integral_of_a_recorded_speed_follows_the_position_of_its_shaft() -> None:
    """A speed's offset and noise add up: an arm's angle, known to 7.5e-6 rad, was 40 times that off, and nothing that
    acts on a machine could have explained it."""
    rng, truth = np.random.default_rng(3), np.sin(2 * np.pi * 0.3 * T)
    phi = (1 - np.cos(2 * np.pi * 0.3 * T)) / (2 * np.pi * 0.3) + 0.7
    w = truth + 0.01 + rng.normal(0, 0.02, len(T))
    read = phi + rng.normal(0, 1e-5, len(T))
    read[200:230] = np.nan  # not recorded
    step = float(T[1] - T[0])
    both = with_place(w, read, step)
    assert both is not None
    found, off = both
    way = 0.7 + np.concatenate([[0.0], np.cumsum((found[1:] + found[:-1]) / 2 * step)])
    drifted = 0.7 + np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2 * step)])
    assert np.abs(way - way[0] - (phi - phi[0])).max() < 0.1 * np.abs(drifted - phi).max()
    assert off == pytest.approx(0.01, rel=0.3)
    assert np.std(found - truth) < 1.1 * np.std(w - truth)


def test_the_position_of_the_shaft_that_recorded_motion_drives_is_not_compared(tmp_path: Path) -> None:
    system = with_data_sheet(chain(["motion", "sensor", "load"]), {"load.J": "0.05 kg.m2"}).system
    write_ssp(system, tmp_path / "axis.ssp")
    rows = np.column_stack([T, 2 * np.cos(T) + 0.05, 2 * np.sin(T), -0.1 * np.sin(T)])
    head = "time [s],w [rad/s],q [rad],tau_sensor [N.m]"
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=head, comments="")
    own = 'system = "axis.ssp"\n[channels]\nw = "w"\nq = "motion.phi"\ntau_sensor = "tau_sensor"\n'
    (tmp_path / "campaign.toml").write_text(own + '[[recording]]\nfile = "run.csv"\n')
    (recording,) = load_campaign(tmp_path / "campaign.toml").recordings
    assert list(recording.outputs) == ["tau_sensor"]
    assert recording.inputs["w"][100:-100] == pytest.approx(2 * np.cos(T[100:-100]), abs=2e-3)
    assert any("its integral follows motion.phi" in note and "0.05 rad/s off" in note for note in recording.notes)


@pytest.mark.parametrize(
    "read",
    [np.rad2deg(np.sin(T)), -np.sin(T), np.cos(3 * T), np.full(len(T), np.nan), np.zeros(len(T))],
    ids=["in degrees", "inverted", "of another shaft", "not recorded", "at rest"],
)
def test_a_position_that_is_not_the_speeds_integral_stays_to_be_compared(read: np.ndarray) -> None:
    """Else a wrong unit or sign would be believed, and the speed bent to it."""
    assert with_place(np.cos(T), read, float(T[1] - T[0])) is None
