"""Scenes, arrays and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest


def test_arrays_are_views_that_cannot_be_written(scene_2d: gs.Scene2d) -> None:
    first, second = scene_2d.means, scene_2d.means
    assert first.ctypes.data == second.ctypes.data
    assert not first.flags.owndata
    with pytest.raises(ValueError):
        first[0, 0] = 1.0
    with pytest.raises(ValueError):
        first.flags.writeable = True


def test_views_outlive_their_scene() -> None:
    means = np.array([[1.0, 2.0]], dtype=np.float32)
    one = np.zeros((1, 2), dtype=np.float32)
    scene = gs.Scene2d(means, one, np.zeros(1, np.float32), np.ones((1, 3), np.float32))
    view = scene.means
    del scene
    means[:] = 7.0
    assert view.tolist() == [[1.0, 2.0]]


def test_shapes(scene_3d: gs.Scene3d) -> None:
    assert scene_3d.means.shape == (10, 3)
    assert scene_3d.rotations.shape == (10, 4)
    assert scene_3d.sh.shape == (10, 4, 3)
    assert (len(scene_3d), scene_3d.sh_degree) == (10, 1)


def arrays_2d() -> dict[str, np.ndarray]:
    return {
        "means": np.ones((3, 2), np.float32),
        "log_scales": np.ones((3, 2), np.float32),
        "rotations": np.ones(3, np.float32),
        "colors": np.ones((3, 3), np.float32),
    }


@pytest.mark.parametrize(
    ("argument", "wrong", "error", "says"),
    [
        ("means", np.ones((3, 2)), TypeError, "float64"),
        ("means", [[1.0, 2.0]], TypeError, "list"),
        ("means", np.ones((3, 3), np.float32), ValueError, "(N, 2)"),
        ("log_scales", np.ones((4, 2), np.float32), ValueError, "(3, 2)"),
        ("rotations", np.ones((3, 1), np.float32), ValueError, "(3,)"),
        ("colors", np.ones((3, 6), np.float32)[:, ::2], ValueError, "ascontiguousarray"),
        ("colors", np.ones((3, 3), np.float32, order="F"), ValueError, "ascontiguousarray"),
        (
            "means",
            np.frombuffer(b"\0" * 25, np.uint8)[1:].view(np.float32).reshape(3, 2),
            ValueError,
            "aligned",
        ),
        ("colors", np.full((3, 3), np.nan, np.float32), ValueError, "colors[0, 0] is NaN"),
    ],
)
def test_wrong_arrays(argument: str, wrong: object, error: type[Exception], says: str) -> None:
    arrays: dict[str, object] = {**arrays_2d(), argument: wrong}
    with pytest.raises(error) as raised:
        gs.Scene2d(**arrays)  # type: ignore[arg-type]
    assert argument in str(raised.value)
    assert says in str(raised.value)


def test_a_wrong_number_of_coefficients() -> None:
    ones = np.ones((2, 3), np.float32)
    with pytest.raises(ValueError, match="sh: expected 1, 4, 9 or 16 coefficients, not 5"):
        gs.Scene3d(
            ones,
            ones,
            np.ones((2, 4), np.float32),
            np.ones(2, np.float32),
            np.ones((2, 5, 3), np.float32),
        )


def test_2d_files(scene_2d: gs.Scene2d, tmp_path: Path) -> None:
    file = tmp_path / "scene.gs2d.safetensors"
    with pytest.raises(ValueError, match="size"):
        scene_2d.save(file)
    with pytest.raises(ValueError, match="scene.ply: cannot write a 2D scene"):
        scene_2d.save(tmp_path / "scene.ply", size=(32, 32))
    scene_2d.save(file, size=(32, 32))
    loaded = gs.load(file)
    assert isinstance(loaded, gs.Scene2d)
    assert loaded.size == (32, 32)
    assert np.array_equal(loaded.means, scene_2d.means)
    assert np.array_equal(gs.render(loaded), gs.render(scene_2d, size=(32, 32)))


@pytest.mark.parametrize(
    "name",
    ["scene.ply", "scene.spz", "scene.glb", "scene.splat", "scene.sog", "scene.rad", "meta.json"],
)
def test_3d_files(scene_3d: gs.Scene3d, tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    scene_3d.save(file)
    loaded = gs.load(file)
    assert isinstance(loaded, gs.Scene3d)
    assert len(loaded) == len(scene_3d)


@pytest.fixture
def city(tmp_path: Path) -> Path:
    """A streamed SOG with a single cell around z = 5, with seven levels of 256 to 4 Gaussians."""
    rng = np.random.default_rng(3)
    n = 256
    scene = gs.Scene3d(
        (rng.uniform(-1, 1, (n, 3)) + [0, 0, 5]).astype(np.float32),
        np.full((n, 3), -3, np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        np.full(n, 1, np.float32),
        rng.uniform(-0.5, 1, (n, 1, 3)).astype(np.float32),
    )
    file = tmp_path / "city" / "lod-meta.json"
    scene.save(file)
    return file


def test_levels_of_detail(city: Path) -> None:
    near = gs.Camera(640, 480, fx=600.0)
    away = near.looking_at([0, 0, 0], [0, 0, -1])
    far = near.looking_at([0, 0, -995], [0, 0, 5])
    assert len(gs.load(city)) == 256
    for path in [city, city.parent]:
        assert len(gs.load(path, cameras=[near])) == 256
    for cameras in [[], [away]]:
        assert len(gs.load(city, cameras=cameras)) == 4
    assert len(gs.load(city, cameras=[far])) < 256
    assert len(gs.load(city, cameras=(far, near))) == 256
    counts = [len(gs.load(city, cameras=[near], max_gaussians=most)) for most in [4, 100, 256]]
    assert counts == [4, 64, 256]
    exact = gs.render(gs.load(city), near)
    assert np.array_equal(gs.render(gs.load(city, cameras=[near]), near), exact)
    with pytest.warns(UserWarning, match="the coarsest levels have 4 Gaussians"):
        assert len(gs.load(city, cameras=[near], max_gaussians=3)) == 4


def test_levels_of_detail_of_a_rad(city: Path) -> None:
    file = city.parent / "city.rad"
    gs.load(city).save(file)
    near = gs.Camera(640, 480, fx=600.0)
    assert len(gs.load(file, cameras=[near])) == 256
    assert len(gs.load(file, cameras=[])) == 4
    assert 4 < len(gs.load(file, cameras=[near], max_gaussians=100)) <= 100


def test_levels_of_detail_are_refused(city: Path, scene_3d: gs.Scene3d, camera: gs.Camera) -> None:
    with pytest.raises(ValueError, match="max_gaussians: needs cameras"):
        gs.load(city, max_gaussians=10)
    with pytest.raises(ValueError, match="max_gaussians: at least 1"):
        gs.load(city, cameras=[camera], max_gaussians=0)
    for wrong in [camera, 3, [camera, None]]:
        with pytest.raises(TypeError, match="cameras: expected a sequence of Camera"):
            gs.load(city, cameras=wrong)  # type: ignore[arg-type]
    file = city.parent / "scene.ply"
    scene_3d.save(file)
    with pytest.raises(ValueError, match=r"cameras: .*scene.ply has no levels of detail"):
        gs.load(file, cameras=[camera])
    with pytest.raises(OSError, match="nothing.ply"):
        gs.load("nothing.ply", cameras=[camera])
    city.write_text("{}")
    with pytest.raises(OSError, match=r"lod-meta.json"):
        gs.load(city, cameras=[camera])


def test_edited_scenes(scene_3d: gs.Scene3d, tmp_path: Path) -> None:
    scene_3d.save(tmp_path / "scene.ply")
    edited = scene_3d.edited("scale=2", "move=0,0,1", f"add={tmp_path / 'scene.ply'}")
    np.testing.assert_allclose(
        edited.means[: len(scene_3d)], 2 * scene_3d.means + [0, 0, 1], rtol=1e-6
    )
    np.testing.assert_array_equal(edited.means[len(scene_3d) :], scene_3d.means)
    below = float(np.median(scene_3d.means[:, 1]))
    assert (scene_3d.edited(f"keep=y<={below}").means[:, 1] <= below).all()
    with pytest.raises(ValueError, match="shrink=2: an operation is move="):
        scene_3d.edited("shrink=2")
    with pytest.raises(ValueError, match="nothing would be left"):
        scene_3d.edited("drop=opacity>=0")
    with pytest.raises(OSError, match="nothing.ply"):
        scene_3d.edited("add=nothing.ply")


def test_files_that_are_not_there_or_not_scenes(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nothing.ply"):
        gs.load(tmp_path / "nothing.ply")
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n")
    with pytest.raises(OSError, match="broken.ply"):
        gs.load(broken)
    with pytest.raises(OSError):
        gs.read_image(broken)


def test_images(tmp_path: Path, image: np.ndarray) -> None:
    file = tmp_path / "image.png"
    gs.write_png(file, image)
    read = gs.read_image(file)
    assert np.abs(read - image).max() < 1 / 255
    as_bytes = (read * 255).round().astype(np.uint8)
    gs.write_png(file, as_bytes)
    assert np.array_equal(gs.read_image(file), read)
    assert gs.compare(read, read)["psnr"] == float("inf")
    with pytest.raises(ValueError, match=r"image: expected shape \(H, W, 3\)"):
        gs.compare(np.zeros((4, 4), np.float32), read)


def test_a_2d_scene_has_no_camera_and_a_3d_scene_needs_one(
    scene_2d: gs.Scene2d, scene_3d: gs.Scene3d, camera: gs.Camera
) -> None:
    with pytest.raises(ValueError, match="camera"):
        gs.render(scene_3d)
    with pytest.raises(ValueError, match="camera"):
        gs.render(scene_2d, camera, size=(8, 8))
    with pytest.raises(TypeError, match="scene: expected Scene2d or Scene3d, not int"):
        gs.render(3)  # type: ignore[arg-type]
    assert gs.render(scene_3d, camera).shape == (24, 32, 3)
    assert gs.render(scene_3d, camera, size=(64, 48)).shape == (48, 64, 3)


def test_a_3d_scene_is_rendered_with_alpha(
    scene_2d: gs.Scene2d, scene_3d: gs.Scene3d, camera: gs.Camera
) -> None:
    image = gs.render(scene_3d, camera, alpha=True)
    colors, alpha = image[..., :3], image[..., 3:]
    exact = gs.render(
        scene_3d, camera, settings={"output": "alpha", "effects": {"background": "none"}}
    )
    assert image.shape == (24, 32, 4) and alpha.max() > 0.5 and alpha.min() < 0.1
    assert np.abs(alpha - exact).max() <= 0.5 / 255 + 1e-6
    for value in (0.0, 1.0):
        behind = gs.render(scene_3d, camera, settings={"background": [value] * 3})
        composite = (colors * alpha + value * (1 - alpha)).clip(0, 1)
        assert np.abs(composite - behind.clip(0, 1)).max() < 1 / 255
    with pytest.raises(ValueError, match="alpha: only renderings of 3D scenes"):
        gs.render(scene_2d, size=(8, 8), alpha=True)


def test_cameras() -> None:
    camera = gs.Camera(32, 24, fx=30.0).looking_at([0, 0, -5], [0, 0, 0])
    assert np.allclose(camera.position, [0, 0, -5], atol=1e-6)
    with pytest.raises(ValueError, match="target"):
        camera.looking_at([1, 1, 1], [1, 1, 1])
    with pytest.raises(ValueError):
        gs.Camera(0, 24, fx=30.0)


def test_settings_refuse_unknown_keys(scene_2d: gs.Scene2d) -> None:
    with pytest.raises(ValueError, match="settings: .*`efects`.*effects"):
        gs.render(scene_2d, size=(8, 8), settings={"efects": {}})
    with pytest.raises(ValueError):
        gs.render(scene_2d, size=(8, 8), settings={"background": float("nan")})


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"rotation": np.zeros(3)}, ValueError, r"rotation: expected shape \(3, 3\), not \[3\]"),
        ({"rotation": "none"}, TypeError, r"rotation: expected numbers of shape \(3, 3\), not str"),
        ({"translation": [1, 2]}, ValueError, r"translation: expected shape \(3,\), not \[2\]"),
    ],
)
def test_wrong_poses(arguments: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        gs.Camera(32, 24, fx=30.0, **arguments)


def test_a_rotation_in_fortrans_order() -> None:
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    cameras = [
        gs.Camera(32, 24, fx=30.0, rotation=rotation, translation=[1.0, 2.0, 3.0])
        for rotation in [turned, np.asfortranarray(turned), turned.tolist()]
    ]
    # The position is -rotation.T @ translation.
    assert all(camera.position == [-2.0, 1.0, -3.0] for camera in cameras)
