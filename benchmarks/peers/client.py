"""Starts a peer's worker and asks it for runs."""

import dataclasses
import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import Absent, Run, Wiring

ROOT = Path(__file__).parents[2]


class Peer:
    """One peer in its own process, run by `python`, an interpreter of the environment that has it.

    Raises `Absent`: it, or something it needs, is not there.
    """

    def __init__(self, name: str, python: str) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [python, "-m", "benchmarks.peers.worker", name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "0"},  # CoFmuPy steps in the order of a set
        )
        greeting = self._answer()
        if "absent" in greeting:
            raise Absent(greeting["absent"])
        self.schemes: list[str] = greeting["schemes"]

    def run(self, wiring: Wiring) -> Run:
        """One run. RuntimeError: the peer failed, with its traceback."""
        assert self._process.stdin is not None
        with tempfile.TemporaryDirectory() as folder:
            results = Path(folder) / "columns.npz"
            request = {"wiring": dataclasses.asdict(wiring), "results": str(results)}
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            answer = self._answer()
            if "error" in answer:
                raise RuntimeError(f"{self.name}: {answer['error']}")
            with np.load(results) as columns:
                return Run(answer["seconds"], dict(columns))

    def close(self) -> None:
        """Ends the worker."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(timeout=30)

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.name}: the process ended with {self._process.wait()}")
        content: dict[str, Any] = json.loads(line)
        return content
