"""The package's structure: small functions, few files in a folder, and imports that point downward only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "orchestrator" / "cobot_joint"
FILES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES, MOST_ARGUMENTS, MOST_FILES, LONGEST = 60, 7, 14, 400

# Rooms from the ground up; a file may import from its own room and from those before it. A room is a file or a folder.
ROOMS = [
    "version.py",
    "errors.py",
    "files.py interrupts.py mathml.py pack.py paths.py screen.py",
    "xml.py",
    "units.py",
    "system",
    "results",
    "cosim",
    "scenario",
    "diagnosis/archive.py diagnosis/budget.py diagnosis/store.py diagnosis/thresholds.py",
    "diagnosis/data",
    "diagnosis/drafts",
    "diagnosis/plant",
    "diagnosis/checks",
    "diagnosis/state_estimation",
    "diagnosis/findings.py",
    "diagnosis/estimation",
    "diagnosis/localization",
    "diagnosis/candidates",
    "diagnosis/selection",
    "diagnosis/anchored",
    "diagnosis/experiments",
    "diagnosis/repair",
    "diagnosis/report",
    "diagnosis/explanation",
    "diagnosis/engine.py diagnosis/frequency",
    "diagnosis/evaluation",
    "diagnosis/basis.py diagnosis/provenance.py diagnosis/run.py diagnosis/frequency_run.py",
    "diagnosis/__init__.py diagnosis/own_bench.py diagnosis/commands.py",
    "live",
    "api.py",
    "__init__.py",
    "cli",
    "__main__.py",
]


def name(file: Path) -> str:
    return file.relative_to(PACKAGE).as_posix()


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{name(file)}:{node.lineno}", node


def arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    a = function.args
    named = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x]
    return len([x for x in named if x not in ("self", "cls")])


def too_large() -> dict[str, str]:
    found = {}
    for where, function in functions():
        lines, n = (function.end_lineno or 0) - function.lineno + 1, arguments(function)
        if lines > MOST_LINES or n > MOST_ARGUMENTS:
            found[function.name] = f"{where} {function.name}: {lines} lines, {n} arguments"
    return found


def test_functions_are_short_and_take_few_arguments() -> None:
    assert too_large() == {}


@pytest.mark.parametrize("folder", sorted({file.parent for file in FILES}), ids=name)
def test_folders_hold_few_files(folder: Path) -> None:
    files = [p.name for p in folder.iterdir() if p.is_file() and p.suffix in (".py", ".c", ".h", ".txt", ".jinja")]
    assert len(files) <= MOST_FILES


def test_no_source_file_is_longer_than_a_reader_keeps_in_mind() -> None:
    sources = [p for room in ("orchestrator", "fmus", "tests", "benchmarks", "proof", "docs")
               for ending in ("py", "c", "h") for p in (ROOT / room).rglob(f"*.{ending}")]  # fmt: skip
    lengths = {p.relative_to(ROOT).as_posix(): len(p.read_text(encoding="utf-8").splitlines()) for p in sources}
    assert len(lengths) > 300
    assert {name: n for name, n in lengths.items() if n > LONGEST} == {}


def target(module: str) -> str | None:
    """The package's file of that module; None: there is none."""
    path = PACKAGE.parent / Path(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return name(file)
    return None


def imported(file: Path) -> set[str]:
    """Files of the package that a file imports, at its top or inside of functions, for types alone or not."""
    modules = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names if alias.name.split(".")[0] == "cobot_joint"]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "cobot_joint":
            assert node.module
            inside = [f"{node.module}.{alias.name}" for alias in node.names]
            modules += [module if target(module) else node.module for module in inside]
    return {found for module in modules if (found := target(module))} - {name(file)}


IMPORTS = {name(file): imported(file) for file in FILES}


def floor(file: str) -> int:
    for n, room in enumerate(ROOMS):
        if any(file == place or file.startswith(f"{place}/") for place in room.split()):
            return n
    raise AssertionError(f"{file} is in no room: give it one in ROOMS")


def upward() -> set[str]:
    return {f"{file} -> {other}" for file, others in IMPORTS.items() for other in others if floor(other) > floor(file)}


def test_imports_point_downward() -> None:
    assert sorted(upward()) == []


def test_no_circle_of_imports() -> None:
    try:
        list(TopologicalSorter(IMPORTS).static_order())
    except CycleError as error:
        pytest.fail(f"files import one another: {' <- '.join(error.args[1])}")


def thresholds() -> dict[str, str]:
    """Name -> what stands behind its number, from the `=` on."""
    text = (PACKAGE / "diagnosis" / "thresholds.py").read_text(encoding="utf-8")
    assigned = [n for n in ast.parse(text).body if isinstance(n, ast.Assign)]
    return {ast.unparse(n.targets[0]): "\n".join(text.splitlines()[n.lineno - 1 : n.end_lineno]) for n in assigned}


def test_sixty_thresholds_decide_at_most_and_each_says_why() -> None:
    found = thresholds()
    assert len(found) <= 60
    assert [n for n, line in found.items() if "#" not in line] == []


def test_every_threshold_decides_something() -> None:
    read = "".join(file.read_text(encoding="utf-8") for file in FILES)
    assert [n for n in thresholds() if f"thresholds.{n}" not in read] == []
