"""`buffon render` as a function."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _program

_Value = bool | int | float | str | os.PathLike[str]

#: The value of an option: `True` for a flag, `None` and `False` for an option that is not given, a sequence for a
#: list, a mapping for `define`.
Option = _Value | Sequence[_Value] | Mapping[str, _Value] | None

#: The options of which each value is an argument of its own. Other lists are joined by these texts, else by commas.
_REPEATED = ("output", "outfile", "search_path")
_JOINED = {"size": "x"}

#: The options that `render` cannot pass on, with the reason.
_REFUSED = {
    "stats": "the result has them",
    "frames": "a call renders one image; set the frame with define={\"frame\": 1}",
    "no_image": "the result is the image",
    "skip_existing": "the result is the image",
    "help": "run the program for it",
    "version": "run the program for it",
}


@dataclass(frozen=True)
class Render:
    """A rendered image."""

    #: All channels: height x width x channels, float32, rows from the top, linear.
    data: npt.NDArray[np.float32]
    #: The names of the channels of `data`: the picture's, such as R, G and B, then the layers', such as albedo.R.
    channels: tuple[str, ...]
    #: The statistics of `buffon render --stats`.
    stats: dict[str, Any]
    #: What the program said: notes, warnings, and a line of figures.
    messages: str

    @property
    def image(self) -> npt.NDArray[np.float32]:
        """The picture: height x width x 3 for RGB; 1 channel more with alpha, 1 for luminance. A view of `data`."""
        return self.data[..., : sum("." not in name for name in self.channels)]

    @property
    def layers(self) -> dict[str, npt.NDArray[np.float32]]:
        """The layers by their names: height x width x channels each. Views of `data`."""
        bounds: dict[str, tuple[int, int]] = {}
        for i, name in enumerate(self.channels):
            layer, dot, _ = name.rpartition(".")
            if dot:
                first, _ = bounds.setdefault(layer, (i, i))
                bounds[layer] = (first, i + 1)
        return {layer: self.data[..., first:end] for layer, (first, end) in bounds.items()}


def render(scene: str | os.PathLike[str], **options: Option) -> Render:
    """Renders a scene.

    Args:
        scene: The path of a scene, or the text of a Mitsuba XML scene. Text begins with "<", and its files are searched
            in the current directory.
        options: The options of `buffon render` by their long names, with "_" for "-": `spp=64`, `target_error=0.01`,
            `adaptive="never"`, `path_guiding=True`, `aov=["albedo", "N"]`, `size=(800, 600)`,
            `define={"max_depth": 6}`. `output="a.exr"` writes files, too.

    Raises:
        Error: if the program refuses the scene or an option, or fails. `code` is its exit code.
        TypeError: if an option has no place here, or a value of a type that none has.
    """
    arguments = [argument for name, value in options.items() for argument in _arguments(name, value)]
    with tempfile.TemporaryDirectory(prefix="buffon-") as name:
        folder = Path(name)
        array, stats = folder / "image.npy", folder / "stats.json"
        path = os.fspath(scene)
        if path.lstrip("\ufeff \t\r\n").startswith("<"):
            text, path = path, os.fspath(folder / "scene.xml")
            Path(path).write_text(text, encoding="utf-8")
            arguments.append(f"--search-path={os.getcwd()}")
        outputs = [f"--output={array}", f"--stats={stats}", "--progress=none"]
        try:
            messages = _program.run(["render", *outputs, *arguments, "--", path])
        except _program.Error as error:
            raise _program.Error(_without(folder, str(error)), error.code) from None
        figures: dict[str, Any] = json.loads(stats.read_text(encoding="utf-8"))
        data: npt.NDArray[np.float32] = np.load(array, allow_pickle=False)
    return Render(data, tuple(figures["channels"]), figures, _without(folder, messages))


def _without(folder: Path, text: str) -> str:
    """Returns a text with the names of the files in a temporary folder that is gone, without the folder."""
    return text.replace(f"{folder}{os.sep}", "")


def _arguments(name: str, value: Option) -> list[str]:
    """Returns the arguments of an option."""
    if name in _REFUSED:
        raise TypeError(f"{name}: {_REFUSED[name]}")
    if value is None or value is False:
        return []
    if name == "define":
        if not isinstance(value, Mapping):
            raise TypeError(f"define: expected a mapping of names to values, found {value!r}")
        return [argument for key, one in value.items() for argument in ("-D", f"{key}={_text('define', one)}")]
    option = "--" + name.replace("_", "-")
    if value is True:
        return [option]
    if isinstance(value, Mapping):
        raise TypeError(f"{name}: expected a value or a list, found {value!r}")
    if isinstance(value, Sequence) and not isinstance(value, str):
        texts = [_text(name, one) for one in value]
        if name in _REPEATED:
            return [f"{option}={text}" for text in texts]
        return [f"{option}={_JOINED.get(name, ',').join(texts)}"] if texts else []
    return [f"{option}={_text(name, value)}"]


def _text(name: str, value: object) -> str:
    """Returns a value as the command line has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, np.generic):
        return _text(name, value.item())
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (str, os.PathLike)):
        return str(os.fspath(value))
    raise TypeError(f"{name}: expected a number, a text or a path, found {value!r}")
