"""The program that the package runs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from collections.abc import Sequence


class Error(Exception):
    """A run of the program that failed. The text is the program's sentence."""

    #: The exit code, as docs/exit-codes.md lists them; -n if signal n killed the program.
    code: int

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code

    def __reduce__(self) -> tuple[type[Error], tuple[str, int]]:
        return Error, (str(self), self.code)


def executable() -> str:
    """Returns the path of the program.

    It is the one that the environment variable `BUFFON` names, else the one that was installed with this package, else
    the first in `PATH`.

    Raises:
        Error: if there is none.
    """
    named = os.environ.get("BUFFON")
    if named:
        found = shutil.which(named)
        if found is None:
            raise Error(f"the environment variable BUFFON names no program: {named}", 127)
        return found
    schemes = ["", f"{os.name}_user"]
    for scheme in schemes:
        if scheme and scheme not in sysconfig.get_scheme_names():
            continue
        folder = sysconfig.get_path("scripts", scheme) if scheme else sysconfig.get_path("scripts")
        found = shutil.which("buffon", path=folder)
        if found is not None:
            return found
    # `pip install --target FOLDER` puts programs into FOLDER/bin, beside the package.
    beside = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "bin")
    found = shutil.which("buffon", path=beside) or shutil.which("buffon")
    if found is None:
        raise Error("there is no program \"buffon\"; install the package again, or set BUFFON to its path", 127)
    return found


def run(arguments: Sequence[str]) -> str:
    """Runs the program and returns what it says on standard error.

    Raises:
        Error: if it cannot be started, fails, or is stopped by a signal.
    """
    program = executable()
    try:
        finished = subprocess.run(
            [program, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
    except OSError as error:
        raise Error(f"{program} cannot be started: {error.strerror}", 126) from error
    if finished.returncode != 0:
        raise Error(_sentence(finished.stderr, finished.returncode), finished.returncode)
    return finished.stderr


def _sentence(stderr: str, code: int) -> str:
    """Returns what the program says of a failure, without its notes and warnings."""
    if code < 0:
        return f"the program was killed by signal {-code}"
    notes = ("buffon: note: ", "buffon: warning: ")
    lines = [line for line in stderr.strip().splitlines() if not line.startswith(notes)]
    text = "\n".join(lines).strip()
    for start in ("buffon: ", "error: "):
        text = text.removeprefix(start)
    return text or f"the program ended with the exit code {code}"
