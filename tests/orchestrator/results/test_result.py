"""A result in other people's hands: tables, pictures, notebooks; what is not installed is said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.errors import UserError
from cobot_joint.results.diagnosed import Diagnosed
from cobot_joint.results.files import SignalsWriter, read_signals
from cobot_joint.results.result import Result
from cobot_joint.results.sweep import Sweep


def make(level: float = 1.0) -> Result:
    time = np.linspace(0.0, 1.0, 11)
    signals = {"i": level * np.ones(11), "w": level * time}
    return Result(time, signals, {"a -> b": (2.0, 1.0, 4.0)}, "jacobi", 0.1, {"i": "A", "w": "rad/s"})


def test_a_result_reads_by_name() -> None:
    assert make()["w"][-1] == 1.0
    with pytest.raises(KeyError, match="no signal 'x' was recorded, there are i, w"):
        make()["x"]


def test_to_pandas_keeps_time_and_units() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed")
    frame = make().to_pandas()
    assert list(frame.columns) == ["i", "w"]
    assert frame.loc[0.5, "w"] == pytest.approx(0.5)
    assert frame.attrs["units"] == {"time": "s", "i": "A", "w": "rad/s"}


def test_to_xarray_keeps_time_and_units() -> None:
    pytest.importorskip("xarray", reason="xarray is not installed")
    data = make().to_xarray()
    assert data["w"].attrs["units"] == "rad/s"
    assert float(data["w"].sel(time=0.5)) == pytest.approx(0.5)


def test_a_library_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    said = "to_xarray: xarray is not installed, `pip install cobot-joint[notebook]` brings it"
    with pytest.raises(UserError, match=re.escape(said)):
        make().to_xarray()


def test_plot_has_a_panel_per_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    figure = make().plot()
    assert [axis.get_ylabel() for axis in figure.axes] == ["current [A]", "speed [rad/s]"]
    np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), make()["w"])
    assert [axis.get_ylabel() for axis in make().plot("w").axes] == ["speed [rad/s]"]


def test_a_notebook_shows_figures_of_every_signal() -> None:
    page = make(2.0)._repr_html_()
    assert "<td>w [rad/s]</td><td>0</td><td>2</td><td>1</td>" in page


def test_a_file_reads_back_as_the_result_that_was_written(tmp_path: Path) -> None:
    result = make()
    facts = {"scheme": result.scheme, "step": result.step, "energy": result.energy}
    with SignalsWriter(tmp_path / "signals.parquet", {"time": "s", **result.units}, facts) as writer:
        writer.write({"time": result.time, **result.signals})
    read = read_signals(tmp_path / "signals.parquet")
    assert read.units == result.units
    assert (read.scheme, read.step, read.energy) == (result.scheme, result.step, result.energy)
    for name in result.signals:
        np.testing.assert_array_equal(read[name], result[name])


def test_a_file_of_another_program_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_text("no")
    with pytest.raises(UserError, match=r"x\.parquet: not a signals file of cobot-joint"):
        read_signals(tmp_path / "x.parquet")


AXES = {"a.k": np.array([1.0, 2.0]), "a.d": np.array([3.0, 4.0, 5.0])}
GRID = Sweep(AXES, [make(n) if n != 4 else None for n in range(6)], {4: "it broke"})


def test_points_of_a_sweep_are_in_the_order_of_its_results() -> None:
    assert GRID.points()[5] == {"a.k": 2.0, "a.d": 5.0}
    assert [at["a.k"] * 10 + at["a.d"] for at, _ in GRID] == [13, 14, 15, 23, 25]


def test_a_sweep_to_pandas_has_its_parameters_as_index() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed")
    frame = GRID.to_pandas()
    assert frame.index.names == ["a.k", "a.d", "time"]
    assert frame.loc[(2.0, 5.0, 1.0), "w"] == pytest.approx(5.0)


def test_a_sweep_to_xarray_has_a_dimension_per_parameter_and_nan_where_it_failed() -> None:
    pytest.importorskip("xarray", reason="xarray is not installed")
    w = GRID.to_xarray()["w"]
    assert dict(w.sizes) == {"a.k": 2, "a.d": 3, "time": 11}
    assert np.isnan(w.sel({"a.k": 2.0, "a.d": 4.0})).all()


def test_a_notebook_shows_what_failed_in_a_sweep() -> None:
    assert "run 4: it broke" in GRID._repr_html_()


def test_a_diagnosis_shows_its_findings_and_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas", reason="pandas is not installed")
    monkeypatch.setenv("MPLBACKEND", "agg")
    finding = {"term": "gear.stribeck", "confidence": 0.93, "parameters": {"f_s": {"value": 0.5, "unit": "1"}}}
    figures = {"noise": 0.01, "train": {"nominal": 0.2, "calibrated": 0.1, "repaired": 0.01}}
    content = {"verdict": "explained", "findings": [finding], "channels": {"i_motor": figures}}
    found = Diagnosed(tmp_path, content)
    assert found.to_pandas().loc[("i_motor", "train"), "repaired"] == 0.01
    assert "gear.stribeck</td><td>93 %</td><td>f_s = 0.5 1" in found._repr_html_()
    assert len(found.plot().axes[0].patches) == 3
