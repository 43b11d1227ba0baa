"""One command, one table: `python -m benchmarks`; see README.md beside this file."""

import argparse
import datetime
import json
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import rows_bench, rows_cost, rows_isolation, rows_peers, rows_runs
from benchmarks.measure import Row

GROUPS: dict[str, Callable[[argparse.Namespace], list[Row]]] = {
    "averaged": lambda _: rows_bench.averaged_level(),
    "peers": lambda arguments: rows_peers.same_bench(arguments.peers),
    "own-cost": lambda arguments: rows_peers.own_cost(arguments.peers),
    "cost": lambda arguments: _cost(arguments),
    "isolation": lambda _: rows_isolation.cost(),
    "simscape": lambda _: rows_bench.three_phase_level(),
    "runs": lambda _: rows_runs.many(),
    "hour": lambda _: rows_runs.hour(),
}


def _cost(arguments: argparse.Namespace) -> list[Row]:
    rows, points = rows_cost.measure(arguments.peers)
    kept = json.dumps([asdict(point) for point in points], indent=1)
    (arguments.out / "error_against_cost.json").write_text(kept + "\n")
    try:
        from benchmarks.plot import draw
    except ImportError as error:
        Console(stderr=True).print(f"no picture of error against cost: {error}")
    else:
        draw(points, arguments.out / "error_against_cost.svg")
    return rows


def _measured(path: Path) -> list[Row]:
    """The rows of an earlier run; none where that group was not run."""
    return [Row(**row) for row in json.loads(path.read_text())["rows"]] if path.exists() else []


def _machine() -> dict[str, object]:
    model = platform.processor()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), model)
    load = os.getloadavg() if hasattr(os, "getloadavg") else None
    machine: dict[str, object] = {"cpu": model, "cores": os.cpu_count(), "load": load, "system": platform.system()}
    return machine | {"python": platform.python_version()}


def show(rows: list[Row], console: Console) -> None:
    """The table, as it is read in README.md."""
    table = Table(title="Benchmarks: every figure a median of paired runs on this machine")
    for heading, justify in (
        ("row", "left"),
        ("measured", "right"),
        ("reach", "right"),
        ("", "left"),
        ("note", "left"),
    ):
        table.add_column(heading, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for row in rows:
        value = "-" if row.value is None else f"{row.value:.3g} {row.unit}"
        verdict = {True: "met", False: "[bold red]missed[/]", None: "not run"}[row.met]
        table.add_row(row.title, value, row.reach, verdict, row.note)
    console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}; all without one")
    parser.add_argument("--out", type=Path, default=Path("build/benchmarks"), help="folder for JSON and picture")
    parser.add_argument("--peers", default=sys.executable, help="interpreter of the environment that has the peers")
    parser.add_argument("--show", action="store_true", help="print what was last measured, measure nothing")
    arguments = parser.parse_args()
    if unknown := [group for group in arguments.groups if group not in GROUPS]:
        parser.error(f"group {unknown[0]!r}: allowed are {', '.join(GROUPS)}")
    os.environ.setdefault("COBOT_JOINT_ISOLATE", "none")  # the benchmarks' own units are foreign, and not what counts
    arguments.out.mkdir(parents=True, exist_ok=True)

    console = Console()
    rows: list[Row] = []
    for group in arguments.groups or GROUPS:
        if arguments.show:
            rows += _measured(arguments.out / f"{group}.json")
            continue
        with console.status(f"measuring {group}"):
            measured = GROUPS[group](arguments)
        rows += measured
        content = {
            "machine": _machine(),
            "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "rows": [row.json() for row in measured],
        }
        (arguments.out / f"{group}.json").write_text(json.dumps(content, indent=1) + "\n")
    show(rows, console)
    return 0


if __name__ == "__main__":
    sys.exit(main())
