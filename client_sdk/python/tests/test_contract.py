"""What the server answers to anything at all is what openapi.yaml says: no failure, no answer that
is not described. `VOLERY_LONG=1` tries more."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Iterator

import pytest
from support.room import Scan, camera
from support.server import REPOSITORY, Server

from volery.types import CreateCamera

CHECKS = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "response_headers_conformance",
]
#: How bytes are sent that are not JSON.
HOOKS = """
import schemathesis

@schemathesis.serializer("application/zip", "image/jpeg", "image/png", "application/octet-stream")
def as_they_are(context, value):
    return value if isinstance(value, bytes) else str(value).encode()
"""


@pytest.fixture(scope="module")
def other_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server of its own: what others need is not deleted."""
    server = Server(tmp_path_factory.mktemp("other") / "data")
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
        }
    return "".join(
        f'[[operations]]\ninclude-path-regex = "^/v1/{kind}/"\nexclude-method = "DELETE"\n'
        f'parameters = {{ "path.id" = "{known}" }}\n\n'
        for kind, known in ids.items()
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
    # It would end the token that is used.
    command += ["--exclude-operation-id", "delete_token"]
    environment = dict(os.environ, PYTHONPATH=str(tmp_path), SCHEMATHESIS_HOOKS="volery_hooks")
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2_000:]
    assert "panicked" not in other_server.log()
