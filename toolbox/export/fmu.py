"""Machines and control laws as FMUs: the C of `toolbox.export_c` behind the interface that other simulators load.

Here stands the interface of a law (FMI 2.0, co-simulation), that of a machine in `toolbox.export.machine_fmu`.

Order at one instant, as in `simulate`: the law is sampled at start + k period and its outputs are held. A master sets the inputs, calls `fmi2DoStep(t, h)` and
then reads the outputs: every sample instant in [t, t + h) is computed with these inputs, so that communication steps of one period, or of a
whole part of it, sample the law as it was designed. At initialisation the outputs are what the law would drive with the inputs of that time; nothing is
sampled by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from toolbox.errors import SceneError
from toolbox.export.c_code import declared_c
from toolbox.export.fmu_archive import FOLDERS, REAL, compiler_here, fmu_archive, folder_here, refusing
from toolbox.export.law_text import Declared, c_paths
from toolbox.files.reading import TEXT, content
from toolbox.files.units import NumberOrText
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop


@sign_of_life("export_fmu is at work")
@takes_loop
def export_fmu(
    loop: ClosedLoop,
    path: str | Path,
    *,
    part: str | None = None,
    duration: NumberOrText | None = None,
    accuracy: float | None = None,
    version: str = "2.0",
    resources: Sequence[str | Path] = (),
) -> Path:
    """Write a sampled controller, or a plant with its controllers, as NAME.fmu for other simulators.

    **A controller** becomes a co-simulation unit of FMI 2.0.

    - Inputs: the measured signals and the set-points, with their defaults as start values.
    - Outputs: the actuated signals. The memory can be read.
    - Parameters: the gains, such as `law.proportional`. They may be changed at any time.

    **A loop**, or a plant without controllers, becomes a unit for co-simulation and for model exchange, of FMI 2.0 or
    3.0, around the C code of `export_c`.

    - Inputs and parameters, with units, bounds and start values, can be set at any time. States can be set at the
      start.
    - Outputs: all states and signals, and the mode of every contact as `<element>.mode`.
    - Co-simulation: every switch inside a communication step is located. An input that is set between two steps jumps
      at this time. In FMI 3.0 a step returns early at a switch if the importer requests it.
    - Model exchange: every guard is an event indicator. Samples of controllers and nodes of tables are time events. A
      rigid contact closes if its next flight would stay below a millionth of the widest gap. Friction in two directions
      is not possible.
    - Time begins at the start time of the importer.

    Names and units are the names and units of the signals. The file contains sources and licences. Calls that are not
    allowed, such as writing an output, are refused and reported to the logger of the importer. The machine code is for
    the present operating system, and also for Windows if mingw-w64 is installed.

    Parameters
    ----------
    loop
        A loop with one sampled controller. Or, for `part="loop"`, any loop or plant.
    path
        Path of the FMU file. Its name without suffix is the name of the unit.
    part
        "law" for the controller, or "loop". By default "law" if the loop has a controller, otherwise "loop".
    duration
        Time over which the accuracy of a loop is promised [s]. By default the duration of its scene. The unit can run
        on after it.
    accuracy
        Target for the global error of a loop in co-simulation, between 1e-13 and 0.1. By default the accuracy of its
        scene, else 1e-6.
    version
        Version of FMI for a loop, "2.0" (default) or "3.0".
    resources
        Paths of files that are added in `resources/`, such as the scene of the loop. By default none.

    Returns
    -------
    Path
        The path of the file.

    Raises
    ------
    SceneError
        If the name is not a valid name in C, the file cannot be written, there is no C compiler (`CC`, or `cc`), or the
        compiler fails. For a controller: if the loop does not contain exactly one `Sampled` with a `Controller`, or
        this controller is no casadi expression. For a loop: if it is stiff, or one of its controllers is no casadi
        expression.

    Examples
    --------
    >>> import zipfile
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, export_fmu
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="60 rpm"), "10 ms"))
    >>> path = export_fmu(loop, "drive.fmu")
    >>> print(zipfile.ZipFile(path).namelist().count("modelDescription.xml"), "model description")
    1 model description
    """
    import tempfile
    import uuid

    path = Path(path)
    c, _ = c_paths(path.with_suffix("") if path.suffix == ".fmu" else path)
    target, name = path.with_name(c.stem + ".fmu"), c.stem
    if part not in (None, "law", "loop"):
        raise SceneError(f'Argument `part` must be "law" or "loop", but it is {part!r}.')
    if version not in FOLDERS:
        raise SceneError(f'Argument `version` must be "2.0" or "3.0", but it is {version!r}.')
    along = {f"resources/{Path(each).name}": content(Path(each), TEXT) for each in resources}
    compiler_here()
    folder_here(version)
    if part == "loop" or (part is None and not loop.controllers):
        from toolbox.export.machine_fmu import written_unit  # here, because few programs need it

        return written_unit(loop, target, duration, accuracy, version, along)
    if duration is not None or accuracy is not None or version != "2.0":
        raise SceneError('Arguments `duration`, `accuracy` and `version` belong to `part="loop"`, but a law is written.')
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        law = declared_c(loop, folder / name)
        identity = uuid.uuid5(
            uuid.NAMESPACE_OID, (folder / f"{name}.c").read_text(encoding="utf-8") + (folder / f"{name}.h").read_text(encoding="utf-8")
        )
        (folder / f"{name}_fmi.c").write_text(_interface(law, f"{{{identity}}}"), encoding="utf-8")
        parts = sorted(folder.rglob("*.c"))
        listed = [each.relative_to(folder).as_posix() for each in parts]
        return fmu_archive(target, folder, parts, _description(law, f"{{{identity}}}", listed), flags=["-ffp-contract=off"], further=along)


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
    units = dict.fromkeys(str(row[1]) for row in (*law.reads, *law.actuated_signals, *law.memory, *law.gains))
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for word in units:
        ElementTree.SubElement(definitions, "Unit", name=word)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=repr(law.period))
    variables = ElementTree.SubElement(root, "ModelVariables")
    held = {"variability": "discrete"}
    rows: list[tuple[str, str, dict[str, str], float | None]] = [
        *((name, unit, {"causality": "input"}, value or 0.0) for name, unit, value in law.reads),
        *((name, unit, {"causality": "output"} | held, None) for name, unit in law.actuated_signals),
        *((f"memory.{name}", unit, {"causality": "local", "initial": "exact"} | held, 0.0) for name, unit in law.memory),
        *((name, unit, {"causality": "parameter", "variability": "tunable"}, value) for name, unit, value in law.gains),
    ]
    for reference, (label, unit, role, value) in enumerate(rows):
        variable = ElementTree.SubElement(variables, "ScalarVariable", {"name": label, "valueReference": str(reference), **role})
        ElementTree.SubElement(variable, "Real", {"unit": unit} | ({} if value is None else {"start": repr(float(value))}))
    structure = ElementTree.SubElement(root, "ModelStructure")
    for word in ("Outputs", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(structure, word)
        for i in range(len(law.actuated_signals)):
            ElementTree.SubElement(unknowns, "Unknown", index=str(len(law.reads) + i + 1))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


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


def _interface(law: Declared, guid: str) -> str:
    """The functions of FMI 2.0 around NAME_step: what is this law's own, and then `law_fmi2.c`."""
    name, gains = law.name, len(law.gains)
    defaults = ", ".join(repr(float(value or 0.0)) for _, _, value in law.reads) or "0.0"
    sizes = {"READS": len(law.reads), "DRIVES": len(law.actuated_signals), "MEMORY": len(law.memory), "GAINS": gains}
    step = f"{name}_step_with((law)->gains, " if gains else f"{name}_step("
    lines = [
        "#include <math.h>",
        "#include <stdlib.h>",
        "#include <string.h>",
        f'#include "{name}.h"',
        f'#define GUID "{guid}"',
        *[f"#define {word} {size}" for word, size in sizes.items()],
        f"#define PERIOD {name.upper()}_PERIOD",
        "#define SIZE(n) ((n) ? (n) : 1)",
        f"#define START(memory) {name}_start(memory)",
        f"#define GAINS_OF(gains) {f'{name}_gains(gains)' if gains else '(gains)[0] = 0.0'}",
        f"#define ALLOWED(gains) {f'{name}_allowed(gains)' if gains else '((void)(gains), 1)'}",
        f"#define NOT_FINITE {name.upper()}_NOT_FINITE",
        f"#define SAMPLE(law, memory) {step}(law)->y, memory, (law)->u)",
        f"static const double defaults[] = {{{defaults}}};",
        "",
        Path(__file__).with_name("law_fmi2.c").read_text(encoding="utf-8"),
        "/* what no law has */",
        *(refusing(*each) for each in REFUSED),
        "",
    ]
    return "\n".join(lines)
