"""Runs the program: `python -m buffon render scene.xml`."""

from __future__ import annotations

import os
import sys

from ._program import Error, executable

try:
    program = executable()
except Error as error:
    sys.exit(f"buffon: {error}")
os.execv(program, [program, *sys.argv[1:]])
