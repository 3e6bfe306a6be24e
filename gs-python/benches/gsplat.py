"""What gsplat, a CUDA library, takes for what the engine does too: frames, steps, training.

Run it with a Python that has gsplat 1.5.3, PyTorch and Pillow, on a machine with an NVIDIA GPU:

    python gs-python/benches/gsplat.py build
    python gs-python/benches/gsplat.py make SCENE.ply 1000000 1920 1080 1403.23
    python gs-python/benches/gsplat.py step SCENE.ply 1920 1080 1403.23
    python gs-python/benches/gsplat.py train DATA OUT

`make` draws a scene like `garden` of the engine's own benchmarks. `train` does what gsplat's
example `simple_trainer.py` does by default, but has all images on the GPU from the start.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import json
import os
import struct
import sys
import time
from functools import cache, partial
from pathlib import Path
from typing import Any, Callable, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

DEVICE = "cuda"
RATES = {"means": 1.6e-4, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2}
RATES |= {"sh0": 2.5e-3, "shN": 2.5e-3 / 20}
NAMES = ["x", "y", "z", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(45))]
NAMES += ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
LENSES = {0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4)}
SH0 = 0.28209479177387814


def library() -> Any:
    """gsplat with its CUDA extension, which is built unless there is a finished build.

    A finished build in the folder TORCH_EXTENSIONS_DIR is loaded as it is: gsplat would ask ninja,
    which builds again where files of the library are newer than the build.
    """
    here = Path(__file__).resolve().parent
    sys.path = [folder for folder in sys.path if Path(folder).resolve() != here]  # it has our name
    os.environ.setdefault("TORCH_CUDA_ARCH_LIST", "9.0")
    os.environ.setdefault("MAX_JOBS", "16")
    torch.backends.cudnn.allow_tf32 = False  # the SSIM takes differences of its convolutions
    import gsplat

    file = Path(os.environ.get("TORCH_EXTENSIONS_DIR", "")) / "gsplat_cuda/gsplat_cuda.so"
    if file.is_file():
        spec = importlib.util.spec_from_file_location("gsplat_cuda", file)
        gsplat.csrc = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(gsplat.csrc)
    from gsplat.cuda._backend import _C

    assert _C is not None, "gsplat found no CUDA compiler"
    print(f"gsplat {gsplat.__version__} from {_C.__file__}, PyTorch {torch.__version__}", end=", ")
    print(torch.cuda.get_device_name() if torch.cuda.is_available() else "no GPU")
    return gsplat


def build() -> None:
    """Says how long the build, or the load of a finished one, takes."""
    started = time.perf_counter()
    library()
    print(f"{time.perf_counter() - started:.1f} s")


def make(file: Path, count: int, width: int, height: int, focal: float) -> None:
    """Writes a random scene like a trained one: the distributions of the engine's `garden`."""
    rng = np.random.default_rng(20_261_121)
    depth = 1.5 * np.exp(2.5 * rng.random(count))
    place = (1.2 * rng.random((count, 2)) - 0.1) * [width, height] - [0.5 * width, 0.5 * height]
    log_px = np.log(2 * np.exp(0.6 * rng.standard_normal(count)) * depth / focal)
    thinner = np.stack([np.zeros(count), rng.random(count), 1 + 2 * rng.random(count)], 1)
    opaque = rng.random(count) < 0.5
    opacity = np.where(opaque, 0.7 + 0.29 * rng.random(count), 0.02 + 0.5 * rng.random(count))
    sh = rng.standard_normal((count, 16, 3), dtype=np.float32)
    sh *= np.float32([1] + 15 * [0.1])[:, None] / np.linalg.norm(sh, axis=2, keepdims=True)
    rows = np.empty((count, len(NAMES)), "<f4")
    rows[:, :3] = np.column_stack([place / focal, np.ones(count)]) * depth[:, None]
    rows[:, 3:6] = sh[:, 0]
    rows[:, 6:51] = sh[:, 1:].transpose(0, 2, 1).reshape(count, 45)
    rows[:, 51] = np.log(opacity / (1 - opacity))
    rows[:, 52:55] = log_px[:, None] - thinner
    rows[:, 55:] = rng.standard_normal((count, 4))
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    header += "".join(f"property float {name}\n" for name in NAMES) + "end_header\n"
    file.write_bytes(header.encode() + rows.tobytes())


def read_ply(file: Path) -> dict[str, np.ndarray]:
    """The parameters of a scene of SH degree 3, as gsplat's example names and shapes them."""
    header, data = file.read_bytes().split(b"end_header\n", 1)
    lines = [line.split() for line in header.decode().splitlines()]
    count = next(int(line[2]) for line in lines if line[:2] == ["element", "vertex"])
    names = [line[2] for line in lines if line[:2] == ["property", "float"]]
    rows = np.frombuffer(data, "<f4", count * len(names)).reshape(count, len(names))
    rows = rows[:, [names.index(name) for name in NAMES]]
    rest = rows[:, 6:51].reshape(count, 3, 15).transpose(0, 2, 1)
    return {
        "means": rows[:, :3],
        "scales": rows[:, 52:55],
        "quats": rows[:, 55:],
        "opacities": rows[:, 51],
        "sh0": rows[:, None, 3:6],
        "shN": rest,
    }


def tensor(values: Any) -> Tensor:
    """Numbers as floats on the GPU."""
    return torch.tensor(values, dtype=torch.float32, device=DEVICE)


def parameters(values: dict[str, Any]) -> torch.nn.ParameterDict:
    """Trainable copies on the GPU."""
    copies = {k: torch.as_tensor(v).to(DEVICE, copy=True).contiguous() for k, v in values.items()}
    return torch.nn.ParameterDict({k: torch.nn.Parameter(v) for k, v in copies.items()})


def adam(
    splats: torch.nn.ParameterDict, rates: dict[str, float], fused: bool
) -> dict[str, torch.optim.Optimizer]:
    """One optimizer for each parameter, as gsplat's density control needs them."""
    kind = {"fused": True} if fused else {}  # PyTorch's default is not `fused=False`
    return {k: torch.optim.Adam([splats[k]], lr=rates[k], eps=1e-15, **kind) for k in splats}


def activated(splats: torch.nn.ParameterDict) -> dict[str, Tensor]:
    """The Gaussians as `rasterization` takes them."""
    return {
        "means": splats["means"],
        "quats": splats["quats"],
        "scales": torch.exp(splats["scales"]),
        "opacities": torch.sigmoid(splats["opacities"]),
        "colors": torch.cat([splats["sh0"], splats["shN"]], 1),
    }


@cache
def window(dtype: torch.dtype, device: torch.device) -> Tensor:
    """11 weights of a Gaussian of 1.5 px for each of three channels."""
    weights = torch.exp(-((torch.arange(11, dtype=dtype, device=device) - 5) ** 2) / 4.5)
    return (weights / weights.sum()).repeat(3, 1, 1, 1)


def ssim(image: Tensor, truth: Tensor) -> Tensor:
    """Mean SSIM of images [1, height, width, 3] with values of 0 to 1, without the border."""
    a, b = (pixels.permute(0, 3, 1, 2).contiguous() for pixels in (image, truth))
    weights = window(a.dtype, a.device)
    maps = torch.cat([a, b, a * a, b * b, a * b])
    maps = F.conv2d(F.conv2d(maps, weights, groups=3), weights.transpose(2, 3), groups=3)
    a, b, aa, bb, ab = maps.split(1)
    luminance = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
    return (luminance * (2 * (ab - a * b) + 9e-4) / (aa - a * a + bb - b * b + 9e-4)).mean()


def l1_and_ssim(image: Tensor, truth: Tensor) -> Tensor:
    """The usual loss, in plain PyTorch: gsplat's example has one CUDA kernel for the SSIM."""
    return 0.8 * F.l1_loss(image, truth) + 0.2 * (1 - ssim(image, truth))


def timed(name: str, call: Callable[[], object], repetitions: int) -> None:
    """Prints a row: GPU time of calls one after the other, and the most memory in use."""
    gc.collect()
    torch.cuda.reset_peak_memory_stats()
    for _ in range(10):
        call()
    events = [torch.cuda.Event(enable_timing=True) for _ in range(repetitions + 1)]
    events[0].record()
    for event in events[1:]:
        call()
        event.record()
    torch.cuda.synchronize()
    times = [a.elapsed_time(b) for a, b in zip(events, events[1:])]
    low, middle, high = np.quantile(times, [0.1, 0.5, 0.9])
    peak = torch.cuda.max_memory_allocated() / 2**20
    print(f"| {name} | {middle:.3f} | {low:.3f} | {high:.3f} | {peak:.0f} |", flush=True)


def step(file: Path, width: int, height: int, focal: float, repetitions: int) -> None:
    """Times frames and training steps of a scene seen from the origin along +z."""
    rasterization = library().rasterization
    scene = read_ply(file)
    lens = tensor([[[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]])
    view = {"viewmats": tensor(np.eye(4))[None], "Ks": lens, "width": width, "height": height}
    view["sh_degree"] = 3

    def frame(splats: torch.nn.ParameterDict, packed: bool = False) -> Tensor:
        return rasterization(**activated(splats), **view, packed=packed)[0]

    def training(loss: Callable[[Tensor, Tensor], Tensor], fused: bool) -> Callable[[], None]:
        """A step whose rates are 0: the same work, but the scene stays as it is."""
        splats = parameters(scene)
        optimizers = adam(splats, dict.fromkeys(RATES, 0.0), fused)

        def run() -> None:
            loss(frame(splats), target).backward()
            for optimizer in optimizers.values():
                optimizer.step()
                optimizer.zero_grad(set_to_none=True)

        return run

    print(f"{len(scene['means'])} Gaussians, {width}x{height} px, {repetitions} repetitions\n")
    print("| what | median, ms | 10 % | 90 % | peak, MiB |\n| --- | --- | --- | --- | --- |")
    with torch.no_grad():
        for packed in (False, True):
            draw = partial(rasterization, **activated(parameters(scene)), **view, packed=packed)
            timed(f"rasterization alone, packed={packed}", draw, repetitions)
        for packed in (False, True):
            draw = partial(frame, parameters(scene), packed)
            timed(f"frame from the parameters, packed={packed}", draw, repetitions)
        image = draw()
        target = (image + 0.02 * torch.randn_like(image)).clamp(0, 1)
        del draw, image
    for name, loss in (("L1", F.l1_loss), ("L1 and SSIM", l1_and_ssim)):
        for kind, fused in (("fused Adam", True), ("Adam", False)):
            timed(f"step, {name}, {kind}", training(loss, fused), repetitions)


class View(NamedTuple):
    """A photograph, and the arguments of its camera for `rasterization`."""

    name: str
    pixels: Tensor
    camera: dict[str, Any]


def text_rows(file: Path, kind: str) -> list[list[Any]]:
    """The records of a COLMAP file: the words of its lines; of images, those of every second."""
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    return [line.split() for line in (lines[::2] if kind == "images" else lines) if line]


def binary_rows(file: Path, kind: str) -> list[list[Any]]:
    """The same of a binary file."""
    layout = {"cameras": "<iiQQ", "images": "<I7dI", "points3D": "<Q3d3Bd"}[kind]
    data, at, rows = file.read_bytes(), 8, []
    for _ in range(struct.unpack_from("<Q", data)[0]):
        row = list(struct.unpack_from(layout, data, at))
        at += struct.calcsize(layout)
        if kind == "cameras":
            row[1], count = LENSES[row[1]]
            row += struct.unpack_from(f"<{count}d", data, at)
            at += 8 * count
        if kind == "images":
            row.append(data[at : data.index(b"\0", at)].decode())
            at += len(row[9].encode()) + 1
        if kind != "cameras":
            count = struct.unpack_from("<Q", data, at)[0]
            at += 8 + count * (24 if kind == "images" else 8)
        rows.append(row)
    return rows


def colmap(folder: Path) -> list[list[list[Any]]]:
    """Cameras, images and points of a COLMAP model."""
    file = next(f for m in ("sparse/0", "sparse") for f in (folder / m).glob("cameras.*"))
    read = binary_rows if file.suffix == ".bin" else text_rows
    return [read(file.with_stem(kind), kind) for kind in ("cameras", "images", "points3D")]


def rotation(w: float, x: float, y: float, z: float) -> np.ndarray:
    """The matrix of a unit quaternion."""
    u = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * cross


def load(folder: Path) -> tuple[list[View], np.ndarray, np.ndarray, float]:
    """Views sorted by name, places and colours of the points, and the extent of the cameras.

    The world is moved and scaled as gsplat's example does, but not turned: the place that most
    cameras look at is at the origin, at a median distance of 1. Distortion is ignored.
    """
    cameras, images, points = colmap(folder)
    lenses = {int(row[0]): (row[1], np.array(row[2:], float)) for row in cameras}
    images = sorted(images, key=lambda row: row[9])
    turns = np.array([rotation(*map(float, row[1:5])) for row in images])
    shifts = np.array([row[5:8] for row in images], float)
    centers = -np.einsum("nji,nj->ni", turns, shifts)
    ahead = turns[:, 2]
    focus = np.median(centers - (ahead * centers).sum(1, keepdims=True) * ahead, axis=0)
    scale = 1 / np.median(np.linalg.norm(centers - focus, axis=1))
    shifts = scale * (shifts + turns @ focus)
    centers = scale * (centers - focus)
    places = scale * (np.array([row[1:4] for row in points], float) - focus)
    colors = np.array([row[4:7] for row in points], float) / 255
    extent = 1.1 * np.linalg.norm(centers - centers.mean(0), axis=1).max()
    names = ("images", "images_2", "images_4", "images_8")
    pictures = next(folder / n for n in names if (folder / n / images[0][9]).is_file())
    views = []
    for row, turn, shift in zip(images, turns, shifts):
        with Image.open(pictures / row[9]) as file:
            pixels = np.asarray(file.convert("RGB"))
        height, width = pixels.shape[:2]
        kind, (whole_width, whole_height, *numbers) = lenses[int(row[8])]
        focal_x, focal_y, *center = numbers if kind == "PINHOLE" else [numbers[0], *numbers]
        lens = np.array([[focal_x, 0, center[0]], [0, focal_y, center[1]], [0, 0, 1]])
        lens[:2] *= [[width / whole_width], [height / whole_height]]
        pose = np.vstack([np.column_stack([turn, shift]), [0, 0, 0, 1]])
        camera = {"viewmats": tensor(pose)[None], "Ks": tensor(lens)[None]}
        camera |= {"width": width, "height": height}
        views.append(View(row[9], tensor(pixels)[None] / 255, camera))
    return views, places, colors, float(extent)


def initial(places: np.ndarray, colors: np.ndarray) -> dict[str, Tensor]:
    """A Gaussian at each point, as large as the distance to its three nearest neighbours."""
    count, means = len(places), tensor(places)
    near = torch.empty(0, 4, device=DEVICE)
    for part in means.split(500):
        distances = torch.cdist(part, means, compute_mode="donot_use_mm_for_euclid_dist")
        near = torch.cat([near, distances.topk(4, largest=False).values])
    scales = near[:, 1:].square().mean(1).sqrt().clamp_min(1e-7).log()
    return {
        "means": means,
        "scales": scales[:, None].repeat(1, 3),
        "quats": torch.rand(count, 4),
        "opacities": torch.full((count,), 0.1).logit(),
        "sh0": tensor((colors - 0.5) / SH0)[:, None],
        "shN": torch.zeros(count, 15, 3),
    }


def train(data: Path, out: Path, steps: int, seed: int) -> None:
    """Trains with the default strategy and measures the held-out views, every eighth."""
    gsplat = library()
    torch.manual_seed(seed)
    views, places, colors, extent = load(data)
    chosen = [view for i, view in enumerate(views) if i % 8]
    splats = parameters(initial(places, colors))
    optimizers = adam(splats, RATES | {"means": RATES["means"] * extent}, True)
    decay = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], 0.01 ** (1 / steps))
    strategy = gsplat.DefaultStrategy()
    strategy.check_sanity(splats, optimizers)
    state = strategy.initialize_state(scene_scale=extent)

    def draw(view: View, degree: int) -> tuple[Tensor, Tensor, dict[str, Any]]:
        shape = {"sh_degree": degree, "packed": False}
        return gsplat.rasterization(**activated(splats), **view.camera, **shape)

    torch.cuda.reset_peak_memory_stats()
    torch.cuda.synchronize()
    started, order = time.perf_counter(), []
    for number in range(steps):
        order = order or torch.randperm(len(chosen)).tolist()
        view = chosen[order.pop()]
        image, _, info = draw(view, min(number // 1000, 3))
        strategy.step_pre_backward(splats, optimizers, state, number, info)
        l1_and_ssim(image, view.pixels).backward()
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        decay.step()
        strategy.step_post_backward(splats, optimizers, state, number, info, packed=False)
    torch.cuda.synchronize()
    summary = {"data": data.name, "steps": steps, "seed": seed, "views": len(views)}
    summary |= {"gaussians": len(splats["means"]), "seconds": time.perf_counter() - started}
    summary["peak_mib"] = torch.cuda.max_memory_allocated() / 2**20
    with torch.no_grad():
        qualities = [quality(draw(view, 3)[0], view, out) for view in views[::8]]
    summary |= {"psnr": np.mean(qualities, 0)[0], "ssim": np.mean(qualities, 0)[1]}
    print(json.dumps(summary))
    (out / "summary.json").write_text(json.dumps(summary | {"held_out": qualities}, indent=1))


def quality(image: Tensor, view: View, out: Path) -> tuple[float, float]:
    """PSNR and SSIM of a picture in 8 bits, which is written as a file, too."""
    image = (image.clamp(0, 1) * 255).round()
    out.mkdir(parents=True, exist_ok=True)
    pixels = image[0].to(torch.uint8).cpu().numpy()
    Image.fromarray(pixels).save((out / Path(view.name).name).with_suffix(".png"))
    image, truth = image.double() / 255, view.pixels.double()
    return -10 * F.mse_loss(image, truth).log10().item(), ssim(image, truth).item()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("build", help="build gsplat's CUDA extension, and say how long it took")
    numbers = {"count": int, "width": int, "height": int, "focal": float}
    for name, text in (("make", "write a random scene"), ("step", "time a scene")):
        command = commands.add_parser(name, help=text)
        command.add_argument("file", type=Path)
        for number in list(numbers)[name == "step" :]:
            command.add_argument(number, type=numbers[number])
    command.add_argument("--repetitions", type=int, default=50)
    command = commands.add_parser("train", help="train from a COLMAP data set")
    command.add_argument("data", type=Path)
    command.add_argument("out", type=Path)
    command.add_argument("--steps", type=int, default=7000)
    command.add_argument("--seed", type=int, default=0)
    given = vars(parser.parse_args())
    {"build": build, "make": make, "step": step, "train": train}[given.pop("command")](**given)


if __name__ == "__main__":
    main()
