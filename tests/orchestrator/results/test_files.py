"""Signals on disk: headers, provenance, whole files or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint.results.files import SignalsWriter, columns_of, provenance, read_provenance, write_csv
from cobot_joint.system import load_system, with_parameters

UNITS = {"time": "s", "w": "rad/s", "n": None}


def test_headers_carry_the_unit(tmp_path: Path) -> None:
    with SignalsWriter(tmp_path / "a.parquet", UNITS, {}) as writer:
        writer.write({"time": np.zeros(2), "w": np.ones(2), "n": np.ones(2)})
    assert pq.read_table(tmp_path / "a.parquet").column_names == ["time [s]", "w [rad/s]", "n [1]"]


def test_pieces_are_gathered_into_row_groups_in_order(tmp_path: Path) -> None:
    pieces = np.split(np.arange(10.0), [1, 4, 9])
    with SignalsWriter(tmp_path / "a.parquet", UNITS, {}, rows_per_group=3) as writer:
        for piece in pieces:
            writer.write({"time": piece, "w": 2 * piece})
    file = pq.ParquetFile(tmp_path / "a.parquet")
    assert [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)] == [4, 5, 1]
    np.testing.assert_array_equal(file.read()["w [rad/s]"].to_numpy(), 2 * np.arange(10.0))
    assert not file.read()["n [1]"].to_numpy().any()


def test_what_is_learnt_during_the_run_is_in_the_provenance(tmp_path: Path) -> None:
    with SignalsWriter(tmp_path / "a.parquet", UNITS, {"scenario": "x"}) as writer:
        writer.write({"time": np.zeros(1)})
        writer.provenance["scheme"] = "jacobi"
    assert read_provenance(tmp_path / "a.parquet") == {"scenario": "x", "scheme": "jacobi"}


def fail_after_a_row(path: Path) -> None:
    with SignalsWriter(path, UNITS, {}) as writer:
        writer.write({"time": np.zeros(1)})
        raise RuntimeError


def test_failed_run_leaves_the_earlier_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    path.write_text("earlier")
    with pytest.raises(RuntimeError):
        fail_after_a_row(path)
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_signal_without_a_column_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyError, match="no column for v"), SignalsWriter(tmp_path / "a.parquet", UNITS, {}) as writer:
        writer.write({"time": np.zeros(1), "v": np.zeros(1)})


def test_provenance_names_versions_units_and_parameters() -> None:
    system = with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.22})
    facts = provenance(system, scenario="x")
    assert facts["parameters"] == {"motor_bldc.winding.R": 0.22}
    assert set(facts["versions"]) == {"cobot-joint", "python", "fmpy", "numpy", "pyarrow"}
    assert facts["fmus"]["motor_bldc"]["guid"] == system.component("motor_bldc").unit.description.guid
    assert facts["scenario"] == "x"


def test_columns_are_time_inputs_outputs() -> None:
    columns = columns_of(load_system("joint_no_load"))
    assert list(columns.items())[:3] == [("time", "s"), ("v_command", "V"), ("i_motor", "A")]


def test_table_is_written_with_its_headers(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "t.csv", ["a [s]", "b"], [(1.0, "x"), (1 / 3, "y, z")])
    assert path.read_text() == 'a [s],b\n1,x\n0.333333333,"y, z"\n'
