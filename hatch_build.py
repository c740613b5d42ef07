"""The description of the package on an index: the README as it reads outside of the repository."""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


def portable(text: str) -> str:
    """Return a page in Markdown without pictures and links to the repository's own files.

    A package index resolves neither. The text of a link stays; the caption of a picture goes.
    """
    text = re.sub(r"!\[[^]]*\]\((?!https?:)[^)]*\)\n*(?:\*[^\n]*\*\n*)?", "", text)
    return re.sub(r"\[([^]]+)\]\((?!https?:)[^)]*\)", r"\1", text)


class Description(MetadataHookInterface):
    """Hook of Hatch that sets the field `readme`."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the description in the package's metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": portable(text)}
