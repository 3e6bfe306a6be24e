"""pack.py FOLDER ARCHIVE: packs a folder as .tar.gz, .zip or .deb, with the same bits each time.

Entries are sorted, belong to root, and have the time of SOURCE_DATE_EPOCH. What is in bin/ and .exe
files are programs.
"""

import gzip
import os
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

EPOCH = int(os.environ["SOURCE_DATE_EPOCH"])


def mode(path: Path) -> int:
    is_program = path.parent.name == "bin" or path.suffix == ".exe"
    return 0o755 if path.is_dir() or is_program else 0o644


def entries(folder: Path) -> list[tuple[str, Path]]:
    """The folder and what is in it, with the names in the archive."""
    paths = [folder, *folder.rglob("*")]
    return sorted((path.relative_to(folder.parent).as_posix(), path) for path in paths)


def tar(folder: Path, archive: Path) -> None:
    def plain(entry: tarfile.TarInfo, path: Path) -> tarfile.TarInfo:
        entry.uid = entry.gid = 0
        entry.uname = entry.gname = "root"
        entry.mtime, entry.mode = EPOCH, mode(path)
        return entry

    with (
        archive.open("wb") as file,
        gzip.GzipFile("", "wb", 9, file, EPOCH) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name, path in entries(folder):
            tar.add(path, name, recursive=False, filter=lambda entry: plain(entry, path))


def zip(folder: Path, archive: Path) -> None:
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as zip:
        for name, path in entries(folder):
            if path.is_file():
                entry = zipfile.ZipInfo(name, time.gmtime(EPOCH)[:6])
                entry.create_system, entry.external_attr = 3, (0o100000 | mode(path)) << 16
                entry.compress_type = zipfile.ZIP_DEFLATED
                zip.writestr(entry, path.read_bytes())


def deb(folder: Path, archive: Path) -> None:
    for _, path in entries(folder):
        if not path.is_symlink():
            path.chmod(mode(path))
            os.utime(path, (EPOCH, EPOCH))
    options = ["--root-owner-group", "-Zgzip", "-z9", "--build"]
    subprocess.run(["dpkg-deb", *options, folder, archive], check=True)


folder, archive = map(Path, sys.argv[1:])
{".gz": tar, ".zip": zip, ".deb": deb}[archive.suffix](folder, archive)
