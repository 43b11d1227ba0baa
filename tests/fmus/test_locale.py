"""Hosts with a decimal comma (Qt and GTK call setlocale): every unit instantiates and reads its values exactly."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.units import Unit

LOCALES = ("de_DE", "tr_TR")

# instantiates FMUs, unpacked, in a host with a locale; prints the decimal point and a value as bits
HOST = """
import locale, sys
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave
locale.setlocale(locale.LC_ALL, sys.argv[1])
print(locale.localeconv()["decimal_point"])
for directory in sys.argv[3:]:
    description = read_model_description(directory)
    slave = FMU2Slave(guid=description.guid, modelIdentifier=description.coSimulation.modelIdentifier,
                      unzipDirectory=directory, instanceName="unit")
    slave.instantiate()
    slave.setupExperiment()
    slave.enterInitializationMode()
    for variable in description.modelVariables:
        if variable.name == sys.argv[2]:
            print(slave.getReal([variable.valueReference])[0].hex())
    slave.freeInstance()
"""


@pytest.fixture(scope="module")
def locales(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which setlocale finds the locales: the machine's own, or ones compiled for the test."""
    environment = dict(os.environ)
    probe = "import locale, sys; [locale.setlocale(locale.LC_ALL, f'{n}.UTF-8') for n in sys.argv[1:]]"
    if subprocess.run([sys.executable, "-c", probe, *LOCALES], capture_output=True, check=False).returncode == 0:
        return environment
    compiler, folder = shutil.which("localedef"), tmp_path_factory.mktemp("locales")
    if compiler is None:
        pytest.skip("no locale de_DE and tr_TR, and no localedef to make them (Debian: apt install locales)")
    for name in LOCALES:
        call = [compiler, "--no-archive", "-i", name, "-f", "UTF-8", str(folder / f"{name}.UTF-8")]
        done = subprocess.run(call, capture_output=True, text=True, check=False)
        if not (folder / f"{name}.UTF-8").is_dir():
            pytest.skip(f"localedef makes no {name} (Debian: apt install locales): {done.stderr.strip()}")
    return environment | {"LOCPATH": str(folder)}


def host(environment: dict[str, str], name: str, variable: str, *directories: Path) -> list[str]:
    """What a host in that locale prints; a unit that refuses fails the test."""
    call = [sys.executable, "-c", HOST, f"{name}.UTF-8", variable, *map(str, directories)]
    done = subprocess.run(call, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    point, *values = done.stdout.split()
    assert point == ","
    return values


@pytest.mark.parametrize("locale", LOCALES)
def test_every_unit_instantiates_under_a_decimal_comma(
    load: Callable[[str], Unit], locales: dict[str, str], locale: str
) -> None:
    units = Path(__file__).parents[2] / "fmus"
    host(locales, locale, "", *(load(table.parent.name).directory for table in sorted(units.glob("*/model.def"))))


@pytest.mark.parametrize("locale", LOCALES)
@pytest.mark.parametrize(("text", "expected"), [("0.75", 0.75), ("1.2345678901234567e-3", 1.2345678901234567e-3)])
def test_start_values_keep_their_decimals_under_a_decimal_comma(
    repaired: Callable[..., Path], locales: dict[str, str], locale: str, text: str, expected: float
) -> None:
    directory = repaired(f"brake.tau_off = {text}")
    assert host(locales, locale, "brake.tau_off", directory) == [expected.hex()]
