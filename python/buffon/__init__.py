"""Renders scenes with Buffon, and returns NumPy arrays.

    import buffon

    result = buffon.render("scene.xml", spp=64, aov=["albedo", "N"])
    result.image             # height x width x 3, float32, linear
    result.layers["albedo"]  # height x width x 3
    result.stats["relmse_estimate"]

Each call runs the program `buffon` once, and each option of `buffon render` is a keyword.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as _version

from ._program import Error, executable
from ._render import Option, Render, render

try:
    __version__ = _version("buffon")
except PackageNotFoundError:  # the sources, without an installation
    __version__ = "0"

__all__ = ["Error", "Option", "Render", "__version__", "executable", "render"]
