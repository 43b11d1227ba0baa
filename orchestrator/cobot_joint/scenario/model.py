"""Scenario files: what they may say, read and checked."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from cobot_joint import paths
from cobot_joint.cosim.experiment import Experiment
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Inputs, System
from cobot_joint.system.read import find_system, load_system, system_names

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Grips(_Model):
    """A person's grips: trapezoids that start `at` these times, s; `height` in the input's unit."""

    at: list[Finite] = Field(min_length=1)
    height: Finite
    rise: Positive
    hold: Positive
    fall: Positive

    def points(self) -> list[tuple[float, float]]:
        """Corners (time, value) of all grips."""
        corners = []
        for start in self.at:
            top = start + self.rise
            corners += [(start, 0.0), (top, self.height)]
            corners += [(top + self.hold, self.height), (top + self.hold + self.fall, 0.0)]
        return corners


class Signal(_Model):
    """One input over time: corners joined by lines, held before the first and after the last; or grips."""

    unit: str | None = None
    points: list[tuple[Finite, Finite]] = Field(default_factory=list)
    grips: Grips | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Signal:
        if bool(self.points) == bool(self.grips):
            raise ValueError("one of points and grips is allowed")
        times = [t for t, _ in self.corners()]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("times have to rise")
        return self

    def corners(self) -> list[tuple[float, float]]:
        """(time, value)"""
        return self.grips.points() if self.grips else self.points

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at `time`: float64[n]"""
        t, v = zip(*self.corners(), strict=True)
        return np.interp(time, t, v)


class BaseScenario(_Model):
    """What every kind of scenario says."""

    title: str = ""
    system: str
    parameters: dict[str, float | str] = Field(default_factory=dict)  # `component.parameter` -> value
    scheme: str | None = None  # of coupling; None: the master's own
    step: Positive | None = None  # s
    name: str = ""
    path: Path | None = None


class TimeScenario(BaseScenario):
    """Inputs over time, one run."""

    kind: Literal["time"] = "time"
    start_time: Finite = 0.0
    stop_time: Positive
    output_step: Positive = 1e-3
    columns_of: str | None = None  # a system whose columns signals.parquet gets; those this one lacks are 0 throughout
    inputs: dict[str, Signal] = Field(default_factory=dict)

    def signals(self, system: System) -> Inputs:
        """The system's inputs, at all their corners. UserError: the system has no such input, or another unit."""
        for name, signal in self.inputs.items():
            where = f"{self.path or self.name}: inputs.{name}"
            if name not in system.inputs:
                raise UserError(f"{where}: {system.name} has no such input, it has {among(system.inputs)}")
            if signal.unit is not None and signal.unit != (unit := system.inputs[name].unit):
                raise UserError(f"{where}: unit {signal.unit!r} is given, {unit!r} is allowed")
        ends = {self.start_time, self.stop_time}
        corners = ends.union(t for s in self.inputs.values() for t, _ in s.corners())
        time = np.array(sorted(t for t in corners if self.start_time <= t <= self.stop_time))
        return Inputs(time, {name: signal.at(time) for name, signal in self.inputs.items()})

    def experiment(self, system: System) -> Experiment:
        """The run of it, without `parameters`, which are the system's. UserError: as `signals`."""
        return Experiment(
            self.signals(system),
            self.stop_time,
            self.start_time,
            self.output_step,
            scheme=self.scheme,
            step=self.step,
            record=system.recorded,
        )


class Variant(_Model):
    """A transfer function k/(J s + B), and parameters that bring the units to the same."""

    name: str
    source: str = ""
    J: Positive  # kg.m2
    B: Positive  # N.m.s/rad
    k: Positive  # N.m/A
    parameters: dict[str, float | str] = Field(default_factory=dict)


class FrequencyResponse(BaseScenario):
    """A current sine per frequency, and the amplitude of the speed after settling."""

    kind: Literal["frequency_response"]
    table: str
    amplitude: Positive
    bias: Finite = 0.0
    bias_from: Literal["measured_speed", "commanded_current"] = "measured_speed"
    settle: Positive = 5.0
    periods: Annotated[int, Field(ge=1)] = 2
    compared: Literal["fundamental", "half_swing"] = "fundamental"
    variants: list[Variant] = Field(min_length=1)
    input: str = "v_command"  # the system's connectors
    current: str = "i_motor"
    speed: str = "w_motor"


class Arm(_Model):
    """Moment arm of thesis Fig. 3.10: weights hang at `l`, its own acts at `d`. T_a = m_r g d + m_w g l (eq. 3.2)."""

    m_r: Positive  # kg
    d: Positive  # m
    l: Positive  # m  # noqa: E741
    g: Positive = 9.80665  # m/s2

    def torque(self, m_w: float) -> float:
        """N.m, of weights of `m_w` kg (eq. 3.2)"""
        return self.g * (self.m_r * self.d + m_w * self.l)


class Shunt(_Model):
    """A resistor across one arm of the sensor's bridge, which looks like a load."""

    R_sh: Positive  # Ohm
    R_bridge: Positive  # Ohm
    rated_output: Positive  # V/V at rated torque
    rated_torque: Positive  # N.m
    v_full: Positive  # V at rated torque, behind the amplifier

    def load(self) -> float:
        """Simulated load over rated load: R_b/(4 R_sh + 2 R_b) over rated output."""
        return self.R_bridge / (4 * self.R_sh + 2 * self.R_bridge) / self.rated_output


class TorqueCalibration(BaseScenario):
    """Weights on an arm, and the shunt check."""

    kind: Literal["torque_calibration"]
    arm: Arm
    weights: list[Annotated[float, Field(ge=0, allow_inf_nan=False)]] = Field(min_length=2)  # kg
    settle: Positive = 2.0  # s, per weight
    shunt: Shunt
    line: dict[Literal["slope", "offset"], Finite]  # eq. 3.3: applied = slope*measured + offset
    uncalibrated: dict[str, float | str] = Field(default_factory=dict)  # on top of `parameters`, for the shunt check


class CurrentSensorCalibration(BaseScenario):
    """A staircase of currents through the ACS712 of each phase."""

    kind: Literal["current_sensor_calibration"]
    currents: list[Finite] = Field(min_length=3)  # A
    settle: Positive = 0.1  # s, per step
    zero: Finite  # V at no current, nominal
    slope: Finite  # V/A, nominal


class ComparedSignal(_Model):
    """`of`/`over` is what errors are of; `of` is an output of the systems."""

    of: str
    over: Positive = 1.0
    unit: str


class Phases(_Model):
    """Signals that are drawn from `from` to `to`, s."""

    signals: list[str]
    begin: Finite = Field(alias="from")
    end: Finite = Field(alias="to")


class LevelTest(_Model):
    """A time scenario that every level runs; its transient lasts until `transient`, s."""

    name: str
    scenario: str
    bench: str  # the system that stands in for the measurement, with its logger
    stop_time: Positive | None = None  # None: the scenario's
    transient: Positive

    @property
    def key(self) -> str:
        """For file names."""
        return re.sub(r"\W+", "_", self.name)


class Reported(_Model):
    """Errors as somebody printed them."""

    test: str
    level: str
    errors: dict[str, dict[Literal["transient", "steady", "combined"], Positive]]  # signal -> part -> value


class LevelComparison(BaseScenario):
    """Tests at every level of the model, beside a simulated bench and what was reported."""

    kind: Literal["levels"]
    bench: str  # the level of the simulated bench
    bench_parameters: dict[str, float | str] = Field(default_factory=dict)
    levels: dict[str, str] = Field(min_length=1)  # level -> in words
    signals: dict[str, ComparedSignal] = Field(min_length=1)
    tests: list[LevelTest] = Field(min_length=1)
    reported: list[Reported] = Field(default_factory=list)
    phases: Phases
    also: list[str] = Field(default_factory=list)  # further scenarios

    def printed(self, test: str, level: str, signal: str) -> dict[str, float]:
        """Part of the run -> the error that was reported."""
        rows = [r for r in self.reported if (r.test, r.level) == (test, level)]
        return {str(part): value for row in rows for part, value in row.errors.get(signal, {}).items()}


Scenario = Annotated[
    TimeScenario | FrequencyResponse | TorqueCalibration | CurrentSensorCalibration | LevelComparison,
    Field(discriminator="kind"),
]
_ADAPTER: TypeAdapter[Any] = TypeAdapter(Scenario)


def scenario_names() -> list[str]:
    """Scenarios that come with the package."""
    return sorted(file.stem for file in paths.folder("scenarios").glob("*.toml"))


def settings_of(scenario: BaseScenario) -> dict[str, float | str]:
    """What `--set NAME=VALUE` changes: the scenario's numbers and choices."""
    fixed = {"name", "path", "kind", "title", "system", "columns_of", "table"}
    return {n: v for n, v in scenario.model_dump().items() if n not in fixed and isinstance(v, int | float | str)}


def load_scenario(scenario: str | Path, settings: Mapping[str, str] | None = None) -> Any:
    """A shipped scenario by name, or a .toml file; `settings` (`bias_from` -> a value) replace what it says.

    A system, by name or as .ssd or .ssp file, is the scenario of its default experiment with no input driven.
    UserError: there is no such scenario, or it says something that is not allowed.
    """
    path = paths.folder("scenarios") / f"{scenario}.toml" if str(scenario) in scenario_names() else Path(scenario)
    if path.suffix == ".toml" and path.is_file():
        given = _read(path)
    elif path.suffix in (".ssd", ".ssp") or str(scenario) in system_names():
        path = find_system(scenario)
        given = _default_experiment(path)
    else:
        raise UserError(
            f"scenario {str(scenario)!r}: there is none, allowed are {among(scenario_names())}, a .toml file, "
            f"or a system: {among(system_names())}, an .ssd or .ssp file"
        )
    try:
        return _ADAPTER.validate_python({**given, **(settings or {}), "name": path.stem, "path": path})
    except ValidationError as error:
        raise UserError(f"{path}: {_first(error)}") from error


def _read(path: Path) -> dict[str, Any]:
    """A scenario file's content; a system's file is looked for beside it first."""
    try:
        given = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path}: not a TOML file: {error}") from error
    except RecursionError:
        raise UserError(f"{path}: not a TOML file: brackets within brackets, deeper than can be read") from None
    given.setdefault("kind", "time")
    for key in ("system", "columns_of"):
        if isinstance(named := given.get(key), str) and (path.parent / named).is_file():
            given[key] = str(path.parent / named)
    return given


def _default_experiment(path: Path) -> dict[str, Any]:
    experiment = load_system(path).default_experiment
    times = {"start_time": experiment.start_time, "stop_time": experiment.stop_time}
    return {"kind": "time", "title": f"{path.stem}: its default experiment", "system": str(path), **times}


def _first(error: ValidationError) -> str:
    """Pydantic's first finding in one line: where, what is given, what is allowed."""
    finding = error.errors()[0]
    path = [str(part) for part in finding["loc"]]
    kinds = {m.model_fields["kind"].annotation.__args__[0]: m for m in _KINDS}  # type: ignore[union-attr]
    if path and path[0] in kinds:
        model, path = kinds[path[0]], path[1:]
        if finding["type"] == "extra_forbidden" and len(path) == 1:
            fields = [f for f in model.model_fields if f not in ("name", "path")]
            return f"{path[0]}: no such key, allowed are {among(fields, 20)}"
    where = ".".join(path) or "kind"
    if finding["type"] == "union_tag_invalid":
        return f"kind: {finding['ctx']['tag']!r} is given, allowed are {among(kinds)}"
    if finding["type"] == "missing":
        return f"{where}: is missing"
    if finding["type"] == "extra_forbidden":
        return f"{where}: no such key"
    message = finding["msg"].removeprefix("Value error, ").replace("Input should be", "allowed is")
    given = finding["input"] if not isinstance(finding["input"], dict) else "a table"
    return f"{where}: {given!r} is given, {message}"


_KINDS: tuple[type[BaseScenario], ...] = (
    TimeScenario, FrequencyResponse, TorqueCalibration, CurrentSensorCalibration, LevelComparison,
)  # fmt: skip
