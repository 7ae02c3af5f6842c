"""Client of Volery: photos to metric maps, poses in them, drones that fly by them.

```python
from volery import Client, KnownDistance

with Client() as client:
    job = client.reconstruct("photos/", scale=KnownDistance("a.jpg", "b.jpg", 3.0))
    map = job.wait(progress=True)
    print(map.localize("photo.jpg").pose.matrix)
```

`AsyncClient` is the same with `async` and `await`. SI units, radians; the frame `map` has z up,
cameras look along z, quaternions are w, x, y, z: see `volery.geometry`.
"""

from . import errors, geometry, interop, types
from ._async.client import AsyncClient
from ._async.drones import AsyncCommand, AsyncDrone
from ._async.flights import AsyncFlight
from ._async.jobs import AsyncJob
from ._async.lease import AsyncLease
from ._async.maps import AsyncMap
from ._async.socket import AsyncStream
from ._sync.client import Client
from ._sync.drones import Command, Drone
from ._sync.flights import Flight
from ._sync.jobs import Job
from ._sync.lease import Lease
from ._sync.maps import Map
from ._sync.socket import Stream
from .errors import VoleryError
from .types import Camera, CameraPose, FlightGoal, Geofence, KnownDistance, Prior

__version__ = "0.1.0"

__all__ = [
    "AsyncClient",
    "AsyncCommand",
    "AsyncDrone",
    "AsyncFlight",
    "AsyncJob",
    "AsyncLease",
    "AsyncMap",
    "AsyncStream",
    "Camera",
    "CameraPose",
    "Client",
    "Command",
    "Drone",
    "Flight",
    "FlightGoal",
    "Geofence",
    "Job",
    "KnownDistance",
    "Lease",
    "Map",
    "Prior",
    "Stream",
    "VoleryError",
    "errors",
    "geometry",
    "interop",
    "types",
]
