"""The content of campaign.toml, as it may be written."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from cobot_joint.diagnosis.data.delimited import Layout
from cobot_joint.diagnosis.data.parameters import FIRST, QUANTITY
from cobot_joint.diagnosis.data.quantity import convert, is_unit
from cobot_joint.diagnosis.data.recording import Column, Reading, Role


@dataclass(frozen=True)
class Tolerance:
    """How far a healthy parameter may be off: relative to its nominal value, or between two values."""

    relative: float | None = None
    between: tuple[float, float] | None = None

    def bounds(self, nominal: float) -> tuple[float, float]:
        """(lower, upper) around `nominal`"""
        if self.between is not None:
            return self.between
        assert self.relative is not None
        return nominal - self.relative * abs(nominal), nominal + self.relative * abs(nominal)


def _tolerance(given: Any) -> Tolerance:
    if isinstance(given, Tolerance):
        return given
    percent = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*%\s*", given) if isinstance(given, str) else None
    if percent and float(percent[1]) > 0:
        return Tolerance(relative=float(percent[1]) / 100)
    if (between := _two_numbers(given)) is not None:
        return Tolerance(between=between)
    raise ValueError(f'{given!r} is given, "20 %" (more than 0 %) or [lower, upper] is allowed')


def _range(given: Any) -> tuple[float, float]:
    if (between := _two_numbers(given)) is not None:
        return between
    raise ValueError(f"{given!r} is given, [lower, upper] is allowed")


def _two_numbers(given: Any) -> tuple[float, float] | None:
    """The first below the second, and both finite; None: it is no such list."""
    numbers = isinstance(given, list | tuple) and len(given) == 2 and all(type(v) in (int, float) for v in given)
    return (float(given[0]), float(given[1])) if numbers and -math.inf < given[0] < given[1] < math.inf else None


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", arbitrary_types_allowed=True, strict=True, allow_inf_nan=False)


class Logged(_Model):
    """What the logger's data sheet says of a channel; what a recording then shows is estimated from the recording."""

    unit: str | None = None  # None: the connector's
    causality: Literal["input", "output"] | None = None
    noise: Annotated[float, Field(gt=0)] | None = None  # 1 sigma
    colour: Annotated[float, Field(ge=0, lt=1)] | None = None  # correlation from sample to sample; None: as recorded
    step: Annotated[float, Field(ge=0)] | None = None  # of the converter
    range: Annotated[float, Field(gt=0)] | None = None  # +-
    setups: list[str] | None = None  # where it exists; None: in all


def _start(value: Any) -> Any:
    """A number; "22.5 deg", in the units that all variables have; "first sample", of the channel of the same name, or
    "first sample of phi * 66", of another, times or over a number."""
    if not isinstance(value, str) or FIRST.fullmatch(value):
        return value
    quantity = QUANTITY.fullmatch(value)
    if quantity is None or not quantity[2] or not is_unit(quantity[2]):
        allowed = "a number, a quantity ('22.5 deg') or 'first sample of CHANNEL' is allowed"
        raise ValueError(f"{value!r} is given, {allowed}")
    return float(convert(np.array([float(quantity[1])]), quantity[2], None, value)[0][0])


Start = Annotated[float | str, BeforeValidator(_start)]
Scale = Annotated[float, Field(allow_inf_nan=False)] | str  # a number, or a quantity: "9.84 mN.m"


class ColumnEntry(_Model):
    """What [channels] says of a column, where a name is not enough: x = sign*scale*column + offset, or its rate; or
    that of its product with another."""

    to: str  # the connector
    scale: Scale | None = None
    sign: Literal[1, -1] | None = None
    offset: Scale = 0.0
    derivative: bool = False  # a position's column for a speed's connector
    hold: bool = False  # a set value that its drive holds until the next one
    mean: bool = False  # a speed's mean since the sample before, of an encoder's counts
    times: str = ""  # another column of the file, which it is multiplied by: a duty cycle's supply

    @property
    def column(self) -> Column:
        """As a recording is read with it. Whoever gives a scale or sign has looked at it."""
        looked = self.scale is not None or self.sign is not None
        scale = 1.0 if self.scale is None else self.scale
        return Column(
            self.to, scale, self.sign or 1, self.offset, self.derivative, looked, self.hold, self.mean, self.times
        )


Values = dict[str, float | bool | str]  # `component.parameter` -> number, choice or quantity


class RecordingEntry(_Model):
    """One [[recording]] of campaign.toml: a file, or several that are read alike."""

    # names or patterns, "runs/*.csv": the files that no other entry names
    file: str | Annotated[list[str], Field(min_length=1)]
    setup: str | None = None
    role: Role = "train"
    initial: dict[str, Start] = Field(default_factory=dict)
    parameters: Values = Field(default_factory=dict)  # of the system in this run: a gain that was changed between runs
    time: str | None = None  # the clock's column, where it has an unusual name
    begin: float | None = None  # s on the file's clock: what lies before is left out
    end: float | None = None
    late: dict[str, float] = Field(default_factory=dict)  # column -> s by which its stamps are late
    without: list[str] = Field(default_factory=list)  # columns or connectors that were not recorded
    table: Literal["mean", "rows"] | None = None  # steady states: the mean of each file, or each line of a file
    skip: Annotated[int, Field(ge=0)] | None = None  # of a text file: lines above the names; None: guessed
    separator: str | None = None
    encoding: str | None = None
    decimal: Literal[",", "."] | None = None

    @property
    def patterns(self) -> list[str]:
        """`file` as a list."""
        return [self.file] if isinstance(self.file, str) else self.file

    def reading(self, setup: str, initial: dict[str, float | str]) -> Reading:
        """How its files become recordings of a set-up. initial: start values that it may say otherwise."""
        return Reading(
            role=self.role,
            setup=setup,
            initial=initial | self.initial,
            time=self.time,
            window=(self.begin, self.end),
            late=self.late,
            without=tuple(self.without),
            layout=Layout(self.skip, self.separator, self.encoding, self.decimal),
            table=self.table,
        )


class Alternative(_Model):
    """A reading of an experiment whose description leaves something open: each is diagnosed, the best is the answer."""

    name: str
    parameters: Values = Field(default_factory=dict)
    term: str | None = None  # what it is a finding of, where it is not the first reading that holds


class FrequencyExperiment(_Model):
    """Amplitudes over frequency instead of time series: what the runs behind them were."""

    input: str  # driven by amplitude*sin(omega t)
    amplitude: Annotated[float, Field(gt=0)]  # in the input's unit
    output: str  # whose half swing after settling was measured
    settle: Annotated[float, Field(ge=0)] = 2.0  # s
    parameters: Values = Field(default_factory=dict)  # of the experiment, not of the system


class CampaignFile(_Model):
    """campaign.toml, and the defaults `<system>.campaign.toml` that a shipped system brings."""

    title: str = "untitled"
    system: str = "joint"
    setups: dict[str, str] = Field(default_factory=dict)  # set-up -> its .ssd or .ssp
    parameters: Values = Field(default_factory=dict)  # nominal values of this machine, in place of the system's
    channels: dict[str, str | ColumnEntry] = Field(default_factory=dict)  # column -> connector
    initial: dict[str, Start] = Field(default_factory=dict)  # of every recording that says nothing else
    tolerances: dict[str, Annotated[Tolerance, BeforeValidator(_tolerance)]] = Field(default_factory=dict)
    logged: dict[str, Logged] = Field(default_factory=dict)
    terms: list[str] = Field(
        default_factory=list
    )  # `component.term` that are looked at, where not all of the units' are
    # `component.term.shape` -> where its values are looked for, where not over what was driven
    scan: dict[str, Annotated[tuple[float, float], BeforeValidator(_range)]] = Field(default_factory=dict)
    onsets: bool = True  # whether what is missing may set in during a run
    frequency_response: FrequencyExperiment | None = None
    alternative: list[Alternative] = Field(default_factory=list)  # of a frequency response
    recording: list[RecordingEntry] = Field(default_factory=list)
