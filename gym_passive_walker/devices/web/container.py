"""WebAssembly modules from LLVM's object files, without a linker.

An object file with all code in it is a module that imports its memory, table and stack pointer. It
lacks exports; the names of its functions are in its custom section "linking".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

_MAGIC = b"\0asm\1\0\0\0"
_CUSTOM, _IMPORT, _EXPORT, _START, _DATA = 0, 2, 7, 8, 11
_SYMBOLS, _FUNCTION, _UNDEFINED, _NAMED = 8, 0, 0x10, 0x40
_KINDS = {0: "function", 1: "table", 2: "memory", 3: "global"}


class _Reader:
    """Reads a section from its beginning."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def whole(self) -> int:
        """Read an unsigned number in LEB128."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    def taken(self, size: int) -> bytes:
        self.at += size
        return self.data[self.at - size : self.at]

    def name(self) -> str:
        return self.taken(self.whole()).decode()


def _whole(value: int) -> bytes:
    """Return an unsigned number in LEB128."""
    written = bytearray()
    while True:
        written.append((value & 127) | (128 if value > 127 else 0))
        value >>= 7
        if not value:
            return bytes(written)


def _named(name: str) -> bytes:
    return _whole(len(name.encode())) + name.encode()


def sections(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the sections of a module, each as its number and its content."""
    reader = _Reader(data)
    reader.at = len(_MAGIC)
    while reader.at < len(data):
        number = reader.byte()
        yield number, reader.taken(reader.whole())


def imports(data: bytes) -> list[str]:
    """Return the names of a module's imports."""
    found = []
    for number, content in sections(data):
        if number != _IMPORT:
            continue
        reader = _Reader(content)
        for _ in range(reader.whole()):
            reader.name()
            found.append(reader.name())
            kind = _KINDS[reader.byte()]
            if kind == "table":
                reader.byte()
            if kind in ("table", "memory"):
                if reader.byte() & 1:
                    reader.whole()
                reader.whole()
            elif kind == "global":
                reader.taken(2)
            else:
                reader.whole()
    return found


def _functions(linking: bytes) -> dict[str, int]:
    """Return the indices of an object file's functions by their names."""
    reader, found = _Reader(linking), {}
    reader.whole()
    while reader.at < len(linking):
        kind = reader.byte()
        part = _Reader(reader.taken(reader.whole()))
        if kind != _SYMBOLS:
            continue
        for _ in range(part.whole()):
            symbol, flags = part.byte(), part.whole()
            if symbol == 1:  # data
                part.name()
                if not flags & _UNDEFINED:
                    for _ in range(3):
                        part.whole()
            elif symbol == 3:  # a section
                part.whole()
            else:
                index = part.whole()
                if not flags & _UNDEFINED or flags & _NAMED:
                    name = part.name()
                    if symbol == _FUNCTION:
                        found[name] = index
    return found


def data_end(data: bytes) -> int:
    """Return the first address after a module's data."""
    end = 0
    for number, content in sections(data):
        if number != _DATA:
            continue
        reader = _Reader(content)
        for _ in range(reader.whole()):
            reader.taken(2)  # an active segment, and the instruction of its address
            address = reader.whole()
            reader.byte()
            size = reader.whole()
            reader.taken(size)
            end = max(end, address + size)
    return end


def module(data: bytes, exported: tuple[str, ...], notes: Mapping[str, bytes]) -> bytes:
    """Return a module from an object file.

    Args:
        data: The object file.
        exported: Names of the functions to export.
        notes: Content of custom sections by name.
    """
    parts = list(sections(data))
    linking = next(
        content[8:] for number, content in parts if number == _CUSTOM and content[1:8] == b"linking"
    )
    indices = _functions(linking)
    entries = b"".join(_named(name) + b"\0" + _whole(indices[name]) for name in exported)
    exports = _whole(len(exported)) + entries
    kept = [(number, content) for number, content in parts if number != _CUSTOM]
    # The number of data segments (section 12) stands before the code, exports before all of these.
    place = next(i for i, (number, _) in enumerate(kept) if number >= _START)
    kept.insert(place, (_EXPORT, exports))
    kept += [(_CUSTOM, _named(name) + content) for name, content in notes.items()]
    written = (bytes([number]) + _whole(len(content)) + content for number, content in kept)
    return _MAGIC + b"".join(written)
