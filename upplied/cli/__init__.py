"""The `upplied` command. Heavy imports stay inside the commands, so that help answers at once.

Exit codes: 0 success, 1 some files or targets were refused or failed, 2 the command was wrong,
3 a fault of the program itself.
"""

import logging
import os
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, Group, Parameter
from rich.markup import escape

import upplied
from upplied.cli import (
    catalog,
    declared,
    demonstrations,
    export,
    findings,
    flights,
    quickstart,
    review,
    serve,
    structures,
    transfer,
)
from upplied.cli.terminal import console, errors
from upplied.errors import RefusedError, UppliedError


def _default(value: object) -> str | None:
    """A default for the help; None if it only means that the option is absent."""
    if value in (None, "", ()) or value is False:
        return None
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


app = App(
    name="upplied",
    help="Plan the inspection of every structure of a kind from one expert's flight.",
    version=upplied.__version__,
    console=console,
    error_console=errors,
    result_action="return_value",
    default_parameter=Parameter(negative="", show_default=_default),
    suppress_keyboard_interrupt=False,  # `main` reports it
    help_epilogue="--quiet (any command): print only errors and requested JSON.",
)
app.register_install_completion_command(help="Install completion of commands and options for the shell.")
_GROUPS = {  # of the help, in the order in which a newcomer needs them
    "Data": (quickstart.samples, structures.app, demonstrations.app, catalog.app),
    "Plan": (
        *(transfer.transfer, transfer.plan, demonstrations.recommend),
        *(declared.set_, declared.settings, declared.require, declared.zones),
    ),
    "Review": (
        *(serve.studio, serve.report, export.render),
        *(review.review, review.release, review.reject, review.edit),
    ),
    "Fly": (export.fly, export.export, export.brief, flights.app),
    "Findings": (findings.app, flights.looks, findings.reshoot),
    "Fleet": (review.in_force, serve.fleet, review.keys),
    "Service": (quickstart.quickstart, serve.serve, serve.deploy, serve.watch, quickstart.doctor),
}
for _at, (_title, _commands) in enumerate(_GROUPS.items()):
    _group = Group(_title, sort_key=_at)
    for _command in _commands:
        if isinstance(_command, App):
            _command.group = (_group,)
            app.command(_command)
        else:
            app.command(_command, group=_group)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    if os.environ.get("UPPLIED_DEBUG"):
        logging.basicConfig(level=logging.INFO)
    try:
        tokens = list(sys.argv[1:] if arguments is None else arguments)
        console.quiet = "--quiet" in tokens
        tokens = [token for token in tokens if token != "--quiet"]
        if tokens[:1] == ["--catalog"] and len(tokens) > 2:  # it is an option of the commands
            tokens = [*tokens[2:], *tokens[:2]]
        return app(tokens, exit_on_error=False, print_error=False) or 0
    except CycloptsError as error:
        return _failed(2, "[red]error:[/]", f"{error} Try --help.")
    except RefusedError as error:
        return _failed(1, "[yellow]refused:[/]", error)
    except UppliedError as error:
        return _failed(2, "[red]error:[/]", error)
    except KeyboardInterrupt:
        return _failed(130, "Stopped.", "Finished work is stored.")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains at its exit
        return 0
    except Exception as error:
        if os.environ.get("UPPLIED_DEBUG"):
            raise
        if isinstance(error, OSError):  # of the machine: rights, space, a name that is too long
            where = error.filename or type(error).__name__
            return _failed(2, "[red]error:[/]", f"{where}: {error.strerror or error}")
        advice = "This is a fault of the program; UPPLIED_DEBUG=1 shows where."
        return _failed(3, "[red]fault:[/]", f"{type(error).__name__}: {error}\n{advice}")
    finally:
        console.quiet = False


def _failed(code: int, word: str, text: object) -> int:
    errors.print(f"{word} {escape(str(text))}", soft_wrap=True)
    return code
