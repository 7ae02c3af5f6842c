"""Everything that openapi.yaml promises is in the package, and what it says of errors is true."""

from __future__ import annotations

import dataclasses
import inspect
import socket
import subprocess
import sys
import typing
from pathlib import Path
from typing import Any, Dict, Iterator, Tuple

import pytest
import yaml
from support.server import REPOSITORY, Server

import volery
from volery import AsyncClient, Client, errors, types
from volery._async.api import AsyncApi
from volery._sync.api import Api
from volery.types import CreateToken, GotoCommand, ServerMessage

DOCUMENT: Dict[str, Any] = yaml.safe_load((REPOSITORY / "openapi.yaml").read_text())


def operations() -> Iterator[Tuple[str, str, Dict[str, Any]]]:
    """Method, path and description of every operation."""
    for path, methods in DOCUMENT["paths"].items():
        for method, operation in methods.items():
            if method != "parameters":
                yield method.upper(), path, operation


@pytest.mark.parametrize("api", [Api, AsyncApi])
def test_every_operation_is_a_method(api: Any) -> None:
    missing = []
    for method, path, operation in operations():
        name = operation["operationId"]
        if name == "open_socket":
            continue
        doc = inspect.getdoc(getattr(api, name, None)) or ""
        taken = inspect.signature(getattr(api, name)).parameters if doc else {}
        needed = [p["name"].lower().replace("-", "_") for p in operation.get("parameters", [])]
        absent = [
            n
            for n in needed
            if n != "id" and n.replace("x_", "", 1) not in taken and n not in taken
        ]
        if f"`{method} {path}`" not in doc or absent:
            missing.append((method, path, absent))
    assert not missing


def test_every_schema_is_a_class() -> None:
    generated = set(vars(types))
    schemas = {name for name in DOCUMENT["components"]["schemas"] if not name.startswith("Page_")}
    assert schemas - generated == {"ServerBody", "ClientBody"} & schemas
    for schema in schemas & generated:
        kind = getattr(types, schema)
        properties = DOCUMENT["components"]["schemas"][schema].get("properties")
        if properties and dataclasses.is_dataclass(kind):
            assert {field.name for field in dataclasses.fields(kind)} == set(properties), schema


def test_the_socket_knows_every_message() -> None:
    said = {
        variant["properties"]["type"]["enum"][0]
        for variant in DOCUMENT["components"]["schemas"]["ServerBody"]["oneOf"]
    }
    known = {kind.__dataclass_fields__["type"].default for kind in typing.get_args(ServerMessage)}
    assert known == said


def test_what_is_generated_is_current() -> None:
    script = Path(__file__).parents[1] / "generate.py"
    done = subprocess.run([sys.executable, str(script), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_faces_are_the_same() -> None:
    """What can be done with `await` can be done without."""
    for name in volery.__all__:
        if name.startswith("Async"):
            mine, other = getattr(volery, name), getattr(volery, name[5:])
            names = {n.replace("aclose", "close") for n in vars(mine) if not n.startswith("__")}
            assert names == {n for n in vars(other) if not n.startswith("__")}


def test_problems_are_errors(client: Client, server: Server) -> None:
    nothing = "00000000-0000-0000-0000-000000000000"
    with pytest.raises(errors.NotFound) as refused:
        client.map(nothing)
    assert (refused.value.code, refused.value.status) == ("not_found", 404)
    assert nothing in refused.value.detail and refused.value.title
    with pytest.raises(errors.Invalid) as invalid:
        client.api.create_token(CreateToken("t", "king"))  # type: ignore[arg-type]
    assert invalid.value.code
    with pytest.raises(errors.Unauthorized), Client(server.url, "wrong") as stranger:
        stranger.maps()
    with pytest.raises(errors.Unauthorized), Client(server.url, "wrong") as stranger:
        list(stranger.alerts())
    viewer = client.api.create_token(CreateToken("viewer", "viewer", 60))
    with pytest.raises(errors.Forbidden), Client(server.url, viewer.secret) as guest:
        guest.all_stop()


def test_a_server_that_is_absent_is_named() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{free.getsockname()[1]}"
    with Client(address) as client:
        with pytest.raises(errors.CannotConnect, match="volery serve"):
            list(client.alerts())
        with pytest.raises(errors.CannotConnect) as absent:
            client.api.command_drone(1, GotoCommand((0, 0, 1)))
    assert address in str(absent.value) and absent.value.hint
    with pytest.raises(ValueError, match="http://HOST:PORT"):
        Client("127.0.0.1:8420")


def test_the_service_speaks_of_itself(client: Client) -> None:
    assert client.info().capabilities.exports
    assert client.api.healthz().status == client.api.readyz().status == "ok"
    assert "openapi" in client.api.openapi_yaml()
    assert "volery" in client.api.front_page().lower()
    assert "volery_http_responses_total" in client.api.metrics()
    assert {model.model for model in client.api.camera_models()} >= {"PINHOLE", "OPENCV"}


def test_async_needs_a_loop_only_when_used() -> None:
    assert AsyncClient("http://127.0.0.1:1").server == "http://127.0.0.1:1"
