"""Control laws as FMUs (FMI 2.0, co-simulation): the C of `toolbox.export_c` behind the interface that other simulators load.

Order at one instant, as in `simulate`: the law is sampled at start + k period and its outputs are held. A master sets the inputs, calls `fmi2DoStep(t, h)` and
then reads the outputs: every sample instant in [t, t + h) is computed with these inputs, so that communication steps of one period, or of a
whole part of it, sample the law as it was designed.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from toolbox.errors import SceneError
from toolbox.export.c_code import Declared, c_paths, declared_c
from toolbox.files.atomic import replaced
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop


@takes_loop
def export_fmu(loop: ClosedLoop, path: str | Path) -> Path:
    """Write a sampled law as NAME.fmu, a co-simulation unit of FMI 2.0 for the machine that runs this.

    Its inputs are what the law measures and its set-points, with their defaults as start values; its outputs are what the law drives, and its memory can be
    looked at. Names and units are those of the signals.

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
        (folder / f"{name}_fmi.c").write_text(_interface(law), encoding="utf-8")
        parts = [path for path in folder.rglob("*.c") if path.parent.name != "inc"]
        includes = [f"-I{each}" for each in {path.parent for path in folder.rglob("*.h")}]
        identity = uuid.uuid5(uuid.NAMESPACE_OID, (folder / f"{name}.c").read_text() + (folder / f"{name}.h").read_text())
        library = folder / f"{name}{suffix}"
        command = [
            *compiler.split(),
            "-O2",
            "-ffp-contract=off",
            "-shared",
            "-fPIC",
            "-w",
            f'-DGUID="{{{identity}}}"',
            *includes,
            *map(str, parts),
            "-lm",
        ]
        done = subprocess.run([*command, "-o", str(library)], capture_output=True, text=True)
        if done.returncode:
            raise SceneError(f"The C compiler `{compiler}` failed: {done.stderr.strip()[-500:]}")
        with replaced(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", _description(law, f"{{{identity}}}", (folder / f"{name}_osqp").exists()))
            archive.write(library, f"binaries/{folders[sys.platform]}/{name}{suffix}")
            for source in (folder / f"{name}.c", folder / f"{name}.h", folder / f"{name}_fmi.c"):
                archive.write(source, f"documentation/{source.name}")
    return target


def _description(law: Declared, guid: str, once: bool) -> bytes:
    """modelDescription.xml: variables by value reference in the order reads, drives, memory."""
    from xml.etree import ElementTree

    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0", modelName=law.name, guid=guid, generationTool="stickslip-toolbox", variableNamingConvention="flat",
        description=f"{law.title}: a control law sampled every {law.period:.17g} s",
    )  # fmt: skip
    ElementTree.SubElement(
        root, "CoSimulation",
        modelIdentifier=law.name, canHandleVariableCommunicationStepSize="true", canGetAndSetFMUstate="false" if once else "true",
        canBeInstantiatedOnlyOncePerProcess="true" if once else "false",
    )  # fmt: skip
    units = dict.fromkeys(str(row[1]) for row in (*law.reads, *law.drives, *law.memory))
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in units:
        ElementTree.SubElement(definitions, "Unit", name=unit)
    variables = ElementTree.SubElement(root, "ModelVariables")
    held = {"variability": "discrete"}
    rows: list[tuple[str, str, dict[str, str], float | None]] = [
        *((name, unit, {"causality": "input"}, value or 0.0) for name, unit, value in law.reads),
        *((name, unit, {"causality": "output"} | held, None) for name, unit in law.drives),
        *((f"memory.{name}", unit, {"causality": "local", "initial": "exact"} | held, 0.0) for name, unit in law.memory),
    ]
    for reference, (label, unit, kind, value) in enumerate(rows):
        variable = ElementTree.SubElement(variables, "ScalarVariable", {"name": label, "valueReference": str(reference), **kind})
        ElementTree.SubElement(variable, "Real", {"unit": unit} | ({} if value is None else {"start": repr(float(value))}))
    structure = ElementTree.SubElement(root, "ModelStructure")
    for word in ("Outputs", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(structure, word)
        for i in range(len(law.drives)):
            ElementTree.SubElement(unknowns, "Unknown", index=str(len(law.reads) + i + 1))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


REFUSED = """/* variables of other types, derivatives and asynchronous steps are not there */
Status fmi2GetInteger(void *c, const Reference *r, size_t n, int *value) { return n ? ERROR : OK; }
Status fmi2GetBoolean(void *c, const Reference *r, size_t n, int *value) { return n ? ERROR : OK; }
Status fmi2GetString(void *c, const Reference *r, size_t n, const char **value) { return n ? ERROR : OK; }
Status fmi2SetInteger(void *c, const Reference *r, size_t n, const int *value) { return n ? ERROR : OK; }
Status fmi2SetBoolean(void *c, const Reference *r, size_t n, const int *value) { return n ? ERROR : OK; }
Status fmi2SetString(void *c, const Reference *r, size_t n, const char *const *value) { return n ? ERROR : OK; }
Status fmi2SetRealInputDerivatives(void *c, const Reference *r, size_t n, const int *order, const double *value) { return ERROR; }
Status fmi2GetRealOutputDerivatives(void *c, const Reference *r, size_t n, const int *order, double *value) { return ERROR; }
Status fmi2GetDirectionalDerivative(void *c, const Reference *u, size_t nu, const Reference *k, size_t nk, const double *dk, double *du) { return ERROR; }
Status fmi2GetStatus(void *c, int kind, Status *value) { return DISCARD; }
Status fmi2GetRealStatus(void *c, int kind, double *value) { return DISCARD; }
Status fmi2GetIntegerStatus(void *c, int kind, int *value) { return DISCARD; }
Status fmi2GetBooleanStatus(void *c, int kind, int *value) { return DISCARD; }
Status fmi2GetStringStatus(void *c, int kind, const char **value) { return DISCARD; }

Status fmi2GetFMUstate(void *c, void **state) {
  if (!*state) *state = malloc(sizeof(Law));
  if (!*state) return ERROR;
  memcpy(*state, c, sizeof(Law));
  return OK;
}
Status fmi2SetFMUstate(void *c, void *state) { memcpy(c, state, sizeof(Law)); return OK; }
Status fmi2FreeFMUstate(void *c, void **state) { free(*state); *state = 0; return OK; }
Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) { return ERROR; }
Status fmi2SerializeFMUstate(void *c, void *state, char *bytes, size_t size) { return ERROR; }
Status fmi2DeSerializeFMUstate(void *c, const char *bytes, size_t size, void **state) { return ERROR; }
"""
"""The functions of FMI 2.0 for which every law answers alike: most are refused, and a state is copied as it is."""


def _interface(law: Declared) -> str:
    """The functions of FMI 2.0 around NAME_step."""
    reads, drives, memory = len(law.reads), len(law.drives), len(law.memory)
    starts = "\n".join(f"  law->y[{i}] = {float(value)!r};" for i, (_, _, value) in enumerate(law.reads) if value is not None)
    return f"""/* FMI 2.0 co-simulation around {law.name}_step: one number per variable, reads first, then drives, then memory. */
#include <stdlib.h>
#include <string.h>
#include "{law.name}.h"

typedef unsigned int Reference;
typedef enum {{ OK, WARNING, DISCARD, ERROR, FATAL, PENDING }} Status;
typedef struct {{
  double y[{max(reads, 1)}], u[{max(drives, 1)}], memory[{max(memory, 1)}], start;
  long sample;
}} Law;

static double *place(Law *law, Reference i) {{
  if (i < {reads}) return law->y + i;
  if (i < {reads + drives}) return law->u + (i - {reads});
  if (i < {reads + drives + memory}) return law->memory + (i - {reads + drives});
  return 0;
}}

static void begin(Law *law) {{
  memset(law, 0, sizeof(Law));
{starts}
  {law.name}_start(law->memory);
}}

const char *fmi2GetTypesPlatform(void) {{ return "default"; }}
const char *fmi2GetVersion(void) {{ return "2.0"; }}
Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *categories) {{ return OK; }}

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *folder, const void *functions, int visible, int logging) {{
  Law *law;
  if (type != 1 || strcmp(guid, GUID)) return 0; /* co-simulation of this unit only */
  law = (Law *)malloc(sizeof(Law));
  if (law) begin(law);
  return law;
}}

void fmi2FreeInstance(void *c) {{ free(c); }}
Status fmi2SetupExperiment(void *c, int toleranceDefined, double tolerance, double start, int stopDefined, double stop) {{
  ((Law *)c)->start = start;
  return OK;
}}
Status fmi2EnterInitializationMode(void *c) {{ return OK; }}
Status fmi2ExitInitializationMode(void *c) {{ return OK; }}
Status fmi2Terminate(void *c) {{ return OK; }}
Status fmi2Reset(void *c) {{ begin((Law *)c); return OK; }}

Status fmi2GetReal(void *c, const Reference *r, size_t n, double *value) {{
  size_t i;
  for (i = 0; i < n; ++i) {{
    double *at = place((Law *)c, r[i]);
    if (!at) return ERROR;
    value[i] = *at;
  }}
  return OK;
}}

Status fmi2SetReal(void *c, const Reference *r, size_t n, const double *value) {{
  size_t i;
  for (i = 0; i < n; ++i) {{
    double *at = place((Law *)c, r[i]);
    if (!at) return ERROR;
    *at = value[i];
  }}
  return OK;
}}

Status fmi2DoStep(void *c, double t, double h, int final) {{
  Law *law = (Law *)c;
  const double period = {law.name.upper()}_PERIOD;
  while (law->start + law->sample * period < t + h - 1e-9 * period) {{
    if ({law.name}_step(law->y, law->memory, law->u)) return ERROR;
    ++law->sample;
  }}
  return OK;
}}
Status fmi2CancelStep(void *c) {{ return ERROR; }}

{REFUSED}"""
