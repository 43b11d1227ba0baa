"""What is wrong with a log is found, repaired and said; nothing is lost in silence."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.clock import regular_clock, unwrapped
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert, split_header
from cobot_joint.diagnosis.data.recording import Column, Connector, Reading, Recording, read_recording, said_once
from cobot_joint.errors import UserError

CONNECTORS = {
    "v": Connector("v", "input", "V"),
    "w": Connector("w", "output", "rad/s"),
    "i": Connector("i", "output", "A"),
}
T = np.arange(1000) * 1e-3
SIGNALS = {"v [V]": 2 * T, "w [rad/s]": 100 * np.sin(5 * T), "i [A]": np.cos(5 * T)}


def read(tmp_path: Path, stamps: np.ndarray, signals: dict[str, np.ndarray], **more) -> Recording:
    pa.parquet.write_table(pa.table({"time [s]": stamps} | signals), tmp_path / "run.parquet")
    return read_recording(tmp_path / "run.parquet", CONNECTORS, {"v": "v", "w": "w", "i": "i"}, Reading(**more))


def test_a_clean_log_passes_untouched_and_without_a_word(tmp_path: Path) -> None:
    r = read(tmp_path, T, SIGNALS)
    assert r.notes == []
    assert np.array_equal(r.outputs["w"], SIGNALS["w [rad/s]"])
    assert np.array_equal(r.inputs["v"], SIGNALS["v [V]"])
    assert np.allclose(r.time, T, atol=1e-12)
    assert r.step == pytest.approx(1e-3)


def test_repeated_stamps_are_dropped_and_said(tmp_path: Path) -> None:
    index = np.sort(np.concatenate([np.arange(1000), [100, 500, 500]]))
    r = read(tmp_path, T[index], {n: v[index] for n, v in SIGNALS.items()})
    assert r.notes == ["the clock repeats 3 time stamps, the first sample of each is used"]
    assert np.array_equal(r.outputs["w"], SIGNALS["w [rad/s]"])


def test_strays_are_sorted_and_said(tmp_path: Path) -> None:
    index = np.arange(1000)
    index[[300, 301]] = index[[301, 300]]
    r = read(tmp_path, T[index], {n: v[index] for n, v in SIGNALS.items()})
    assert "runs backward 1 times" in r.notes[0]
    assert np.array_equal(r.outputs["w"], SIGNALS["w [rad/s]"])


def test_a_clock_that_restarts_is_cut_to_its_longest_piece_and_the_loss_is_counted(tmp_path: Path) -> None:
    r = read(
        tmp_path,
        np.concatenate([T[:300], T[:700]]),
        {n: np.concatenate([v[:300], v[:700]]) for n, v in SIGNALS.items()},
    )
    assert len(r.time) == 700
    assert "restarts 1 times (first at 0.299 s)" in r.notes[0]
    assert "300 of 1000 samples are not" in r.notes[0]


def test_a_gap_masks_outputs_bridges_inputs_and_is_said(tmp_path: Path) -> None:
    keep = (T < 0.4) | (T >= 0.45)
    r = read(tmp_path, T[keep], {n: v[keep] for n, v in SIGNALS.items()})
    assert len(r.time) == 1000
    assert np.isnan(r.outputs["w"][400:450]).all()
    assert np.isfinite(r.outputs["w"]).sum() == 950
    assert np.allclose(r.inputs["v"], SIGNALS["v [V]"], atol=1e-12)
    assert "every channel: 1 gaps, 50 of 1000 samples, first at 0.4 s" in r.notes
    assert "v drives the system: 50 samples that were not recorded are bridged in a straight line" in r.notes


def test_a_wild_sample_is_taken_out_and_said_and_an_input_is_bridged_there(tmp_path: Path) -> None:
    wild = {n: np.where(np.isin(np.arange(1000), [200, 201, 700]), 1e6, x) for n, x in SIGNALS.items()}
    r = read(tmp_path, T, wild)
    assert np.isnan(r.outputs["w"][200:202]).all()
    there = np.isfinite(r.outputs["w"])
    assert there.sum() >= 997
    assert np.allclose(r.outputs["w"][there], SIGNALS["w [rad/s]"][there], atol=0.02)  # one that is missing is bridged
    assert np.allclose(r.inputs["v"], SIGNALS["v [V]"])
    out = {out.channel: out for out in r.left_out}
    assert out["i"].samples == 3
    assert out["i"].words.startswith("3 samples lie far outside, first 1e+06 among")
    (said,) = [s for s in suspicions([r]) if s.channel == "w"]
    assert (said.kind, said.wrong) == ("outlier", False)


@pytest.mark.parametrize(("unit", "turn", "begin"), [("deg", 360.0, 0.0), ("rad", 2 * np.pi, -np.pi)])
def test_an_encoder_that_begins_anew_after_a_turn_goes_on_instead(
    tmp_path: Path, unit: str, turn: float, begin: float
) -> None:
    """Its jumps had been 20,000 times the noise that a simulation missed the angle by."""
    time = np.arange(0, 4, 1e-3)
    phi = 25 * np.sin(2 * time)  # rad
    column = np.mod(phi * turn / (2 * np.pi) - begin, turn) + begin
    rows = np.column_stack([time, time, column])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=f"t [s],u [V],phi [{unit}]", comments="")
    connectors = {"u": Connector("u", "input", "V"), "phi": Connector("phi", "output", "rad")}
    recording = read_recording(tmp_path / "run.csv", connectors, {"u": "u", "phi": "phi"})
    assert recording.outputs["phi"] - recording.outputs["phi"][0] == pytest.approx(phi - phi[0], abs=1e-9)
    assert any("begins anew after a turn" in note for note in recording.notes)


def test_an_angle_with_jumps_of_its_own_or_of_more_than_a_turn_is_left_as_it_is() -> None:
    time = np.arange(0, 4, 1e-3)
    sawtooth = 200 * np.mod(time, 1.0)  # deg: falls by less than a turn
    for x in (300 * np.sin(time), sawtooth, np.where(time > 2, 250.0, 0.0)):
        left, jumps = unwrapped(x, 360.0)
        assert jumps == 0
        assert left is x


def test_a_pulse_of_three_samples_is_no_wild_sample(tmp_path: Path) -> None:
    pulse = {n: np.where(np.isin(np.arange(1000), [200, 201, 202]), 1e6, x) for n, x in SIGNALS.items()}
    r = read(tmp_path, T, pulse)
    assert r.left_out == []
    assert r.outputs["w"][201] == 1e6


def test_a_wild_sample_of_a_column_that_somebody_looked_at_is_meant(tmp_path: Path) -> None:
    wild = {n: np.where(np.arange(1000) == 200, 1e6, x) for n, x in SIGNALS.items()}
    pa.parquet.write_table(pa.table({"time [s]": T} | wild), tmp_path / "run.parquet")
    columns = {"v": "v", "w": Column("w", believed=True), "i": "i"}
    r = read_recording(tmp_path / "run.parquet", CONNECTORS, columns, Reading())
    assert r.outputs["w"][200] == 1e6
    assert {out.channel for out in r.left_out} == {"v", "i"}


def test_values_that_are_missing_are_masked_and_said(tmp_path: Path) -> None:
    w = SIGNALS["w [rad/s]"].copy()
    w[200:220] = np.nan
    r = read(tmp_path, T, SIGNALS | {"w [rad/s]": w})
    assert np.isnan(r.outputs["w"][200:220]).all()
    assert np.isfinite(r.outputs["w"]).sum() == 980
    assert "w has no value in 20 of 1000 samples, left out" in r.notes


def test_an_irregular_clock_is_interpolated_onto_a_regular_one_and_said(tmp_path: Path) -> None:
    t = T + np.random.default_rng(1).uniform(-2e-4, 2e-4, len(T))
    r = read(tmp_path, t, {"v [V]": 2 * t, "w [rad/s]": 100 * np.sin(5 * t), "i [A]": np.cos(5 * t)})
    assert np.allclose(np.diff(r.time), r.step)
    assert np.nanmax(np.abs(r.outputs["w"] - 100 * np.sin(5 * r.time))) < 2e-3
    assert any(note.startswith("every channel: ") and "off the regular clock" in note for note in r.notes)


def test_a_missing_channel_is_said_and_an_unknown_one_too(tmp_path: Path) -> None:
    r = read(tmp_path, T, {"w [rad/s]": SIGNALS["w [rad/s]"], "oil [K]": T}, without=("i", "v"))
    assert "oil is not connected to the system and not used" in r.notes
    assert "i is not recorded and is not compared" in r.notes
    assert "v is not recorded and stays at its start value" in r.notes


def test_what_holds_of_every_recording_is_said_once() -> None:
    """An unused column was told four times, in a campaign of four recordings."""
    oil, gap = "oil is not connected to the system and not used", "w has no value in 20 of 1000 samples, left out"
    assert said_once([("01", [oil]), ("02", [oil, gap, gap]), ("03", [oil])]) == [oil, f"02: {gap}"]


def test_units_of_the_header_are_converted(tmp_path: Path) -> None:
    rpm = SIGNALS["w [rad/s]"] * 30 / np.pi
    r = read(tmp_path, T, {"w [rpm]": rpm, "i [mA]": 1e3 * SIGNALS["i [A]"], "v [V]": SIGNALS["v [V]"]})
    assert np.allclose(r.outputs["w"], SIGNALS["w [rad/s]"])
    assert np.allclose(r.outputs["i"], SIGNALS["i [A]"])
    assert r.units == {"w": "rad/s", "i": "A", "v": "V"}


@pytest.mark.parametrize(
    ("unit", "target", "at_1"),
    [
        ("degC", "K", 274.15),
        ("0.1 %", "1", 1e-3),
        ("mN.m", "N.m", 1e-3),
        ("g.m2", "kg.m2", 1e-3),
        ("deg", "rad", np.pi / 180),
    ],
)
def test_a_unit_converts(unit: str, target: str, at_1: float) -> None:
    assert convert(np.ones(1), unit, target, "x")[0][0] == pytest.approx(at_1)


@pytest.mark.parametrize(("unit", "target"), [("V", "rad/s"), ("Hz", "rad/s"), ("furlongish", "m")])
def test_a_unit_that_does_not_convert_is_refused(unit: str, target: str) -> None:
    with pytest.raises(UserError, match=f"column 'x': unit '{unit}' is given"):
        convert(np.ones(1), unit, target, "column 'x'")


def test_an_initial_value_is_taken_from_the_first_sample(tmp_path: Path) -> None:
    r = read(tmp_path, T, SIGNALS, initial={"i": "first sample", "phi": 0.25})
    assert r.initial == {"i": 1.0, "phi": 0.25}
    with pytest.raises(
        UserError, match="initial 'phi' = 'first sample' is given, a number or \"first sample\" of one of v, w, i"
    ):
        read(tmp_path, T, SIGNALS, initial={"phi": "first sample"})


def test_a_position_stands_for_a_speed_and_its_integral_does_not_drift(tmp_path: Path) -> None:
    noisy = 90 + np.degrees(np.sin(4 * T) + np.random.default_rng(1).normal(0, 1e-3, len(T)))
    pa.parquet.write_table(pa.table({"t": T, "phi [deg]": noisy, "i [A]": T}), tmp_path / "run.parquet")
    columns = {"phi": Column("w", derivative=True), "i": "i"}
    connectors = {"w": Connector("w", "input", "rad/s"), "i": CONNECTORS["i"]}
    reading = Reading(initial={"motor.phi": "first sample of phi"})
    r = read_recording(tmp_path / "run.parquet", connectors, columns, reading)
    w, phi = r.inputs["w"], np.radians(noisy)
    assert np.allclose(w[1:-1], (phi[2:] - phi[:-2]) / 2e-3)
    assert r.units["w"] == "rad/s"
    assert r.initial == {"motor.phi": pytest.approx(np.pi / 2, abs=1e-3)}
    travelled = phi[0] + np.concatenate([[0], np.cumsum((w[1:] + w[:-1]) / 2) * 1e-3])
    assert np.max(np.abs(travelled - phi)) < 8e-3  # rad; errors of 1 mrad that added up would reach 30


def test_a_unit_that_differs_from_the_file_s_own_is_said(tmp_path: Path) -> None:
    pa.parquet.write_table(pa.table({"time [s]": T} | SIGNALS), tmp_path / "run.parquet")
    columns = {"v [mV]": "v", "w [1/s.rad]": "w", "i": "i"}
    r = read_recording(tmp_path / "run.parquet", CONNECTORS, columns)
    assert r.notes == ["v: the file says [V] and the campaign [mV]; the file's is used, a scale corrects it"]
    assert np.array_equal(r.inputs["v"], SIGNALS["v [V]"])


def test_a_log_without_any_output_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        UserError, match="none of its columns is an output of the system to compare with; known are w, i"
    ):
        read(tmp_path, T, {"v [V]": SIGNALS["v [V]"]}, without=("w", "i"))


def test_a_window_and_late_stamps_are_put_right(tmp_path: Path) -> None:
    time = np.arange(0, 1, 0.01)
    table = np.column_stack([time, np.sin(time), np.sin(time - 0.02)])  # y is stamped two samples late
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="time,u,y", comments="", fmt="%.12g")
    connectors = {"u": Connector("u", "input"), "y": Connector("y", "output")}
    recording = read_recording(
        tmp_path / "a.csv", connectors, {"u": "u", "y": "y"}, Reading(window=(0.2, 0.5), late={"y": 0.02})
    )
    assert recording.time[0] == pytest.approx(0.2)
    assert recording.time[-1] == pytest.approx(0.5)
    np.testing.assert_allclose(recording.outputs["y"], recording.inputs["u"], atol=1e-6)
    header = Reading(window=(0.2, 0.5), late={"y [1]": 0.02})  # as the file has it
    again = read_recording(tmp_path / "a.csv", connectors, {"u": "u", "y": "y"}, header)
    assert np.array_equal(again.outputs["y"], recording.outputs["y"])
    with pytest.raises(UserError, match="late: column 'z' is given, u, y are there"):
        read_recording(tmp_path / "a.csv", connectors, {"u": "u", "y": "y"}, Reading(late={"z": 0.02}))


def test_a_regular_clock_with_rounded_stamps_keeps_its_mean_step(tmp_path: Path) -> None:
    time = np.float32(np.arange(20000) * 1e-3).astype(float)  # single precision: the median step is off by 1e-5
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([time, time]), delimiter=",", header="time,y", comments="", fmt="%.9g"
    )
    recording = read_recording(tmp_path / "a.csv", {"y": Connector("y", "output")}, {"y": "y"})
    assert recording.step == pytest.approx(1e-3, rel=1e-7)
    assert len(recording.time) == 20000


def log(folder: Path, text: str, columns: dict[str, str] | None = None, **more) -> Recording:
    (folder / "a.csv").write_text(text)
    return read_recording(folder / "a.csv", CONNECTORS, columns or {"w": "w"}, Reading(**more))


def rows(time: np.ndarray, w: np.ndarray, header: str = "time [s],w [rad/s]") -> str:
    return "\n".join([header, *(f"{a:.12g},{b:.12g}" for a, b in zip(time, w, strict=True))])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (rows(T, np.sin(T)).replace("0.5,", "1e12,", 1), "clock jumps from"),
        (rows(1e3 * T, np.sin(T)), "its clock steps by 1 s and runs for 999 s"),
        (rows(1e3 * T, np.sin(T)), 'if it counts ms (factor 1000), say time = "NAME [ms]"'),
        (rows(T, np.sin(T)).replace("0.5,0.4794", "0.5,ERR,4794", 1), "line 502 has 3 cells, 2 are needed: '0.5,ERR"),
        (rows(T, np.sin(T)).replace("\n0.5,0.47942553860", "\n0.5,ERR"), "w holds 'ERR4' in line 502, a number"),
        (rows(T, np.sin(T)).replace("\n0.5,", "\n0.5,1e300\n0.5005,"), "column 'w' holds 1e+300 at 0.5 s, up to 1e+15"),
        (rows(T, np.full(1000, np.nan)), "w has no values"),
        (rows(T[:3], T[:3]), "3 usable samples are given, 16 at least are needed"),
        ("time [s],w [rad/s],w [rpm]\n" + "\n".join(f"{t},1,2" for t in T), "w is there 2 times; rename them"),
        ("time [s],w [rad/s]," + " " * 200_000 + "\n0,1,2\n", "line 1 has 200019 characters"),
        ("time [s],[w [0 rad/s]]\n0,1\n1,2\n", "one unit in one pair of brackets is allowed"),
    ],
)
def test_a_hostile_log_is_refused_in_one_line_at_once(tmp_path: Path, text: str, told: str) -> None:
    begun = time.monotonic()
    with pytest.raises(UserError) as error:
        log(tmp_path, text)
    assert told in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500
    assert time.monotonic() - begun < 5


def test_a_slow_clock_is_believed_where_the_campaign_names_it_with_its_unit(tmp_path: Path) -> None:
    assert log(tmp_path, rows(1e3 * T, np.sin(T)), time="time [s]").step == 1.0


def test_two_columns_for_one_channel_are_refused(tmp_path: Path) -> None:
    text = "time [s],n [rpm],w [rad/s]\n" + "\n".join(f"{t},1,2" for t in T)
    with pytest.raises(UserError, match="columns 'n' and 'w' are both there for 'w', one is allowed"):
        log(tmp_path, text, {"n": "w", "w": "w"})


def test_a_row_that_was_cut_when_the_logger_was_switched_off_is_left_out_and_said(tmp_path: Path) -> None:
    r = log(tmp_path, rows(T, np.sin(T)) + "\n1.0")
    assert r.notes[0] == "the last row has 1 cells of 2, left out"
    assert len(r.time) == 1000


def test_a_column_cannot_command_the_terminal() -> None:
    assert split_header("\x1b[31mw\x07 [rad/s]") == ("\ufffd[31mw\ufffd", "rad/s")


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("w [rad/s]", "w", "rad/s"),
        ("w[rpm]", "w", "rpm"),
        ("w []", "w", None),
        ("rec.act_pos[0]", "rec.act_pos[0]", None),
        ("rec.act_pos[0] [mm]", "rec.act_pos[0]", "mm"),
        ("torque (mNm)", "torque (mNm)", "mNm"),
        ("n (U/min)", "n (U/min)", "U/min"),
        ("speed (rpm) [rad/s]", "speed (rpm)", "rad/s"),
        *((name, name, None) for name in ("w (raw)", "w (min)", "phase (A)", "w (1)", "q (in)", "w (a.u.)", "(mNm)")),
    ],
)
def test_a_header_is_a_name_and_a_unit(header: str, name: str, unit: str | None) -> None:
    assert split_header(header) == (name, unit)


def test_a_log_with_its_units_in_parentheses_is_read_in_them(tmp_path: Path) -> None:
    """An oscilloscope's `Time (s)` was no clock; `Speed (rpm)`, as a campaign names it, was taken for rad/s."""
    table = np.column_stack([T, 1e3 * SIGNALS["v [V]"], SIGNALS["w [rad/s]"] * 30 / np.pi, SIGNALS["i [A]"]])
    (tmp_path / "run.csv").write_text("Time (s),Drive (mV),Speed (rpm),I (A)\n")
    with (tmp_path / "run.csv").open("a") as file:
        np.savetxt(file, table, delimiter=",")
    columns = {"Drive (mV)": "v", "Speed (rpm)": "w", "I (A)": "i"}
    r = read_recording(tmp_path / "run.csv", CONNECTORS, columns, Reading())
    assert np.allclose(r.inputs["v"], SIGNALS["v [V]"])
    assert np.allclose(r.outputs["w"], SIGNALS["w [rad/s]"])
    assert np.allclose(r.outputs["i"], SIGNALS["i [A]"])
    assert np.allclose(r.time, T, atol=1e-12)


@pytest.mark.parametrize("unit", ["Nm", "N.m", "N*m", "J", "1 N m"])
def test_a_newton_metre_is_read_however_it_is_written(unit: str) -> None:
    assert convert(np.ones(1), unit, "N.m", "x")[0][0] == pytest.approx(1.0)


@pytest.mark.parametrize("unit", ["rpm", "U/min", "1/min", "min⁻¹", "min-1", "r/min", "Upm"])
def test_turns_per_minute_are_read_however_they_are_written(unit: str) -> None:
    assert convert(np.ones(1), unit, "rad/s", "x")[0][0] == pytest.approx(np.pi / 30)


@pytest.mark.parametrize(
    "unit", ["0 rad/s", "-1 rad/s", "9**9**9**9", "m**9**9", "1e999 m", "import os", "1/s", "Grad/s/s", " " * 200_000]
)
def test_a_unit_that_computes_or_means_nothing_is_refused_at_once(unit: str) -> None:
    begun = time.monotonic()
    with pytest.raises(UserError):
        convert(np.ones(1), unit, "rad/s", "x")
    assert time.monotonic() - begun < 5


@pytest.mark.parametrize("lost", [slice(0, 0), slice(400, 500)], ids=["whole", "with a gap"])
def test_the_step_of_a_clock_that_jitters_does_not_walk(lost: slice) -> None:
    """The median of differences was 0.04 % off: half a sample at the end."""
    for seed in range(20):
        jitter = 0.01 * np.random.default_rng(seed).normal(size=3200)
        time = np.delete(2.5e-3 * (np.arange(3200) + jitter), lost)
        raw = {"y": Channel("y", None, time, time)}
        clock = regular_clock(Path("a.csv"), raw, [])
        assert clock[1] - clock[0] == pytest.approx(2.5e-3, rel=1e-5)
