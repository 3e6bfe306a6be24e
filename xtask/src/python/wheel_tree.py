"""wheel_tree.py TREE VERSION [PLATFORM]: what a wheel's tree needs besides the compiled module.

The Python sources, the metadata of pyproject.toml, and the tags: Python's stable ABI since the oldest
Python that it names, and the platform, which is that of this Python if none is given.
"""

import shutil
import sys
from pathlib import Path

import tomli
from packaging.tags import platform_tags
from pyproject_metadata import StandardMetadata

TAGS = """\
Wheel-Version: 1.0
Generator: cargo xtask
Root-Is-Purelib: false
Tag: cp{python}-abi3-{platform}
"""


def main(tree: Path, version: str, platform: str = "") -> None:
    platform = platform or next(platform_tags())
    package = Path("gs-python")
    for source in (package / "python/gaussian_splats").iterdir():
        if source.suffix in {".py", ".pyi"} or source.name == "py.typed":
            shutil.copyfile(source, tree / "gaussian_splats" / source.name)
    pyproject = tomli.loads((package / "pyproject.toml").read_text())
    metadata = StandardMetadata.from_pyproject(pyproject, package)
    metadata.version = version
    metadata.dynamic = []
    info = tree / f"gaussian_splats-{version}.dist-info"
    metadata.license_files = sorted(path.relative_to(info / "licenses") for path in (info / "licenses").iterdir())
    (info / "METADATA").write_bytes(bytes(metadata.as_rfc822()))
    python = pyproject["project"]["requires-python"].removeprefix(">=").replace(".", "")
    (info / "WHEEL").write_text(TAGS.format(python=python, platform=platform))
    for path in tree.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)


main(Path(sys.argv[1]), *sys.argv[2:])
