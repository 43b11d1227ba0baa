"""Units: where their FMUs are, what their modelDescription says, and the physics terms and flanges they annotate."""

from __future__ import annotations

import atexit
import hashlib
import lzma
import os
import re
import shutil
import tempfile
import time
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Literal

from fmpy import read_model_description
from fmpy.model_description import BaseUnit, ModelDescription, ModelVariable

from cobot_joint import paths, xml
from cobot_joint.errors import UserError, among

ENCRYPTED = 0x1  # general purpose bit flag of a zip entry, PKWARE APPNOTE 4.4.4
MOST_ENTRIES, MOST_BYTES = 10_000, 1_000_000_000  # of an archive, unpacked
CACHE_BYTES = 2_000_000_000  # of all archives together
IN_USE = 3600.0  # s since an archive was last asked for, in which a process may still read it
PARTIAL = "partial-"
IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)
TOOL = "cobot-joint"  # the name under which units annotate their modelDescription


@dataclass(frozen=True)
class Shape:
    """A parameter that shapes a term; not identifiable while the term is off, so it is scanned from min to max.

    `scan`: lin or log spacing, or what kind of parameter it is: order (whole numbers per turn), phase (0, quarter).
    """

    name: str
    min: float
    max: float
    scan: str = "lin"
    points: int = 5


@dataclass(frozen=True)
class Term:
    """A physics term that can be switched off: with its amplitude parameter at `neutral` it is as if not there."""

    name: str
    title: str
    equation: str
    source: str
    amplitude: str | None = None
    neutral: float = 0.0
    shapes: tuple[Shape, ...] = ()


@dataclass(frozen=True)
class Flange:
    """A shaft end: variables of angle, speed, torque, and work through it. `gives`: tau*w > 0 leaves the unit there."""

    name: str
    phi: str
    w: str
    tau: str
    W: str
    W_abs: str
    role: Literal["gives", "takes"]


@dataclass(frozen=True)
class Unit:
    """An FMU, unpacked, and what it says of itself."""

    path: Path
    directory: Path
    description: ModelDescription = field(repr=False)
    terms: tuple[Term, ...] = field(default=(), repr=False)
    flanges: tuple[Flange, ...] = field(default=(), repr=False)
    named_values: Mapping[str, Mapping[str, int]] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        """The FMU's modelName."""
        return str(self.description.modelName)

    @cached_property
    def variables(self) -> Mapping[str, ModelVariable]:
        """name -> variable, in the order of the modelDescription"""
        return {variable.name: variable for variable in self.description.modelVariables}

    @cached_property
    def units(self) -> Mapping[str, BaseUnit]:
        """The FMU's UnitDefinitions that have a BaseUnit."""
        return {u.name: u.baseUnit for u in self.description.unitDefinitions if u.name and u.baseUnit}

    def unit_of(self, variable: str) -> str | None:
        """The unit that a variable, or its declared type, names."""
        v = self.variables[variable]
        return v.unit or (v.declaredType.unit if v.declaredType else None)

    @cached_property
    def states(self) -> Mapping[str, str]:
        """State -> the variable that is its derivative, as far as the unit lists them (FMI 2.0.4, 2.2.8), without the
        work through flanges: nothing depends on it."""
        work = {name for flange in self.flanges for name in (flange.W, flange.W_abs)}
        listed = [unknown.variable for unknown in self.description.derivatives or []]
        return {v.derivative.name: v.name for v in listed if v.derivative.name not in work}

    @cached_property
    def needs(self) -> Mapping[str, list[str]]:
        """Output -> inputs that it depends on; through the states of a unit that has some, on all of them.

        A unit has states, as far as it says, where an output depends on no input or does not say on which.
        """
        inputs = [v.name for v in self.variables.values() if v.causality == "input"]
        memory = any(not unknown.dependencies for unknown in self.description.outputs)
        return {
            unknown.variable.name: inputs if memory else [v.name for v in unknown.dependencies]
            for unknown in self.description.outputs
        }

    def feeds_through(self, output: str) -> list[str]:
        """Inputs that an output depends on at once, not by way of a state; all where the unit does not say."""
        inputs = [v.name for v in self.variables.values() if v.causality == "input"]
        unknown = next((u for u in self.description.outputs if u.variable.name == output), None)
        if unknown is None or unknown.dependencies is None:
            return inputs
        return [v.name for v in unknown.dependencies if v.causality == "input"]

    def choices_of(self, variable: str) -> Mapping[str, int]:
        """Name -> value, of an enumeration or of an Integer whose values the unit's annotations name; else nothing."""
        declared = self.variables[variable].declaredType
        if declared is not None and declared.items:
            return {str(item.name): int(item.value) for item in declared.items}
        return self.named_values.get(variable, {})

    def bounds_of(self, variable: str) -> tuple[float | None, float | None]:
        """(min, max) of a variable or of its declared type, None where open; the first and last of named values."""
        v, t = self.variables[variable], self.variables[variable].declaredType
        if values := self.choices_of(variable).values():
            return min(values), max(values)
        lower = v.min if v.min is not None else t.min if t else None
        upper = v.max if v.max is not None else t.max if t else None
        return (None if lower is None else float(lower)), (None if upper is None else float(upper))


def find_fmu(file: str, beside: Path | None = None) -> Path:
    """The FMU of that name or path: relative to `beside` first, else by its file name among the shipped units.

    UserError: there is none; says where it was looked for.
    """
    if beside is not None and (beside / file).is_file():
        return (beside / file).resolve()
    for directory in fmu_directories():
        if (found := directory / Path(file).name).is_file():
            return found
    places = [str(d) for d in ([beside] if beside else []) + fmu_directories()]
    raise UserError(f"{file}: there is no such FMU, looked for in {among(places)}")


def fmu_directories() -> list[Path]:
    """Where shipped units are: COBOT_JOINT_FMUS, the installed package, a checkout's build tree; those that exist."""
    named = os.environ.get("COBOT_JOINT_FMUS")
    places = ([Path(named)] if named else []) + [paths.PACKAGE / "fmus", paths.CHECKOUT / "build" / "fmus"]
    return [place for place in places if place.is_dir()]


def load_unit(path: Path | str) -> Unit:
    """Unpack an FMU once and read it. UserError: not an FMU that can be stepped (FMI 2.0 co-simulation)."""
    return _load(Path(path), unpack(Path(path)))


@cache
def _digest(path: Path, modified: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _load(path: Path, directory: Path) -> Unit:
    try:
        text = (directory / "modelDescription.xml").read_bytes()
    except FileNotFoundError as error:
        raise UserError(f"{path}: not an FMU: it holds no modelDescription.xml") from error
    root = xml.parse(text, f"{path}: modelDescription.xml")
    try:
        description = read_model_description(str(directory))
    except Exception as error:  # FMPy raises bare Exceptions for what it does not like in a file
        raise UserError(f"{path}: modelDescription.xml: {' '.join(str(error).split())}") from error
    if description.fmiVersion != "2.0" or description.coSimulation is None:
        raise UserError(f"{path}: FMI {description.fmiVersion} is given, FMI 2.0 co-simulation is needed")
    identifier = description.coSimulation.modelIdentifier
    if not IDENTIFIER.fullmatch(identifier):  # it names a file
        raise UserError(f"{path}: modelIdentifier {identifier!r} is given, a name as in C is allowed")
    for unknown in description.outputs:  # here only: what an output feeds through, not the states that it shows
        if unknown.dependencies is not None:
            unknown.dependencies = [v for v in unknown.dependencies if v.causality == "input"]
    annotations = root.find(f"VendorAnnotations/Tool[@name='{TOOL}']")
    terms: tuple[Term, ...] = ()
    flanges: tuple[Flange, ...] = ()
    choices: dict[str, dict[str, int]] = {}
    if annotations is not None:
        where = f"{path}: VendorAnnotations"
        terms = tuple(_term(element, where) for element in annotations.iterfind(".//Term"))
        flanges = tuple(_flange(element, where) for element in annotations.iterfind(".//Flange"))
        choices = dict(_choice(element, where) for element in annotations.iterfind(".//Choice"))
    unit = Unit(path, directory, description, terms, flanges, choices)
    _check_annotations(unit)
    return unit


def _term(element: xml.etree._Element, where: str) -> Term:
    try:
        return Term(
            name=element.attrib["name"],
            title=element.get("title", ""),
            equation=element.get("equation", ""),
            source=element.get("source", ""),
            amplitude=element.get("amplitude") or None,
            neutral=float(element.get("neutral", "0")),
            shapes=tuple(
                Shape(
                    name=shape.attrib["name"],
                    min=float(shape.attrib["min"]),
                    max=float(shape.attrib["max"]),
                    scan=shape.get("scan", "lin"),
                    points=int(shape.get("points", "5")),
                )
                for shape in element.iterfind("Shape")
            ),
        )
    except (KeyError, ValueError) as error:
        raise UserError(f"{where}: Term {element.get('name')!r}: {error}") from error


def _flange(element: xml.etree._Element, where: str) -> Flange:
    try:
        names = {key: element.attrib[key] for key in ("name", "phi", "w", "tau", "W", "W_abs")}
    except KeyError as error:
        raise UserError(f"{where}: Flange {element.get('name')!r}: {error} is missing") from error
    role = element.get("role")
    if role not in ("gives", "takes"):
        raise UserError(f"{where}: Flange {names['name']!r}: role {role!r} is given, gives or takes is allowed")
    return Flange(**names, role="gives" if role == "gives" else "takes")


def _choice(element: xml.etree._Element, where: str) -> tuple[str, dict[str, int]]:
    try:
        return element.attrib["name"], {e.attrib["name"]: int(e.attrib["value"]) for e in element.iterfind("Item")}
    except (KeyError, ValueError) as error:
        raise UserError(f"{where}: Choice {element.get('name')!r}: {error}") from error


def _check_annotations(unit: Unit) -> None:
    named = [name for term in unit.terms for name in (term.amplitude, *(s.name for s in term.shapes)) if name]
    named += [name for f in unit.flanges for name in (f.phi, f.w, f.tau, f.W, f.W_abs)]
    named += unit.named_values
    for name in named:
        if name not in unit.variables:
            raise UserError(f"{unit.path}: VendorAnnotations name {name!r}, which is no variable of the unit")


def unpack(path: Path) -> Path:
    """The folder with a zip file's content (.fmu, .ssp), unpacked once. UserError: not readable, or no zip file."""
    try:
        return _unpack(path, _digest(path, path.stat().st_mtime_ns))
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from error


def _unpack(path: Path, digest: str) -> Path:
    """In the user's cache, under the file's hash: unpacked by the first process that needs it, whole or not at all."""
    target = _cache() / digest
    if target.is_dir():
        with suppress(OSError):  # of somebody else: it is read all the same
            os.utime(target)  # when it was last used
        return target
    partial = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=target.parent))
    try:
        with zipfile.ZipFile(path) as archive:
            _check_archive(path, archive)
            archive.extractall(partial)
        partial.rename(target)
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"{path}: not a {path.suffix or 'zip'} file: {error}") from error
    except OSError:
        if not target.is_dir():  # else another process was faster
            raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    _make_room(target.parent)
    return target


def _make_room(cache: Path) -> None:
    """Least recently used archives leave a cache that has grown too large; what may still be in use stays."""
    now = time.time()
    ages: dict[Path, float] = {}
    for place in cache.iterdir():
        with suppress(FileNotFoundError):  # another process has just taken it away
            ages |= {place: now - place.stat().st_mtime} if place.is_dir() else {}
    for place in [place for place, age in ages.items() if place.name.startswith(PARTIAL) and age > IN_USE]:
        shutil.rmtree(place, ignore_errors=True)  # of a process that was killed
        del ages[place]
    sizes: dict[Path, int] = {}
    for place in ages:
        with suppress(FileNotFoundError):
            sizes[place] = sum(file.lstat().st_size for file in place.rglob("*"))
    for place in sorted(ages, key=ages.__getitem__, reverse=True):
        if sum(sizes.values()) <= CACHE_BYTES or ages[place] <= IN_USE:
            return
        shutil.rmtree(place, ignore_errors=True)
        sizes.pop(place, None)


def _check_archive(path: Path, archive: zipfile.ZipFile) -> None:
    """UserError: it is encrypted, or more than a unit can be."""
    entries = archive.infolist()
    if any(entry.flag_bits & ENCRYPTED for entry in entries):
        raise UserError(f"{path}: an encrypted archive is given, one without a password is needed")
    if len(entries) > MOST_ENTRIES:
        raise UserError(f"{path}: {len(entries)} files are in the archive, {MOST_ENTRIES} are allowed")
    if (size := sum(entry.file_size for entry in entries)) > MOST_BYTES:
        raise UserError(f"{path}: {size / 1e6:.0f} MB are in the archive, {MOST_BYTES / 1e6:.0f} MB are allowed")


@cache
def _cache() -> Path:
    """COBOT_JOINT_CACHE, or XDG's cache; a folder of this process's own where that cannot be written."""
    users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / TOOL / "fmus"
    place = Path(os.environ.get("COBOT_JOINT_CACHE") or users)
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=place):
            return place
    except OSError:
        own = Path(tempfile.mkdtemp(prefix=f"{TOOL}-"))
        atexit.register(shutil.rmtree, own, ignore_errors=True)
        return own
