"""The command `lithoform`, a module a command.

Results go to standard output, progress and errors to standard error.  Exit status: 0 done; 1 an unsound mesh
was found by `check`; 2 a wrong request or a failure, said in one sentence; 130 interrupted; 141 nobody reads on.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError

from lithoform import __version__
from lithoform.cli.checking import check
from lithoform.cli.compacting import compact
from lithoform.cli.comparing import compare
from lithoform.cli.database import database
from lithoform.cli.designing import design
from lithoform.cli.experimenting import experiment
from lithoform.cli.exploring import explore
from lithoform.cli.exporting import export
from lithoform.cli.generating import generate
from lithoform.cli.laboratory import laboratory
from lithoform.cli.matching import match
from lithoform.cli.measuring import measure, picture
from lithoform.cli.output import drop_output, one_line, open_output, say
from lithoform.cli.packing import pack
from lithoform.cli.reproducing import reproduce
from lithoform.cli.sensitivity import sensitivity
from lithoform.errors import LithoformError, RecipeError

__all__ = ["app", "main"]

app = App(
    name="lithoform",
    help="""Simulation-ready virtual rock particles: generate, check, measure, picture and compare them.

**Example:** `lithoform generate stones --count 12 --picture`""",
    version=__version__,
    help_format="markdown",
    suppress_keyboard_interrupt=False,  # `main` tells it
)
for _command in (
    generate, check, measure, laboratory, pack, compact, experiment, export, picture, database, compare, match,
    sensitivity, design, explore, reproduce,
):  # fmt: skip
    app.command(_command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command and exit with its status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        open_output()
        _require_size_in_one_word(given)
        status = app(_repeat_set(given), exit_on_error=False, print_error=False, result_action="return_value")
        say("", end="")  # what the help has left in the buffer
    except KeyboardInterrupt:
        print("lithoform: interrupted.", file=sys.stderr)
        status = 130
    except (BrokenPipeError, SystemExit):
        # The reader of our output has gone (`lithoform check ... | head`): no fault of ours, nothing to say.
        # The page of --help ends with SystemExit then.
        drop_output()
        status = 141
    except (LithoformError, CycloptsError) as error:
        if "--debug" in given:
            raise
        print(f"lithoform: {one_line(error)}", file=sys.stderr)
        status = 2
    except Exception as error:
        if "--debug" in given:
            raise
        if isinstance(error, OSError) and {"--help", "-h", "--version"} & set(given):
            # These pages are printed by cyclopts, not by `say`.
            drop_output()
            print(f"lithoform: standard output cannot be written: {error.strerror or error}.", file=sys.stderr)
            sys.exit(2)
        # A fault of the program, not of the request; still no traceback in a user's terminal.
        kind = type(error).__name__
        print(f"lithoform: unexpected fault ({kind}: {one_line(error)}); --debug shows where.", file=sys.stderr)
        status = 2

    sys.exit(status or 0)


def _require_size_in_one_word(arguments: list[str]) -> None:
    """Refuse `--size 20 15 10` and `--size -20,15,10`, of which the second word and the minus mean something else."""
    for word, value, after in zip(arguments, arguments[1:], [*arguments[2:], ""], strict=False):
        is_split = value.count(",") != 2 and re.match(r"[-+.,]?[0-9]", after)
        if word == "--size" and (is_split or re.match(r"-[.0-9]", value)):
            got = f"{value} {after}" if is_split else value
            raise RecipeError(f"expected --size L,W,H, three lengths above 0 such as 20,15,10; got {got}.")


def _repeat_set(arguments: list[str]) -> list[str]:
    """Let one --set take several NAME=VALUE: each further one gets a --set of its own."""
    out: list[str] = []
    in_set = False
    for word in arguments:
        if in_set and out[-1] != "--set" and "=" in word and not word.startswith("-"):
            out.append("--set")
        elif word == "--set":
            in_set = True
        elif in_set and out[-1] != "--set":
            in_set = False
        out.append(word)
    return out
