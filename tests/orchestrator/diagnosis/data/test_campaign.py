"""A campaign file says what it wants, or is told in one line what it may say."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from cobot_joint import paths
from cobot_joint.diagnosis.data.campaign import load_campaign, read_campaign_file, system_connectors
from cobot_joint.diagnosis.estimation.calibrate import noises
from cobot_joint.errors import UserError
from cobot_joint.system.read import load_system


def write(folder: Path, toml: str) -> Path:
    t = np.arange(100) * 1e-3
    rows = "\n".join(f"{a},{3 * a},{1000 * a + 5}" for a in t)
    (folder / "run.csv").write_text(f"t,vir,qm\n{rows}\n")
    (folder / "campaign.toml").write_text(toml)
    return folder / "campaign.toml"


AXIS = """system = "axis.ssd"
[channels]
"vir [V]" = "u"
"qm [mm]" = "axis.s"
[tolerances]
"axis.friction.d" = "20 %"
"axis.friction.tau_C" = [0.0, 2.0]
[[recording]]
file = "run.csv"
initial = { "axis.s" = "first sample" }
"""


def test_a_campaign_over_another_system_maps_columns_to_its_connectors(tmp_path: Path, axis: Path) -> None:
    campaign = load_campaign(write(tmp_path, AXIS))
    (r,) = campaign.recordings
    assert set(r.inputs) == {"u"}
    assert set(r.outputs) == {"axis.s"}
    assert r.role == "train"
    assert r.outputs["axis.s"][1] == pytest.approx(6e-3)
    assert r.initial == {"axis.s": pytest.approx(5e-3)}
    assert campaign.tolerances["axis.friction.d"].bounds(-2.0) == pytest.approx((-2.4, -1.6))
    assert campaign.tolerances["axis.friction.tau_C"].bounds(1.0) == (0.0, 2.0)


def test_connectors_are_those_of_the_system_and_of_its_components(axis: Path) -> None:
    found = {(c.name, c.causality, c.unit) for c in system_connectors(axis).values()}
    assert found == {("u", "input", "V"), ("axis.u", "input", "V"), ("axis.F", "input", "N"), ("axis.s", "output", "m")}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            ("[[recording]]", "[[recordings]]"),
            "recordings: no such key, allowed are title, system, setups, parameters, channels, initial, tolerances, "
            "logged, terms, scan, onsets, frequency_response, alternative, recording",
        ),
        (('file = "run.csv"', 'file = "gone.csv"'), "gone.csv: there is no such file"),
        (
            ('file = "run.csv"', 'file = "run.csv"\nrole = "test"'),
            "recording.0.role: 'test' is given; Input should be 'train' or 'holdout'",
        ),
        (('file = "run.csv"', 'file = "run.csv"\nsetup = "hot"'), "setup 'hot' is given, default is allowed"),
        (
            ('"20 %"', '"20"'),
            "tolerances.axis.friction.d: '20' is given, \"20 %\" (more than 0 %) or [lower, upper] is",
        ),
        (('"axis.s"\n', '"axis.x"\n'), "'axis.x': axis.ssd has no such connector, it has u, axis.s, axis.F, axis.u"),
        (('"axis.ssd"', '"exo.ssd"'), "system 'exo.ssd': there is no"),
        (
            ('"axis.ssd"', '"exo"'),
            "system 'exo' is given, allowed are current_sensor_calibration, joint, ",
        ),
        (("[[recording]]", "[[recording"), "not a TOML file"),
        (("qm [mm]", "qm [A]"), "unit 'A' is given, one that converts to 'm' is needed"),
    ],
)
def test_a_wrong_campaign_is_refused_in_one_line(
    tmp_path: Path, axis: Path, change: tuple[str, str], told: str
) -> None:
    with pytest.raises(UserError) as error:
        load_campaign(write(tmp_path, AXIS.replace(*change)))
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_a_campaign_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="there is no such campaign file"):
        load_campaign(tmp_path / "campaign.toml")


def test_every_shipped_system_is_a_campaigns_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(
        "t [s],u [V],w [rad/s]\n" + "".join(f"{k / 100},{k % 7},{k}\n" for k in range(99))
    )
    (tmp_path / "campaign.toml").write_text(
        'system = "joint_no_load"\n[channels]\n"u [V]" = "v_command"\n"w [rad/s]" = "w_motor"\n'
        '[tolerances]\n"motor_bldc.winding.R" = "10 %"\n[[recording]]\nfile = "run.csv"\n'
    )
    campaign = load_campaign(tmp_path)
    assert [system.name for system in campaign.systems().values()] == ["joint_no_load"]
    assert set(campaign.tolerances) == {"motor_bldc.winding.R"}


def test_an_open_campaign_reads_without_a_word(root: Path) -> None:
    campaign = load_campaign(root / "proof/open/case01")
    assert [(r.name, r.setup, r.role, len(r.time)) for r in campaign.recordings] == [
        ("noload", "no_load", "train", 16001),
        ("load", "loaded", "train", 16001),
        ("reversals", "loaded", "train", 16001),
        ("holdout", "loaded", "holdout", 16001),
    ]
    assert not any(r.notes for r in campaign.recordings)
    assert set(campaign.train[0].inputs) == {"v_command"}
    assert set(campaign.train[0].outputs) == {"i_motor", "w_motor"}


def test_what_the_campaign_says_of_noise_replaces_the_estimate(tmp_path: Path, axis: Path) -> None:
    logged = '[logged."axis.s"]\nunit = "m"\ncausality = "output"\nnoise = 0.5\ncolour = 0.25\n'
    noise = noises(load_campaign(write(tmp_path, AXIS + logged)))["axis.s"]
    assert (noise.sigma, noise.colour) == (0.5, 0.25)


def test_noise_that_the_campaign_says_is_believed_below_what_the_recordings_show(root: Path, tmp_path: Path) -> None:
    case = shutil.copytree(root / "proof/open/case01", tmp_path / "case01")
    assert noises(load_campaign(case))["w_motor"].sigma > 0.3
    with (case / "campaign.toml").open("a") as file:
        file.write("[logged]\nw_motor = { noise = 0.1 }\n")
    assert noises(load_campaign(case))["w_motor"].sigma == 0.1


def test_what_the_joint_brings_fits_its_systems() -> None:
    """Logged channels are connectors of every set-up that has them, tolerances are parameters of its units."""
    given = read_campaign_file(paths.folder("systems") / "joint.campaign.toml")
    parameters: set[str] = set()
    for setup, file in given.setups.items():
        path = paths.folder("systems") / file
        offered = system_connectors(path)
        for name, channel in given.logged.items():
            if channel.setups is None or setup in channel.setups:
                assert (offered[name].causality, offered[name].unit) == (channel.causality, channel.unit)
        for component in load_system(path).components:
            parameters |= {f"{component.name}.{name}" for name in component.unit.variables}
    assert len(given.tolerances) == 19
    assert set(given.tolerances) <= parameters
    assert set(given.channels.values()) == set(given.logged)


def column(entry: str) -> str:
    return AXIS.replace('"qm [mm]" = "axis.s"', f'"qm" = {entry}')


@pytest.mark.parametrize(
    ("entry", "first"),
    [
        ('{ to = "axis.s", scale = 1e-3 }', 5e-3),
        ('{ to = "axis.s", scale = "2 mm" }', 10e-3),
        ('{ to = "axis.s", scale = 1e-3, sign = -1 }', -5e-3),
        ('{ to = "axis.s", scale = 1e-3, sign = -1, offset = 1.0 }', 0.995),
        ('{ to = "axis.s", scale = 1e-3, offset = "10 mm" }', 15e-3),
        ('{ to = "axis.s", scale = 1e-3, offset = "-2 mm" }', 3e-3),
    ],
)
def test_a_column_has_a_scale_a_sign_and_an_offset_of_its_own(
    tmp_path: Path, axis: Path, entry: str, first: float
) -> None:
    (r,) = load_campaign(write(tmp_path, column(entry))).recordings
    assert r.outputs["axis.s"][0] == pytest.approx(first)


def test_a_column_in_percent_of_a_rated_value_is_read_with_that_value_as_its_scale(tmp_path: Path, axis: Path) -> None:
    entry = '"qm [%]" = { to = "axis.s", scale = "40 mm" }'
    (r,) = load_campaign(write(tmp_path, AXIS.replace('"qm [mm]" = "axis.s"', entry))).recordings
    assert r.outputs["axis.s"][0] == pytest.approx(0.05 * 0.04)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (('"qm [mm]"', '"qn [mm]"'), "run.csv: no column 'qn' for 'axis.s'; the file has vir, qm; the nearest is 'qm'"),
        (('"vir [V]"', '"v_ir [V]"'), "no column 'v_ir' for 'u'; the file has vir, qm; the nearest is 'vir'"),
        (('"axis.s"\n', '"axis.S"\n'), "it has u, axis.s, axis.F, axis.u; the nearest is 'axis.s'"),
        (('"qm [mm]" = "axis.s"', '"qm [mm]" = "axis.s"\n"vir" = "axis.s"'), "'vir' are both there for 'axis.s'"),
        (("qm [mm]", "qm [0 mm]"), "unit '0 mm' is given, its factor has to be positive"),
        (("qm [mm]", "qm [9**9**9**9]"), "unit '9**9**9**9' is given, an SI spelling"),
        (('"qm [mm]" = "axis.s"', '"qm" = { to = "axis.s", scale = "2 V" }'), "one that converts to 'm' is needed"),
        (
            ('"qm [mm]" = "axis.s"', '"qm" = { to = "axis.s", gain = 2 }'),
            "no such key, allowed are to, scale, sign, offset, derivative",
        ),
        (
            ('"qm [mm]" = "axis.s"', '"qm" = { to = "axis.s", sign = 2 }'),
            "channels.qm.sign: 2 is given; Input should be 1 or -1",
        ),
    ],
)
def test_what_would_be_read_wrongly_is_refused_in_one_line(
    tmp_path: Path, axis: Path, change: tuple[str, str], told: str
) -> None:
    with pytest.raises(UserError) as error:
        load_campaign(write(tmp_path, AXIS.replace(*change)))
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_a_channel_that_was_not_recorded_is_left_out_where_the_campaign_says_so(tmp_path: Path, axis: Path) -> None:
    lacking = AXIS.replace("vir [V]", "u_mot [V]").replace('file = "run.csv"', 'file = "run.csv"\nwithout = ["u"]')
    (r,) = load_campaign(write(tmp_path, lacking)).recordings
    assert r.inputs == {}
    assert "u is not recorded and stays at its start value" in r.notes


def test_a_pattern_stands_for_the_files_that_no_other_entry_names(tmp_path: Path, axis: Path) -> None:
    path = write(tmp_path, AXIS.replace('"run.csv"', '"*.csv"') + '[[recording]]\nfile = ["b.csv"]\nrole = "holdout"\n')
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text((tmp_path / "run.csv").read_text())
    campaign = load_campaign(path)
    assert [(r.name, r.role) for r in campaign.recordings] == [("a", "train"), ("run", "train"), ("b", "holdout")]


def test_start_values_of_all_recordings_may_stand_at_the_top_and_have_a_factor(tmp_path: Path, axis: Path) -> None:
    own = 'initial = { "axis.s" = "first sample" }'
    top = AXIS.replace("[channels]", '[initial]\n"axis.s" = "first sample * 2"\n[channels]')
    (r,) = load_campaign(write(tmp_path, top.replace(own, ""))).recordings
    assert r.initial == {"axis.s": pytest.approx(10e-3)}
    (r,) = load_campaign(write(tmp_path, top.replace('"first sample" }', '"first sample of axis.s / 5" }'))).recordings
    assert r.initial == {"axis.s": pytest.approx(1e-3)}


def test_a_start_value_may_have_a_unit_and_what_is_none_is_refused_with_what_may_stand(
    tmp_path: Path, axis: Path
) -> None:
    own = 'initial = { "axis.s" = "first sample" }'
    (r,) = load_campaign(write(tmp_path, AXIS.replace(own, 'initial = { "axis.s" = "2.5 mm" }'))).recordings
    assert r.initial == {"axis.s": pytest.approx(2.5e-3)}
    allowed = r"'2,5 mm' is given, a number, a quantity \('22.5 deg'\) or 'first sample of CHANNEL' is allowed"
    with pytest.raises(UserError, match=allowed):
        load_campaign(write(tmp_path, AXIS.replace(own, 'initial = { "axis.s" = "2,5 mm" }')))


def test_a_force_that_nothing_gives_is_warned_of_before_anything_is_read(
    tmp_path: Path, axis: Path, caplog: pytest.LogCaptureFixture
) -> None:
    load_campaign(write(tmp_path, AXIS))
    assert f"{axis}: axis.F is not connected and stays at 0 N" in caplog.text


def test_a_column_may_give_an_input_of_a_component(tmp_path: Path, axis: Path) -> None:
    campaign = load_campaign(write(tmp_path, AXIS.replace('"vir [V]" = "u"', '"vir [N]" = "axis.F"')))
    (system,) = campaign.systems().values()
    assert system.inputs["axis.F"].unit == "N"
    assert [(c.sink_component, c.sink) for c in system.connections if c.source == "axis.F"] == [("axis", "F")]
    assert list(campaign.recordings[0].inputs) == ["axis.F"]


def test_a_column_for_an_input_that_is_wired_is_refused(tmp_path: Path, axis: Path) -> None:
    with pytest.raises(UserError, match=r"axis\.u is given a column, but u is wired to it"):
        load_campaign(write(tmp_path, AXIS.replace('"vir [V]" = "u"', '"vir [V]" = "axis.u"')))


def test_recordings_of_one_name_in_two_folders_are_told_apart(tmp_path: Path, axis: Path) -> None:
    path = write(tmp_path, AXIS.replace('"run.csv"', '["run.csv", "day1/run.csv", "day2/run.csv"]'))
    for day in ("day1", "day2"):
        (tmp_path / day).mkdir()
        shutil.copy(tmp_path / "run.csv", tmp_path / day)
    assert [r.name for r in load_campaign(path).recordings] == ["run.csv", "day1/run.csv", "day2/run.csv"]


def test_windows_whose_times_print_alike_are_told_apart(tmp_path: Path, axis: Path) -> None:
    again = 'begin = BEGIN\nend = END\ninitial = { "axis.s" = "first sample" }\n'
    first = AXIS.replace('initial = { "axis.s" = "first sample" }\n', again)
    both = first + '[[recording]]\nfile = "run.csv"\n' + again
    path = write(tmp_path, both.replace("BEGIN", "1700000000.00", 1).replace("END", "1700000000.04", 1))
    path.write_text(path.read_text().replace("BEGIN", "1700000000.05").replace("END", "1700000000.09"))
    rows = "\n".join(f"{1.7e9 + a:.3f},{3 * a},{1000 * a + 5}" for a in np.arange(100) * 1e-3)
    (tmp_path / "run.csv").write_text(f"t,vir,qm\n{rows}\n")
    one, other = (r.name for r in load_campaign(path).recordings)
    assert one != other


def test_a_campaign_all_of_whose_recordings_are_held_out_is_refused(tmp_path: Path, axis: Path) -> None:
    path = write(tmp_path, AXIS + 'role = "holdout"\n')
    with pytest.raises(UserError, match=r"every .* has role holdout, one at least with role train is needed"):
        load_campaign(path)
    assert load_campaign(path, roles=("holdout",)).recordings
    with pytest.raises(UserError, match=r"recording\.0\.file"):
        load_campaign(write(tmp_path, AXIS.replace('"run.csv"', "[]")))


def test_a_campaign_file_may_begin_with_a_byte_order_mark(tmp_path: Path, axis: Path) -> None:
    path = write(tmp_path, AXIS)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_campaign(path).recordings


def test_a_column_that_is_left_away_may_be_empty(tmp_path: Path, axis: Path) -> None:
    path = write(tmp_path, AXIS.replace('file = "run.csv"', 'file = "run.csv"\nwithout = ["vir"]'))
    (tmp_path / "run.csv").write_text("t,vir,qm\n" + "\n".join(f"{k * 1e-3},,{k + 5}" for k in range(100)))
    (r,) = load_campaign(path).recordings
    assert r.inputs == {}


def test_a_campaign_says_where_shapes_are_looked_for_and_that_nothing_sets_in(campaign_file: Path) -> None:
    text = campaign_file.read_text()
    keys = 'onsets = false\n[scan]\n"motor_bldc.stribeck.w_S" = [1e-3, 0.2]\n'
    given = campaign_file.with_name("scanned.toml")
    given.write_text(text.replace("[[recording]]", f"{keys}[[recording]]", 1))
    campaign = load_campaign(given)
    assert campaign.scan == {"motor_bldc.stribeck.w_S": (1e-3, 0.2)}
    assert (campaign.onsets, load_campaign(campaign_file).onsets) == (False, True)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("stribeck.w = [1, 2]", "no term has such a shape, allowed are motor_bldc.stribeck.w_S"),
        ("stribeck.w_S = [2, 1]", "[2, 1] is given, [lower, upper] is allowed"),
        ("stribeck.w_S = 1.0", "1.0 is given, [lower, upper] is allowed"),
        ("stribeck.w_S = [0.0, 1.0]", "[0, 1] is given, motor_bldc.fmu allows 1e-06 to 10000"),
        ("cogging.n = [0.0, 24.0]", "[0, 24] is given, motor_bldc.fmu allows 1 to 1000"),
        ("cogging.n = [6.2, 6.8]", "[6.2, 6.8] is given, a whole number in between is needed"),
        ("cogging.phi_0 = [0.0, 1.0]", "no term has such a shape"),
    ],
)
def test_a_range_that_no_scan_can_have_is_refused_in_one_line(tmp_path: Path, line: str, told: str) -> None:
    name, given = line.split(" = ")
    scan = f'[scan]\n"motor_bldc.{name}" = {given}\n'
    with pytest.raises(UserError) as error:
        load_campaign(write(tmp_path, f'system = "joint"\n{scan}[[recording]]\nfile = "run.csv"\n'))
    assert told in str(error.value)
    assert "\n" not in str(error.value)
