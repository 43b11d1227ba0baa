"""Text as loggers write it is read as it is meant, however its cells, signs, marks and stamps are written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.delimited import Layout
from cobot_joint.diagnosis.data.formats import read_log
from cobot_joint.errors import UserError

T = np.arange(400) * 1e-3


@pytest.mark.parametrize(
    ("name", "per_second"), [("ms", 1e3), ("Millis", 1e3), ("ms_today", 1e3), ("us", 1e6), ("sec", 1.0)]
)
def test_a_clock_may_be_named_by_its_unit_alone(tmp_path: Path, name: str, per_second: float) -> None:
    """`ms;u_motor [V];rpm` was taken for a table of steady states."""
    rows = [f"{name},rpm"] + [f"{per_second * t:.6g},{w}" for t, w in zip(T, np.sin(9 * T), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    log = read_log(tmp_path / "a.csv")
    assert (log.clock, log.names) == (name, ["rpm"])
    assert np.allclose(log.channels[0].time, T, atol=1e-6)


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".log", ".dat", ".asc"])
def test_delimited_text_is_read_whatever_its_file_is_called(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"a{suffix}").write_text("t,w\n" + "\n".join(f"{t},{np.sin(9 * t)}" for t in T))
    assert read_log(tmp_path / f"a{suffix}").names == ["w"]


def test_a_way_or_a_count_of_ms_in_a_log_is_no_clock(tmp_path: Path) -> None:
    rows = ["s,latency_ms"] + [f"{t},3" for t in T]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(UserError, match="no time column; columns are s, latency_ms"):
        read_log(tmp_path / "a.csv")


@pytest.mark.parametrize("skip", [None, 0], ids=["guessed", "skip = 0"])
@pytest.mark.parametrize("late", [3, 390], ids=["starts", "is empty"])
def test_a_last_column_that_is_empty_at_first_is_a_column(tmp_path: Path, late: int, skip: int | None) -> None:
    rows = "\n".join(f"{k}e-3;{k};{k if k > late else ''}" for k in range(400))
    (tmp_path / "a.csv").write_text("t;w;late\n" + rows)
    found = {c.name: c for c in read_log(tmp_path / "a.csv", layout=Layout(skip=skip)).channels}
    assert list(found) == ["w", "late"]
    assert len(found["w"].values) == 400
    assert np.isfinite(found["late"].values).sum() == 399 - late


def test_a_separator_that_ends_every_row_is_no_column(tmp_path: Path) -> None:
    for header in ("t;w", "t;w;"):
        (tmp_path / "a.csv").write_text(header + "\n" + "\n".join(f"{k}e-3;{k};" for k in range(50)))
        (channel,) = read_log(tmp_path / "a.csv").channels
        assert (channel.name, len(channel.values)) == ("w", 50)


def test_a_byte_order_mark_is_none_of_the_first_name_whatever_encoding_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(("t;w\n0;1\n1e-3;2\n2e-3;3\n").encode("utf-8-sig"))
    assert read_log(tmp_path / "a.csv", layout=Layout(encoding="utf-8")).clock == "t"


def test_a_decimal_comma_far_below_is_seen(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;w\n" + "\n".join(f"{k};0" for k in range(450)) + "\n450;0,5\n451;0,5\n")
    (channel,) = read_log(tmp_path / "a.csv").channels
    assert channel.values[-1] == 0.5


def test_decimal_commas_in_quotes_between_commas_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,w\n" + "\n".join(f'"0,{k:03d}","{k},5"' for k in range(50)))
    (channel,) = read_log(tmp_path / "a.csv").channels
    assert np.allclose(channel.values, np.arange(50) + 0.5)
    assert np.allclose(channel.time, 1e-3 * np.arange(50))


def test_time_stamps_may_have_a_decimal_comma_and_a_clock_that_is_none_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;w\n" + "\n".join(f"2024-01-01 12:00:00,{k:03d};{k}" for k in range(50)))
    (channel,) = read_log(tmp_path / "a.csv").channels
    assert np.allclose(channel.time - channel.time[0], 1e-3 * np.arange(50))
    (tmp_path / "a.csv").write_text("t;w\n" + "\n".join(f"12:00:{k}h;wait" for k in range(10, 60)))
    with pytest.raises(UserError, match=r"'12:00:34h;wait' is no time: seconds or 2024-01-31 12:00:00\.5 are read"):
        read_log(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "stamp",
    [
        "2024-05-01T{h:02d}:{m:02d}:{s:06.3f}Z",
        "2024-05-01 {h:02d}:{m:02d}:{s:06.3f}+02:00",
        "01.05.2024 {h:02d}:{m:02d}:{s:06.3f}",
        "5/1/2024 {h}:{m:02d}:{s:06.3f}",
        "{h:02d}:{m:02d}:{s:06.3f}",
        "{h:02d}:{m:02d}:{s:02.0f}",
    ],
)
def test_a_column_of_dates_and_times_of_day_is_the_clock_whatever_its_name(stamp: str, tmp_path: Path) -> None:
    """Four an hour of a wheel, logged as `UTC`, were taken for a table of steady states."""
    hours = [(9 + (59 * 60 + k) // 3600, (59 * 60 + k) // 60 % 60, k % 60) for k in range(100)]
    rows = [f"{stamp.format(h=h, m=m, s=s)},0.1,{k}" for k, (h, m, s) in enumerate(hours)]
    (tmp_path / "a.csv").write_text("\n".join(["UTC,cycle_time,w", *rows]))
    log = read_log(tmp_path / "a.csv")
    assert log.clock == "UTC"
    assert log.names == ["cycle_time", "w"]
    assert np.allclose(log.channels[0].time, np.arange(100.0))


def test_a_clock_goes_on_past_midnight_and_noon_and_with_a_decimal_comma(tmp_path: Path) -> None:
    for begins, form in ((86390, "%d:%02d:%02d,50"), (43190, "31.12.2023 %d:%02d:%02d,50 PM")):
        day = [(begins + k) % 86400 for k in range(50)]
        times = [form % (d // 3600, d // 60 % 60, d % 60) for d in day]
        if "PM" in form:
            times = [form.replace("PM", "AM" if d < 43200 else "PM") % ((d // 3600 - 1) % 12 + 1, d // 60 % 60, d % 60)
                     for d in day]  # fmt: skip
        (tmp_path / "a.csv").write_text("\n".join(["Uhr;w", *(f"{t};{k}" for k, t in enumerate(times))]))
        (channel,) = read_log(tmp_path / "a.csv").channels
        assert np.allclose(channel.time, np.arange(50.0))


def test_a_date_beside_the_clock_is_no_channel(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Date,Time,w\n" + "\n".join(f"2024-05-01,12:00:{k},{k}" for k in range(10, 60)))
    log = read_log(tmp_path / "a.csv")
    assert (log.clock, log.names) == ("Time", ["w"])
    assert log.unusable == {"Date": "holds dates or times of day and is not the clock"}


def test_numbers_of_whole_nanoseconds_since_1970_are_read(tmp_path: Path) -> None:
    rows = "\n".join(f"{1_700_000_000_000_000_000 + k * 1_000_000},{k}" for k in range(50))
    (tmp_path / "a.csv").write_text("t [ns],w\n" + rows)
    (channel,) = read_log(tmp_path / "a.csv").channels
    assert np.allclose(np.diff(channel.time), 1e-3, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("timestamp_ms", 1e-3), ("Time ms", 1e-3), ("elapsed_us", 1e-6), ("timestamp_ns", 1e-9), ("t", 1.0)],
)
def test_a_clocks_name_may_end_with_its_unit(name: str, unit: float, tmp_path: Path) -> None:
    """`timestamp_ms` was no clock, and neither were nanoseconds, as robots log them."""
    time = np.arange(50) * 0.004
    np.savetxt(tmp_path / "a.csv", np.column_stack([time / unit, time]), delimiter=",", header=f"{name},w", comments="")
    (w,) = read_log(tmp_path / "a.csv").channels
    np.testing.assert_allclose(w.time, time, atol=1e-9)


@pytest.mark.parametrize(
    ("header", "clock"),
    [
        ("timestamp,T_s,w", "timestamp"),
        ("timestamp,t_us,w", "timestamp"),
        ("t,time_ms,w", "t"),
        ("time_ms,time_s,w", "time_s"),
        ("w,x,log.t_ms", "log.t_ms"),
    ],
)
def test_of_columns_that_could_be_the_clock_the_likelier_is(header: str, clock: str, tmp_path: Path) -> None:
    """A stator's temperature `T_s` is none where there is a `timestamp`."""
    table = np.column_stack([np.arange(50) * 0.004 * (1 + k) for k in range(3)])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="")
    assert read_log(tmp_path / "a.csv").clock == clock


def test_rows_without_a_clock_are_as_far_apart_as_is_said(tmp_path: Path) -> None:
    """They could only be a table of steady states."""
    (tmp_path / "a.csv").write_text("u,w\n" + "\n".join(f"{k},{np.sin(k / 9)}" for k in range(300)))
    log = read_log(tmp_path / "a.csv", "2.5 ms")
    assert log.names == ["u", "w"]
    assert np.allclose(log.channels[0].time, 2.5e-3 * np.arange(300))
    with pytest.raises(UserError, match='or how far rows are apart, time = "10 ms"'):
        read_log(tmp_path / "a.csv")
    with pytest.raises(UserError, match="columns are u, w"):
        read_log(tmp_path / "a.csv", "10 mm")
