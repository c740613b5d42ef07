"""Compiles the modules into a folder: a process of `build`."""

from __future__ import annotations

import sys
from pathlib import Path

from gym_passive_walker.web import code, container, notes
from gym_passive_walker.web.build import KINDS

_GIVEN = ("__linear_memory", "__stack_pointer", "__indirect_function_table")


def main(folder: Path) -> None:
    """Write a module for each kind of walker."""
    for kind in KINDS:
        made = code.object_code(kind)
        if strange := set(container.imports(made)) - set(_GIVEN):
            raise SystemExit(f"the module {kind} needs {', '.join(sorted(strange))}")
        told = notes.of_module(code.KINDS[kind], code.VARIANTS, container.data_end(made))
        module = container.module(made, code.EXPORTED, {notes.SECTION: told})
        (folder / f"{kind}.wasm").write_bytes(module)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
