"""A channel that is not what it is taken for is said so, with the likely reason, before anything is fitted."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint.diagnosis.checks.beside_nominal import beside_nominal, known_factors
from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.errors import UserError

Change = Callable[[np.ndarray, Recording], np.ndarray]
N = 112.66666666666667


@pytest.fixture(scope="module")
def look(root: Path) -> Iterator[Callable[..., list[Suspicion]]]:
    """look(name, change): what is said of two runs of the open set whose channel of that name is changed."""
    campaign = load_campaign(root / "proof/open/case01", roles=("train",))
    believed: set[str] = set()
    with Simulator(campaign.systems()) as simulate:

        def changed(r: Recording, name: str, change: Change) -> Recording:
            kind = "inputs" if name in r.inputs else "outputs"
            series = dict(getattr(r, kind))
            if name in series:
                series[name] = change(series[name], r)
            return replace(r, **{kind: series}, believed=r.believed | believed)

        def said(name: str = "", change: Change = lambda x, r: x, looked_at: Collection[str] = ()) -> list[Suspicion]:
            nonlocal believed
            believed = {*looked_at}
            runs = [changed(r, name, change) for r in campaign.train[1:]]
            return suspicions(runs) + beside_nominal(runs, simulate, {"planetary_gear.ratio.N": N})

        yield said


def test_nothing_is_said_of_a_clean_log(look: Callable[..., list[Suspicion]]) -> None:
    assert look() == []


@pytest.mark.parametrize(
    ("name", "change", "kind", "words"),
    [
        ("i_motor", lambda x, r: 1e3 * x, "factor", "factor 1000, a unit of a thousandth was declared whole (mA as A)"),
        ("i_motor", lambda x, r: 10 * x, "factor", "factor 10, a decimal place"),
        (
            "w_motor",
            lambda x, r: x * 30 / np.pi,
            "factor",
            "factor 9.5493, rpm read as rad/s or 10, a decimal place? If so, its unit or scale",
        ),
        ("w_motor", lambda x, r: x / (2 * np.pi), "factor", "factor 0.15915, turns per second read as rad/s"),
        ("w_motor", lambda x, r: x * 180 / np.pi, "factor", "factor 57.296, degrees per second read as rad/s"),
        ("w_motor", lambda x, r: x / N, "factor", "the gear ratio planetary_gear.ratio.N"),
        ("tau_sensor", lambda x, r: -x, "sign", "it moves against the nominal system (correlation -1.00): reversed?"),
        ("i_brake", lambda x, r: 1e3 * x, "factor", "with a factor of 0.001 every output fits the nominal system"),
        ("v_command", lambda x, r: N * x, "factor", "a gear's ratio: it belongs to the other side of that gear"),
        ("v_command", lambda x, r: -x, "sign", "with its sign reversed every output fits the nominal system"),
        ("v_command", lambda x, r: 0 * x, "frozen", "with which the nominal system stands still while i_motor moves"),
    ],
)
def test_a_factor_sign_or_dead_input_is_named_and_sure_enough_to_stop(
    look: Callable[..., list[Suspicion]], name: str, change: Change, kind: str, words: str
) -> None:
    found = look(name, change)[-1]
    assert (found.channel, found.kind, found.wrong) == (name, kind, True)
    assert words in found.evidence


def test_an_input_that_somebody_looked_at_is_named_where_outputs_are_odd_unless_these_were_looked_at_as_well(
    look: Callable[..., list[Suspicion]],
) -> None:
    """A drafted scale, "9.52 V/(N.m)", counted as looked at: the measured current was said to be read wrongly."""
    found = look("v_command", lambda x, r: N * x, {"v_command"})[-1]
    assert (found.channel, found.kind, found.wrong) == ("v_command", "factor", True)
    assert found.evidence.endswith("if it is right, scale = 1 for w_motor")
    assert not any(s.wrong for s in look("v_command", lambda x, r: N * x, {"v_command", "w_motor"}))


def hold(x: np.ndarray, r: Recording) -> np.ndarray:
    held = np.random.default_rng(3).random(len(x)) < 0.3
    return x[np.maximum.accumulate(np.where(held, 0, np.arange(len(x))))]


@pytest.mark.parametrize(
    ("name", "change", "kind", "words"),
    [
        ("tau_sensor", lambda x, r: np.minimum(x, 0.6 * x.max()), "clipped", "clipped at the top"),
        ("w_motor", lambda x, r: np.where((r.time > 6) & (r.time < 8), x[6000], x), "frozen", "while i_motor moves"),
        ("i_motor", hold, "held", "% of its samples repeat the one before while it moves: held"),
        ("w_motor", lambda x, r: np.interp(r.time - 0.005, r.time, x), "late", "it comes 5"),
        ("w_motor", lambda x, r: np.interp(1.005 * r.time, r.time, x), "clock drifts", "its delay grows by -5"),
        ("w_motor", lambda x, r: np.where(r.time == r.time[77], 1e6, x), "outlier", "1 samples lie far outside"),
        ("v_command", lambda x, r: np.where(r.time == r.time[77], 1e6, x), "outlier", "1 samples lie far outside"),
    ],
)
def test_a_faulty_channel_is_said_in_words(
    look: Callable[..., list[Suspicion]], name: str, change: Change, kind: str, words: str
) -> None:
    found = [s for s in look(name, change) if s.channel == name]
    assert {s.kind for s in found} == {kind}
    assert words in found[-1].evidence


def test_two_channels_that_are_swapped_are_named(look: Callable[..., list[Suspicion]], root: Path) -> None:
    first = load_campaign(root / "proof/open/case01", roles=("train",)).train[2]
    i, w = first.outputs["i_motor"], first.outputs["w_motor"]
    swapped = replace(first, outputs=first.outputs | {"i_motor": w, "w_motor": i})
    with Simulator(load_campaign(root / "proof/open/case01", roles=("train",)).systems()) as simulate:
        (found,) = beside_nominal([swapped], simulate)
    assert (found.kind, found.wrong, found.channel) == ("swapped", True, "i_motor, w_motor")


def test_one_column_taken_for_two_channels_is_named_and_sure_enough_to_stop(
    look: Callable[..., list[Suspicion]],
) -> None:
    found = look("tau_sensor", lambda x, r: r.outputs["i_motor"])[0]
    assert (found.channel, found.kind, found.wrong) == ("i_motor, tau_sensor", "duplicate", True)


def test_a_run_that_excites_nothing_is_said(look: Callable[..., list[Suspicion]]) -> None:
    rng = np.random.default_rng(1)
    r = Recording(
        "rest", "train", "default", np.arange(4000) * 1e-3, {}, {"w": rng.normal(0, 0.3, 4000)}, {"w": "rad/s"}
    )
    (found,) = suspicions([r])
    assert found.kind == "not excited"


def spun(name: str, J: float, tau_C: float = 0.0, share: float = 1.0, noise: float = 0.01) -> Recording:
    """J dw/dt = tau - tau_C sgn(w) - d w: a shaft under a torque that was recorded, logged with noise."""
    rng, step = np.random.default_rng(5), 1e-3
    t = np.arange(8000) * step
    tau = share * (0.5 * np.sin(2 * np.pi * 0.7 * t) + 0.3 * np.sin(2 * np.pi * 2.3 * t))
    tau = tau + tau_C * np.sign(tau)
    w = np.zeros_like(t)
    for k in range(len(t) - 1):
        w[k + 1] = w[k] + step * (tau[k] - tau_C * np.tanh(w[k] / 0.02) - 0.05 * w[k]) / J
    logged = {"tau": tau + rng.normal(0, 1e-3, len(t))}
    return Recording(
        name, "train", "default", t, logged, {"w": w + rng.normal(0, noise, len(t))}, {"w": "rad/s", "tau": "N.m"}
    )


def test_an_inertia_that_differs_by_run_is_said_and_one_that_does_not_is_not() -> None:
    assert suspicions([spun("a", 0.02), spun("b", 0.02)]) == []
    (found,) = suspicions([spun("a", 0.02), spun("b", 0.03)])
    assert (found.kind, found.recording) == ("inertia differs", "a, b")
    a, b = (float(x) for x in re.findall(r"(\S+) in [ab]", found.evidence))
    assert (a, b) == (pytest.approx(0.02, rel=0.02), pytest.approx(0.03, rel=0.02))


def test_a_slow_run_beside_quick_ones_has_no_other_inertia_and_quick_ones_that_differ_are_still_said() -> None:
    slow, quick = (spun(name, 0.02, 0.05, share, noise=0.02) for name, share in (("slow", 0.1), ("quick", 1.0)))
    assert suspicions([slow, quick]) == []
    (found,) = suspicions([slow, quick, spun("heavy", 0.03, 0.05, noise=0.02)])
    assert found.kind == "inertia differs"
    assert "heavy" in found.recording


def test_the_usual_factor_nearest_in_size_is_named() -> None:
    rpm = (pytest.approx(9.5493, abs=1e-4), "rpm read as rad/s")
    # a nominal system that is 8 % off tells neither from the other
    assert known_factors(10.3, "rad/s", {}) == [rpm, (10.0, "a decimal place")]
    assert known_factors(98.0, "rad/s", {}) == [(100.0, "percent, or hundredths")]
    assert known_factors(9.8, "A", {}) == [(10.0, "a decimal place")]
    assert [words for _, words in known_factors(57.0, "rad", {})] == ["degrees read as rad"]
    assert known_factors(1.02e-3, "V", {})[0][1].endswith("inverted")
    assert known_factors(4.2, "V", {}) == []


def milliamperes(root: Path, folder: Path, entry: str = "") -> Path:
    shutil.copytree(root / "proof/open/case01", folder / "case", dirs_exist_ok=True)
    file = folder / "case/load.parquet"
    table = pa.parquet.read_table(file)
    k = next(k for k, name in enumerate(table.column_names) if name.startswith("i_motor"))
    table = table.set_column(k, table.column_names[k], pa.compute.multiply(table.column(k), 1e3))
    pa.parquet.write_table(table, file)
    with (folder / "case/campaign.toml").open("a") as campaign:
        campaign.write(entry)
    return folder / "case/campaign.toml"


def test_mA_declared_as_A_ends_the_diagnosis_in_one_line_within_seconds(root: Path, tmp_path: Path) -> None:
    begun = time.monotonic()
    call = [sys.executable, "-m", "cobot_joint", "diagnose", str(milliamperes(root, tmp_path))]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "load: i_motor: it moves 971.4 times as much as the nominal system" in done.stderr
    assert "scale = 0.001 for 'i_motor'" in done.stderr
    assert time.monotonic() - begun < 30  # 3 s on an idle machine


def test_whoever_gives_a_scale_is_believed(root: Path, tmp_path: Path) -> None:
    from cobot_joint.diagnosis.checks.plausibility import plausible

    names = ["v_command", "i_brake", "w_motor", "tau_sensor"]
    entry = "\n[channels]\n" + "".join(f'{n} = "{n}"\n' for n in names) + 'i_motor = { to = "i_motor", scale = 1 }\n'
    campaign = load_campaign(milliamperes(root, tmp_path, entry), roles=("train",))
    assert all(not s.wrong for s in plausible(campaign))
    with pytest.raises(UserError):
        plausible(load_campaign(milliamperes(root, tmp_path / "b"), roles=("train",)))


def test_a_scale_that_somebody_gave_is_believed_and_one_that_is_far_off_is_said(
    look: Callable[..., list[Suspicion]],
) -> None:
    """57 times too large a speed with `scale = 1` was believed without a word."""
    (found,) = look("w_motor", lambda x, r: x * 180 / np.pi, looked_at=["w_motor"])
    assert (found.kind, found.wrong) == ("factor", False)
    assert "the scale that [channels] gives 'w_motor' is believed" in found.evidence
    assert look(looked_at=["w_motor"]) == []
