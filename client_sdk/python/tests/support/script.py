"""Scripts as users run them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import IO, Any, Dict, List, Optional

from support.server import PATIENCE, Server, until

#: The folder of the Python package.
PACKAGE = Path(__file__).parents[2]


class Script:
    """A Python script that runs with the server."""

    def __init__(
        self,
        server: Server,
        log: Path,
        source: Path,
        *arguments: str,
        folder: Optional[Path] = None,
    ) -> None:
        environment: Dict[str, str] = server.environment()
        environment["PYTHONPATH"] = str(PACKAGE / "src")
        self.log = log
        self._out: IO[Any] = log.open("w")
        command: List[str] = [sys.executable, "-u", str(source), *arguments]
        self.process = subprocess.Popen(
            command, stdout=self._out, stderr=subprocess.STDOUT, env=environment, cwd=folder
        )

    def said(self) -> str:
        """What it said so far."""
        return self.log.read_text()

    def until_said(self, words: str) -> None:
        """Waits for words."""

        def look() -> bool:
            ended = self.process.poll() is not None
            assert words in self.said() or not ended, self.said()
            return words in self.said()

        until(look, f"the script says {words!r}", 2 * PATIENCE)

    def finish(self) -> str:
        """Waits for its end, which must be a good one, and gives what it said."""
        code = self.process.wait(3 * PATIENCE)
        assert code == 0, self.said()
        return self.said()
