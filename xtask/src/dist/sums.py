"""sums.py FOLDER: writes SHA256SUMS of the files of a folder, as sha256sum --check reads it."""

import hashlib
import sys
from pathlib import Path

folder = Path(sys.argv[1])
files = sorted(path for path in folder.iterdir() if path.is_file() and path.name != "SHA256SUMS")
lines = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files]
(folder / "SHA256SUMS").write_bytes("".join(lines).encode())
