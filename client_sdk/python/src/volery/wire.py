"""Between JSON and the classes of `types`."""

from __future__ import annotations

import dataclasses
import functools
import json
import struct
import sys
import typing
import uuid
from typing import Any, Callable, Dict, Generic, Optional, Sequence, Tuple, Type, TypeVar, Union
from urllib.parse import quote

import httpx

from .errors import Misunderstood

T = TypeVar("T")

#: First bytes of a binary frame, its version, and the kind that asks for the pose of an image.
_FRAME_MAGIC, _FRAME_VERSION, _IMAGE_QUERY = 0x5956, 1, 1


class Wire:
    """Something that goes over the wire."""

    def to_json(self) -> Dict[str, Any]:
        """As the server takes it: what is unknown is left out."""
        result: Dict[str, Any] = {}
        for field in dataclasses.fields(typing.cast(Any, self)):
            value = getattr(self, field.name)
            if not (_is_optional(field) and (value is None or _is_empty(value))):
                result[field.name] = plain(value)
        return result


@dataclasses.dataclass(frozen=True)
class Page(Generic[T]):
    """A part of a list."""

    items: Sequence[T]
    next_cursor: Optional[str] = None
    """Where the next page begins; `None` on the last."""


def _is_optional(field: Any) -> bool:
    return field.default is None or field.default == ()


def _is_empty(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 0


def plain(value: Any) -> Any:
    """Classes, tuples and arrays as JSON knows them."""
    if isinstance(value, Wire):
        return value.to_json()
    if isinstance(value, dict):
        return {str(key): plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return value


def compact(value: Any) -> Optional[str]:
    """JSON on one line, for a header."""
    return (
        None if value is None else json.dumps(plain(value), separators=(",", ":"), allow_nan=False)
    )


@functools.cache
def _hints(kind: Any) -> Dict[str, Any]:
    return typing.get_type_hints(kind, vars(sys.modules[kind.__module__]))


def decode(kind: Any, value: Any) -> Any:
    """JSON as a class of `types`. What this package does not know is passed over."""
    if kind is Any or value is None:
        return value
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is Union:
        kinds = [one for one in inner if one is not type(None)]
        return decode(kinds[0] if len(kinds) == 1 else _variant(kinds, value), value)
    if origin is Page:
        page = tuple(decode(inner[0], item) for item in value["items"])
        return Page(page, value.get("next_cursor"))
    if origin is dict:
        return {key: decode(inner[1], item) for key, item in value.items()}
    if origin is not None and origin is not typing.Literal:
        items = (decode(inner[0], item) for item in value)
        return list(items) if origin is list else tuple(items)
    if dataclasses.is_dataclass(kind):
        hints = _hints(typing.cast(Any, kind))
        known = {name: decode(hints[name], value[name]) for name in hints if name in value}
        return typing.cast(Any, kind)(**known)
    return value


def _variant(kinds: Sequence[Any], value: Any) -> Any:
    tag = value.get("type")
    for kind in kinds:
        if _hints(kind)["type"] == typing.Literal[tag]:
            return kind
    raise KeyError(f"type {tag!r}")


def understood(kind: Any, value: Any) -> Any:
    """`decode`, or an error that names what was not understood."""
    try:
        return decode(kind, value)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        name = getattr(kind, "__name__", str(kind))
        raise Misunderstood(f"an answer is no {name}: {error}") from error


def json_of(kind: Type[T]) -> Callable[[httpx.Response], T]:
    """Reads an answer as a class."""

    def read(answer: httpx.Response) -> T:
        try:
            value = answer.json()
        except ValueError as error:
            raise Misunderstood(f"an answer is no JSON: {error}") from error
        return typing.cast(T, understood(kind, value))

    return read


def json_or_text(answer: httpx.Response) -> Any:
    """Reads an answer as what it says it is."""
    return answer.json() if "json" in answer.headers.get("content-type", "") else answer.text


def text(answer: httpx.Response) -> str:
    """The words of an answer."""
    return answer.text


def content(answer: httpx.Response) -> bytes:
    """The bytes of an answer."""
    return answer.content


def none(answer: httpx.Response) -> None:
    """Nothing is answered."""


def quoted(value: Any) -> str:
    """A part of a path."""
    return quote(str(value), safe="")


def new_key() -> str:
    """Names a request, so that the server does it once however often it arrives."""
    return str(uuid.uuid4())


def image_frame(header: Wire, payload: bytes) -> bytes:
    """A binary frame that asks for the pose of an image: prefix, JSON header, pixels.

    The prefix is `magic u16 | version u8 | kind u8 | header_len u32`, little-endian.
    """
    words = json.dumps(header.to_json(), allow_nan=False).encode()
    return (
        struct.pack("<HBBI", _FRAME_MAGIC, _FRAME_VERSION, _IMAGE_QUERY, len(words))
        + words
        + payload
    )


def split_frame(frame: bytes) -> Tuple[int, Any, bytes]:
    """Kind, header and payload of a binary frame."""
    try:
        magic, version, kind, size = struct.unpack_from("<HBBI", frame)
        header = json.loads(frame[8 : 8 + size]) if len(frame) >= 8 + size else None
    except (struct.error, ValueError) as error:
        raise Misunderstood(f"a binary frame cannot be read: {error}") from error
    if (magic, version) != (_FRAME_MAGIC, _FRAME_VERSION) or header is None:
        raise Misunderstood("a binary frame is of another version or cut short")
    return kind, header, frame[8 + size :]
