"""notices.py TRIPLE NOTICES [PROGRAM MODULE]: what a release for a system, or the npm package, is made of.

NOTICES gets the licence texts of everything in the program, the page and the Python module, each
text once. PROGRAM and MODULE get SBOMs in CycloneDX's JSON: the crates of the program with the
page, and of the Python module. Cargo says which crates these are, and their sources have the texts.
"""

import html
import json
import os
import re
import subprocess
import sys
import uuid
from datetime import datetime, timezone
from pathlib import Path

import ziglang

from cyclonedx.contrib.hash.factories import HashTypeFactory
from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import ExternalReference, ExternalReferenceType, XsUri
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL

CARGO = os.environ["CARGO"]
# Names of files with licences, in the folder of a crate or of what it contains.
LICENCE = re.compile(r"(LICEN[CS]E|COPYING|COPYRIGHT|NOTICE|UNLICENSE|OFL|UFL)", re.IGNORECASE)
INTRODUCTION = """\
This contains these crates, Rust's standard library, and what the linker adds to a program. The
licence texts follow."""
ZIG = Path(ziglang.__file__).parent
# What the linker adds: libraries for the compiler, and on Windows the start of C programs.
LINKED = {"Zig's compiler-rt": "LICENSE", "LLVM's libunwind": "lib/libunwind/LICENSE.TXT"}
LINKED_ON_WINDOWS = {"mingw-w64": "lib/libc/mingw/COPYING"}
CODE = {".rs", ".c", ".h", ".py", ".html", ".toml", ".json"}


def cargo(*arguments: str) -> str:
    done = subprocess.run([CARGO, *arguments, "--locked"], check=True, stdout=subprocess.PIPE)
    return done.stdout.decode()


def rustc(*arguments: str) -> str:
    compiler = os.environ.get("RUSTC", "rustc")
    return subprocess.run([compiler, *arguments], check=True, stdout=subprocess.PIPE).stdout.decode().strip()


RUST = Path(rustc("--print", "sysroot")) / "share/doc/rust"


def crates_of(triple: str, *packages: str) -> set[tuple[str, str]]:
    """Names and versions of what packages are made of for a system, without their build scripts' crates.

    The packages are arguments of cargo: `--package`, `--features`."""
    tree = ["tree", "--edges", "normal", "--prefix", "none", "--format", "{p}"]
    lines = cargo(*tree, "--target", triple, *packages).splitlines()
    return {(name, version.removeprefix("v")) for name, version, *_ in map(str.split, filter(None, lines))}


def texts_of(package: dict) -> dict[str, str]:
    """The licence texts in the sources of a crate."""
    folder = Path(package["manifest_path"]).parent
    depth = len(folder.parts) + 4
    files = (path for path in sorted(folder.rglob("*")) if len(path.parts) < depth and path.is_file())
    named = (path for path in files if LICENCE.match(path.name) and path.suffix not in CODE)
    texts = {path.relative_to(folder).as_posix(): path.read_text("utf-8", "replace").strip() for path in named}
    return {name: text.replace("\r\n", "\n") for name, text in texts.items()}


def standard_texts(expression: str) -> dict[str, str]:
    """The general texts of the licences of a crate that has none of its own."""
    known = {path.stem: path for path in (RUST / "licenses").glob("*.txt")}
    names = re.findall(r"[\w.-]+", expression)
    return {name: known[name].read_text("utf-8").strip() for name in names if name in known}


def standard_library() -> str:
    """The notices of Rust's standard library, without the marks of HTML."""
    text = (RUST / "COPYRIGHT-library.html").read_text("utf-8")
    text = html.unescape(re.sub(r"<[^>]+>", "", text[text.index("<body>") :]))
    return re.sub(r"\s*\n\s*\n\s*", "\n\n", text).strip()


def notices(packages: list[dict], linked: dict[str, str]) -> str:
    lines, texts = [INTRODUCTION, ""], {}
    for package in packages:
        crate = f"{package['name']} {package['version']}"
        if not package["license"]:
            sys.exit(f"error: {crate} names no licence")
        found = texts_of(package)
        lines.append(f"{crate}: {package['license']}")
        if not found:
            lines.append(f"    by {', '.join(package['authors'])}, {package['repository']}")
            found = standard_texts(package["license"])
            if not found:
                sys.exit(f"error: {crate}: no text of {package['license']}, neither in its sources nor in {RUST}")
        for text in found.values():
            texts.setdefault(text, []).append(crate)
    texts[standard_library()] = ["Rust's standard library"]
    for name, path in linked.items():
        texts.setdefault((ZIG / path).read_text("utf-8").strip(), []).append(name)
    for text, crates in texts.items():
        lines += ["", "=" * 80, ", ".join(sorted(set(crates))), "", text]
    return "\n".join(lines) + "\n"


def component(package: dict, checksums: dict[tuple[str, str], str], kind: ComponentType) -> Component:
    name, version = package["name"], package["version"]
    checksum = checksums.get((name, version))
    return Component(
        name=name,
        version=version,
        type=kind,
        bom_ref=f"{name}@{version}",
        purl=PackageURL("cargo", name=name, version=version),
        licenses=[LicenseFactory().make_from_string(package["license"].replace("/", " OR "))],
        hashes=[HashTypeFactory().from_composite_str(f"sha256:{checksum}")] if checksum else [],
        external_references=[
            ExternalReference(type=ExternalReferenceType.VCS, url=XsUri(package["repository"]))
        ]
        if package["repository"]
        else [],
    )


def sbom(root: dict, kind: ComponentType, packages: list[dict], nodes: dict[str, list[str]]) -> str:
    entries = re.findall(r'name = "(.*)"\nversion = "(.*)"\nsource = .*\nchecksum = "(.*)"', Path("Cargo.lock").read_text())
    checksums = {(name, version): checksum for name, version, checksum in entries}
    program = component(root, checksums, kind)
    components = {package["id"]: component(package, checksums, ComponentType.LIBRARY) for package in packages}
    components[root["id"]] = program
    std = Component(
        name="rust-std",
        version=re.search(r"^release: (.*)$", rustc("-vV"), re.MULTILINE)[1],
        type=ComponentType.LIBRARY,
        bom_ref="rust-std",
        licenses=[LicenseFactory().make_from_string("MIT OR Apache-2.0")],
    )
    parts = [std, *(each for each in components.values() if each is not program)]
    serial = uuid.uuid5(uuid.NAMESPACE_URL, ",".join(sorted(f"{each.name} {each.version}" for each in [program, *parts])))
    bom = Bom(components=parts, serial_number=serial)
    bom.metadata.component = program
    bom.metadata.timestamp = datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), timezone.utc)
    for id, each in components.items():
        bom.register_dependency(each, [std, *(components[other] for other in nodes[id] if other in components)])
    text = JsonV1Dot6(bom).output_as_string(indent=2)
    if error := JsonStrictValidator(SchemaVersion.V1_6).validate_str(text):
        sys.exit(f"error: the SBOM is not valid: {error}")
    return text + "\n"


def main(triple: str, notices_path: str, *sboms: str) -> None:
    metadata = json.loads(cargo("metadata", "--format-version", "1", "--features", "gs-cli/manual"))
    known = {(package["name"], package["version"]): package for package in metadata["packages"]}
    packages = lambda crates: [known[crate] for crate in sorted(crates)]
    linked = LINKED | (LINKED_ON_WINDOWS if "windows" in triple else {})
    if sboms:
        page = crates_of("wasm32-unknown-unknown", "--package", "gs-web")
        manual = ["--features", "gs-cli/manual"]
        # Both are built together, with the features of both.
        everything = page | crates_of(triple, "--package", "gs-cli", "--package", "gs-python", *manual)
        parts = [
            ("gs-cli", ComponentType.APPLICATION, page | crates_of(triple, "--package", "gs-cli", *manual)),
            ("gs-python", ComponentType.LIBRARY, crates_of(triple, "--package", "gs-python")),
        ]
    else:
        features = ["--no-default-features", "--features", "viewer,picture"]
        everything, parts, linked = crates_of(triple, "--package", "gs-web", *features), [], {}
    others = [package for package in packages(everything) if package["source"]]
    Path(notices_path).write_bytes(notices(others, linked).encode())
    nodes = {node["id"]: [dep["pkg"] for dep in node["deps"]] for node in metadata["resolve"]["nodes"]}
    for (name, kind, crates), path in zip(parts, sboms):
        root = next(package for package in metadata["packages"] if package["name"] == name)
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_bytes(sbom(root, kind, packages(crates), nodes).encode())


main(*sys.argv[1:])
