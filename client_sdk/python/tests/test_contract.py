"""What the server answers to anything at all is what openapi.yaml says: no failure, no answer that
is not described. `VOLERY_LONG=1` tries more."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Iterator

import pytest
from support.room import Scan, camera
from support.server import REPOSITORY, Field, Server

from volery.types import CreateCamera, CreateUpload

CHECKS = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "response_headers_conformance",
]
#: System id of the drone that is there.
DRONE = 7
#: How bytes are sent that are not JSON, and whose token stays: the one that all is asked with.
HOOKS = """
import os
import uuid

import schemathesis

@schemathesis.hook
def before_call(context, case, kwargs):
    if case.operation.path == "/v1/tokens/{id}" and case.path_parameters:
        if str(case.path_parameters.get("id")).strip().lower() == os.environ["OWN_TOKEN"]:
            case.path_parameters["id"] = str(uuid.uuid4())

@schemathesis.serializer("application/zip", "image/jpeg", "image/png", "application/octet-stream")
def as_they_are(context, value):
    return value if isinstance(value, bytes) else str(value).encode()
"""


@pytest.fixture(scope="module")
def other_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server of its own, with a drone: what others need is not deleted."""
    server = Server(tmp_path_factory.mktemp("other") / "data")
    with Field(server, 1, first=DRONE):
        yield server
    server.stop()


def known_things(server: Server, photos: Scan) -> str:
    """A configuration by which operations meet things that are there."""
    with server.client() as client:
        job = client.reconstruct(
            photos.folder, camera=camera(), priors=photos.priors, preset="fast"
        )
        map = job.wait()
        imageset = job.info.request.imageset_ids[0]
        ids = {
            "maps": map.id,
            "jobs": job.id,
            "imagesets": imageset,
            "images": client.api.list_images(imageset).items[0].id,
            "cameras": client.api.create_camera(CreateCamera("known", camera())).id,
            "uploads": client.api.create_upload(CreateUpload(imageset, 9, "0" * 64)).id,
        }
    return "".join(
        f'[[operations]]\ninclude-path-regex = "^/v1/{kind}/"\nexclude-method = "DELETE"\n'
        f'parameters = {{ "path.id" = {json.dumps(known)} }}\n\n'
        for kind, known in [*ids.items(), ("drones", DRONE)]
    )


def test_every_answer_is_described(other_server: Server, photos: Scan, tmp_path: Path) -> None:
    pytest.importorskip("schemathesis")
    long = bool(os.environ.get("VOLERY_LONG"))
    (tmp_path / "volery_hooks.py").write_text(HOOKS)
    (tmp_path / "schemathesis.toml").write_text(known_things(other_server, photos))
    command = [sys.executable, "-m", "schemathesis.cli"]
    command += ["--config-file", "schemathesis.toml", "run", str(REPOSITORY / "openapi.yaml")]
    command += [
        "--url",
        other_server.url,
        "--header",
        f"Authorization: Bearer {other_server.token}",
    ]
    command += ["--checks", ",".join(CHECKS), "--seed", "1", "--continue-on-failure"]
    command += ["--request-timeout", "60", "--suppress-health-check", "all"]
    command += ["--max-examples", "100" if long else "3"]
    command += ["--phases", "coverage,fuzzing,stateful" if long else "fuzzing"]
    with other_server.client() as client:
        (own,) = [token.id for token in client.api.list_tokens().items if token.name == "first"]
    environment = dict(os.environ, PYTHONPATH=str(tmp_path), SCHEMATHESIS_HOOKS="volery_hooks")
    environment["OWN_TOKEN"] = own
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2_000:]
    assert "panicked" not in other_server.log()
