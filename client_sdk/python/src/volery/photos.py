"""Photos on disk, and as arrays."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any, Iterable, List, Sequence, Tuple, Union

#: Files of a folder that are taken for photos.
SUFFIXES = {".jpg", ".jpeg", ".png"}
#: Photos and bytes of one request: an upload that breaks off loses little.
BATCH_FILES, BATCH_BYTES = 16, 32 * 1024 * 1024

Photos = Union[str, Path, Iterable[Union[str, Path]]]


def listed(photos: Photos) -> List[Path]:
    """The photos of a folder, by name, or those that are named."""
    if isinstance(photos, (str, Path)):
        path = Path(photos)
        if not path.is_dir():
            return [existing(path)]
        found = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())
        if not found:
            raise FileNotFoundError(f"{path} holds no photos ({', '.join(sorted(SUFFIXES))})")
        return found
    return [existing(Path(photo)) for photo in photos]


def existing(path: Path) -> Path:
    """A file that is there."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no photo {path}")
    return path


def batches(files: Sequence[Path]) -> List[List[Path]]:
    """Files in groups that one request holds."""
    groups: List[List[Path]] = []
    size = 0
    for file in files:
        bytes_of_file = file.stat().st_size
        if not groups or len(groups[-1]) >= BATCH_FILES or size + bytes_of_file > BATCH_BYTES:
            groups.append([])
            size = 0
        groups[-1].append(file)
        size += bytes_of_file
    return groups


def parts(files: Sequence[Path]) -> List[Tuple[str, Tuple[str, bytes]]]:
    """Files as the parts of a form."""
    return [("file", (file.name, file.read_bytes())) for file in files]


def encoded(image: Any) -> bytes:
    """The bytes of a photo: of a file, of an array, or as they are.

    An array is of uint8, height x width (gray) or height x width x 3 (RGB).
    """
    if isinstance(image, (bytes, bytearray, memoryview)):
        return bytes(image)
    if isinstance(image, (str, Path)):
        return existing(Path(image)).read_bytes()
    return png(image)


def png(pixels: Any) -> bytes:
    """An array of uint8, height x width (x 3, RGB), as PNG."""
    if str(pixels.dtype) != "uint8" or pixels.ndim < 2 or pixels.shape[2:] not in ((), (3,)):
        kind = f"{pixels.dtype} of shape {pixels.shape}"
        raise ValueError(f"pixels are uint8, h x w or h x w x 3, not {kind}")
    height, width = pixels.shape[:2]

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 0 if pixels.ndim == 2 else 2, 0, 0, 0)
    # Each row begins with its filter: none.
    rows = zlib.compress(b"".join(b"\0" + row.tobytes() for row in pixels))
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks
