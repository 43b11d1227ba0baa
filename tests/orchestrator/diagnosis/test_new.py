"""`new` and `inspect` as somebody types them who knows neither the names nor the files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.diagnosis.drafts.chain import PARTS, chain, with_data_sheet
from tests.orchestrator.diagnosis.typed import Done


def test_list_shows_what_set_takes_with_values_given_and_writes_nothing(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    done = cobot_joint("new", "--chain", "motor,load", "--set", "motor.R=0.62 Ohm", "--list")
    assert (done.returncode, done.stderr) == (0, "")
    rows = [line.split() for line in done.stdout.replace("│", " ").splitlines()]
    assert any(row[:3] == ["motor.winding.R", "0.62", "Ohm"] for row in rows)
    assert any(row[:3] == ["load.windage.c", "0", "N.m.s2/rad2"] for row in rows)
    assert not any(tmp_path.iterdir())


def test_the_parts_of_a_chain_are_shown_where_none_is_given(cobot_joint: Callable[..., Done]) -> None:
    """`new --list` asked for a --chain first, of parts that nobody had shown."""
    done = cobot_joint("new", "--list")
    assert done.returncode == 0, done.stderr
    assert all(f" {part} " in done.stdout for part in PARTS)


def test_new_writes_over_a_folder_only_where_that_is_asked_for(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """Its own advice, further --set, could not be followed in place."""
    first = ("new", "--chain", "motor,load", "--out", "bench")
    assert cobot_joint(*first).returncode == 0
    system = tmp_path / "bench/system.ssd"
    before = system.read_text()
    again = cobot_joint(*first, "--set", "motor.R=0.62 Ohm")
    assert again.returncode == 2
    assert "--overwrite writes over it" in again.stderr
    assert system.read_text() == before
    assert cobot_joint(*first, "--set", "motor.R=0.62 Ohm", "--overwrite").returncode == 0
    assert "0.62" in system.read_text()


def test_inspect_says_that_there_is_no_such_system_before_it_reads_logs(cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("inspect", "no_log.csv", "--system", "machine/system.ssd")
    assert done.returncode == 2
    assert "system 'machine/system.ssd': there is none" in done.stderr


@pytest.mark.parametrize(
    ("names", "key", "parameter"),
    [
        ("motor,harmonic,link", "harmonic.J", "harmonic.wave_generator.J_coupled"),
        ("motor,harmonic,link", "harmonic.input_inertia", "harmonic.wave_generator.J_coupled"),
        ("motor,harmonic,link", "link.J", "link.arm.J_l"),
        ("motor,harmonic,link", "link.mass", "link.arm.m"),
        ("motor,cycloidal,load", "cycloidal.inertia", "cycloidal.eccentric.J_coupled"),
        ("motor,gear,load", "gear.inertia", "gear.housing.J_coupled"),
        ("motor,gear,load", "motor.J", "motor.rotor.J"),
        ("motor,gear,load", "load.inertia", "load.body.J"),
        ("motor,gear,load", "load.fan", "load.windage.c"),
        ("motor,load", "motor.resistance", "motor.winding.R"),
        ("motor,load", "motor.inductance", "motor.winding.L"),
        ("motor,load", "motor.back_emf_constant", "motor.winding.k"),
        ("motor,load", "motor.friction", "motor.friction.tau_C"),
    ],
)
def test_a_name_that_data_sheets_use_is_the_units_own(names: str, key: str, parameter: str) -> None:
    made = with_data_sheet(chain(names.split(",")), {key: "0.0125"})
    component, _, name = parameter.partition(".")
    (found,) = [c for c in made.system.components if c.name == component]
    assert found.parameters[name] == 0.0125


@pytest.mark.parametrize("given", [True, False])
def test_a_hoist_without_gravity_is_said_to_be_weightless(cobot_joint: Callable[..., Done], given: bool) -> None:
    """Gravity is 0 unless it is given, and a newcomer's hoist lifted nothing."""
    sheet = ["--set", "load.m=12 kg", "--set", "load.lead=0.04", "--set", "load.gravity.slope=90 deg"]
    more = ["--set", "load.gravity.g=9.81"] if given else []
    done = cobot_joint("new", "--chain", "motor,gear,load", *sheet, *more, "--out", "hoist")
    assert done.returncode == 0, done.stderr
    assert ("load is weightless, though a slope is given: --set load.gravity.g=9.81" in done.stdout) != given
