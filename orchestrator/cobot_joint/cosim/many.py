"""Many varied runs of one system: over local processes, or over a Dask cluster by its address; the same call."""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cobot_joint.cosim.experiment import Experiment
from cobot_joint.cosim.simulation import Simulation
from cobot_joint.errors import UserError
from cobot_joint.interrupts import end_with
from cobot_joint.results.files import SignalsWriter, provenance
from cobot_joint.results.result import Result
from cobot_joint.system.model import System
from cobot_joint.system.parameters import with_parameters

RUNS_PER_TASK = 16  # at most: so that sending a task does not show
Keep = Callable[[Result], Any]


@dataclass(frozen=True)
class Outcome:
    """How the run of that index ended: `kept` of its result, the file with it, or the error in one line."""

    index: int
    kept: Any = None
    path: Path | None = None
    error: str | None = None


@dataclass(frozen=True)
class Advance:
    """How far the runs have come; `remaining`: s, estimated from those that are done."""

    done: int
    failed: int
    total: int
    elapsed: float
    remaining: float


@dataclass(frozen=True)
class _Campaign:
    """What all runs have in common, sent to every worker once per task; `key` names it in the worker's cache."""

    key: str
    system: bytes
    keep: Keep | None
    out: Path | None
    started: Path | None


def simulate_many(
    system: System,
    experiments: Iterable[Experiment],
    *,
    jobs: int = -1,
    dask: str | None = None,
    keep: Keep | None = None,
    out: Path | None = None,
    progress: Callable[[Advance], None] | None = None,
) -> Iterator[Outcome]:
    """Run every experiment; yield outcomes as they come, in any order. A failed run is one of them and stops nothing.

    `keep`: computed from each result where it was made, so that only that travels; None: the result itself, or nothing
    where `out` is given. `out`: a folder that gets `run_00000.parquet` of every run, with provenance. `jobs`:
    processes, -1: one per core; `dask`: a scheduler's address instead. `progress`: called after every run.
    UserError: a parameter that is wrong, before anything runs.
    """
    todo = dict(enumerate(experiments))
    for n, experiment in todo.items():
        with_parameters(system, experiment.parameters, f"experiment {n}")
    blob = pickle.dumps(system)
    key = hashlib.sha256(blob).hexdigest()
    begun, failed, total = time.monotonic(), 0, len(todo)
    with tempfile.TemporaryDirectory() as marks:
        campaign = _Campaign(key, blob, keep, out, None if dask else Path(marks))
        outcomes = _over_dask(campaign, todo, dask) if dask else _over_processes(campaign, todo, jobs)
        for done, outcome in enumerate(outcomes, 1):
            failed += outcome.error is not None
            if progress:
                elapsed = time.monotonic() - begun
                progress(Advance(done, failed, total, elapsed, elapsed / done * (total - done)))
            yield outcome


def _over_processes(campaign: _Campaign, todo: dict[int, Experiment], jobs: int) -> Iterator[Outcome]:
    """Where a process dies, those runs that had been started are tried alone, and the rest goes on."""
    import joblib  # here: most runs are single ones, and it takes longer to import than one of these takes
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    workers = joblib.cpu_count() if jobs < 0 else max(1, jobs)
    while todo:
        per_task = max(1, min(RUNS_PER_TASK, math.ceil(len(todo) / (4 * workers))))
        items = list(todo.items())
        tasks = [items[k : k + per_task] for k in range(0, len(items), per_task)]
        try:
            for outcomes in _parallel(campaign, tasks, workers):
                for outcome in outcomes:
                    del todo[outcome.index]
                    yield outcome
        except TerminatedWorkerError:
            assert campaign.started is not None
            for n in sorted(n for n in todo if (campaign.started / str(n)).exists()):
                yield _alone(campaign, n, todo.pop(n))


def _parallel(campaign: _Campaign, tasks: list[list[tuple[int, Experiment]]], workers: int) -> Iterator[list[Outcome]]:
    import joblib

    lifeline = {"initializer": end_with, "initargs": (os.getpid(),)}
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1, **lifeline)
    yield from parallel(joblib.delayed(_run_task)(campaign, task) for task in tasks)


def _alone(campaign: _Campaign, n: int, experiment: Experiment) -> Outcome:
    """A run in a process of its own, that may die."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    twice = [[(n, experiment)], []]  # with one task alone joblib would run it right here
    try:
        return next(outcome for outcomes in _parallel(campaign, twice, 2) for outcome in outcomes)
    except TerminatedWorkerError:
        return Outcome(n, error="the process that ran it died: a unit crashed")


def _over_dask(campaign: _Campaign, todo: dict[int, Experiment], address: str) -> Iterator[Outcome]:
    """One future per run; Dask restarts workers that die and gives a run up that kills several."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise UserError(
            f"dask {address!r} is given: `pip install cobot-joint[cluster]` brings what it needs"
        ) from error
    with Client(address) as client:
        common = client.scatter((campaign, todo), broadcast=True)  # inputs that runs share travel once
        futures = {client.submit(_run_nth, common, n, pure=False): n for n in todo}
        for future in as_completed(futures):
            n = futures.pop(future)
            if (trouble := future.exception()) is not None:
                yield Outcome(n, error=f"{type(trouble).__name__}: {trouble}")
            else:
                yield future.result()


_loaded: dict[str, Simulation] = {}  # in a worker: the system that it last ran


def _run_nth(common: tuple[_Campaign, Mapping[int, Experiment]], n: int) -> Outcome:
    campaign, experiments = common
    return _run(campaign, n, experiments[n])


def _run_task(campaign: _Campaign, runs: list[tuple[int, Experiment]]) -> list[Outcome]:
    return [_run(campaign, n, experiment) for n, experiment in runs]


def _run(campaign: _Campaign, n: int, experiment: Experiment) -> Outcome:
    mark = campaign.started / str(n) if campaign.started else None
    try:
        if mark:
            mark.touch()
        simulation = _simulation(campaign)
        result = simulation.run(experiment)
        path = _write(campaign.out, n, simulation.system, experiment, result) if campaign.out else None
        kept = campaign.keep(result) if campaign.keep else None if campaign.out else result
        return Outcome(n, kept, path)
    except Exception as error:  # whatever it was, the other runs go on, and the outcome says it
        return Outcome(n, error=f"{type(error).__name__}: {error}")
    finally:
        if mark:
            with suppress(FileNotFoundError):
                mark.unlink()


def _simulation(campaign: _Campaign) -> Simulation:
    if campaign.key not in _loaded:
        for other in _loaded.values():
            other.close()
        _loaded.clear()
        _loaded[campaign.key] = Simulation(pickle.loads(campaign.system))
    return _loaded[campaign.key]


def _write(out: Path, n: int, system: System, experiment: Experiment, result: Result) -> Path:
    path = out / f"run_{n:05d}.parquet"
    columns = {"time": "s"} | {name: result.units[name] for name in result.signals}
    varied = with_parameters(system, experiment.parameters)
    facts = provenance(varied, scheme=result.scheme, step=result.step, energy=result.energy, run=n)
    with SignalsWriter(path, columns, facts) as writer:
        writer.write({"time": result.time, **result.signals})
    return path
