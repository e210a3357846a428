"""The command line: `comwalk walk`, `dance`, `pattern`, `figures` and so on.

This module only finds the command and turns errors into one line; what the commands
do, and all that takes time to import, is in `commands` and the modules named like it.
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import metadata

from cyclopts import App, CycloptsError, UnusedCliTokensError

from ..errors import ComwalkError, printable
from ..views import choose_backend

COMPLETED, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: it worked; the robot fell or a check failed; the input is wrong; the user
stopped it."""

_COMMANDS = {
    "walk": {
        "walk": "Walk in physics: with no arguments the paper's gait, 20 steps.",
        "check": "Tell whether a robot is able to walk so, and what is "
        "nearest to a limit.",
        "dance": "Dance with both feet on the ground (Fig. 6).",
        "pattern": "Print the numbers of the walking pattern, Eqs. (4)-(13), Fig. 3.",
        "figures": "Draw the paper's Figs. 3, 5, 6 and 7, its figures beside ours.",
        "motions": "List the built-in dances, or describe a motion file.",
        "robots": "List the robots that are known by name.",
        "replay": "Summarise a run, or verify it with MuJoCo alone.",
    },
    "robot": {
        "robot": "Tell what was found out about a robot: limbs, soles, servos, gait.",
    },
    "certify": {
        "certify": "Tell what the gains of a robot guarantee, before it moves.",
    },
    "identify": {
        "identify": "Shake the standing robot; tell lag, dead time, compliance "
        "and noise.",
    },
    "runs": {
        "log": "Tell what the log of a run holds, and repair one that was cut off.",
        "export": "Write the log of a run as CSV, Parquet, or for rosbag2.",
        "report": "Write a run, or two side by side, as one page that works offline.",
        "film": "Film a run, or take stills of it, without a window.",
    },
    "view": {
        "view": "Look at a run in the browser: scrub through it, with CoM "
        "and ZMP beside.",
    },
    "generate": {
        "generate": "Write random gaits or dances of a robot as a dataset.",
    },
    "bench": {
        "bench": "Try robots on walks, dances, floors, pushes and loads.",
    },
}
"""What each command does, by the module that it is imported from when it is called."""
_PAIRS = re.compile(r"--gains\.[\w-]+|--disturbance")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Words after the name of the program; those of the process if None.

    Returns:
        The exit code: 0 completed, 1 not, 2 bad input, 130 interrupted.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # saves, as Ctrl-C
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may be any bytes
        sys.stdout.reconfigure(errors="backslashreplace")
    choose_backend()  # a wrong MUJOCO_GL would make the import of MuJoCo fail
    try:
        code = _app()(
            _joined_pairs(words),
            exit_on_error=False,
            print_error=False,
            result_action="return_value",
        )
        sys.stdout.flush()
        return code if isinstance(code, int) else COMPLETED
    except UnusedCliTokensError as error:
        return _refuse(f'unexpected "{(error.unused_tokens or [""])[0]}"; see --help')
    except (ComwalkError, CycloptsError) as error:
        return _refuse(str(error))
    except UnicodeEncodeError as error:
        part = ascii(error.object[max(0, error.start - 40) : error.end])
        return _refuse(f"{part} is not UTF-8; give files and folders another name")
    except MemoryError:
        return _refuse("not enough memory; take fewer steps, or a longer period")
    except KeyboardInterrupt:
        return _stopped()
    except ImportError as error:
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        return _stopped()  # a compiled module was being imported
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        return _refuse(f"{error.filename or 'the output'}: {error.strerror}")


def _app() -> App:
    """Return the application; its commands are imported when they are called."""
    app = App(
        name="comwalk",
        help="Humanoid walking by the CoM Jacobian with embedded motion.",
        help_format="plaintext",
        version=lambda: metadata.version("comwalk"),
        suppress_keyboard_interrupt=False,
    )
    for module, commands in _COMMANDS.items():
        for name, text in commands.items():
            app.command(f"{__package__}.{module}:{name}", name=name, help=text)
    return app


def _stopped() -> int:
    """Say that the user stopped the program."""
    _say("interrupted")
    return INTERRUPTED


def _refuse(message: str) -> int:
    """Print an input error on one line."""
    _say(message)
    return BAD_INPUT


def _say(message: str) -> None:
    """Write one line to stderr."""
    print(f"comwalk: {printable(' '.join(message.split()))}", file=sys.stderr)


def _joined_pairs(words: list[str]) -> list[str]:
    """Return words in which the two numbers of a pair are one, as in "3,1.8"."""
    joined: list[str] = []
    for word in words:
        if len(joined) > 1 and _PAIRS.fullmatch(joined[-2]):
            if _is_number(joined[-1].rpartition(",")[2]) and _is_number(word):
                joined[-1] += f",{word}"
                continue
        joined.append(word)
    return joined


def _is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True
