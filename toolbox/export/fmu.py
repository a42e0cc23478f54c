"""Control laws as FMUs (FMI 2.0, co-simulation): the C of `toolbox.export_c` behind the interface that other simulators load.

Order at one instant, as in `simulate`: the law is sampled at start + k period and its outputs are held. A master sets the inputs, calls `fmi2DoStep(t, h)` and
then reads the outputs: every sample instant in [t, t + h) is computed with these inputs, so that communication steps of one period, or of a
whole part of it, sample the law as it was designed. At initialisation the outputs are what the law would drive with the inputs of that time; nothing is
sampled by that.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from toolbox.errors import SceneError
from toolbox.export.c_code import Declared, c_paths, declared_c
from toolbox.files.atomic import replaced
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop


@takes_loop
def export_fmu(loop: ClosedLoop, path: str | Path) -> Path:
    """Write a sampled law as NAME.fmu, a co-simulation unit of FMI 2.0 for the machine that runs this.

    Its inputs are what the law measures and its set-points, with their defaults as start values; its outputs are what the law drives, and its memory can be
    looked at. Names and units are those of the signals. The gains of the law are parameters, such as `law.proportional`, and may be changed at any time.
    The sources are in the file, too. What is not allowed, such as to write an output, is refused and told to the logger of the importer.

    Parameters
    ----------
    loop
        As in `export_c`.
    path
        The file, whose name without suffix is that of the unit.

    Returns
    -------
    Path
        The path of the file.

    Raises
    ------
    SceneError
        As `export_c` does, and if there is no C compiler (`CC`, or `cc`) or it fails.
    """
    import platform
    import subprocess
    import tempfile
    import uuid
    import zipfile

    path = Path(path)
    c, _ = c_paths(path.with_suffix("") if path.suffix == ".fmu" else path)
    target, name = path.with_name(c.stem + ".fmu"), c.stem
    compiler = os.environ.get("CC") or shutil.which("cc")
    folders = {"linux": "linux64", "darwin": "darwin64"}
    if compiler is None or sys.platform not in folders or platform.architecture()[0] != "64bit":
        raise SceneError("An FMU holds machine code: it needs Linux or macOS on 64 bits and a C compiler, `cc` or the one that CC names.")
    suffix = {"linux": ".so", "darwin": ".dylib"}[sys.platform]
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        law = declared_c(loop, folder / name)
        identity = uuid.uuid5(uuid.NAMESPACE_OID, (folder / f"{name}.c").read_text() + (folder / f"{name}.h").read_text())
        (folder / f"{name}_fmi.c").write_text(_interface(law, f"{{{identity}}}"), encoding="utf-8")
        parts = sorted(folder.rglob("*.c"))
        includes = [f"-I{each}" for each in sorted({path.parent for path in folder.rglob("*.h")})]
        library = folder / f"{name}{suffix}"
        command = [
            *compiler.split(),
            "-O2",
            "-ffp-contract=off",
            "-shared",
            "-fPIC",
            *includes,
            *map(str, parts),
            "-lm",
        ]
        done = subprocess.run([*command, "-o", str(library)], capture_output=True, text=True)
        if done.returncode:
            raise SceneError(f"The C compiler `{compiler}` failed: {done.stderr.strip()[-500:]}")
        with replaced(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            listed = [path.relative_to(folder).as_posix() for path in parts]
            archive.writestr("modelDescription.xml", _description(law, f"{{{identity}}}", listed))
            archive.write(library, f"binaries/{folders[sys.platform]}/{name}{suffix}")
            for source in sorted(each for each in folder.rglob("*") if each.suffix in (".c", ".h")):
                archive.write(source, f"sources/{source.relative_to(folder).as_posix()}")
    return target


def _description(law: Declared, guid: str, sources: Sequence[str]) -> bytes:
    """modelDescription.xml: variables by value reference in the order reads, drives, memory, gains."""
    from xml.etree import ElementTree

    once = any("/" in source for source in sources)  # a solver whose memory is static
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0", modelName=law.name, guid=guid, generationTool="stickslip-toolbox", variableNamingConvention="flat",
        description=f"{law.title}: a control law sampled every {law.period:.17g} s",
    )  # fmt: skip
    kind = ElementTree.SubElement(
        root, "CoSimulation",
        modelIdentifier=law.name, canHandleVariableCommunicationStepSize="true", canGetAndSetFMUstate="false" if once else "true",
        canBeInstantiatedOnlyOncePerProcess="true" if once else "false",
    )  # fmt: skip
    files = ElementTree.SubElement(kind, "SourceFiles")
    for source in sources:
        ElementTree.SubElement(files, "File", name=source)
    units = dict.fromkeys(str(row[1]) for row in (*law.reads, *law.drives, *law.memory, *law.gains))
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for word in units:
        ElementTree.SubElement(definitions, "Unit", name=word)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=repr(law.period))
    variables = ElementTree.SubElement(root, "ModelVariables")
    held = {"variability": "discrete"}
    rows: list[tuple[str, str, dict[str, str], float | None]] = [
        *((name, unit, {"causality": "input"}, value or 0.0) for name, unit, value in law.reads),
        *((name, unit, {"causality": "output"} | held, None) for name, unit in law.drives),
        *((f"memory.{name}", unit, {"causality": "local", "initial": "exact"} | held, 0.0) for name, unit in law.memory),
        *((name, unit, {"causality": "parameter", "variability": "tunable"}, value) for name, unit, value in law.gains),
    ]
    for reference, (label, unit, role, value) in enumerate(rows):
        variable = ElementTree.SubElement(variables, "ScalarVariable", {"name": label, "valueReference": str(reference), **role})
        ElementTree.SubElement(variable, "Real", {"unit": unit} | ({} if value is None else {"start": repr(float(value))}))
    structure = ElementTree.SubElement(root, "ModelStructure")
    for word in ("Outputs", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(structure, word)
        for i in range(len(law.drives)):
            ElementTree.SubElement(unknowns, "Unknown", index=str(len(law.reads) + i + 1))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


REAL = "void *c, const Reference *r, size_t n"
REFUSED = (
    *((f"fmi2{way}{kind}", f"{REAL}, {const}{word}", "n ? refused(c, MESSAGE) : OK")
      for kind, word in (("Integer", "int *value"), ("Boolean", "int *value"), ("String", "const char **value"))
      for way, const in (("Get", ""), ("Set", "const ")) if (way, kind) != ("Set", "String")),
    ("fmi2SetString", f"{REAL}, const char *const *value", "n ? refused(c, MESSAGE) : OK"),
    ("fmi2SetRealInputDerivatives", f"{REAL}, const int *order, const double *value", "refused(c, MESSAGE)"),
    ("fmi2GetRealOutputDerivatives", f"{REAL}, const int *order, double *value", "refused(c, MESSAGE)"),
    ("fmi2GetDirectionalDerivative", "void *c, const Reference *u, size_t nu, const Reference *k, size_t nk, const double *dk, double *du",
     "refused(c, MESSAGE)"),
    *((f"fmi2Get{word}Status", f"void *c, int kind, {kind} *value", "DISCARD")
      for word, kind in (("", "Status"), ("Real", "double"), ("Integer", "int"), ("Boolean", "int"), ("String", "const char *"))),
    ("fmi2CancelStep", "void *c", "refused(c, MESSAGE)"),
    ("fmi2SetDebugLogging", "void *c, int on, size_t n, const char *const *categories", "OK"),
    ("fmi2SerializedFMUstateSize", "void *c, void *state, size_t *size", "refused(c, MESSAGE)"),
    ("fmi2SerializeFMUstate", "void *c, void *state, char *bytes, size_t size", "refused(c, MESSAGE)"),
    ("fmi2DeSerializeFMUstate", "void *c, const char *bytes, size_t size, void **state", "refused(c, MESSAGE)"),
)  # fmt: skip
"""(function, parameters, answer) of what no law has: variables of other types, derivatives, asynchronous steps."""


def _function(name: str, parameters: str, answer: str) -> str:
    """A function that looks at none of its parameters but the unit."""
    words = [re.split(r"[ *]", each)[-1] for each in parameters.split(",")]
    unused = " ".join(f"(void){word};" for word in words)
    return f"Status {name}({parameters}) {{ {unused} return {answer.replace('MESSAGE', f'{chr(34)}{name} is not there{chr(34)}')}; }}"


def _interface(law: Declared, guid: str) -> str:
    """The functions of FMI 2.0 around NAME_step: what is this law's own, and then `law_fmi2.c`."""
    name, gains = law.name, len(law.gains)
    defaults = ", ".join(repr(float(value or 0.0)) for _, _, value in law.reads) or "0.0"
    sizes = {"READS": len(law.reads), "DRIVES": len(law.drives), "MEMORY": len(law.memory), "GAINS": gains}
    step = f"{name}_step_with((law)->gains, " if gains else f"{name}_step("
    lines = [
        "#include <stdlib.h>",
        "#include <string.h>",
        f'#include "{name}.h"',
        f'#define GUID "{guid}"',
        *[f"#define {word} {size}" for word, size in sizes.items()],
        f"#define PERIOD {name.upper()}_PERIOD",
        "#define SIZE(n) ((n) ? (n) : 1)",
        f"#define START(memory) {name}_start(memory)",
        f"#define GAINS_OF(gains) {f'{name}_gains(gains)' if gains else '(gains)[0] = 0.0'}",
        f"#define SAMPLE(law, memory) {step}(law)->y, memory, (law)->u)",
        f"static const double defaults[] = {{{defaults}}};",
        "",
        Path(__file__).with_name("law_fmi2.c").read_text(encoding="utf-8"),
        "/* what no law has */",
        *(_function(*each) for each in REFUSED),
        "",
    ]
    return "\n".join(lines)
