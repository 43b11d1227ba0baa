"""Reference files per unit: laid out as FMI's cross-check asks, and reproduced by FMPy within the band it allows."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.cross_check import validate_signal
from fmpy.util import read_csv, read_ref_opt_file

from cobot_joint.cosim.foreign.cross_check import write_cross_check
from cobot_joint.diagnosis.repair.export import export_unit
from cobot_joint.units import find_fmu, load_unit

UNITS = sorted(table.parent.name for table in (Path(__file__).parents[3] / "fmus").glob("*/model.def"))
LARGEST = 1_000_000  # bytes; FMI-CROSS-CHECK-RULES 4.1, appendix B
OUTLIERS = 0.1  # of the samples, 10 % of the signal's range away: as FMPy judges, here per signal


@pytest.fixture(scope="module", params=UNITS)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """A unit's FMU, and its files."""
    fmu = find_fmu(f"{request.param}.fmu")
    return fmu, write_cross_check(load_unit(fmu), tmp_path_factory.mktemp("cross_check"))


def test_fmpy_reproduces_the_reference(written: tuple[Path, list[Path]]) -> None:
    fmu, (inputs, reference, options) = written
    given = read_ref_opt_file(options)
    start, stop, step = (given[key] for key in ("StartTime", "StopTime", "StepSize"))
    expected = read_csv(reference)
    assert (expected["time"][0], expected["time"][-1]) == (start, stop)
    found = fmpy.simulate_fmu(
        str(fmu), start_time=start, stop_time=stop, output_interval=step, input=read_csv(inputs),
        output=expected.dtype.names[1:],
    )  # fmt: skip
    for name in expected.dtype.names[1:]:
        signals = (found["time"], found[name], expected["time"], expected[name])
        outside = validate_signal(*signals, t_start=start, t_stop=stop)[3]
        assert np.mean(outside) <= OUTLIERS, name


def test_files_are_as_the_rules_ask(written: tuple[Path, list[Path]]) -> None:
    fmu, files = written
    assert [f.name for f in files] == [f"{fmu.stem}_{kind}" for kind in ("in.csv", "ref.csv", "ref.opt")]
    unit = load_unit(fmu)
    for file, causality in zip(files, ("input", "output"), strict=False):
        assert file.stat().st_size < LARGEST
        time, *names = file.read_text(encoding="utf-8").splitlines()[0].split(",")
        assert time == '"time"'
        assert {unit.variables[name.strip('"')].causality for name in names} == {causality}
        assert all(name == f'"{name[1:-1]}"' for name in names)
        assert len(names) <= 10
    keys = [line.split(", ")[0] for line in files[2].read_text(encoding="utf-8").splitlines()]
    assert keys[:3] == ["StartTime", "StopTime", "StepSize"]
    assert "RelTol" in keys


def test_another_parameter_makes_another_reference(tmp_path: Path) -> None:
    original = load_unit(find_fmu("motor_bldc.fmu"))
    changed = load_unit(export_unit(original, {"winding.R": 0.9}, tmp_path / "motor_bldc.fmu"))
    for folder, unit in (("one", original), ("other", changed)):
        (tmp_path / folder).mkdir()
        write_cross_check(unit, tmp_path / folder)
    one, other = (read_csv(tmp_path / folder / "motor_bldc_ref.csv")["w"] for folder in ("one", "other"))
    assert np.max(np.abs(one - other)) > 0.01 * np.ptp(one)
    given = [(tmp_path / folder / "motor_bldc_in.csv").read_bytes() for folder in ("one", "other")]
    assert given[0] == given[1]
