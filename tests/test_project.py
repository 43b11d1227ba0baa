"""The project around the code: what pages promise exists, a fact stands in one place, what is imported is declared."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
import zipfile
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*/README.md"), *ROOT.glob("proof/**/*.md")]


@cache
def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def without_code(markdown: str) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`|^    .*$", "", markdown, flags=re.S | re.M)


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", sorted(set(PAGES)), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


def test_commands_in_the_readme_exist() -> None:
    import typer.main

    from cobot_joint.cli import app

    known = set(typer.main.get_group(app).commands)
    used = set(re.findall(r"cobot-joint ([a-z_]+)", (ROOT / "README.md").read_text(encoding="utf-8")))
    assert used, "the README shows no command"
    assert used <= known


def test_the_readme_names_every_scenario() -> None:
    row = next(line for line in (ROOT / "README.md").read_text(encoding="utf-8").split("\n") if "run SCENARIO" in line)
    assert set(re.findall(r"`([a-z_]+)`", row)) == {path.stem for path in (ROOT / "scenarios").glob("*.toml")}


def test_decisions_are_listed_on_the_docs_page() -> None:
    page = (ROOT / "docs/README.md").read_text(encoding="utf-8")
    unlisted = [d.name for d in (ROOT / "docs/decisions").glob("*.md") if f"(decisions/{d.name})" not in page]
    assert not unlisted


def test_the_version_stands_in_one_place_and_the_changelog_knows_it() -> None:
    from cobot_joint import __version__

    assert project()["project"]["dynamic"] == ["version"]
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.M)
    assert __version__ in headings


def test_what_the_package_imports_is_declared() -> None:
    imported: dict[str, str] = {}
    for file in sorted((ROOT / "orchestrator").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [node.module]
            imported |= {name.split(".")[0]: str(file.relative_to(ROOT)) for name in names}
    foreign = {n: f for n, f in imported.items() if n not in sys.stdlib_module_names and n != "cobot_joint"}
    extras = project()["project"]["optional-dependencies"]
    declared = {
        re.split(r"[ \[<>=~!]", requirement)[0].lower().replace("_", "-")
        for requirement in [*project()["project"]["dependencies"], *(r for extra in extras.values() for r in extra)]
    }
    distributions = packages_distributions()
    undeclared = {
        name: file
        for name, file in foreign.items()
        if not {d.lower().replace("_", "-") for d in distributions.get(name, [name])} & declared
    }
    assert not undeclared


def declared(*extras: str) -> set[str]:
    """Names of what the project requires, and of what these extras add."""
    own = project()["project"]
    rows = [*own["dependencies"], *(row for extra in extras for row in own["optional-dependencies"][extra])]
    return {re.split(r"[ \[<>=~!]", row)[0] for row in rows} - {"cobot-joint"}


def test_the_licence_of_everything_that_is_required_is_listed() -> None:
    page = (ROOT / "docs/licences.md").read_text(encoding="utf-8")
    listed = {name for row in re.findall(r"^\| ([^|]+) \|", page, flags=re.M) for name in row.split(", ")}
    assert listed - {"package", "---"} == declared(*project()["project"]["optional-dependencies"])


@pytest.mark.parametrize(("lock", "extras"), [("requirements", False), ("requirements-extras", True)])
def test_a_lock_pins_what_an_installation_needs_with_hashes(lock: str, extras: bool) -> None:
    entries = re.split(r"\n(?=\S)", (ROOT / f"{lock}.lock").read_text(encoding="utf-8").strip())
    assert all("==" in entry.splitlines()[0] and "--hash=sha256:" in entry for entry in entries)
    wanted = declared(*project()["project"]["optional-dependencies"]) if extras else declared()
    assert wanted <= {entry.split("==")[0] for entry in entries}


def test_the_installed_package_finds_its_data_from_any_folder(tmp_path: Path) -> None:
    program = "from cobot_joint.paths import folder; print(len(list(folder('systems').glob('*.ssd'))))"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == len(list((ROOT / "systems").glob("*.ssd")))


@pytest.mark.parametrize("unit", sorted(p.parent.name for p in ROOT.glob("fmus/*/model.def")))
def test_every_unit_has_an_icon(unit: str) -> None:
    icon = (ROOT / "fmus" / unit / "model.png").read_bytes()
    assert icon[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(icon[16:20]) == int.from_bytes(icon[20:24]) == 256


HOME = re.compile(rb"/(?:home|Users|root|tmp|work)/[\w.-]+/")  # a folder of one machine


def test_no_file_names_a_folder_of_one_machine() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    files = [file for file in listed.stdout.splitlines() if (ROOT / file).is_file()]
    assert [file for file in files if HOME.search((ROOT / file).read_bytes())] == []


def test_no_unit_names_a_folder_of_the_machine_that_built_it() -> None:
    from cobot_joint.units import fmu_directories

    units = sorted(fmu_directories()[0].glob("*.fmu"))
    assert units
    named = []
    for unit in units:
        with zipfile.ZipFile(unit) as archive:
            named += [f"{unit.name}: {name}" for name in archive.namelist() if HOME.search(archive.read(name))]
    assert not named


def test_rows_of_the_units_tables_can_be_read_without_scrolling() -> None:
    tables = [*ROOT.glob("fmus/*/model.def"), ROOT / "fmus/friction/friction.def"]
    long = {
        (table.parent.name, number): len(line)
        for table in tables
        for number, line in enumerate(table.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > 150 and not line.startswith("#")
    }
    assert len(tables) > 10
    assert not long
