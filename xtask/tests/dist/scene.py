"""scene.py FOLDER: writes a picture and a data set, for machines that have no test data.

FOLDER/photo.png is 384 by 256 pixels. FOLDER/dataset holds twelve views of three balls on a floor,
with their poses in transforms.json.
"""

import json
import math
import struct
import sys
import zlib
from pathlib import Path

SIZE, FOCAL, VIEWS = (96, 72), 100.0, 12
BALLS = [((-0.7, 0.0, 0.5), 0.5, (220, 70, 50)), ((0.6, 0.5, 0.4), 0.4, (60, 160, 80)), ((0.3, -0.7, 0.3), 0.3, (70, 90, 210))]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def unit(a):
    return [x / math.sqrt(dot(a, a)) for x in a]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def color(eye, ray):
    """The first ball along a ray, lit from above, or the floor, or the sky."""
    nearest, seen = math.inf, (180, 200, 230)
    if ray[2] < 0:
        nearest = -eye[2] / ray[2]
        x, y = (eye[axis] + nearest * ray[axis] for axis in (0, 1))
        light = 0.6 + 0.2 * math.sin(4 * x) * math.sin(4 * y)
        seen = tuple(round(light * 200) for _ in range(3)) if max(abs(x), abs(y)) < 3 else seen
    for center, radius, paint in BALLS:
        to = [c - e for c, e in zip(center, eye)]
        along = dot(to, ray)
        inside = radius**2 - dot(to, to) + along**2
        distance = along - math.sqrt(inside) if inside > 0 else math.inf
        if 0 < distance < nearest:
            nearest = distance
            normal = [(e + distance * r - c) / radius for e, r, c in zip(eye, ray, center)]
            seen = tuple(round(value * (0.55 + 0.45 * normal[2])) for value in paint)
    return seen


def png(path, width, height, pixel):
    rows = b"".join(b"\0" + bytes(v for x in range(width) for v in pixel(x, y)) for y in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def view(path, eye):
    """Writes what a camera sees that looks at the middle, and returns its axes and place as a matrix."""
    backward = unit([eye[0], eye[1], eye[2] - 0.4])
    right = unit(cross([0, 0, 1], backward))
    up = cross(backward, right)

    def pixel(x, y):
        u, v = (x + 0.5 - SIZE[0] / 2) / FOCAL, (SIZE[1] / 2 - y - 0.5) / FOCAL
        return color(eye, unit([u * r + v * t - b for r, t, b in zip(right, up, backward)]))

    png(path, *SIZE, pixel)
    return [[right[i], up[i], backward[i], eye[i]] for i in range(3)] + [[0, 0, 0, 1]]


def main(folder):
    dataset = folder / "dataset"
    (dataset / "images").mkdir(parents=True, exist_ok=True)
    frames = []
    for index in range(VIEWS):
        angle = 2 * math.pi * index / VIEWS
        eye = [4 * math.cos(angle), 4 * math.sin(angle), 1.6 + 0.5 * (index % 2)]
        name = f"images/{index:02}.png"
        frames.append({"file_path": name, "transform_matrix": view(dataset / name, eye)})
    camera = {"w": SIZE[0], "h": SIZE[1], "fl_x": FOCAL, "fl_y": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2}
    (dataset / "transforms.json").write_text(json.dumps({**camera, "frames": frames}, indent=1))

    def wave(x, y):
        return tuple(round(127 + 90 * math.sin(x / (17 + 9 * c)) * math.cos(y / (23 - 5 * c))) for c in range(3))

    png(folder / "photo.png", 384, 256, wave)


main(Path(sys.argv[1]))
