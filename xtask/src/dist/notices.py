"""notices.py TRIPLE NOTICES [SBOM]: what a release for a system, or the npm package, is made of.

NOTICES gets the licence texts of the crates in the program, the page and the Python module, each
text once. SBOM gets the crates of the program and the page in CycloneDX's JSON. Cargo says which
crates these are, and their sources have the texts.
"""

import json
import os
import re
import subprocess
import sys
import uuid
from datetime import datetime, timezone
from pathlib import Path

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
This contains Rust's standard library (MIT OR Apache-2.0) and these crates. Their licence texts
follow."""
CODE = {".rs", ".c", ".h", ".py", ".html", ".toml", ".json"}


def cargo(*arguments: str) -> str:
    done = subprocess.run([CARGO, *arguments, "--locked"], check=True, stdout=subprocess.PIPE)
    return done.stdout.decode()


def crates_of(package: str, triple: str, *features: str) -> set[tuple[str, str]]:
    """Names and versions of what a package is made of for a system, without its build scripts' crates."""
    tree = ["tree", "--edges", "normal", "--prefix", "none", "--format", "{p}"]
    lines = cargo(*tree, "--package", package, "--target", triple, *features).splitlines()
    return {(name, version.removeprefix("v")) for name, version, *_ in map(str.split, filter(None, lines))}


def texts_of(package: dict) -> dict[str, str]:
    """The licence texts in the sources of a crate."""
    folder = Path(package["manifest_path"]).parent
    depth = len(folder.parts) + 4
    files = (path for path in sorted(folder.rglob("*")) if len(path.parts) < depth and path.is_file())
    named = (path for path in files if LICENCE.match(path.name) and path.suffix not in CODE)
    texts = {path.relative_to(folder).as_posix(): path.read_text("utf-8", "replace").strip() for path in named}
    return {name: text.replace("\r\n", "\n") for name, text in texts.items()}


def notices(packages: list[dict]) -> str:
    lines, texts = [INTRODUCTION, ""], {}
    for package in packages:
        crate = f"{package['name']} {package['version']}"
        if not package["license"]:
            sys.exit(f"error: {crate} names no licence")
        found = texts_of(package)
        lines.append(f"{crate}: {package['license']}" + ("" if found else " (no text in its sources)"))
        if not found:
            lines.append(f"    by {', '.join(package['authors'])}, {package['repository']}")
        for text in found.values():
            texts.setdefault(text, []).append(crate)
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


def sbom(root: dict, packages: list[dict], nodes: dict[str, list[str]]) -> str:
    entries = re.findall(r'name = "(.*)"\nversion = "(.*)"\nsource = .*\nchecksum = "(.*)"', Path("Cargo.lock").read_text())
    checksums = {(name, version): checksum for name, version, checksum in entries}
    program = component(root, checksums, ComponentType.APPLICATION)
    components = {package["id"]: component(package, checksums, ComponentType.LIBRARY) for package in packages}
    components[root["id"]] = program
    serial = uuid.uuid5(uuid.NAMESPACE_URL, ",".join(sorted(components)))
    bom = Bom(components=[each for each in components.values() if each is not program], serial_number=serial)
    bom.metadata.component = program
    bom.metadata.timestamp = datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), timezone.utc)
    for id, each in components.items():
        bom.register_dependency(each, [components[other] for other in nodes[id] if other in components])
    text = JsonV1Dot6(bom).output_as_string(indent=2)
    if error := JsonStrictValidator(SchemaVersion.V1_6).validate_str(text):
        sys.exit(f"error: the SBOM is not valid: {error}")
    return text + "\n"


def main(triple: str, notices_path: str, sbom_path: str | None = None) -> None:
    metadata = json.loads(cargo("metadata", "--format-version", "1", "--features", "gs-cli/manual"))
    known = {(package["name"], package["version"]): package for package in metadata["packages"]}
    if sbom_path is None:
        package = crates_of("gs-web", triple, "--no-default-features", "--features", "viewer,picture")
        others = [known[crate] for crate in sorted(package) if known[crate]["source"]]
        Path(notices_path).write_bytes(notices(others).encode())
        return
    program = crates_of("gs-cli", triple, "--features", "manual") | crates_of("gs-web", "wasm32-unknown-unknown")
    everything = [known[crate] for crate in sorted(program | crates_of("gs-python", triple))]
    others = [package for package in everything if package["source"]]
    Path(notices_path).write_bytes(notices(others).encode())
    packages = [known[crate] for crate in sorted(program)]
    nodes = {node["id"]: [dep["pkg"] for dep in node["deps"]] for node in metadata["resolve"]["nodes"]}
    root = next(package for package in packages if package["name"] == "gs-cli")
    Path(sbom_path).write_bytes(sbom(root, packages, nodes).encode())


main(*sys.argv[1:])
