"""Models of other programs as the server takes them."""

from __future__ import annotations

import io
import json
import os
import zipfile
from pathlib import Path
from typing import Any, Dict, Union

#: A folder with COLMAP's files, a zip archive of it, or a `transforms.json`.
ModelSource = Union[str, "os.PathLike[str]"]

#: What tells poses; points are not needed.
COLMAP_FILES = ("cameras.bin", "images.bin", "cameras.txt", "images.txt")


def model_body(model: ModelSource) -> Union[Dict[str, Any], bytes]:
    """The document of nerfstudio, or an archive of COLMAP's files."""
    path = Path(model)
    if path.suffix == ".json":
        document: Dict[str, Any] = json.loads(path.read_text())
        return document
    if not path.is_dir():
        return path.read_bytes()
    files = [path / name for name in COLMAP_FILES if (path / name).is_file()]
    if not files:
        raise FileNotFoundError(f"{path} has none of {', '.join(COLMAP_FILES)}")
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in files:
            packed.write(file, file.name)
    return archive.getvalue()
