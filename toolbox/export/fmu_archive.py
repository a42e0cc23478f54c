"""What every FMU needs: sources compiled for the machine that runs this, and where its compiler is installed for Windows, and one archive around them."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from toolbox.errors import SceneError
from toolbox.files.atomic import replaced

FOLDERS = {
    "2.0": {("linux", "x86_64"): "linux64", ("darwin", "x86_64"): "darwin64", ("win32", "x86_64"): "win64"},
    "3.0": {(system, processor): f"{processor}-{word}" for system, word in (("linux", "linux"), ("darwin", "darwin"), ("win32", "windows"))
            for processor in ("x86_64", "aarch64")},
}  # fmt: skip
"""{version of FMI: {(platform, processor): folder of its binary}}."""

PROCESSORS = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
"""{what Python calls a processor, in small letters: what FMI 3.0 calls it}."""

WINDOWS = "x86_64-w64-mingw32-gcc"
"""The compiler for Windows on other systems, mingw-w64."""

OPTIMISED = "-O2"
"""Option of the C compiler that says how much it searches for fast code; the quick suite of tests asks for none, which gives the same bits."""

REAL = "void *c, const Reference *r, size_t n"
"""What functions of FMI that read or write several variables begin with."""


def refusing(name: str, parameters: str, answer: str) -> str:
    """A function that looks at none of its parameters but the unit."""
    words = [re.split(r"[ *]", each)[-1] for each in parameters.split(",")]
    unused = " ".join(f"(void){word};" for word in words)
    return f"Status {name}({parameters}) {{ {unused} return {answer.replace('MESSAGE', f'{chr(34)}{name} is not there{chr(34)}')}; }}"


def folder_here(version: str) -> str:
    """Return the folder for the binary of this machine. SceneError is raised if the version of FMI has no name for the processor."""
    told = platform.machine()
    folder = FOLDERS[version].get((sys.platform, PROCESSORS.get(told.lower(), told)))
    if folder is None:
        instead = (
            'write a loop with `version="3.0"`'
            if (sys.platform, PROCESSORS.get(told.lower())) in FOLDERS["3.0"]
            else "make it on another machine"
        )
        raise SceneError(f"FMI {version} has no folder for the machine code of this processor, {told}: {instead}.")
    return folder


def compiler_here() -> str:
    """Return the C compiler of this machine. SceneError is raised if there is none."""
    compiler = os.environ.get("CC") or shutil.which("cc")
    if compiler is None or sys.platform not in ("linux", "darwin") or platform.architecture()[0] != "64bit":
        raise SceneError("An FMU holds machine code: it needs Linux or macOS on 64 bits and a C compiler, `cc` or the one that CC names.")
    return compiler


def fmu_archive(
    target: Path,
    folder: Path,
    parts: Sequence[Path],
    description: bytes,
    version: str = "2.0",
    flags: Sequence[str] = (),
    further: Mapping[str, bytes] | None = None,
) -> Path:
    """Compile sources and write them with their description as an FMU.

    Parameters
    ----------
    target
        The file NAME.fmu; its binaries are called NAME, too.
    folder
        Where all sources and headers are; they go into sources/.
    parts
        The sources that are compiled and linked.
    description
        modelDescription.xml.
    version
        "2.0" or "3.0", which say what the folders of binaries are called.
    flags
        Further flags of the compiler.
    further
        {place in the archive: content} of what else goes in.

    Raises
    ------
    SceneError
        If there is no C compiler or it fails.
    """
    name = target.stem
    includes = [f"-I{each}" for each in sorted({path.parent for path in folder.rglob("*.h")})]
    compilers = {sys.platform: (compiler_here(), folder_here(version))}
    if (windows := shutil.which(WINDOWS)) is not None:
        compilers["win32"] = windows, FOLDERS[version]["win32", "x86_64"]
    binaries = {}
    for system, (compiler, place) in compilers.items():
        suffix = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}[system]
        library = folder / f"{name}{suffix}"
        position = [] if system == "win32" else ["-fPIC"]
        static = ["-static-libgcc"] if system == "win32" else []
        options = [OPTIMISED, *flags, "-shared", *position, *includes]
        command = [*compiler.split(), *options, *map(str, parts), "-lm", *static, "-o", str(library)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise SceneError(f"The C compiler `{compiler}` failed: {done.stderr.strip()[-500:]}")
        binaries[library] = f"binaries/{place}/{name}{suffix}"
    with replaced(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description)
        for library, place in binaries.items():
            archive.write(library, place)
        for source in sorted(each for each in folder.rglob("*") if each.suffix in (".c", ".h")):
            archive.write(source, f"sources/{source.relative_to(folder).as_posix()}")
        for place, content in (licences(any("osqp" in path.as_posix() for path in parts)) | dict(further or {})).items():
            archive.writestr(place, content)
    return target


def licences(solver: bool) -> dict[str, bytes]:
    """Return {path in an FMU: text} of the licences of the toolbox and, for a predictive law, of its solver."""
    from importlib.metadata import PackageNotFoundError, files

    found = {}
    for package in ("stickslip-toolbox", *(["osqp"] if solver else [])):
        try:
            listed = files(package) or []
        except PackageNotFoundError:
            continue
        for each in listed:
            if re.search(r"licenses?/[^/]*licen[cs]e", str(each), re.IGNORECASE) or each.name.upper().startswith("LICENSE"):
                found[f"documentation/licenses/{package}.txt"] = Path(str(each.locate())).read_bytes()
    return found
