"""Compiles the modules into a folder: a process of `build`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from gym_passive_walker.devices.web import code, container, page_data
from gym_passive_walker.devices.web.build import MODULES
from gym_passive_walker.engine.layout import NARROW, WIDE, Layout

_GIVEN = ("__linear_memory", "__stack_pointer", "__indirect_function_table")


_LAYOUTS = {"narrow": NARROW, "wide": WIDE}


def _object(
    name: str, texts: Sequence[str], exported: Sequence[str], layout: Layout | None = None
) -> bytes:
    made = code.wasm_object(texts, exported, layout)
    if strange := set(container.imports(made)) - set(_GIVEN):
        raise SystemExit(f"the module {name} needs {', '.join(sorted(strange))}")
    return made


def main(folder: Path, *names: str) -> None:
    """Write a module for each kind of walker, or the object file of a user's system.

    Args:
        folder: Where to write, and where the texts of the system are.
        names: Nothing, or the name of the system's layout, with which names of its files begin.
    """
    for name in names:
        texts = [part.read_text(encoding="utf-8") for part in sorted(folder.glob(f"{name}-*.ll"))]
        made = _object(name, texts, code.EXPORTED_OF_SYSTEM, _LAYOUTS[name])
        (folder / f"{name}.o").write_bytes(made)
    if names:
        return
    for kind in MODULES:
        made = _object(kind, code.of_kind(kind), code.EXPORTED)
        content = page_data.of_module(
            code.SYSTEMS_OF[kind], code.VARIANTS, container.data_end(made)
        )
        module = container.module(made, code.EXPORTED, {page_data.SECTION: content})
        (folder / f"{kind}.wasm").write_bytes(module)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
