"""What the documents tell their readers to type."""

from __future__ import annotations

import re
from typing import List, Tuple

from support.server import REPOSITORY

DOCUMENTS = [
    REPOSITORY / "README.md",
    *sorted((REPOSITORY / "docs").rglob("*.md")),
    *sorted((REPOSITORY / "client_sdk").rglob("README.md")),
]


def blocks(language: str) -> List[Tuple[str, str]]:
    """Code blocks of a language, each with its document and line."""
    found = []
    for document in DOCUMENTS:
        text = document.read_text()
        for match in re.finditer(rf"^```{language}\n(.*?)^```", text, re.S | re.M):
            line = text[: match.start()].count("\n") + 1
            found.append((f"{document.relative_to(REPOSITORY)}:{line}", match[1]))
    return found


def commands() -> List[str]:
    """Shell commands, in blocks and in sentences, in the order of the documents, each once."""
    found = []
    for _, block in blocks("sh"):
        lines = block.replace("\\\n", " ").splitlines()
        found += [re.sub(r"\s+#.*", "", line) for line in lines]
    for document in DOCUMENTS:
        sentences = re.sub(r"^```.*?^```", "", document.read_text(), flags=re.S | re.M)
        found += re.findall(r"`((?:volery|\./run)\s[^`]*)`", sentences)
    return list(dict.fromkeys(" ".join(command.split()) for command in found if command.strip()))
