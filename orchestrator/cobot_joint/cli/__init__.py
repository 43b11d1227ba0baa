"""The command `cobot-joint`.

Exit status: 0 done; 2 the call or a file is wrong (a line on stderr); 130 interrupted; 1 anything else.
Nothing that simulates is imported before it is needed: a person who asks for help gets it at once.
"""

from __future__ import annotations

import sys
import traceback
from typing import Annotated

import typer

from cobot_joint.cli import fmus, run
from cobot_joint.cli.options import with_options
from cobot_joint.cli.output import console, output, say_json
from cobot_joint.cli.precautions import Precautions, common_first
from cobot_joint.diagnosis import commands as diagnosis
from cobot_joint.diagnosis import own_bench
from cobot_joint.errors import UserError, among, printable
from cobot_joint.files import what_is_missing
from cobot_joint.interrupts import Interrupted, interruptible
from cobot_joint.live import command as live
from cobot_joint.version import __version__

HELP = """A cobot joint's test bench: run it, compare it with recordings, export it.

-q, -v, --json, --isolate and limits may stand anywhere in the call.
"""
app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help=HELP,
)
WITHOUT_JSON = {"inspect", "new", "open", "prove"}


_NO_PRECAUTIONS = Precautions()


def _version(wanted: bool) -> None:
    if wanted:
        print(f"cobot-joint {__version__}")
        raise typer.Exit


@app.callback()
@with_options
def common(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Trace an error to where it arose.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
    precautions: Precautions = _NO_PRECAUTIONS,
) -> None:
    """What holds for every command."""
    precautions.take(context)
    if as_json and context.invoked_subcommand in WITHOUT_JSON:
        allowed = among(sorted(set(_commands()) - WITHOUT_JSON))
        raise UserError(f"--json is given with {context.invoked_subcommand}, it is allowed with {allowed}")
    output.verbose, output.as_json = verbose, as_json
    for one in (console, diagnosis.console, own_bench.console, live.console):
        one.quiet = quiet or as_json


app.command(help=run.HELP)(with_options(run.run))
app.command()(run.demo)
app.command()(fmus.export)
app.command(help=fmus.CHECK_HELP)(fmus.check)
diagnosis.register(app)
for command in (own_bench.inspect, own_bench.new):
    app.command()(command)
app.command("open")(live.open_)


def main() -> None:
    """Entry point."""
    sys.exit(_status(common_first(sys.argv[1:])))


def _status(arguments: list[str]) -> int:
    try:
        with interruptible():
            answer = app(arguments, prog_name="cobot-joint", standalone_mode=False)
            if isinstance(answer, dict):
                say_json(answer)
                return 0
            return int(answer or 0)
    except Interrupted as how:
        return _say(", ".join(["interrupted", *how.args]), 130)
    except UserError as error:
        return _say(error, 2)
    except typer.TyperException as error:
        return _say(_usage(error), 2)
    except OSError as error:
        return _say(what_is_missing(error), 1)
    except RuntimeError as error:  # a unit failed while it ran: SimulationError says which and when
        from cobot_joint.cosim.instances import SimulationError

        if not isinstance(error, SimulationError):
            raise
        return _say(error, 1)


def _commands() -> list[str]:
    return [c.name or c.callback.__name__ for c in app.registered_commands if c.callback]


def _usage(error: typer.TyperException) -> str:
    message = " ".join(error.format_message().split())
    if message.startswith("No such command"):
        message += f" Allowed are {among(sorted(_commands()))}."
    return message


def _say(what: object, status: int) -> int:
    if output.verbose:
        traceback.print_exc()
    print(f"cobot-joint: {printable(' '.join(str(what).split()))}", file=sys.stderr)
    return status
