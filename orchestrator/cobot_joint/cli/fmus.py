"""`cobot-joint export` and `check`: our units in other simulators, other people's here."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from cobot_joint.cli.output import console, grid_of, say_json
from cobot_joint.errors import UserError
from cobot_joint.files import results_folder

CHECK_HELP = """Whether an FMU of yours can take a component's place, and what it lacks.

Looks at its ports, runs it alone, and says in words what is missing: `no` means that it cannot be used as it is (exit
status 1), `lacks` that something is done without, and what that costs.

\b
Examples:
  cobot-joint check my_gear.fmu --as planetary_gear
  cobot-joint check my_gear.fmu:tau=tau_m,w_o=-speed,J_coupled= --as planetary_gear
"""


class Importer(Enum):
    """For whom a system is exported."""

    ANY = "any"
    ECOS = "ecos"
    LIBCOSIM = "libcosim"
    FMI3 = "fmi3"


def export(
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("export"),
    system: Annotated[str, typer.Option(help="A shipped system by name, or an .ssd or .ssp file.")] = "joint",
    unit: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A shipped unit that the system does not hold; repeatable.")
    ] = None,
    all_platforms: Annotated[
        bool, typer.Option("--all-platforms", help="Compile the units for Linux, Windows and macOS (needs ziglang).")
    ] = False,
    flat_names: Annotated[
        bool, typer.Option("--flat-names", help="friction_tau_C for friction.tau_C: some importers take no dots.")
    ] = False,
    reference: Annotated[
        bool, typer.Option("--reference", help="NAME_in.csv, NAME_ref.csv, NAME_ref.opt per unit: FMI's cross-check.")
    ] = False,
    importer: Annotated[
        Importer,
        typer.Option("--for", help="ecos, libcosim: no wires at the system's connectors; fmi3: FMUs alone, FMI 3.0."),
    ] = Importer.ANY,
) -> None:
    """The units as FMUs, and the system as one .ssp, for other simulators."""
    from cobot_joint.cosim.foreign.cross_check import write_cross_check
    from cobot_joint.system import load_system, with_fmus, without_own_wires, write_fmu, write_fmus_alone, write_ssp
    from cobot_joint.system.export.fmi3 import as_fmi3
    from cobot_joint.system.export.platforms import compile_for_all
    from cobot_joint.system.flat_names import flatten
    from cobot_joint.system.osp import write_osp
    from cobot_joint.units import find_fmu, load_unit

    fmi3 = importer is Importer.FMI3
    if fmi3 and reference:
        raise UserError("--reference: the files are made by running the FMUs, and those of --for fmi3 do not run here")
    asked = ((as_fmi3, fmi3), (flatten, flat_names), (compile_for_all, all_platforms))
    wanted = [change for change, is_asked in asked if is_asked]
    given = load_system(system)
    names = write_fmus_alone(given, results_folder(out), wanted)
    files = [out / name for name in dict.fromkeys(names.values())]
    files += [write_fmu(load_unit(find_fmu(f"{name}.fmu")), out / f"{name}.fmu", wanted) for name in unit or []]
    if reference:
        files += [file for fmu in tuple(files) for file in write_cross_check(load_unit(fmu), out)]
    if not fmi3:
        exported = with_fmus(given, out, names)
        if importer is Importer.LIBCOSIM:
            files.append(write_osp(exported, out / "OspSystemStructure.xml"))
        if importer is not Importer.ANY:
            exported = without_own_wires(exported)
        files.append(write_ssp(exported, out / f"{exported.name}.ssp"))
    for file in files:
        console.print(file, soft_wrap=True)
    say_json({"files": [str(file) for file in files]})


def check(
    fmu: Annotated[str, typer.Argument(metavar="FMU[:PORTS]", help="An FMU; PORTS where its names differ.")],
    place: Annotated[str, typer.Option("--as", metavar="NAME", help="The component in whose place it would come.")],
    system: Annotated[str, typer.Option(help="A system by name, or an .ssd or .ssp file.")] = "joint",
) -> None:
    """See CHECK_HELP."""
    from cobot_joint.cosim.foreign.standalone import examine
    from cobot_joint.scenario.report import Table
    from cobot_joint.system import load_system

    findings = examine(load_system(system), place, fmu)
    rows = [(f.verdict, f.what, f.detail) for f in findings]
    console.print(grid_of(Table(f"{fmu} as {place} of {system}", ["", "looked at", "found"], rows)))
    say_json({"findings": [{"verdict": v, "what": what, "detail": detail} for v, what, detail in rows]})
    if "no" in {f.verdict for f in findings}:
        raise typer.Exit(1)
