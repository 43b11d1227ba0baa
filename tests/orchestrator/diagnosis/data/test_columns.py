"""What a campaign says of a column beside its connector and unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint.diagnosis.data.recording import Column, read_recording
from cobot_joint.errors import UserError
from tests.orchestrator.diagnosis.data.test_recording import CONNECTORS, SIGNALS, T


def test_a_set_value_that_is_held_keeps_its_samples_and_says_so(tmp_path: Path) -> None:
    pa.parquet.write_table(pa.table({"time [s]": T} | SIGNALS), tmp_path / "run.parquet")
    plain = read_recording(tmp_path / "run.parquet", CONNECTORS, {"v": "v", "w": "w", "i": "i"})
    r = read_recording(tmp_path / "run.parquet", CONNECTORS, {"v": Column("v", hold=True), "w": "w", "i": "i"})
    assert np.array_equal(r.inputs["v"], plain.inputs["v"])
    assert (r.held, plain.held) == ({"v"}, set())
    with pytest.raises(UserError, match="column 'w': hold is given, 'w' is an output; it is for inputs"):
        read_recording(tmp_path / "run.parquet", CONNECTORS, {"v": "v", "w": Column("w", hold=True), "i": "i"})


def test_a_speed_that_is_a_mean_says_so_and_a_filter_gets_it_where_it_is(tmp_path: Path) -> None:
    pa.parquet.write_table(pa.table({"time [s]": T} | SIGNALS), tmp_path / "run.parquet")
    r = read_recording(tmp_path / "run.parquet", CONNECTORS, {"v": "v", "w": Column("w", mean=True), "i": "i"})
    assert r.differences == {"w": "backward"}
    w, there = r.outputs["w"], r.centred()
    np.testing.assert_allclose(there.outputs["w"][:-1], (w[1:] + w[:-1]) / 2)
    assert np.isnan(there.outputs["w"][-1])
    assert there.centred() is there
    with pytest.raises(UserError, match="'v': mean is given, 'v' is an input; it is for a speed's output"):
        read_recording(tmp_path / "run.parquet", CONNECTORS, {"v": Column("v", mean=True), "w": "w", "i": "i"})


def test_a_column_may_be_multiplied_by_another_as_a_duty_cycle_by_its_supply(tmp_path: Path) -> None:
    log = {"time [s]": T, "duty [%]": 50 * np.sin(T), "w [rad/s]": T, "supply [mV]": 24e3 - 1e3 * T, "raw": 128 + 0 * T}
    pa.parquet.write_table(pa.table(log), tmp_path / "run.parquet")
    path = tmp_path / "run.parquet"
    r = read_recording(path, CONNECTORS, {"duty": Column("v", times="supply"), "w": "w"})
    np.testing.assert_allclose(r.inputs["v"], 0.5 * np.sin(T) * (24 - T))
    assert not any("supply" in note for note in r.notes)
    of_raw = read_recording(path, CONNECTORS, {"raw": Column("v", 1 / 256, times="supply"), "w": "w"})
    np.testing.assert_allclose(of_raw.inputs["v"], 0.5 * (24 - T))
    with pytest.raises(UserError, match=r"'duty': times = 'suply' is given, the file has .*; the nearest is 'supply'"):
        read_recording(path, CONNECTORS, {"duty": Column("v", times="suply"), "w": "w"})
