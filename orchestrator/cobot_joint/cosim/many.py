"""Many varied runs of one system: over local processes, or over a Dask cluster by its address; the same call."""

from __future__ import annotations

import hashlib
import math
import pickle
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from cobot_joint.cosim.simulation import Simulation
from cobot_joint.errors import UserError
from cobot_joint.results import SignalsWriter, columns_of, provenance
from cobot_joint.system.model import Inputs, Result, System, Value
from cobot_joint.system.parameters import with_parameters

RUNS_PER_TASK = 16  # at most: so that sending a task does not show
Keep = Callable[[Result], Any]


@dataclass(frozen=True)
class Variation:
    """One run: what differs from the others. `inputs` of None: the common ones; `options`: of Simulation.run."""

    parameters: Mapping[str, Value] = field(default_factory=dict)
    inputs: Inputs | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """What became of a variation: `kept` of its result, the file it was written to, or the error in one line."""

    index: int
    variation: Variation
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
    inputs: Inputs
    stop_time: float
    options: Mapping[str, Any]
    keep: Keep | None
    out: Path | None
    started: Path | None


def simulate_many(
    system: System,
    inputs: Inputs,
    stop_time: float,
    variations: Sequence[Variation | Mapping[str, Value]],
    *,
    jobs: int = -1,
    dask: str | None = None,
    keep: Keep | None = None,
    out: Path | None = None,
    progress: Callable[[Advance], None] | None = None,
    **options: Any,
) -> Iterator[Outcome]:
    """Run every variation; yield outcomes as they come, in any order. A failed run is one of them and stops nothing.

    `variations`: parameters by `component.variable`, or Variation; `options`: of Simulation.run, for all. `keep`:
    computed from each result where it was made, so that only that travels; None: the result itself, or nothing where
    `out` is given. `out`: a folder that gets `run_00000.parquet` of every run, with provenance. `jobs`: processes,
    -1: one per core; `dask`: a scheduler's address instead. `progress`: called after every run.
    UserError: a parameter that is wrong, before anything runs.
    """
    runs = [v if isinstance(v, Variation) else Variation(v) for v in variations]
    for n, run in enumerate(runs):
        with_parameters(system, run.parameters, f"variation {n}")
    blob = pickle.dumps(system)
    key = hashlib.sha256(blob).hexdigest()
    begun, failed = time.monotonic(), 0
    with tempfile.TemporaryDirectory() as marks:
        campaign = _Campaign(key, blob, inputs, stop_time, options, keep, out, None if dask else Path(marks))
        todo = dict(enumerate(runs))
        outcomes = _over_dask(campaign, todo, dask) if dask else _over_processes(campaign, todo, jobs)
        for done, outcome in enumerate(outcomes, 1):
            failed += outcome.error is not None
            if progress:
                elapsed = time.monotonic() - begun
                progress(Advance(done, failed, len(runs), elapsed, elapsed / done * (len(runs) - done)))
            yield outcome


def _over_processes(campaign: _Campaign, todo: dict[int, Variation], jobs: int) -> Iterator[Outcome]:
    """Where a process dies, those runs that had been started are tried alone, and the rest goes on."""
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


def _parallel(campaign: _Campaign, tasks: list[list[tuple[int, Variation]]], workers: int) -> Iterator[list[Outcome]]:
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
    yield from parallel(joblib.delayed(_run_task)(campaign, task) for task in tasks)


def _alone(campaign: _Campaign, n: int, variation: Variation) -> Outcome:
    """A run in a process of its own, that may die."""
    twice = [[(n, variation)], []]  # with one task alone joblib would run it right here
    try:
        return next(outcome for outcomes in _parallel(campaign, twice, 2) for outcome in outcomes)
    except TerminatedWorkerError:
        return Outcome(n, variation, error="the process that ran it died: a unit crashed")


def _over_dask(campaign: _Campaign, todo: dict[int, Variation], address: str) -> Iterator[Outcome]:
    """One future per run; Dask restarts workers that die and gives a run up that kills several."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise UserError(
            f"dask {address!r} is given: `pip install cobot-joint[cluster]` brings what it needs"
        ) from error
    with Client(address) as client:
        common = client.scatter(campaign, broadcast=True)
        futures = {client.submit(_run_task, common, [(n, v)], pure=False): (n, v) for n, v in todo.items()}
        for future in as_completed(futures):
            n, variation = futures.pop(future)
            if (trouble := future.exception()) is not None:
                yield Outcome(n, variation, error=f"{type(trouble).__name__}: {trouble}")
            else:
                yield from future.result()


_loaded: dict[str, Simulation] = {}  # in a worker: the system that it last ran


def _run_task(campaign: _Campaign, runs: list[tuple[int, Variation]]) -> list[Outcome]:
    return [_run(campaign, n, variation) for n, variation in runs]


def _run(campaign: _Campaign, n: int, variation: Variation) -> Outcome:
    mark = campaign.started / str(n) if campaign.started else None
    try:
        if mark:
            mark.touch()
        simulation = _simulation(campaign)
        result = simulation.run(
            variation.inputs or campaign.inputs,
            campaign.stop_time,
            parameters=variation.parameters,
            **{**campaign.options, **variation.options},
        )
        path = _write(campaign.out, n, simulation.system, variation, result) if campaign.out else None
        kept = campaign.keep(result) if campaign.keep else None if campaign.out else result
        return Outcome(n, variation, kept, path)
    except Exception as error:  # whatever it was, the other runs go on, and the outcome says it
        return Outcome(n, variation, error=f"{type(error).__name__}: {error}")
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


def _write(out: Path, n: int, system: System, variation: Variation, result: Result) -> Path:
    path = out / f"run_{n:05d}.parquet"
    columns = {name: unit for name, unit in columns_of(system).items() if name == "time" or name in result.signals}
    columns |= {name: None for name in result.signals if name not in columns}
    varied = with_parameters(system, variation.parameters)
    facts = provenance(varied, scheme=result.scheme, step=result.step, energy=result.energy, variation=n)
    with SignalsWriter(path, columns, facts) as writer:
        writer.write({"time": result.time, **result.signals})
    return path
