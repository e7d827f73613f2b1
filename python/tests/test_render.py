"""The package against the program that was installed with it."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import buffon
import numpy as np
import pytest

SCENE = """<scene version="3.0.0">
  <default name="radiance" value="0.5"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <film type="hdrfilm"><integer name="width" value="20"/><integer name="height" value="10"/></film>
  </sensor>
  <shape type="sphere">
    <point name="center" value="0,0,4"/><bsdf type="diffuse"><rgb name="reflectance" value="0.2,0.4,0.6"/></bsdf>
  </shape>
  <emitter type="constant"><rgb name="radiance" value="$radiance"/></emitter>
</scene>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "s.xml"
    path.write_text(SCENE)
    return path


def test_a_picture_is_an_array_with_its_statistics(scene: Path) -> None:
    result = buffon.render(scene, spp=4)
    assert result.image.shape == (10, 20, 3) and result.image.dtype == np.float32
    assert result.channels == ("R", "G", "B") and result.layers == {}
    assert result.stats["spp"] == 4 and (result.stats["width"], result.stats["height"]) == (20, 10)
    np.testing.assert_allclose(result.image[0, 0], 0.5, rtol=1e-6)
    assert "image.npy: 20x10, 4 samples per pixel" in result.messages


def test_layers_have_names(scene: Path) -> None:
    result = buffon.render(scene, spp=4, aov=["albedo", "samples"])
    assert list(result.layers) == ["albedo", "samples"]
    assert result.image.shape == (10, 20, 3)
    np.testing.assert_allclose(result.layers["albedo"][5, 10], [0.2, 0.4, 0.6], rtol=1e-6)
    assert result.layers["samples"].shape == (10, 20, 1)
    assert np.all(result.layers["samples"] == 4)
    assert np.shares_memory(result.image, result.data)


def test_the_scene_may_be_text_or_a_path_in_either_form(scene: Path) -> None:
    whole = buffon.render(scene, spp=4).data
    for other in (SCENE, str(scene), "\n" + SCENE):
        np.testing.assert_array_equal(buffon.render(other, spp=4).data, whole)


def test_files_of_a_scene_in_text_are_beside_the_caller(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = buffon.render(scene, spp=1, size=(8, 8), output=[tmp_path / "sky.exr", tmp_path / "sky.pfm"])
    assert result.image.shape == (8, 8, 3)
    monkeypatch.chdir(tmp_path)
    sky = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    before, _, _ = SCENE.partition('<emitter type="constant">')
    assert buffon.render(before + sky + "</scene>", spp=1).image.max() > 0


def test_options_are_those_of_the_program(scene: Path) -> None:
    options: dict[str, buffon.Option] = {
        "define": {"radiance": 2.0},
        "spp": 2,
        "adaptive": "never",
        "size": (16, 12),
        "crop": (0, 0, 6, 5),
        "path_guiding": False,
        "quiet": True,
        "target_error": None,
        "seed": 3,
    }
    result = buffon.render(scene, **options)
    assert result.image.shape == (5, 6, 3) and result.stats["seed"] == 3 and result.messages == ""
    np.testing.assert_allclose(result.image[0, 0], 2.0, rtol=1e-6)
    assert buffon.render(scene, spp=32, adaptive=True).stats["adaptive"] is True
    error = buffon.render(scene, target_error=0.5).stats["stop_reason"]
    assert "error" in error


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        ({"integrator": "pth"}, 2, '--integrator: there is no integrator "pth" (did you mean "path"?)'),
        ({"no_such_option": 1}, 2, "unexpected argument '--no-such-option'"),
        ({"spp": "many"}, 2, "invalid value 'many' for '--spp <N>'"),
        ({"define": {"nothing": 1}, "strict": True}, 5, "nothing"),
        ({"output": "a.tiff"}, 2, "a.tiff: expected the extension .exr, .png, .jpg, .jpeg, .pfm or .npy, found .tiff"),
    ],
)
def test_a_failure_has_the_program_s_sentence_and_code(
    scene: Path, options: dict[str, Any], code: int, sentence: str
) -> None:
    with pytest.raises(buffon.Error) as caught:
        buffon.render(scene, **options)
    assert caught.value.code == code and sentence in str(caught.value)
    assert not str(caught.value).startswith(("buffon: ", "error: "))
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (copy.code, str(copy)) == (code, str(caught.value))


def test_scenes_that_are_wrong_or_missing() -> None:
    with pytest.raises(buffon.Error, match=r"^none\.xml: cannot be read: no such file or directory$") as missing:
        buffon.render("none.xml")
    assert missing.value.code == 3
    with pytest.raises(buffon.Error, match=r"^scene\.xml:1:\d+") as wrong:
        buffon.render("<scene version='3.0.0'><shape type='teapot'/></scene>")
    assert wrong.value.code == 3


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"stats": "s.json"}, "stats: the result has them"),
        ({"frames": "1..3"}, 'frames: a call renders one image; set the frame with define={"frame": 1}'),
        ({"define": ["x=1"]}, "define: expected a mapping of names to values, found ['x=1']"),
        ({"aov": {"albedo": 1}}, "aov: expected a value or a list, found {'albedo': 1}"),
        ({"seed": object}, "seed: expected a number, a text or a path, found <class 'object'>"),
    ],
)
def test_options_without_a_place_are_type_errors(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(TypeError) as caught:
        buffon.render(SCENE, **options)
    assert str(caught.value) == sentence


def test_the_program_can_be_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Path(buffon.executable()).name.startswith("buffon")
    monkeypatch.setenv("BUFFON", "/no/such/program")
    with pytest.raises(buffon.Error, match="BUFFON names no program: /no/such/program"):
        buffon.render(SCENE)
    monkeypatch.setenv("BUFFON", "false")
    with pytest.raises(buffon.Error, match="^the program ended with the exit code 1$"):
        buffon.render(SCENE)


def test_the_package_runs_the_program() -> None:
    run = subprocess.run([sys.executable, "-m", "buffon", "--version"], capture_output=True, text=True, check=True)
    assert run.stdout.startswith(f"buffon {buffon.__version__}")
