"""Options of every command that keep a call apart from units and files that are not trusted.

They are handed on as environment variables, so that processes that a command starts take them, too.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import islice
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

FLAGS = ("-q", "--quiet", "-v", "--verbose", "--json", "--isolate", "--no-cache")
VALUED = ("--time-limit", "--memory-limit")


@dataclass(frozen=True)
class Precautions:
    """See cosim.isolation for what the limits are, units for the cache."""

    isolate: Annotated[
        bool | None, typer.Option("--isolate", help="Run shipped units, too, in processes of their own.")
    ] = None
    time_limit: Annotated[
        str | None, typer.Option(metavar="S", help="Time limit for one call of an isolated unit.", show_default="30")
    ] = None
    memory_limit: Annotated[
        str | None, typer.Option(metavar="MB", help="Address space of an isolated unit.", show_default="4000")
    ] = None
    no_cache: Annotated[
        bool | None, typer.Option("--no-cache", help="Unpack FMUs for this call alone, not into the user's cache.")
    ] = None

    def take(self, context: typer.Context) -> None:
        """For this process and those that it starts."""
        given = {"COBOT_JOINT_TIME_LIMIT": self.time_limit, "COBOT_JOINT_MEMORY_LIMIT": self.memory_limit}
        if self.isolate:
            given["COBOT_JOINT_ISOLATE"] = "all"
        if self.no_cache:
            given["COBOT_JOINT_CACHE"] = context.with_resource(TemporaryDirectory(prefix="cobot-joint-"))
        os.environ |= {name: value for name, value in given.items() if value is not None}


def common_first(given: list[str]) -> list[str]:
    """The arguments with those in front that hold for every command and may stand anywhere."""
    first: list[str] = []
    rest: list[str] = []
    arguments = iter(given)
    for argument in arguments:
        if argument in FLAGS or argument.partition("=")[0] in VALUED:
            first += [argument, *(islice(arguments, 1) if argument in VALUED else ())]
        else:
            rest.append(argument)
    return [*first, *rest]
