"""Serves one peer's runs in a process, and often an environment, of its own, so that none can harm another.

One JSON request per line on standard input (`wiring`, `results`: file for the columns), one JSON answer per line on
the original standard output: `{"seconds": s}` or `{"error": ...}`; the first: `{"schemes": ...}` or `{"absent": ...}`.
"""

import importlib
import json
import os
import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np

from benchmarks.peers import PEERS, Absent, Wiring


def serve(name: str) -> None:
    if name not in PEERS:
        raise SystemExit(f"peer {name!r}: allowed are {', '.join(PEERS)}")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a peer prints goes to standard error

    def answer(content: dict[str, object]) -> None:
        answers.write(json.dumps(content) + "\n")
        answers.flush()

    try:
        peer = importlib.import_module(f"benchmarks.peers.{name}")
    except (Absent, ImportError) as error:
        answer({"absent": str(error)})
        return
    answer({"schemes": peer.SCHEMES})
    for line in sys.stdin:
        request = json.loads(line)
        try:
            with tempfile.TemporaryDirectory() as folder:
                run = peer.run(Wiring(**request["wiring"]), Path(folder))
            np.savez(request["results"], **run.columns)
            answer({"seconds": run.seconds})
        except Exception:  # whatever a peer raises is this run's answer
            answer({"error": traceback.format_exc()})


if __name__ == "__main__":
    serve(sys.argv[1])
