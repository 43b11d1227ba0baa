"""Every case of a set of concealed campaigns, then the scoreboard."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from joblib import Parallel, delayed

from cobot_joint.diagnosis.data.campaign import holdouts, missing_recordings
from cobot_joint.diagnosis.evaluation import field_score
from cobot_joint.diagnosis.evaluation import score as case_score
from cobot_joint.diagnosis.evaluation.coverage import coverage
from cobot_joint.diagnosis.evaluation.score import broken_seals
from cobot_joint.diagnosis.store import plain, read_object
from cobot_joint.errors import UserError
from cobot_joint.files import write_atomically
from cobot_joint.paths import PACKAGE


@dataclass(frozen=True)
class CaseResult:
    """What became of one case."""

    case: str
    status: str  # "kept", "done", "failed", or "absent": its recordings are not here
    seconds: float
    message: str = ""  # of a failure: its last line; of what is absent: the first file


@dataclass(frozen=True)
class Proof:
    """A set after all its cases."""

    results: list[CaseResult]
    broken_seals: dict[str, str] | None  # None: nothing is sealed, or the answers are not published
    score: dict[str, Any] | None  # None: no answers


def cases_of(folder: Path) -> list[str]:
    """Names of the sub-folders that hold a campaign. Raises UserError where there are none."""
    if not folder.is_dir():
        raise UserError(f"{folder}: there is no such folder; a set is a folder of folders with a campaign.toml each")
    cases = sorted(path.parent.name for path in folder.glob("*/campaign.toml"))
    if not cases:
        raise UserError(f"{folder}: holds no case; a set is a folder of folders with a campaign.toml each")
    return cases


def prove(
    folder: Path,
    out: Path | None = None,
    *,
    baseline: str | None = None,
    jobs: int = 2,
    done: Callable[[CaseResult], None] | None = None,
) -> Proof:
    """Diagnose every case of `folder`, verify those with held-out runs, score where answers.json is present.

    Finished cases are kept: a diagnosis.json that is there is never written again. Each case runs in a process of its
    own, so that one that fails is reported and does not stop the others. out: results as OUT/<case>/; default: beside
    the recordings.
    """
    out = out or (folder / "baselines" / baseline if baseline else folder)
    cases = cases_of(folder)
    answers, seals = _published(folder / "answers.json"), _published(folder / "seals.json")
    results: list[CaseResult] = []
    calls = Calls()
    work = (delayed(_case)(folder / case, out / case, baseline, calls) for case in cases)
    with calls:
        for result in Parallel(n_jobs=jobs, prefer="threads", return_as="generator_unordered")(work):
            results.append(result)
            if done:
                done(result)
    score = scored(folder, out)
    if score is not None:
        score["baseline"] = baseline
        score["seconds_median"] = seconds_median(cases, out)
        score["true_value_in_interval"] = coverage(answers or {}, out)
        text = json.dumps(plain(score), indent=1) + "\n"
        write_atomically(out / "scoreboard.json", lambda file: file.write_text(text))
    broken = broken_seals(answers, seals) if answers is not None and seals is not None else None
    return Proof(sorted(results, key=lambda r: r.case), broken, score)


def scored(folder: Path, out: Path) -> dict[str, Any] | None:
    """The scoreboard of what OUT/<case>/ answers, by the rules of its kind of campaign; None: no truths are there."""
    answers = _published(folder / "answers.json")
    if answers is None:
        return None
    rules = field_score if field_score.of_field(answers) else case_score
    return rules.scoreboard({case: answers[case] for case in cases_of(folder) if case in answers}, out)


def seconds_median(cases: list[str], out: Path) -> float | None:
    """Median of what the diagnoses took; None where none says it."""
    answers = [read_object(out / case / "diagnosis.json")[0] for case in cases]
    seconds = [answer["seconds"] for answer in answers if answer and answer.get("seconds")]
    return round(median(seconds), 1) if seconds else None


def _published(path: Path) -> dict[str, Any] | None:
    content, why = read_object(path)
    if why and why != "no answer":
        raise UserError(f"{path}: {why}, a JSON object by case is needed")
    return content


class Calls:
    """Processes that are at work; where what is inside this context fails or is interrupted, they are ended."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def __enter__(self) -> Calls:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._stopped = kind is not None
        for process in list(self._running) if self._stopped else ():
            process.terminate()

    def run(self, command: Sequence[str], environment: Mapping[str, str]) -> tuple[int, str]:
        """(exit status, last line of what it said)"""
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        ) as process:
            self._running.add(process)
            if self._stopped:
                process.terminate()
            out, error = process.communicate()
            self._running.discard(process)
        said = error.strip() or out.strip() or f"exit status {process.returncode}"
        return process.returncode, said.splitlines()[-1]


def _case(campaign: Path, out: Path, baseline: str | None, running: Calls) -> CaseResult:
    """One case through the command line that anyone would use."""
    begin = time.monotonic()
    if absent := missing_recordings(campaign / "campaign.toml"):
        return CaseResult(campaign.name, "absent", 0.0, f"{absent[0].name} is not here, the answer stays as it is")
    option = ["--baseline", baseline] if baseline else []
    calls = []
    if not (out / "diagnosis.json").is_file():
        calls.append(["diagnose", str(campaign / "campaign.toml"), "--out", str(out), *option])
    if holdouts(campaign / "campaign.toml") and not (out / "verify.json").is_file():
        calls.append(["verify", str(out), str(campaign / "campaign.toml")])
    # this very package, not one that happens to lie in the working directory (-P)
    path = os.pathsep.join(filter(None, (str(PACKAGE.parent), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": path}
    for arguments in calls:
        program = f"from cobot_joint import cli, interrupts; interrupts.end_with({os.getpid()}); cli.main()"
        command = [sys.executable, "-P", "-c", program, *arguments]
        status, said = running.run(command, environment)
        if status:
            return CaseResult(campaign.name, "failed", time.monotonic() - begin, f"{arguments[0]}: {said}")
    return CaseResult(campaign.name, "done" if calls else "kept", time.monotonic() - begin)
