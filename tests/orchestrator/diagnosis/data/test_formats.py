"""Every format is written by a library that is not ours and read back by ours."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.formats import read_channels
from cobot_joint.errors import UserError

T = np.arange(400) * 1e-3
W = 50 * np.sin(9 * T)
V = 3 * T


def by_name(path: Path, time: str | None = None) -> dict:
    return {c.name: c for c in read_channels(path, time)}


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
    assert set(channels) == {"qm", "i_motor"}
    assert np.array_equal(channels["qm"].values, W)
    assert np.array_equal(channels["i_motor"].values, V)


def test_mat_of_version_7_3_is_read(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="MAT 7.3 is HDF5; h5py comes with mat73")
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        for name, values in {"t": T, "qm": W}.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with (tmp_path / "a.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert np.array_equal(by_name(tmp_path / "a.mat")["qm"].values, W)


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


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.xlsx", b"", "suffix '.xlsx' is given, one of .parquet, .csv, .mat, .mf4, .mdf is needed"),
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
        read_channels(tmp_path / name)
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
