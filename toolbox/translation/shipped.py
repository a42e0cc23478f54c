"""The machine code of all compiled loops as files that a wheel carries, for one kind of processor: `python -m toolbox.translation.shipped [FOLDER]`.

A file is named by a number of the text of LLVM, of the version of llvmlite and of the machine (`Compiled.shipped_name`), and begins with its checksum. Where
an installed package has no file of that name, because anything differs, the loop is compiled as in a source tree.
"""

from __future__ import annotations

import hashlib
import importlib
import sys
from pathlib import Path

from toolbox.files.atomic import replaced
from toolbox.translation.compiled import SHIPPED, Compiled, plain_processor

ROOT = Path(__file__).parents[2]


def compiled_loops() -> list[Compiled]:
    """All compiled loops of the packages, found by their text."""
    found: dict[str, Compiled] = {}
    for path in sorted(path for package in ("toolbox", "controllers") for path in (ROOT / package).rglob("*.py")):
        if "= Compiled(" in path.read_text(encoding="utf-8"):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            module = importlib.import_module(name)
            found |= {f"{name}.{word}": value for word, value in vars(module).items() if isinstance(value, Compiled)}
    return list({id(each): each for each in found.values()}.values())


def write(folder: Path) -> list[Path]:
    """Write the machine code of all loops into a folder, and nothing else: files of other texts go."""
    from toolbox.compilation.emitter import object_code

    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for loop in compiled_loops():
        code = object_code(loop.text, plain_processor())
        files.append(folder / loop.shipped_name)
        with replaced(files[-1]) as file:
            file.write(hashlib.sha256(code).digest() + code)
    for old in set(folder.glob("*.o")) - set(files):
        old.unlink()
    return files


if __name__ == "__main__":
    print("\n".join(map(str, write(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED))))
