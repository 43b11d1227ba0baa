"""What a caller changes on a scenario, as options of a command."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from cobot_joint.errors import UserError

if TYPE_CHECKING:
    from cobot_joint.scenario.options import Options


@dataclass(frozen=True)
class Changes:
    """What a caller changes on a scenario: options of `run`."""

    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="A parameter (motor_bldc.winding.R=0.22) or a setting of the scenario (stop_time=5); repeatable.",
        ),
    ] = None
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=FILE[:PORTS]",
            help="An FMU in a component's place; PORTS where its names differ: tau=tau_m,w=-speed; repeatable.",
        ),
    ] = None
    level: Annotated[
        str | None,
        typer.Option(help="transfer_function, averaged, simscape, comprehensive, foc or switching: the motor's model."),
    ] = None
    scheme: Annotated[
        str | None,
        typer.Option(help="Coupling scheme: one of those above.", show_default="the scenario's, or adaptive"),
    ] = None
    step: Annotated[float | None, typer.Option(help="Communication step, s.", show_default="the scheme's own")] = None

    def settings(self) -> dict[str, str]:
        """Of `--set`, the scenario's."""
        return {name: value for name, value in self._set().items() if "." not in name}

    def options(self) -> Options:
        """The rest of them. UserError: a level that there is not."""
        from cobot_joint.scenario.options import Options

        parameters = {name: value for name, value in self._set().items() if "." in name}
        units = _pairs("--unit", self.unit, "NAME=FILE is allowed, for example planetary_gear=my_gear.fmu")
        return Options(self.level, self.step, self.scheme, parameters, units)

    def _set(self) -> dict[str, str]:
        return _pairs("--set", self.set_, "NAME=VALUE is allowed, for example motor_bldc.winding.R=0.22")


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command, whose last argument is a dataclass of options, with a command-line option for each of its fields."""
    *own, last = inspect.signature(command, eval_str=True).parameters.values()
    types = get_type_hints(last.annotation, include_extras=True)
    names = [field.name for field in fields(last.annotation)]
    options = [inspect.Parameter(n, last.KEYWORD_ONLY, default=None, annotation=types[n]) for n in names]

    @wraps(command)
    def called(**given: Any) -> None:
        together = last.annotation(**{name: given[name] for name in names})
        command(**{p.name: given[p.name] for p in own}, **{last.name: together})

    called.__signature__ = inspect.Signature([*own, *options])  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in (*own, *options)}
    return called


def _pairs(option: str, texts: list[str] | None, allowed: str) -> dict[str, str]:
    pairs = {}
    for text in texts or []:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UserError(f"{option} {text!r} is given, {allowed}")
        pairs[name] = value
    return pairs
