"""Steady states as a table: every row is held, only the end of its hold counts, and its scatter is the noise."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.recording import condition
from cobot_joint.diagnosis.data.tables import PER_HOLD, error_of_mean, scatter
from cobot_joint.diagnosis.drafts.chain import chain, write_readable
from cobot_joint.diagnosis.engine import diagnose
from cobot_joint.errors import UserError

SPEEDS = np.concatenate([-np.arange(200, 5, -10), np.arange(10, 205, 10)]).astype(float)  # rpm

CAMPAIGN = """system = "system.ssd"
[channels]
"n [rpm]" = { to = "w", sign = -1 }
"M [%]" = { to = "tau", sign = -1, scale = "9.84 mN.m" }
[tolerances]
"friction.friction.tau_C" = [0.0, 0.01]
[[recording]]
file = FILE
table = KIND
"""


def law(rpm: np.ndarray) -> np.ndarray:
    """% of the rated torque: Coulomb and viscous friction."""
    return 20 * np.sign(rpm) + 0.05 * rpm


def campaign(folder: Path, file: str, kind: str) -> Path:
    write_readable(chain(["friction"]).system, [], folder / "system.ssd")
    (folder / "campaign.toml").write_text(CAMPAIGN.replace("FILE", file).replace("KIND", f'"{kind}"'))
    return folder / "campaign.toml"


def test_lines_without_a_clock_are_rows(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.5, len(SPEEDS))
    rows = "\n".join(f"{n},{m}" for n, m in rng.permutation(np.column_stack([SPEEDS, law(SPEEDS) + noise])))
    (tmp_path / "table.csv").write_text(f"n,M\n{rows}")
    (r,) = load_campaign(campaign(tmp_path, '"table.csv"', "rows")).recordings
    ends = np.flatnonzero(np.isfinite(r.outputs["tau"]))
    assert np.array_equal(ends, PER_HOLD * np.arange(1, len(SPEEDS) + 1))
    assert r.inputs["w"][ends] == pytest.approx(np.sort(SPEEDS) * np.pi / 30)
    assert r.outputs["tau"][ends] == pytest.approx(law(np.sort(SPEEDS)) * 9.84e-5, abs=5 * 0.5 * 9.84e-5)
    held = [r.inputs["w"][k - PER_HOLD // 2 : k + 1] for k in ends]
    assert all(np.ptp(x) == 0 for x in held)


def test_a_file_per_speed_is_a_row_of_its_means(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for n in SPEEDS:
        t, m = np.arange(200) * 0.05, law(np.array([n])) + rng.normal(0, 1, 200)
        lines = [f"{a},{n},{b}" for a, b in zip(t, m, strict=True)]
        (tmp_path / f"{n:g}.csv").write_text("time,n,M\n" + "\n".join(lines))
    loaded = load_campaign(campaign(tmp_path, '"*.csv"', "mean"))
    (r,) = loaded.recordings
    rows = r.outputs["tau"][np.isfinite(r.outputs["tau"])]
    assert rows == pytest.approx(law(np.sort(SPEEDS)) * 9.84e-5, abs=0.4 * 9.84e-5)
    assert condition(loaded.recordings)["tau"].noise == pytest.approx(9.84e-5 / np.sqrt(200), rel=0.5)


def test_tables_of_one_folder_are_told_apart_by_what_they_are_for_and_ask_for_no_clock(tmp_path: Path) -> None:
    """They were both called `../tab/v00.csvtab`, with fifty notes on gaps and clocks of files whose means count."""
    rng = np.random.default_rng(3)
    for k, n in enumerate(SPEEDS[:12]):
        t = np.delete(np.arange(200) * 0.05, slice(50, 60)) + rng.uniform(-0.01, 0.01, 190)
        lines = [f"{a},{n},{law(np.array([n]))[0]}" for a in t]
        (tmp_path / f"{k:02}.csv").write_text("time,n,M\n" + "\n".join(lines))
    held = '\n[[recording]]\nfile = ["08.csv", "09.csv", "10.csv", "11.csv"]\ntable = "mean"\nrole = "holdout"\n'
    path = campaign(tmp_path, '"*.csv"', "mean")
    path.write_text(path.read_text() + held)
    training, other = load_campaign(path).recordings
    assert [training.name, other.name] == [f"{tmp_path.name}, training", f"{tmp_path.name}, held out"]
    assert training.notes == []


def test_what_is_said_of_some_files_of_a_table_has_their_names(tmp_path: Path) -> None:
    """It was said of the first, whichever it was."""
    for k, n in enumerate(SPEEDS[:12]):
        lines = [f"{0.05 * j},{n},{law(np.array([n]))[0]},{j}" for j in range(100)]
        lines = lines if k == 3 else [line.rpartition(",")[0] for line in lines]
        (tmp_path / f"{k:02}.csv").write_text(f"time,n,M{',oil' if k == 3 else ''}\n" + "\n".join(lines))
    (r,) = load_campaign(campaign(tmp_path, '"*.csv"', "mean")).recordings
    assert r.notes == ["03.csv: oil is not connected to the system and not used"]


def test_the_scatter_is_that_of_the_rows_and_not_of_the_law() -> None:
    rng = np.random.default_rng(2)
    x = np.sort(rng.uniform(-20, 20, 400))
    y = law(10 * x) + rng.normal(0, 0.3, 400)
    assert scatter([x], y) == pytest.approx(0.3, rel=0.15)


def test_a_table_of_too_few_rows_is_refused(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("n,M\n10,1\n20,2\n30,3\n")
    with pytest.raises(UserError, match="3 usable samples are given, 4 at least are needed"):
        load_campaign(campaign(tmp_path, '"table.csv"', "rows"))


def test_the_page_s_campaign_reads_a_drive_maker_s_exports_as_they_are(
    tmp_path: Path, root: Path, shared: Path
) -> None:
    page = (root / "docs/own-bench.md").read_text().split('    title = "Lead screw')[1]
    text = textwrap.dedent('    title = "Lead screw' + page)
    assert len(text.strip().splitlines()) <= 20
    write_readable(chain(["friction"]).system, [], tmp_path / "system.ssd")
    drives = shared / "recordings/real/screw_drives"
    (tmp_path / "campaign.toml").write_text(text.replace("driveNo1/", f"{drives}/driveNo1/"))
    train, holdout = load_campaign(tmp_path / "campaign.toml").recordings
    assert [int(np.isfinite(r.outputs["tau"]).sum()) for r in (train, holdout)] == [24, 8]
    ends = np.isfinite(train.outputs["tau"])
    speed, torque = train.inputs["w"][ends] * 30 / np.pi, 1e3 * train.outputs["tau"][ends]
    assert speed == pytest.approx([-200, -160, -140, -100, -90, -80, -60, -50, -40, -20, -10, -2,
                                   2, 10, 20, 40, 50, 60, 80, 90, 100, 140, 160, 200], abs=1)  # fmt: skip
    assert np.all(np.sign(torque) == np.sign(speed))
    assert 0.02 < 1e3 * train.scatter["tau"] < 0.3  # mN.m; a friction law leaves 0.04 to 0.13


def test_how_well_a_row_is_known_the_means_of_parts_of_its_file_say() -> None:
    rng = np.random.default_rng(4)
    errors = [error_of_mean(3.0 + rng.normal(0, 0.5, 2000)) for _ in range(40)]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(0.5 / np.sqrt(2000), rel=0.15)
    assert np.isnan(error_of_mean(np.arange(12.0)))


def test_an_output_that_one_file_lacks_is_not_compared_in_its_row_whichever_file_comes_first(tmp_path: Path) -> None:
    system = chain(["friction"]).system
    write_readable(system, [], tmp_path / "system.ssd")
    for k, n in enumerate(SPEEDS):
        rows = [f"{a},{n},{law(np.array([n]))[0]},{n}" for a in np.arange(20) * 0.05]
        columns = "t,n,M" if k in (0, 3) else "t,n,M,M2"
        (tmp_path / f"{k:02d}.csv").write_text(
            columns + "\n" + "\n".join(r.rsplit(",", columns == "t,n,M")[0] for r in rows)
        )
    text = CAMPAIGN.replace("FILE", '"*.csv"').replace("KIND", '"mean"\nwithout = ["M2"]')
    (tmp_path / "campaign.toml").write_text(text.replace("[tolerances]", '"M2 [N.m]" = "friction.tau_f"\n[tolerances]'))
    (r,) = load_campaign(tmp_path / "campaign.toml").recordings
    assert np.isfinite(r.outputs["tau"]).sum() == len(SPEEDS)
    assert np.isfinite(r.outputs["friction.tau_f"]).sum() == len(SPEEDS) - 2


def test_where_a_table_differs_is_said_without_a_time(tmp_path: Path) -> None:
    """A drag that shows at high speed was "time is first quarter": the order that rows are visited in."""
    drag = 4e-4 * SPEEDS * np.abs(SPEEDS)  # %
    noise = np.random.default_rng(4).normal(0, 0.1, len(SPEEDS))
    rows = "\n".join(f"{n},{m}" for n, m in zip(SPEEDS, law(SPEEDS) + drag + noise, strict=True))
    (tmp_path / "table.csv").write_text(f"n,M\n{rows}")
    found = diagnose(load_campaign(campaign(tmp_path, '"table.csv"', "rows")))
    assert found.located is not None
    assert found.located["above_noise"]
    assert found.located["change_points"] == []
    variables = [*found.located["regimes"], *(r["variable"] for f in found.findings for r in f.where["by_regime"])]
    assert "w" in variables
    assert "time" not in variables
