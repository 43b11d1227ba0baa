"""Many runs: the same answers as one by one, over processes and over Dask; what fails is reported and stops nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from joblib.externals.loky import get_reusable_executor

from cobot_joint.cosim import Advance, Experiment, simulate, simulate_many
from cobot_joint.errors import UserError
from cobot_joint.results.files import read_provenance
from cobot_joint.results.result import Result
from cobot_joint.system import Inputs, System

MakeSystem = Callable[..., System]
RAMP = Inputs(np.array([0.0, 1.0]), {"u": np.array([0.0, 1.0])})
PLAIN = Experiment(RAMP, 1.0, scheme="gauss_seidel_extrapolated", step=0.1, output_step=0.1)


def last_y(result: Result) -> float:
    return float(result.signals["y"][-1])


@pytest.mark.parametrize("jobs", [1, 2])
def test_runs_over_processes_are_the_runs_one_by_one(make_gain: MakeSystem, jobs: int) -> None:
    experiments = [PLAIN.with_parameters({"gain.k": float(k)}) for k in range(20)]
    outcomes = list(simulate_many(make_gain(), experiments, jobs=jobs))
    assert sorted(o.index for o in outcomes) == list(range(20))
    for outcome in outcomes:
        alone = simulate(make_gain(), experiments[outcome.index])
        assert outcome.error is None
        assert outcome.kept.signals["y"].tobytes() == alone.signals["y"].tobytes()


def test_inputs_and_steps_can_differ_from_run_to_run(make_gain: MakeSystem) -> None:
    steady = Inputs(np.array([0.0]), {"u": np.array([3.0])})
    experiments = [PLAIN, replace(PLAIN, inputs=steady), replace(PLAIN, output_step=0.5, step=0.5)]
    outcomes = simulate_many(make_gain(), experiments, jobs=1)
    results = {o.index: o.kept for o in outcomes}
    assert [last_y(results[n]) for n in range(3)] == pytest.approx([21, 61, 21])
    assert [len(results[n].time) for n in range(3)] == [11, 11, 3]


def test_a_failed_run_is_reported_and_stops_nothing(make_gain: MakeSystem) -> None:
    experiments = [PLAIN.with_parameters({"gain.fail_at": 0.5 if n == 3 else 9.0}) for n in range(8)]
    outcomes = sorted(simulate_many(make_gain(), experiments, jobs=2, keep=last_y), key=lambda o: o.index)
    assert [o.error is None for o in outcomes] == [n != 3 for n in range(8)]
    assert "gain: fmi2DoStep returned error at t = 0.5 s" in (outcomes[3].error or "")
    assert [o.kept for o in outcomes if o.error is None] == pytest.approx([21] * 7)


@pytest.mark.parametrize(
    ("isolated", "told"),
    [
        ("foreign", "UnitEndedError: gain: fmi2DoStep at t = 0.5 s crashed (SIGABRT: "),
        ("none", "the process that ran it died: a unit crashed"),
    ],
)
def test_a_run_that_takes_its_process_with_it_is_reported_and_stops_nothing(
    make_gain: MakeSystem, monkeypatch: pytest.MonkeyPatch, isolated: str, told: str
) -> None:
    monkeypatch.setenv("COBOT_JOINT_ISOLATE", isolated)
    get_reusable_executor().shutdown(wait=True)  # processes of earlier tests have the environment of then
    system = make_gain(fail_as=9)
    experiments = [PLAIN.with_parameters({"gain.fail_at": 0.5 if n in (2, 9) else 9.0}) for n in range(12)]
    outcomes = sorted(simulate_many(system, experiments, jobs=2, keep=last_y), key=lambda o: o.index)
    assert [o.index for o in outcomes] == list(range(12))
    assert [o.index for o in outcomes if o.error] == [2, 9]
    assert [outcomes[n].error.startswith(told) for n in (2, 9)] == [True, True]
    get_reusable_executor().shutdown(wait=True)


def test_results_go_to_disk_with_units_and_provenance(make_gain: MakeSystem, tmp_path: Path) -> None:
    gains = [3.0, 4.0]
    outcomes = list(
        simulate_many(make_gain(), [PLAIN.with_parameters({"gain.k": k}) for k in gains], jobs=1, out=tmp_path)
    )
    for outcome in outcomes:
        assert outcome.kept is None
        assert outcome.path == tmp_path / f"run_{outcome.index:05d}.parquet"
        y = pq.read_table(outcome.path)["y [1]"].to_numpy()
        assert y[-1] == pytest.approx(10 * gains[outcome.index] + 1)
        assert read_provenance(outcome.path)["parameters"]["gain.k"] == gains[outcome.index]


def test_progress_counts_failures_and_estimates_what_remains(make_gain: MakeSystem) -> None:
    seen: list[Advance] = []
    experiments = [PLAIN.with_parameters({"gain.fail_at": 0.5}), PLAIN, PLAIN, PLAIN]
    list(simulate_many(make_gain(), experiments, jobs=1, progress=seen.append))
    assert [a.done for a in seen] == [1, 2, 3, 4]
    assert seen[-1].failed == 1
    assert seen[-1].remaining == 0
    assert all(a.remaining == pytest.approx(a.elapsed / a.done * (4 - a.done)) for a in seen)


def test_a_wrong_parameter_is_refused_before_anything_runs(make_gain: MakeSystem) -> None:
    with pytest.raises(UserError, match=r"experiment 1: gain\.kk: no variable"):
        next(simulate_many(make_gain(), [PLAIN, PLAIN.with_parameters({"gain.kk": 1.0})]))


def test_the_same_call_runs_on_a_dask_cluster(make_gain: MakeSystem) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    experiments = [
        PLAIN.with_parameters({"gain.k": float(k), "gain.fail_at": 0.5 if k == 2 else 9.0}) for k in range(6)
    ]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        outcomes = list(simulate_many(make_gain(), experiments, dask=address, keep=last_y))
    kept = {o.index: o.kept for o in outcomes if o.error is None}
    assert kept == pytest.approx({k: 10 * k + 1 for k in range(6) if k != 2})
    assert [o.index for o in outcomes if o.error] == [2]
