"""SSP 1.0 in: an .ssd, or the SystemStructure.ssd of an .ssp, with its FMUs and parameter sets, as a checked System."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote, urlsplit

from fmpy.model_description import BaseUnit
from lxml import etree

from cobot_joint import paths, xml
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, Connection, Connector, DefaultExperiment, System, Value
from cobot_joint.system.parameters import checked
from cobot_joint.system.wiring import EXPONENTS, Endpoint, Wiring, check, conversion, port_type
from cobot_joint.units import find_fmu, load_unit, unpack

NS = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
}
LONGEST_STEP = 1.0  # s; what couples less often is no co-simulation of a machine
FMU = "application/x-fmu-sharedlibrary"
COUPLING = (
    "cobot-joint.coupling"  # annotation of the default experiment: <coupling scheme="gauss_seidel" step="0.001"/>
)


def load_system(path: Path | str) -> System:
    """The system that an .ssd or .ssp file, or the name of a shipped one (`joint`), describes.

    FMUs of an .ssp are those in it; of an .ssd those beside it, else by file name the shipped units. Components keep
    the file's order.
    UserError: the file or what it names is missing or wrong; one line that says what, what is allowed and where.
    """
    path = find_system(path)
    if path.suffix == ".ssp":
        base = unpack(path)
        file = base / "SystemStructure.ssd"
        if not file.is_file():
            raise UserError(f"{path}: not a system: it holds no SystemStructure.ssd")
    else:
        base, file = path.parent, path
    return _Reader(path, base, file.read_bytes()).system()


def find_system(path: Path | str) -> Path:
    """The file of a shipped system by its name, or the given file. UserError: there is neither."""
    if str(path) in system_names():
        return paths.folder("systems") / f"{path}.ssd"
    path = Path(path)
    if path.suffix not in (".ssd", ".ssp") or not path.is_file():
        raise UserError(
            f"system {str(path)!r}: there is none, allowed are {among(system_names())} or an .ssd or .ssp file"
        )
    return path


def system_names() -> list[str]:
    """Systems that come with the package."""
    return sorted(file.stem for file in paths.folder("systems").glob("*.ssd"))


@dataclass(frozen=True)
class _Given:
    """One value of a parameter set, with its unit there."""

    name: str
    value: Value | str
    unit: str | None
    base: BaseUnit | None
    where: str


class _Reader:
    """One SystemStructureDescription on its way to a System."""

    def __init__(self, path: Path, base: Path, text: bytes):
        self.path, self.base = path, base
        self.root = xml.parse(text, str(path), "SystemStructureDescription")
        found = self.root.find("ssd:System", NS)
        assert found is not None  # the schema demands it
        self.element = found
        self.units = read_units(self.root.find("ssd:Units", NS))

    def system(self) -> System:
        components = [self._component(e) for e in self.element.iterfind("ssd:Elements/*", NS)]
        of_system = list(self._values(self.element, str(self.path)))
        components = [self._with_values(c, of_system, prefixed=True) for c in components]
        self._all_used(of_system, components)
        connectors = self._typed(list(self._connectors()), components)
        wiring = Wiring(components, connectors, self.units, str(self.path))
        for element in self.element.iterfind("ssd:Elements/ssd:Component", NS):
            self._check_declared(element, wiring)
        wires = [self._connection(e, wiring) for e in self.element.iterfind("ssd:Connections/ssd:Connection", NS)]
        system = System(
            name=self.element.get("name", self.path.stem),
            components=tuple(components),
            connections=tuple(wires),
            inputs={c.name: c for c in connectors if c.causality == "input"},
            outputs={c.name: c for c in connectors if c.causality == "output"},
            default_experiment=self._experiment(),
            path=self.path,
        )
        check(system)
        return system

    def _experiment(self) -> DefaultExperiment:
        """The default experiment, with the annotation COUPLING if there is one."""
        element = self.root.find("ssd:DefaultExperiment", NS)
        if element is None:
            return DefaultExperiment()
        start, stop = float(element.get("startTime", "0")), float(element.get("stopTime", "1"))
        coupling = element.find(f"ssd:Annotations/ssc:Annotation[@type='{COUPLING}']/*", NS)
        if coupling is None:
            return DefaultExperiment(start, stop)
        scheme, step = coupling.get("scheme"), coupling.get("step")
        return DefaultExperiment(start, stop, scheme, self._coupling_step(step) if step is not None else None)

    def _coupling_step(self, text: str) -> float:
        try:
            step = float(text)
        except ValueError:
            step = math.nan
        if not 0 < step <= LONGEST_STEP:
            allowed = f"seconds above 0 and up to {LONGEST_STEP:g} are allowed"
            raise UserError(f"{self.path}: coupling: step {text!r} is given, {allowed}")
        return step

    def _component(self, element: etree._Element) -> Component:
        name, where = element.get("name", ""), f"{self.path}: component {element.get('name')!r}"
        if etree.QName(element).localname != "Component" or element.get("type", FMU) != FMU:
            raise UserError(f"{where}: a nested system is given, FMUs are allowed")
        if element.get("implementation", "any") == "ModelExchange":
            raise UserError(f"{where}: ModelExchange is asked for, CoSimulation is allowed")
        source = element.get("source", "")
        file = self._relative(source, where)
        if self.path.suffix == ".ssp" and not (self.base / file).is_file():  # another one of that name may differ
            raise UserError(f"{where}: source {source!r} is given, the archive holds no such FMU")
        unit = load_unit(find_fmu(file, self.base))
        component = Component(name, source, unit)
        values = list(self._values(element, where))
        component = self._with_values(component, values, prefixed=False)
        self._all_used(values, [component])
        return component

    def _relative(self, source: str, where: str) -> str:
        """A source's path; of an .ssp nothing outside of it."""
        parts = urlsplit(source)
        path = unquote(parts.path)
        if not path.isprintable():
            raise UserError(f"{where}: source {source!r} is given, a name without control characters is allowed")
        inside = (self.base / path).resolve().is_relative_to(self.base.resolve())
        if parts.scheme or parts.netloc or parts.fragment or (self.path.suffix == ".ssp" and not inside):
            raise UserError(f"{where}: source {source!r} is given, a path relative to the description is allowed")
        return unquote(parts.path)

    def _connectors(self) -> Iterator[Connector]:
        self._once(self.element, str(self.path))
        for element in self.element.iterfind("ssd:Connectors/ssd:Connector", NS):
            name, kind = element.get("name", ""), element.get("kind")
            if kind not in ("input", "output"):
                raise UserError(f"{self.path}: connector {name!r}: {kind} is given, input or output is allowed")
            type_, unit = _type(element)
            kind_of = port_type(type_) if type_ else None
            if type_ and kind_of is None:
                raise UserError(
                    f"{self.path}: connector {name!r}: {type_} is given, Real, Integer or Boolean is allowed"
                )
            yield Connector(name, kind, kind_of or "Real", unit, element.get("description", ""))

    def _once(self, element: etree._Element, where: str) -> None:
        """UserError: a connector is listed twice, so that one of both would be lost."""
        names = [c.get("name", "") for c in element.iterfind("ssd:Connectors/ssd:Connector", NS)]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise UserError(f"{where}: connector {among(twice)} is listed twice, once is allowed")

    def _typed(self, connectors: list[Connector], components: list[Component]) -> list[Connector]:
        """Where the description gives a system's connector no type or unit, those of the variable it is wired to."""
        declared = {e.get("name"): _type(e) for e in self.element.iterfind("ssd:Connectors/ssd:Connector", NS)}
        ends: dict[str, Endpoint] = {}
        wiring = Wiring(components, where=str(self.path))
        for wire in self.element.iterfind("ssd:Connections/ssd:Connection", NS):
            start, end = _ends(wire)
            for own, other in ((start, end), (end, start)):
                if own[0] is None and other[0] is not None:
                    ends.setdefault(own[1], wiring.endpoint(*other))
        typed = []
        for connector in connectors:
            if (wired := ends.get(connector.name)) is not None:
                type_, unit = declared[connector.name]
                connector = replace(
                    connector, type=connector.type if type_ else wired.type or "Real", unit=unit or wired.unit
                )
                if connector.unit == wired.unit and wired.unit and wired.base:
                    self.units.setdefault(wired.unit, wired.base)
            typed.append(connector)
        return typed

    def _connection(self, element: etree._Element, wiring: Wiring) -> Connection:
        start, end = _ends(element)
        convert = element.get("suppressUnitConversion") not in ("true", "1")
        factor, offset = _transformation(element, f"{self.path}: {start[1]} to {end[1]}")
        return wiring.connect(start, end, factor, offset, convert)

    def _check_declared(self, element: etree._Element, wiring: Wiring) -> None:
        """Connectors that the description lists for a component have to be what its FMU offers."""
        name = element.get("name", "")
        self._once(element, f"{self.path}: component {name!r}")
        for connector in element.iterfind("ssd:Connectors/ssd:Connector", NS):
            kind, variable = connector.get("kind"), connector.get("name", "")
            if kind not in ("input", "output"):
                continue
            offered = wiring.endpoint(name, variable)
            what = f"{self.path}: connector {name}.{variable}"
            if offered.is_source != (kind == "output"):
                raise UserError(f"{what}: {kind} is given, but the FMU says otherwise")
            type_, unit = _type(connector)
            if type_ and port_type(type_) != offered.type:
                raise UserError(f"{what}: {type_} is given, the FMU says {offered.type}")
            if unit and offered.unit and unit != offered.unit:
                raise UserError(f"{what}: [{unit}] is given, the FMU says [{offered.unit}]")

    def _values(self, element: etree._Element, where: str) -> Iterator[_Given]:
        """Values of an element's parameter bindings, inline or in .ssv files, mapped where a mapping is given."""
        for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NS):
            prefix, at = binding.get("prefix", ""), where
            values = binding.find("ssd:ParameterValues/ssv:ParameterSet", NS)
            if (source := binding.get("source")) is not None:
                file = self.base / self._relative(source, where)
                at = f"{where}: {source}"
                values = xml.parse(self._read(file, where), at, "SystemStructureParameterValues")
            if values is None:
                raise UserError(f"{where}: a ParameterBinding without source and without ParameterSet is given")
            mapping = self._mapping(binding, where)
            for given in _parameters(values, at):
                if mapping is None:
                    yield replace(given, name=prefix + given.name)
                for target, factor, offset in (mapping or {}).get(given.name, []):
                    value = given.value
                    if (factor, offset) != (1.0, 0.0):
                        value = factor * _number(value, f"{at}: {given.name}") + offset
                    yield replace(given, name=prefix + target, value=value)

    def _mapping(self, binding: etree._Element, where: str) -> dict[str, list[tuple[str, float, float]]] | None:
        element = binding.find("ssd:ParameterMapping", NS)
        if element is None:
            return None
        root = element.find("ssm:ParameterMapping", NS)
        if (source := element.get("source")) is not None:
            file = self.base / self._relative(source, where)
            root = xml.parse(self._read(file, where), f"{where}: {source}", "SystemStructureParameterMapping")
        mapped: dict[str, list[tuple[str, float, float]]] = {}
        for entry in root.iterfind("ssm:MappingEntry", NS) if root is not None else ():
            transformation = _transformation(entry, f"{where}: mapping of {entry.get('source')!r}")
            mapped.setdefault(entry.get("source", ""), []).append((entry.get("target", ""), *transformation))
        return mapped

    def _read(self, file: Path, where: str) -> bytes:
        try:
            return file.read_bytes()
        except OSError as error:
            raise UserError(f"{where}: {file}: {error.strerror}") from error

    def _with_values(self, component: Component, values: list[_Given], prefixed: bool) -> Component:
        parameters = dict(component.parameters)
        for given in values:
            name = given.name.removeprefix(f"{component.name}.") if prefixed else given.name
            if prefixed and name == given.name:
                continue
            where = f"{given.where}: {component.name}.{name}"
            value = given.value
            if given.unit is not None and name in component.unit.variables:
                value = _converted(given, float(value), component, name, where)
            parameters[name] = checked(component.unit, name, value, where)
        return replace(component, parameters=parameters)

    def _all_used(self, values: list[_Given], components: list[Component]) -> None:
        for given in values:
            names = [f"{c.name}.{given.name}" if len(components) == 1 else given.name for c in components]
            if not any(n.removeprefix(f"{c.name}.") in c.parameters for c, n in zip(components, names, strict=True)):
                raise UserError(
                    f"{given.where}: {given.name}: no such component, there are {among(c.name for c in components)}"
                )


def read_units(element: etree._Element | None) -> dict[str, BaseUnit]:
    """Unit definitions of an SSD or SSV: name -> BaseUnit"""
    units = {}
    for unit in element.iterfind("ssc:Unit", NS) if element is not None else ():
        base = unit.find("ssc:BaseUnit", NS)
        assert base is not None  # the schema demands it
        units[unit.get("name", "")] = BaseUnit(
            **{e: int(base.get(e, "0")) for e in EXPONENTS},
            factor=float(base.get("factor", "1")),
            offset=float(base.get("offset", "0")),
        )
    return units


def _converted(given: _Given, value: float, component: Component, name: str, where: str) -> float:
    unit = component.unit.unit_of(name)
    source = Endpoint(None, given.name, None, True, given.unit, given.base)
    sink = Endpoint(component.name, name, None, False, unit, component.unit.units.get(unit or ""))
    factor, offset = conversion(source, sink, where)
    return factor * value + offset


def _parameters(root: etree._Element, where: str) -> Iterator[_Given]:
    units = read_units(root.find("ssv:Units", NS))
    for parameter in root.iterfind("ssv:Parameters/ssv:Parameter", NS):
        typed = next(iter(parameter))
        unit = typed.get("unit")
        yield _Given(parameter.get("name", ""), typed.get("value", ""), unit, units.get(unit or ""), where)


def _ends(element: etree._Element) -> tuple[tuple[str | None, str], tuple[str | None, str]]:
    return (
        (element.get("startElement"), element.get("startConnector", "")),
        (element.get("endElement"), element.get("endConnector", "")),
    )


def _type(connector: etree._Element) -> tuple[str | None, str | None]:
    """(type, unit) as a connector's child says them"""
    for child in connector:
        if etree.QName(child).namespace == NS["ssc"]:
            return etree.QName(child).localname, child.get("unit")
    return None, None


def _number(value: Value | str, where: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise UserError(f"{where}: {value!r} is given, a number is needed to be transformed") from None


def _transformation(element: etree._Element, where: str) -> tuple[float, float]:
    for child in element:
        kind = etree.QName(child).localname
        if kind == "LinearTransformation":
            factor, offset = child.get("factor", "1"), child.get("offset", "0")
            return _number(factor, f"{where}: factor"), _number(offset, f"{where}: offset")
        if kind.endswith("Transformation"):
            raise UserError(f"{where}: {kind} is given, LinearTransformation is allowed")
    return 1.0, 0.0
