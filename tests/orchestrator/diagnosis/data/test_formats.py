"""Every format is written by a library that is not ours and read back by ours."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.delimited import Layout
from cobot_joint.diagnosis.data.formats import read_log
from cobot_joint.errors import UserError

T = np.arange(400) * 1e-3
W = 50 * np.sin(9 * T)
V = 3 * T


def by_name(path: Path, time: str | None = None) -> dict:
    return {c.name: c for c in read_log(path, time).channels}


def test_parquet_written_by_pyarrow_is_read_with_the_units_of_its_headers(tmp_path: Path) -> None:
    pa.parquet.write_table(
        pa.table({"time [s]": T, "w_motor [rad/s]": W, "label": ["x"] * 400}), tmp_path / "a.parquet"
    )
    channels = by_name(tmp_path / "a.parquet")
    assert list(channels) == ["w_motor"]
    assert channels["w_motor"].unit == "rad/s"
    assert np.array_equal(channels["w_motor"].values, W)
    assert np.array_equal(channels["w_motor"].time, T)


@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", ".")])
def test_csv_is_read_whatever_its_delimiter_and_decimal_sign(tmp_path: Path, delimiter: str, decimal: str) -> None:
    rows = ["t [ms]" + delimiter + "w_motor [rpm]"]
    rows += [f"{1e3 * t:.3f}{delimiter}{w:.9f}".replace(".", decimal) for t, w in zip(T, W, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    channel = by_name(tmp_path / "a.csv")["w_motor"]
    assert channel.unit == "rpm"
    assert np.allclose(channel.values, W, atol=1e-8)
    assert np.allclose(channel.time, T)


def test_csv_with_absolute_time_stamps_counts_seconds_from_the_first(tmp_path: Path) -> None:
    start = datetime.datetime(2024, 5, 3, 12)
    rows = ["timestamp,w"] + [
        f"{(start + datetime.timedelta(seconds=float(t))).isoformat(timespec='microseconds')},{w}"
        for t, w in zip(T, W, strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    assert np.allclose(by_name(tmp_path / "a.csv")["w"].time, T, atol=1e-6)


@pytest.mark.parametrize("orientation", ["row", "column"])
def test_mat_written_by_scipy_is_read_and_its_scalars_left(tmp_path: Path, orientation: str) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"t": T, "qm": W, "gain": 3.0, "run": {"i_motor": V}}, oned_as=orientation)
    channels = by_name(tmp_path / "a.mat")
    assert set(channels) == {"qm", "run.i_motor"}
    assert np.array_equal(channels["qm"].values, W)
    assert np.array_equal(channels["run.i_motor"].values, V)


def test_mat_of_version_7_3_is_read_with_structs_matrices_and_cells(tmp_path: Path) -> None:
    import h5py

    def put(group: Any, name: str, values: np.ndarray) -> Any:
        data = group.create_dataset(name, data=values)
        data.attrs["MATLAB_class"] = np.bytes_("char" if values.dtype.kind == "u" else "double")
        return data

    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        put(file, "t", T[None, :])
        put(file, "note", np.array([[98], [101]], dtype=np.uint16))
        put(file.create_group("rec"), "act_pos", np.stack([W, V]).T)  # MATLAB's arrays lie transposed: 2 x n there
        cells = [put(file.create_group(f"#refs#/{k}"), "x", x[None, :]).ref for k, x in enumerate((V, W))]
        file.create_dataset("runs", data=np.array([cells], dtype=object), dtype=h5py.ref_dtype)
    with (tmp_path / "a.mat").open("r+b") as raw:  # MATLAB's preamble
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    channels = by_name(tmp_path / "a.mat")
    assert set(channels) == {"rec.act_pos[0]", "rec.act_pos[1]", "runs[0]", "runs[1]"}
    assert np.array_equal(channels["rec.act_pos[0]"].values, W)
    assert np.array_equal(channels["runs[1]"].values, W)


@pytest.mark.parametrize(("suffix", "version"), [(".mf4", "4.10"), (".mdf", "3.30")])
def test_mdf_written_by_asammdf_is_read_with_units_and_a_clock_per_channel(
    tmp_path: Path, suffix: str, version: str
) -> None:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the optional extra [mdf]")
    with asammdf.MDF(version=version) as file:
        file.append([asammdf.Signal(samples=W, timestamps=T, name="w_motor", unit="rad/s")])
        file.append([asammdf.Signal(samples=V[::4], timestamps=T[::4], name="v_command [V]")])
        written = file.save(tmp_path / f"a{suffix}", overwrite=True)
    channels = by_name(Path(written))
    assert channels["w_motor"].unit == "rad/s"
    assert channels["v_command"].unit == "V"
    assert np.allclose(channels["w_motor"].values, W)
    assert len(channels["v_command"].time) == 100
    assert np.allclose(channels["v_command"].time, T[::4])


@pytest.mark.parametrize("name", ["stamp_s", "Time stamp", "controller_clock_s"])
def test_a_column_called_by_a_word_for_time_that_never_falls_is_the_clock(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.csv").write_text(f"{name},cycle_time,y\n214.1,0.5,1\n214.2,0.4,2\n214.3,0.6,4\n")
    log = read_log(tmp_path / "a.csv")
    assert log.clock == name
    assert np.allclose(by_name(tmp_path / "a.csv")["y"].time, [214.1, 214.2, 214.3])


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        (
            "a.xlsx",
            b"",
            "suffix '.xlsx' is given, one of .parquet, .csv, .txt, .tsv, .log, .dat, .asc, .mat, .mf4",
        ),
        ("gone.csv", None, "there is no such file"),
        ("a.parquet", b"not parquet", "cannot be read as parquet"),
        ("a.mat", b"not mat", "cannot be read as mat"),
        ("a.csv", b"", "cannot be read as csv"),
        ("a.csv", b"x,y\n1,2\n", "no time column; columns are x, y; a clock is called time or t or"),
        ("a.csv", b"time [V],y\n1,2\n", "unit 'V' is given, one that converts to 's' is needed"),
        ("a.csv", b"time [s],y\n1,abc\n2,d\n", "holds no numeric channel beside the clock"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line_that_names_it(
    tmp_path: Path, name: str, content: bytes | None, told: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError) as error:
        read_log(tmp_path / name)
    assert told in str(error.value)
    assert name in str(error.value)
    assert "\n" not in str(error.value)


def test_one_run_in_four_formats_is_one_recording(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the optional extra [mdf]")
    columns = {"v_command": V, "i_motor": 0.1 * V, "w_motor": W}
    headers = {"v_command": "v_command [V]", "i_motor": "i_motor [A]", "w_motor": "w_motor [rad/s]"}
    table = pa.table({"time [s]": T} | {headers[n]: v for n, v in columns.items()})
    pa.parquet.write_table(table, tmp_path / "p.parquet")
    pa.csv.write_csv(table, tmp_path / "c.csv")
    scipy.io.savemat(tmp_path / "m.mat", {"time": T} | columns)
    with asammdf.MDF() as file:
        file.append(
            [
                asammdf.Signal(samples=v, timestamps=T, name=n, unit=headers[n].split("[")[1][:-1])
                for n, v in columns.items()
            ]
        )
        file.save(tmp_path / "d.mf4")
    entries = "".join(
        f'[[recording]]\nfile = "{f}"\nsetup = "no_load"\n' for f in ("p.parquet", "c.csv", "m.mat", "d.mf4")
    )
    (tmp_path / "campaign.toml").write_text('title = "four"\nsystem = "joint"\n' + entries)
    first, *others = load_campaign(tmp_path).recordings
    assert len(others) == 3
    for other in others:
        assert np.allclose(other.time, first.time)
        assert other.notes == []
        for name, values in (first.inputs | first.outputs).items():
            assert np.allclose((other.inputs | other.outputs)[name], values, atol=1e-12)


EXPORT = """Date:;2020-07-08 21:24:28
Firmware Version:;0x0120;0x6150;0x0000;0x0000
Max. samples:;500
Scale:;0;True;1.000;10.000;-14.000;-6.000
Scale:;1;True;5.000;29.650;-49.650;-9.650
Trigger:;1;0.000000;"Parameter values";"Channel 1";"Rising above value"
;Velocity actual value averaged;Torque actual value averaged
ms;rpm;%
0.000;-10;-32.0
51.200;-10;-32.6
102.400;-11;-33.3
"""


def test_a_drive_makers_export_is_read_with_its_preamble_names_and_units(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(EXPORT.replace("\n", "\r\n"))
    channels = by_name(tmp_path / "a.csv")
    assert [(c.name, c.unit) for c in channels.values()] == [
        ("Velocity actual value averaged", "rpm"),
        ("Torque actual value averaged", "%"),
    ]
    assert channels["Torque actual value averaged"].values.tolist() == [-32.0, -32.6, -33.3]
    assert channels["Torque actual value averaged"].time == pytest.approx([0, 0.0512, 0.1024])


def test_an_export_that_went_through_a_spreadsheet_is_read_and_what_stands_beside_it_is_said(tmp_path: Path) -> None:
    lines = [f'"{line}",,'.replace('"Par', '""Par') if ';"' in line else f"{line},," for line in EXPORT.splitlines()]
    lines[-3] = lines[-3].replace(",,", ",,was -30.1")
    (tmp_path / "a.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "a.csv")
    assert log.channels[1].values.tolist() == [-32.0, -32.6, -33.3]
    assert log.notes == ["a spreadsheet has put 1 cells beside the log, left out: 'was -30.1'"]


ROWS = "\n".join(f"{1e3 * t:.3f};{w:.6f}".replace(".", ",") for t, w in zip(T, W, strict=True))


@pytest.mark.parametrize(
    ("text", "encoding", "layout", "unit"),
    [
        ("t [ms];Drehzahl Rührer [U/min]\n" + ROWS, "latin-1", Layout(), "U/min"),
        ("t [ms];Drehzahl Rührer [U/min]\n" + ROWS, "utf-8-sig", Layout(), "U/min"),
        ("t [ms];Drehzahl Rührer [U/min]\n" + ROWS, "utf-16", Layout(), "U/min"),
        ("Prüfstand 3\n\nZeit;Drehzahl Rührer\nms;U/min\n" + ROWS, "latin-1", Layout(), "U/min"),
        ("# t;Drehzahl Rührer\n[ms];[1/min]\n" + ROWS.replace(";", "; "), "utf-8", Layout(), "1/min"),
        ("t_ms\tDrehzahl Rührer\n" + ROWS.replace(";", "\t"), "cp1252", Layout(), None),
        ("t n\nt_ms Drehzahl_Rührer\n" + ROWS.replace(";", "   "), "utf-8", Layout(skip=1, separator="space"), None),
        ("1;2\n3;4\nt [ms];Drehzahl Rührer\n" + ROWS, "latin-1", Layout(skip=2, encoding="latin-1"), None),
    ],
)
def test_text_is_read_whatever_its_encoding_preamble_and_place_of_units(
    tmp_path: Path, text: str, encoding: str, layout: Layout, unit: str | None
) -> None:
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    (channel,) = read_log(tmp_path / "a.csv", layout=layout).channels
    assert channel.name.replace("_", " ") == "Drehzahl Rührer"
    assert channel.unit == unit
    assert np.allclose(channel.time, T)
    assert np.allclose(channel.values, W, atol=1e-6)


@pytest.mark.parametrize(
    ("layout", "told"),
    [
        (Layout(encoding="klingon"), "encoding 'klingon' is given"),
        (Layout(encoding="ascii"), "it is not ascii: byte 8 is 0xfc"),
        (Layout(separator="::"), "separator '::' is given, one character"),
    ],
)
def test_a_layout_that_does_not_fit_is_refused_in_one_line(tmp_path: Path, layout: Layout, told: str) -> None:
    (tmp_path / "a.csv").write_bytes(("t [ms];Züge\n" + ROWS).encode("latin-1"))
    with pytest.raises(UserError) as error:
        read_log(tmp_path / "a.csv", layout=layout)
    assert told in str(error.value)


def test_numbers_with_both_decimal_signs_are_not_guessed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;w\n" + "\n".join(f"{k};{k},5" if k % 2 else f"{k};{k}.5" for k in range(50)))
    with pytest.raises(UserError, match=r"both 1,5 and 1\.5 occur"):
        read_log(tmp_path / "a.csv")


def test_mat_structs_matrices_and_variables_of_other_lengths_are_read(tmp_path: Path) -> None:
    matrix = np.stack([W, 2 * W, 3 * W])
    scipy.io.savemat(
        tmp_path / "a.mat",
        {"rec": {"t": T, "act_pos": matrix, "tau": matrix.T}, "poly": np.arange(5.0), "note": "x", "big": np.eye(30)},
    )
    log = read_log(tmp_path / "a.mat")
    assert log.find("rec.act_pos[1]").values == pytest.approx(2 * W)
    assert log.find("tau[2]").values == pytest.approx(3 * W)
    assert set(log.unusable) == {"poly", "big"}
    with pytest.raises(UserError, match=r"column 'poly' has 5 samples, its clock 'rec.t' has 400"):
        log.find("poly")


def test_a_mat_file_with_two_clocks_asks_which(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"a": {"t": T, "w": W}, "b": {"t": 2 * T, "w": 2 * W}})
    with pytest.raises(UserError, match=r'a.t, b.t could be the clock: say which, time = "a.t \[s\]"'):
        read_log(tmp_path / "a.mat")
    log = read_log(tmp_path / "a.mat", "b.t [s]")
    assert log.find("b.w").time[1] == pytest.approx(2e-3)
    with pytest.raises(UserError, match=r"column 'w' is given, the file has a.w, b.w"):
        log.find("w")


JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def bag(path: Path, own: float = 1.7e9, joints: Callable[[int], list[str]] = lambda k: ["elbow", "wrist"]) -> Path:
    """A ROS 2 bag: joint states stamped `own` + T, a current at half the rate without a stamp, recorded 10 ms late."""
    ros2 = pytest.importorskip("mcap_ros2.writer")
    recorded = [1_700_000_000_010_000_000 + round(t * 1e9) for t in T]
    with path.open("wb") as file:
        writer = ros2.Writer(file)
        state = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        current = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        for k, (t, stamp) in enumerate(zip(T, recorded, strict=True)):
            sec, nanosec = divmod(round((own + t) * 1e9), 10**9)
            header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
            n = len(joints(k))
            message = {"header": header, "name": joints(k), "position": [0.0] * n, "velocity": [W[k]] * n, "effort": []}
            writer.write_message("/joint_states", state, message, stamp, stamp)
            if k % 2 == 0:
                writer.write_message("/drive/current", current, {"data": V[k]}, stamp, stamp)
        writer.finish()
    return path


def test_a_ros_2_bag_is_read_with_joints_by_name_and_a_clock_per_topic(tmp_path: Path) -> None:
    channels = by_name(bag(tmp_path / "a.mcap"))
    joints = {f"joint_states.{joint}.{of}" for joint in ("elbow", "wrist") for of in ("position", "velocity")}
    assert set(channels) == {*joints, "drive/current.data"}
    assert np.array_equal(channels["joint_states.elbow.velocity"].values, W)
    assert np.allclose(channels["joint_states.elbow.velocity"].time, T, atol=1e-6)
    assert np.array_equal(channels["drive/current.data"].values, V[::2])
    assert np.allclose(channels["drive/current.data"].time, T[::2] + 0.01, atol=1e-6)


def test_stamps_of_a_bag_that_count_from_another_moment_give_way_to_the_recorder_s(tmp_path: Path) -> None:
    channels = by_name(bag(tmp_path / "a.mcap", own=0.0))
    assert np.allclose(channels["joint_states.elbow.velocity"].time, T, atol=1e-6)
    assert np.allclose(channels["drive/current.data"].time, T[::2], atol=1e-6)


def test_a_joint_that_comes_and_goes_in_a_bag_is_no_channel_and_says_why(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", joints=lambda k: ["elbow", "wrist"] if k else ["elbow"])
    assert "wrist.velocity" not in by_name(path)
    with pytest.raises(UserError, match=rf"is in {len(T) - 1} of {len(T)} messages"):
        read_log(path).find("joint_states.wrist.velocity")


def test_a_bag_that_was_cut_is_refused_in_one_line(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(UserError, match=r"a\.mcap: cannot be read as mcap: .+") as error:
        read_log(path)
    assert "\n" not in str(error.value)


def test_a_bag_without_its_reader_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path / "a.mcap")
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(UserError, match=r"pip install 'cobot-joint\[rosbag\]'"):
        read_log(path)


def test_mdf_groups_with_alike_names_keep_their_groups_and_clocks(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the optional extra [mdf]")
    with asammdf.MDF() as file:
        for k, name in ((1, "drive"), (4, "bench")):
            signal = asammdf.Signal(samples=W[::k], timestamps=T[::k], name="speed", unit="rad/s")
            file.append([signal], acq_name=name)
        file.save(tmp_path / "a.mf4", overwrite=True)
    log = read_log(tmp_path / "a.mf4")
    assert log.names == ["drive.speed", "bench.speed"]
    assert len(log.find("bench.speed").time) == 100
    with pytest.raises(UserError, match=r"column 'speed' is given, the file has drive\.speed, bench\.speed"):
        log.find("speed")


def test_parquet_units_may_stand_in_the_metadata_of_its_columns(tmp_path: Path) -> None:
    fields = [
        pa.field("time", pa.float64(), metadata={"unit": "ms"}),
        pa.field("w", pa.float64(), metadata={"Unit": "rpm"}),
    ]
    pa.parquet.write_table(pa.table([1e3 * T, W], schema=pa.schema(fields)), tmp_path / "a.parquet")
    (channel,) = read_log(tmp_path / "a.parquet").channels
    assert (channel.name, channel.unit) == ("w", "rpm")
    assert np.allclose(channel.time, T)


def test_a_column_that_is_wanted_and_has_a_bad_cell_is_refused_with_line_and_value(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "t,w,label\n" + "\n".join(f"{t},{'ERR' if k == 7 else k},x" for k, t in enumerate(T))
    )
    with pytest.raises(UserError, match="w holds 'ERR' in line 9, a number is needed"):
        read_log(tmp_path / "a.csv")
