"""Writes the parts of the package that follow from other files.

    python generate.py            # writes them
    python generate.py --check    # fails where they are not current

`types.py` and `_async/api.py` follow from `openapi.yaml`: one class per schema, one method per
operation. `_sync/` follows from `_async/`: the same code without `async` and `await`.
Needs PyYAML.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional, Tuple

import yaml

HERE = Path(__file__).parent
PACKAGE = HERE / "src" / "volery"
OPENAPI = HERE.parent.parent / "openapi.yaml"

#: Repeating these does no more than doing them once, though they are POST.
REPEATABLE_POSTS = {
    "localize",
    "localize_in_maps",
    "render",
    "upload_images",
    "all_stop",
    "estimate",
}
#: A drone that is told late to fly must not be told at all: who repeats these does so knowingly.
SENT_ONCE = {"command_drone", "fly_to_target", "start_flight", "resume_flight"}
#: Spoken over the WebSocket, in `_async/socket.py`.
NOT_A_CALL = {"open_socket"}
#: What the variants of a union are called: its tag and this.
VARIANTS = {
    "AlignRequest": "Alignment",
    "DroneCommand": "Command",
    "ServerMessage": "Message",
    "ClientMessage": "Request",
}
#: Unions that stand in the file as part of these.
INNER_UNIONS = {"ServerBody", "ClientBody"}
#: What stands differently in `_async/` and `_sync/`.
WITHOUT_ASYNC = [
    (r"async def ", "def "),
    (r"async with ", "with "),
    (r"async for ", "for "),
    (r"\bawait ", ""),
    (r"\bAsyncIterator\b", "Iterator"),
    (r"\bAwaitable\[((?:[^][]|\[[^]]*\])*)\]", r"\1"),
    (r"\bAsyncGenerator\[([^]]*), None\]", r"Generator[\1, None, None]"),
    (r"\bAsyncGenerator\b", "Generator"),
    (r"\bAsync([A-Z])", r"\1"),
    (r"__aenter__", "__enter__"),
    (r"__aexit__", "__exit__"),
    (r"__aiter__", "__iter__"),
    (r"__anext__", "__next__"),
    (r"\b(a)(close|read|iter_bytes)\b", r"\2"),
    (r"websockets\.asyncio", "websockets.sync"),
    (r"\b_async\b", "_sync"),
]

Schema = Dict[str, Any]


class Writer:
    """Python from schemas."""

    def __init__(self, document: Schema) -> None:
        self.schemas: Dict[str, Schema] = document["components"]["schemas"]
        self.paths: Dict[str, Schema] = document["paths"]

    def type_of(self, schema: Optional[Schema]) -> str:
        """The annotation of a schema."""
        if not schema or not {"$ref", "oneOf", "anyOf", "type", "enum", "allOf"} & set(schema):
            return "Any"
        if "$ref" in schema:
            name = schema["$ref"].rsplit("/", 1)[1]
            return f"Page[{name[5:]}]" if name.startswith("Page_") else name
        for word in ("oneOf", "anyOf"):
            if word in schema:
                kinds = [self.type_of(s) for s in schema[word] if s.get("type") != "null"]
                joined = kinds[0] if len(kinds) == 1 else f"Union[{', '.join(kinds)}]"
                return f"Optional[{joined}]" if len(kinds) < len(schema[word]) else joined
        kind = schema.get("type")
        if isinstance(kind, list):
            not_null = [k for k in kind if k != "null"]
            return f"Optional[{self.type_of(dict(schema, type=not_null[0]))}]"
        if "enum" in schema:
            return f"Literal[{', '.join(map(json.dumps, schema['enum']))}]"
        if kind == "array":
            return f"Sequence[{self.type_of(schema.get('items'))}]"
        if kind == "object":
            values = schema.get("additionalProperties")
            return f"Dict[str, {self.type_of(values) if isinstance(values, dict) else 'Any'}]"
        return {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}[str(kind)]

    def fields(self, schema: Schema) -> Iterator[Tuple[str, Schema, bool]]:
        """Name, schema and need of each property."""
        if "$ref" in schema:
            yield from self.fields(self.schemas[schema["$ref"].rsplit("/", 1)[1]])
        for part in schema.get("allOf", []):
            yield from self.fields(part)
        for name, inner in schema.get("properties", {}).items():
            yield name, inner, name in schema.get("required", [])

    def dataclass(self, name: str, schema: Schema, more: Tuple[Schema, ...] = ()) -> str:
        """A class with one attribute per property."""
        lines: List[Tuple[bool, str]] = []
        fields = [field for part in (schema, *more) for field in self.fields(part)]
        for field, inner, required in fields:
            kind, default = self.type_of(inner), ""
            if field == "type" and "enum" in inner:
                default = f' = "{inner["enum"][0]}"'
            elif not required and kind.startswith("Sequence["):
                default = " = ()"
            elif not required or kind.startswith("Optional["):
                kind, default = (
                    kind if kind.startswith("Optional[") else f"Optional[{kind}]",
                    " = None",
                )
            text = f"    {field}: {kind}{default}\n"
            if inner.get("description") or "oneOf" in inner:
                text += docstring(description_of(inner), 4)
            lines.append((bool(default), text))
        names = {field for field, _, _ in fields}
        base = "Posed" if {"position", "orientation"} <= names else "Wire"
        body = "".join(text for _, text in sorted(lines, key=lambda line: line[0]))
        doc = docstring(schema.get("description") or f"`{name}`.", 4)
        return f"@dataclass(frozen=True)\nclass {name}({base}):\n{doc}\n{body}\n\n"

    def union(self, name: str, schema: Schema) -> str:
        """A class per variant and the name of them all."""
        more: Tuple[Schema, ...] = ()
        variants = schema.get("oneOf")
        if variants is None:
            inner, *rest = schema["allOf"]
            variants, more = self.schemas[inner["$ref"].rsplit("/", 1)[1]]["oneOf"], tuple(rest)
        text, names = "", []
        for variant in variants:
            fields = {field: inner for field, inner, _ in self.fields(variant)}
            tag = fields["type"]["enum"][0] if "type" in fields else variant["required"][0]
            names.append(camel(tag) + VARIANTS[name])
            text += self.dataclass(names[-1], variant, more)
        listed = ",\n    ".join(names)
        doc = docstring(schema.get("description", name), 0)
        return f"{text}{name} = Union[\n    {listed},\n]\n{doc}\n\n"

    def types(self) -> str:
        """`types.py`."""
        text = ""
        for name, schema in self.schemas.items():
            if name.startswith("Page_") or name in INNER_UNIONS:
                continue
            if name in VARIANTS:
                text += self.union(name, schema)
            elif "enum" in schema:
                doc = docstring(schema.get("description", name), 0)
                text += f"{name} = {self.type_of(schema)}\n{doc}\n\n"
            else:
                text += self.dataclass(name, schema)
        return HEAD + TYPES_HEAD + text.rstrip() + "\n"

    def method(self, verb: str, path: str, operation: Schema) -> str:
        """One method of `AsyncApi`."""
        name = operation["operationId"]
        first: List[str] = []
        later: List[str] = []
        query: List[str] = []
        headers: List[str] = []
        url, extra = path, []
        parameters = sorted(
            operation.get("parameters", []), key=lambda p: path.find(f"{{{p['name']}}}")
        )
        for parameter in parameters:
            spelled, place = parameter["name"], parameter["in"]
            kind = self.type_of(parameter["schema"])
            if place == "path":
                owner = path.split(f"/{{{spelled}}}")[0].rsplit("/", 1)[1]
                python = owner.rstrip("s") + "_id" if spelled == "id" else spelled
                first.append(f"{python}: {kind}")
                url = url.replace(f"{{{spelled}}}", f"{{quoted({python})}}")
                continue
            python = argument(spelled)
            typed = re.match(r"`(\w+)`.* as JSON", parameter.get("description", ""))
            kind = f"Optional[{typed.group(1)}]" if typed else kind
            later.append(
                f"{python}: {kind if kind.startswith('Optional') else f'Optional[{kind}]'} = None"
            )
            if spelled == "Idempotency-Key":
                unnamed = "" if name in SENT_ONCE else " or new_key()"
                extra.append(f"key=idempotency_key{unnamed}")
            elif place == "query":
                query.append(f'"{spelled}": {python}')
            else:
                headers.append(f'"{spelled}": {f"compact({python})" if typed else python}')
        content = operation.get("requestBody", {}).get("content", {})
        if "application/json" in content:
            kind = self.type_of(content["application/json"].get("schema"))
            if "application/zip" in content:
                kind = f"Union[{kind}, bytes]"
                headers.append(
                    '"Content-Type": "application/zip" if isinstance(body, bytes) else None'
                )
            if "text/csv" in content:
                kind = f"Union[{kind}, str]"
            first.append(f"body: {kind}")
            extra.append("body=body")
        elif content:
            first.append("data: bytes")
            raw = "application/octet-stream"
            kind = raw if raw in content else next(iter(content))
            extra.append("body=data")
            headers.insert(0, f'"Content-Type": "{kind}"')
        if name in REPEATABLE_POSTS:
            extra.append("repeatable=True")
        if name in SENT_ONCE:
            extra.append("repeatable=False")
        answers = operation["responses"]
        kinds: Schema = next(
            (answers[s].get("content", {}) for s in ("200", "201", "202") if s in answers), {}
        )
        result, cast = "None", "none"
        if set(kinds) == {"application/json", "text/html"}:
            later.append("html: bool = False")
            headers.append('"Accept": "text/html" if html else "application/json"')
            result, cast = "Any", "json_or_text"
        elif "application/json" in kinds:
            result = self.type_of(kinds["application/json"].get("schema"))
            result = result.replace("Sequence[", "List[")
            cast = f"json_of({result})"
        elif any(kind.startswith("text/") or kind.endswith("yaml") for kind in kinds):
            result, cast = "str", "text"
        elif kinds:
            result, cast = "bytes", "content"
        if query:
            extra.append(f"query={{{', '.join(query)}}}")
        if headers:
            extra.append(f"headers={{{', '.join(headers)}}}")
        signature = ", ".join(["self", *first, *(["*", *later] if later else [])])
        quote = "f" if "{" in url else ""
        call = ", ".join([f'"{verb.upper()}"', f'{quote}"{url}"', cast, *extra])
        doc = "\n\n".join(filter(None, [operation.get("summary"), operation.get("description")]))
        told = [p for p in parameters if p["in"] != "path" and p.get("description")]
        if told:
            doc += "\n\n" + "\n".join(
                f"* `{argument(p['name'])}`: {p['description']}" for p in told
            )
        doc += f"\n\n`{verb.upper()} {path}`"
        return (
            f"    async def {name}({signature}) -> {result}:\n{docstring(doc, 8)}"
            f"        return await self._http.call({call})\n\n"
        )

    def api(self) -> str:
        """`_async/api.py`."""
        text = HEAD + API_HEAD
        for path, operations in self.paths.items():
            for verb, operation in operations.items():
                if verb != "parameters" and operation["operationId"] not in NOT_A_CALL:
                    text += self.method(verb, path, operation)
        return text.rstrip() + "\n"


HEAD = "# Written by generate.py; changes here are lost.\n"

TYPES_HEAD = '''"""What the server takes and gives: one class per schema of `openapi.yaml`.

SI units, angles in radians. The frame `map` is right-handed with z up, a camera looks along z with
x right and y down, a body has x forward, y left, z up. Quaternions are w, x, y, z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Literal, Optional, Sequence, Union

from .geometry import Posed
from .wire import Wire

'''

API_HEAD = '''"""Every operation of the API, one method each."""

from __future__ import annotations

from typing import Any, Dict, List, Literal, Optional, Union

from ..types import *
from ..wire import Page, compact, content, json_of, json_or_text, new_key, none, quoted, text
from .http import AsyncHttp


class AsyncApi:
    """Every operation of the API, one method each, as `openapi.yaml` names them."""

    def __init__(self, http: AsyncHttp) -> None:
        self._http = http

'''


def argument(name: str) -> str:
    """`X-Image-Name` as `image_name`."""
    return re.sub("^x_", "", name.lower().replace("-", "_"))


def camel(name: str) -> str:
    """`stream.open` as `StreamOpen`."""
    return "".join(word[:1].upper() + word[1:] for word in re.split(r"[._]", name))


def description_of(schema: Schema) -> str:
    """The words for a property."""
    inner = [s.get("description", "") for s in schema.get("oneOf", [])]
    return str(schema.get("description") or " ".join(filter(None, inner)))


def docstring(words: str, indent: int) -> str:
    """Words as a docstring."""
    words = words.strip().replace("\\", "\\\\")
    if not words:
        return ""
    paragraphs = []
    for paragraph in words.split("\n\n"):
        is_list = paragraph.startswith("* ")
        parts = paragraph.split("\n") if is_list else [paragraph.replace("\n", " ")]
        hang = "  " if is_list else ""
        filled = [textwrap.fill(part, 96 - indent, subsequent_indent=hang) for part in parts]
        paragraphs.append("\n".join(filled))
    joined = "\n\n".join(paragraphs)
    if "\n" in joined or len(joined) > 90 - indent:
        joined += "\n"
    return textwrap.indent(f'"""{joined}"""\n', " " * indent)


def without_async(source: str) -> str:
    """The same code for callers that wait."""
    for pattern, replacement in WITHOUT_ASYNC:
        source = re.sub(pattern, replacement, source)
    if source.startswith(HEAD):
        return source
    return HEAD + source


def generated() -> Dict[Path, str]:
    """The files and what is in them."""
    writer = Writer(yaml.safe_load(OPENAPI.read_text(encoding="utf-8")))
    files = {PACKAGE / "types.py": writer.types(), PACKAGE / "_async" / "api.py": writer.api()}
    for source in sorted((PACKAGE / "_async").glob("*.py")):
        # The one file that is written twice by hand: tasks there, threads here.
        if source.name != "concurrency.py":
            text = files.get(source) or source.read_text(encoding="utf-8")
            files[PACKAGE / "_sync" / source.name] = without_async(text)
    return files


def main() -> int:
    """Writes or checks."""
    stale = 0
    for path, text in generated().items():
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        stale += 1
        if "--check" in sys.argv:
            print(
                f"{path.relative_to(HERE)} is not current: run `python generate.py`",
                file=sys.stderr,
            )
        else:
            path.write_text(text, encoding="utf-8")
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
