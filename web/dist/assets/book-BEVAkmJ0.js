const __vite__mapDeps=(i,m=__vite__mapDeps,d=(m.f||(m.f=["assets/routes-CPAqWyR6.js","assets/index-Cyv-LP05.js","assets/index-fZ4iakdh.css"])))=>i.map(i=>d[i]);
import{A as s,a as e,E as c,l as i,_ as h}from"./index-Cyv-LP05.js";const l="/assets/capture-circle-MgerOP_U.svg",p="/assets/capture-overlap-CWWkyFip.svg",m="/assets/frames-KOM5T_tv.svg",f="/assets/pixels-and-yaw-CPWTW6fs.svg",u=[l,p,m,f],g=t=>t.replace(/volery:picture-(\d+)/g,(o,a)=>u[a]),r=[{name:"capture",title:"How to photograph a room",html:`<h1 id="how-to-photograph-a-room">How to photograph a room</h1>
<p>A map is as good as its photos. Ten minutes of care here save an hour of guessing later.</p>
<h2 id="walk-a-circle-do-not-spin">Walk a circle, do not spin</h2>
<p><img src="volery:picture-0" alt="Turning on the spot gives no depth; a circle does" loading="lazy"></p>
<p>A camera that only turns sees all things from one place: nothing tells how far they are. Volery says so
(<code>no_parallax</code>) instead of inventing a map. Turn while you walk a circle of 0.3 m or more, or hover at three or
four points and turn at each. A drone on a tripod of air does the same: a small circle per stop.</p>
<ul>
<li><strong>Yaw steps:</strong> at most 15° from one photo to the next, so 24 photos for a full turn. Wide lenses may take 20°.</li>
<li><strong>Height:</strong> a second round half a meter higher or lower ties floor and ceiling to the walls.</li>
</ul>
<h2 id="overlap">Overlap</h2>
<p><img src="volery:picture-1" alt="Neighbors share more than half of the wall" loading="lazy"></p>
<p>Each thing should be in three photos or more. Along a wall, step sideways by less than half of what one photo
shows: at 3 m distance and a usual lens that is a meter. Come back to where you began, so that the way closes.</p>
<h2 id="light-and-sharpness">Light and sharpness</h2>
<ul>
<li>Stop and shoot, or move slower than 10°/s and 0.3 m/s. A blurred photo is used, with a warning
(<code>blurred_images</code>); it is left out only if it shows too little to hold on to (<code>blurred</code>).</li>
<li>Much light, no direct sun through one window. Lamps stay as they are from the first photo to the last.</li>
<li>Lock exposure, white balance, focus and zoom where the camera can. One lens per set.</li>
<li>Do not crop, turn or scale photos, and keep their EXIF.</li>
</ul>
<h2 id="what-cannot-be-seen">What cannot be seen</h2>
<p>Bare walls, glass, mirrors and moving people hold nothing to recognize. Hang up posters, put tape or tools where
walls are white (<code>too_few_features</code>), and cover large mirrors. Two corners that look the same are told apart by
something that only one of them has (<code>ambiguous</code>).</p>
<h2 id="scale-and-gravity">Scale and gravity</h2>
<p>Photos alone have no meters. Give one of these:</p>
<ul>
<li>the distance between the cameras of two photos, measured with a tape: <code>--known-distance a.jpg,b.jpg,3.0</code>;</li>
<li>the telemetry of a flight (attitude and height), or camera positions, as CSV;</li>
<li>afterwards, on the page of the map: the ruler between two places of known distance.</li>
</ul>
<p>Without it a map still localizes photos, but no drone is flown by it (<code>map_not_metric</code>).</p>
<h2 id="joining-rooms">Joining rooms</h2>
<p>Photograph the doorway from both sides, 10 photos through it. Two maps that share it become one
(<code>volery maps register</code>), and single photos can be added later (<code>volery maps extend</code>).</p>
<h2 id="is-it-good">Is it good?</h2>
<p>Open the map: every photo is green with its place, or red with its reason. A <code>suspect</code> verdict names the weak part.
Three to five photos between two parts that do not hold together usually mend it.</p>
`},{name:"safety",title:"Safety",html:`<h1 id="safety">Safety</h1>
<p>Volery tells drones where they are and where to go. It does not see people, and it is not a certified safety
system. Read this page before propellers turn.</p>
<h2 id="all-stop">All stop</h2>
<p>The red button is on every view. <strong>Shift+Space</strong>, or <strong>Escape twice</strong>, does the same; so does
<code>POST /v1/all-stop</code> with any pilot&#39;s token. It asks nothing and waits for nothing: drones in flight stay where they
are, motors on the ground go off. No lease is needed, and no queue lies before it. The page shows at once that it
was asked, and for each drone what it did. When it says that the stop did not arrive, use the remote controls.</p>
<p>Escape twice also works while you type; Shift+Space does not, because it is a space there.</p>
<h2 id="what-happens-by-itself">What happens by itself</h2>
<div class="wide" tabindex="0"><table><thead><tr><th>What fails</th><th>After</th><th>The drone</th></tr></thead><tbody><tr><td>no fresh pose (<code>pose_stale</code>), place lost, frozen camera</td><td>0.5 s</td><td>holds</td></tr><tr><td></td><td>1.5 s</td><td>lands</td></tr><tr><td>link to the drone silent (<code>link_lost</code>)</td><td>1 s</td><td>is told to hold</td></tr><tr><td></td><td>5 s</td><td>is told to land</td></tr><tr><td>lease of the pilot over (<code>lease_over</code>), or the socket closed that took it</td><td>at once</td><td>holds</td></tr><tr><td></td><td>30 s without another pilot</td><td>lands</td></tr><tr><td>pose jumps</td><td></td><td>is not passed on: as without a pose</td></tr><tr><td>pose elsewhere, announced by its source (<code>relocating</code>)</td><td>at once</td><td>holds until three poses agree</td></tr><tr><td>battery below 20 % (<code>battery_low</code>)</td><td>at once</td><td>lands</td></tr><tr><td>another drone too near (<code>too_close</code>)</td><td>at once</td><td>holds</td></tr><tr><td>somebody else took control (<code>not_in_control</code>)</td><td>at once</td><td>is left to them</td></tr></tbody></table></div>
<p>The gravest one counts. The journal of each drone (<code>GET /v1/drones/{id}/events</code>) keeps what happened.</p>
<p>What Volery cannot do once it is dead, or once the radio is, is left to the autopilot: <strong>set its failsafes</strong> for loss
of the ground station, of position and of battery before the first flight. They take seconds where the above takes
half a second; a drone without poses drifts meanwhile. So keep those seconds few: Volery says four times a second that
it is there, ArduPilot with <code>FS_GCS_TIMEOUT</code> 2 lands two seconds after the last word, PX4 with <code>COM_OF_LOSS_T</code> 1 after
one. <code>volery doctor --mavlink</code> names every parameter that is otherwise.</p>
<h2 id="limits">Limits</h2>
<ul>
<li>A pose older than 100 ms (<code>--max-pose-age-ms</code>), not finite, or further from where the drone&#39;s own motion can have
brought it than its errors explain, does not leave the service.</li>
<li>A plan is checked as a whole before anything flies: fence, speed, distances of all pairs at all times. One that
breaks a rule is refused with the rule, the drones, the time and the place. The page also compares the way with the
free space of the map.</li>
<li>A fence is where drones may be; without one, flights keep 0.5 m inside the bounds of the map.</li>
<li>A map without meters flies nobody.</li>
<li>The service pulls cameras from the hosts of <code>--camera-host</code> only, over HTTP that nobody encrypts or signs: who can
answer in the place of a camera can show it anything. A picture that was frozen, or is of elsewhere, is dealt with as
above; a false picture that fits is not. Keep cameras on a network of your own.</li>
<li>Separation: 1 m unless you say otherwise; heights count half, because of downwash.</li>
</ul>
<h2 id="what-volery-cannot-know">What Volery cannot know</h2>
<ul>
<li><strong>Anything that came after the photos.</strong> People, doors, ladders and cables are not in the map. The free space is
what the photos showed as empty then.</li>
<li><strong>Thin or clear things:</strong> wires, nets, glass. They leave no points.</li>
<li><strong>Wind, payload, a damaged propeller.</strong> Only the autopilot feels them.</li>
<li><strong>Drones that it does not hear</strong>, and those of other ground stations.</li>
<li><strong>How far your radio reaches</strong> where you have not flown yet.</li>
</ul>
<h2 id="before-each-flight">Before each flight</h2>
<ol>
<li>People out of the room, or behind a net. Remote control in hand, its takeover tried.</li>
<li>Every drone is <code>linked</code>, its pose fresh, its battery above what the flight needs.</li>
<li>The view from the drone on the page looks like what is before it.</li>
<li>The fence is drawn and leaves out what the photos did not show.</li>
<li>One drone first, low and slow; then the group.</li>
<li>Somebody does nothing but watch, with a finger near Shift+Space.</li>
</ol>
<p>MAVLink is signed (<code>--mavlink-key</code>); <code>--insecure-mavlink</code> takes the word of whoever reaches the port. The page and
the API belong on a network of your own, behind TLS where others are near.</p>
`},{name:"frames-and-units",title:"Frames and units",html:`<h1 id="frames-and-units">Frames and units</h1>
<p>One page of law. Every pose that leaves Volery names its frame; every transform is named
<code>b_from_a</code> and used as <code>x_in_b = b_from_a * x_in_a</code>, so that products chain by equal neighbors.</p>
<h2 id="frames">Frames</h2>
<p><img src="volery:picture-2" alt="The axes of all frames" loading="lazy"></p>
<div class="wide" tabindex="0"><table><thead><tr><th>frame</th><th>axes</th><th>where</th></tr></thead><tbody><tr><td><code>map</code></td><td>right-handed, <strong>z up</strong> (against gravity), x = forward vector (yaw of the last mapping image, levelled), y left</td><td>all positions and poses in JSON, <code>poses.csv</code>, PLY, COLMAP files</td></tr><tr><td><code>camera</code></td><td>x right, y down, z forward (through the lens)</td><td>poses of images</td></tr><tr><td><code>body</code></td><td>forward, left, up</td><td>drones, in the API</td></tr><tr><td>local NED</td><td>x = map x, y = −map y, z = −map z, turned by the alignment heading</td><td>only towards an autopilot</td></tr><tr><td>glTF</td><td>y up, z forward, x left; vertices stay in map coordinates, the root node turns them</td><td><code>map.glb</code></td></tr></tbody></table></div>
<p>The origin of <code>map</code> is the position of the last mapping camera (<code>last_camera</code>), the mean of all
camera positions (<code>mean_cameras</code>), or whatever frame the given positions had (<code>given</code>).</p>
<p>Changes of frame are named functions in <code>vision/geometry/src/frames.rs</code>, those between map and drone in
<code>flight/src/frames.rs</code>; there are no stray minus signs elsewhere.</p>
<h2 id="pixels-and-yaw">Pixels and yaw</h2>
<p><img src="volery:picture-3" alt="Corners of pixels at integers; yaw counter-clockwise from x" loading="lazy"></p>
<p>Corners are at integers: the center of the first pixel is (0.5, 0.5), as in COLMAP. Calibrations in
OpenCV&#39;s convention (center of the first pixel at (0, 0)) need +0.5 on <code>cx, cy</code>. A <code>camera.json</code> with
a <code>distortion</code> object is read as OpenCV&#39;s; <code>&quot;pixel_center&quot;: 0</code> or <code>0.5</code> says it outright.</p>
<h2 id="attitude-from-telemetry">Attitude from telemetry</h2>
<p><code>yaw_deg</code>: heading clockwise from north (+y of the telemetry frame); <code>pitch_deg</code>: nose up;
<code>roll_deg</code>: right side down; <code>height_m</code>: up. The camera looks along the nose. All three angles or none
count. <code>x_m</code>, <code>y_m</code>, <code>z_m</code>: where the camera was, in a frame with z up that the map then keeps.</p>
<h2 id="units">Units</h2>
<p>SI and radians. Anything else carries its suffix (<code>_deg</code>, <code>_px</code>, <code>_ms</code>, <code>t_ns</code>). Quaternions are
Hamilton, w first. In JSON unknown numbers are <code>null</code>; NaN and infinity never leave.</p>
<h2 id="metric-or-not">Metric or not</h2>
<p>A monocular reconstruction has no scale. A map states <code>scale: {metric, source, sigma_rel}</code> and
<code>gravity: {source, sigma}</code>. While <code>metric</code> is <code>false</code>, lengths are in an arbitrary unit: such a map
localizes images, but no drone may be flown by it.</p>
`},{name:"api",title:"The API",html:`<h1 id="the-api">The API</h1>
<p>Everything that the page and the command line do goes over HTTP and one WebSocket. The contract is
<a href="/docs/routes"><code>openapi.yaml</code></a>, served at <code>/openapi.yaml</code>; the page shows it under Docs, Routes. Rust and Python
clients are in <code>client_sdk/</code>.</p>
<h2 id="rules">Rules</h2>
<ul>
<li><strong>Tokens:</strong> <code>Authorization: Bearer vly_…</code>; a browser&#39;s socket names the subprotocol <code>bearer.vly_…</code>. Roles:
<code>viewer</code> looks, <code>mapper</code> makes maps, <code>pilot</code> flies, <code>admin</code> makes tokens.</li>
<li><strong>Failures</strong> are <code>application/problem+json</code> with <code>code</code> (stable), <code>detail</code> and <code>hint</code>: <a href="/docs/errors">all codes</a>.</li>
<li><strong>Unknown fields</strong> are refused: a typing error in a command of a drone must not pass.</li>
<li><strong>Long work</strong> is a job: <code>202</code>, <code>Location</code>, then <code>GET /v1/jobs/{id}</code> or the socket.</li>
<li><strong><code>Idempotency-Key</code></strong> on a POST that makes or commands something: sent again, it is done once. Image sets, cameras,
uploads, jobs, registrations, aligned versions and leases are known by their keys as long as they exist. Answers to
commands of drones, targets, flights, recordings, and to <code>cancel</code>, <code>retry</code>, <code>activate</code> are remembered (the newest
16 MiB of them, until the service ends) and given again with <code>Idempotency-Replayed: true</code>. What was refused did
nothing and is asked anew. <code>POST /v1/all-stop</code> needs no key; <code>POST /v1/tokens</code> takes none, for no secret is kept.</li>
<li><strong>Lists</strong> of image sets, their images, cameras, jobs, maps, their versions, tokens and the audit come in pages:
<code>?limit=&amp;cursor=</code>, <code>next_cursor</code>. Those of drones, leases, recordings, flights and geofences come whole, the last two
as bare arrays. Events of a job or a drone go on with <code>?after=</code>, the <code>seq</code> of the last one.</li>
<li><strong>Files</strong> have <code>ETag</code> and <code>Range</code>.</li>
<li><strong>Who did what when:</strong> <code>GET /v1/audit</code>, for admins.</li>
<li><strong>Units</strong> are SI and radians; frames are in <a href="/docs/frames-and-units">frames and units</a>. Unknown numbers are <code>null</code>.</li>
</ul>
<h2 id="photos-to-a-map">Photos to a map</h2>
<p>Upload files as a form to <code>/v1/imagesets/{id}/images</code>, then start a job.</p>
<pre tabindex="0"><code>POST /v1/imagesets
{ "name": "hall, first floor" }</code></pre>
<pre tabindex="0"><code>POST /v1/jobs
{
  "kind": "reconstruct",
  "imageset_ids": ["00000000-0000-0000-0000-000000000001"],
  "preset": "balanced",
  "map_name": "Hall",
  "known_distances": [{ "image_a": "a.jpg", "image_b": "b.jpg", "meters": 3.0 }]
}</code></pre>
<p>A zip archive may come in parts, which a broken connection or a new start of the server does not undo: begin it,
<code>PATCH</code> the parts one after another with the header <code>Upload-Offset</code>, ask with <code>GET</code> where to go on, and end with
<code>POST /v1/uploads/{id}/complete</code>. <code>volery upload photos.zip</code> does it.</p>
<pre tabindex="0"><code>POST /v1/uploads
{
  "imageset_id": "00000000-0000-0000-0000-000000000001",
  "size": 12800000,
  "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
}</code></pre>
<p><code>preset</code> is a set of numbers; <code>GET /v1/presets</code> tells them, <code>GET /v1/options</code> their ranges, and <code>options</code> sets some
otherwise: <code>&quot;options&quot;: { &quot;max_features&quot;: 4000 }</code>. A job tells its <code>stages</code> with what of them was found finished
(<code>cached</code>), and <code>warnings</code>. <code>POST /v1/jobs/{id}/retry</code> goes on with a job that ended without a whole map;
<code>?from_stage=mapping</code> does that stage and all after it anew.</p>
<h2 id="a-photo-to-a-pose">A photo to a pose</h2>
<p><code>POST /v1/maps/{id}/localize</code> takes the bytes of a photo and answers <code>ok</code> with pose and covariance, <code>ambiguous</code>, or
<code>not_found</code> with a reason. A photo without a place is no failure of HTTP.</p>
<h2 id="a-drone">A drone</h2>
<pre tabindex="0"><code>PUT /v1/drones/1
{
  "name": "Wren",
  "body_from_camera": { "position": [0.05, 0, 0], "orientation": [0.5, -0.5, 0.5, -0.5] }
}</code></pre>
<p><code>PATCH</code> changes what it names and keeps the rest, also a signing key.</p>
<p>Its estimator lives on poses, at least ten a second: from a stream of its camera, or from a tracker of yours.</p>
<pre tabindex="0"><code>POST /v1/drones/1/pose
{ "position": [1.2, 0.4, 1.0], "orientation": [1, 0, 0, 0], "age_ms": 20, "position_sd": 0.02, "angle_sd": 0.02 }</code></pre>
<pre tabindex="0"><code>POST /v1/drones/1/commands
{ "type": "takeoff", "height": 1.0 }</code></pre>
<pre tabindex="0"><code>POST /v1/drones/1/commands
{ "type": "goto", "position": [2.0, 1.0, 1.2], "yaw": 1.57 }</code></pre>
<p>A command is <code>accepted</code>, <code>sent</code>, <code>executing</code>, then <code>done</code>, <code>rejected</code>, <code>timed_out</code> or <code>superseded</code>:
<code>GET /v1/drones/{id}/commands/{command}</code>, or topic <code>drone:1</code>.</p>
<p><strong>At the goal</strong> a frame tells exactly where the drone is: <code>POST /v1/drones/1/frames?map_id=…</code> with the bytes of a
picture (and the header <code>X-Camera</code>) answers the pose by the features of that frame alone, how far the drone&#39;s own
estimate was from it (<code>correction_m</code>), and how far it is from the goal (<code>goal_distance_m</code>). A fresh pose that can be
true also goes to the drone. With <code>&amp;extend=true</code> the frame joins the map: <code>job_id</code> names the job.</p>
<p><strong>A camera that serves motion JPEG</strong> over HTTP, as an ESP32-CAM does, is pulled by the service itself, if its option
<code>--camera-host</code> names the host: by name, by address, or by a network such as <code>192.168.4.0/24</code>. What a stream with
<code>track</code> does with frames is done with its pictures: topic <code>pose:1</code>, and with <code>feed</code> the drone&#39;s estimator. In Python it
is <code>client.api.put_drone_camera(1, PutDroneCamera(url, map.id, camera, feed=True))</code>.</p>
<pre tabindex="0"><code>PUT /v1/drones/1/camera
{
  "url": "http://192.168.4.17:81/stream",
  "map_id": "00000000-0000-0000-0000-000000000002",
  "camera": { "model": "PINHOLE", "width": 640, "height": 480, "params": [457, 457, 320, 240] },
  "feed": true
}</code></pre>
<p><code>GET</code> tells how it goes: <code>state</code> (<code>connecting</code>, <code>streaming</code>, <code>failed</code>), <code>frames</code>, <code>rate_hz</code>, <code>last_frame_age_ms</code>,
<code>last_error</code>. A camera that is gone is tried again, after a quarter of a second at first, and a new start of the
service goes on with it; <code>DELETE</code> ends it. <code>X-Timestamp</code> of a picture, seconds of the camera&#39;s clock, is taken as the
time it was taken at, the fastest picture of the last minute as one that came at once; without it that is when its
first byte came.</p>
<p><strong>What it sees:</strong> <code>GET /v1/drones/1/frame</code> is the newest picture of its camera as it came, with <code>ETag</code> and
<code>X-Frame-Age-Ms</code>.</p>
<p><strong>A flight is recorded</strong> from a start to a stop, everything that the drone&#39;s link sends and receives:</p>
<pre tabindex="0"><code>POST /v1/recordings
{ "drone": 1 }</code></pre>
<p><code>POST /v1/recordings/{id}/stop</code> ends it, <code>GET /v1/recordings</code> lists all, <code>GET /v1/recordings/{id}</code> is the telemetry
log (<code>.tlog</code>), as ground stations and pymavlink read it. <code>volery replay flight.tlog</code> sends what the drone said to a
service once more, and the page shows the flight again; give that service a data folder of its own, and
<code>--insecure-mavlink</code>, for signatures are never taken twice.</p>
<h2 id="a-group">A group</h2>
<p>Drones are held by a lease that has to be renewed; when it is over they hold.</p>
<pre tabindex="0"><code>POST /v1/leases
{ "drones": [1, 2], "ttl_ms": 1000 }</code></pre>
<p>Over the socket <code>/v1/ws</code> the same is <code>{&quot;type&quot;: &quot;lease&quot;, &quot;drones&quot;: [1, 2], &quot;ttl_ms&quot;: 1000}</code>, answered by <code>leased</code>, kept
by <code>lease.renew</code> and ended by <code>lease.release</code>, both with <code>lease_id</code>. Such a lease ends with its socket, too: the drones
hold at once, not when the time is over.</p>
<pre tabindex="0"><code>PUT /v1/geofences
{
  "map_id": "00000000-0000-0000-0000-000000000002",
  "area": { "outline": [[0, 0], [10, 0], [10, 8], [0, 8]], "floor": 0, "ceiling": 3 },
  "keep_out": [{ "outline": [[4, 4], [5, 4], [5, 5], [4, 5]], "floor": 0, "ceiling": 3 }],
  "margin_m": 0.4
}</code></pre>
<pre tabindex="0"><code>POST /v1/flights
{
  "map_id": "00000000-0000-0000-0000-000000000002",
  "drones": [
    { "id": 1, "start": { "position": [1, 1, 1.2] }, "goals": [{ "position": [8, 6, 1.2] }] },
    { "id": 2, "goals": [{ "position": [8, 2, 1.2], "yaw": 3.14 }] }
  ],
  "separation_m": 1.0
}</code></pre>
<p>Nothing flies by that: the answer is the plan, checked. <code>POST /v1/flights/{id}/start</code>, <code>pause</code>, <code>resume</code> and <code>abort</code>
do what they say, and <code>POST /v1/all-stop</code> stops everybody.</p>
<h2 id="the-socket">The socket</h2>
<p><code>GET /v1/ws</code>. One socket, many topics: <code>jobs</code>, <code>job:&lt;id&gt;</code>, <code>pose:&lt;drone&gt;</code>, <code>drone:&lt;drone&gt;</code>, <code>flights</code>,
<code>flight:&lt;id&gt;</code>, <code>alerts</code>; <code>*</code> in place of a drone means all.</p>
<pre tabindex="0"><code>SEND subscribe
{ "type": "subscribe", "topic": "drone:*", "id": "a1" }</code></pre>
<pre tabindex="0"><code>RECEIVE alert
{
  "type": "alert", "topic": "alerts", "t_ns": 1700000000000000000,
  "alert": { "drone": 1, "t_ns": 1700000000000000000, "code": "pose_stale", "detail": "holds" }
}</code></pre>
<p>Frames of a camera go up as binary messages; <code>FrameHeader</code> in <code>openapi.yaml</code> says how.</p>
`},{name:"errors",title:"Error codes",html:`<h1 id="error-codes">Error codes</h1>
<p>Every failure of the API is <code>application/problem+json</code> with a stable <code>code</code>. The codes below are all there are: a
test compares this list with the source. Where no status stands, the code comes inside of an answer: of a job, a
file of an upload, a photo or an alert.</p>
<h2 id="requests">Requests</h2>
<p>What any request may be answered with. <code>title</code>, <code>detail</code> and <code>hint</code> are for people, <code>code</code> is for programs and stays.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>bad_request</code></td><td>400</td><td>The request cannot be read: its address, a header or its JSON.</td></tr><tr><td><code>unauthorized</code></td><td>401</td><td>No token, or one that is not valid.</td></tr><tr><td><code>token_expired</code></td><td>401</td><td>The time of the token is over: ask an admin for a new one.</td></tr><tr><td><code>too_many_failures</code></td><td>429</td><td>Too many wrong tokens from this address: wait as <code>Retry-After</code> says.</td></tr><tr><td><code>forbidden</code></td><td>403</td><td>The role of the token is too low: <code>viewer</code> &lt; <code>mapper</code> &lt; <code>pilot</code> &lt; <code>admin</code>.</td></tr><tr><td><code>not_found</code></td><td>404</td><td>There is no such thing.</td></tr><tr><td><code>no_such_route</code></td><td>404</td><td>There is no such route: see <code>openapi.yaml</code>.</td></tr><tr><td><code>method_not_allowed</code></td><td>405</td><td>The route does not know this method.</td></tr><tr><td><code>request_timeout</code></td><td>408</td><td>The body came too slowly.</td></tr><tr><td><code>too_large</code></td><td>413</td><td>The body, the file, or a number of things is above a limit of <code>/v1/info</code>.</td></tr><tr><td><code>unsupported_media_type</code></td><td>415</td><td>The body is of another type than the route takes.</td></tr><tr><td><code>range_not_satisfiable</code></td><td>416</td><td>The range lies outside of the file.</td></tr><tr><td><code>upgrade_required</code></td><td>426</td><td>The route opens sockets only.</td></tr><tr><td><code>invalid_body</code></td><td>422</td><td>The JSON does not fit the route; <code>detail</code> names the place.</td></tr><tr><td><code>invalid_query</code></td><td>422</td><td>The query of the address does not fit the route; <code>detail</code> says why.</td></tr><tr><td><code>unknown_field</code></td><td>422</td><td>A field that the route does not know: a typing error, most often.</td></tr><tr><td><code>bad_cursor</code></td><td>422</td><td>The cursor is not one that was answered.</td></tr><tr><td><code>bad_limit</code></td><td>422</td><td><code>limit</code> is out of its range.</td></tr><tr><td><code>bad_name</code></td><td>422</td><td>The name is empty or too long.</td></tr><tr><td><code>bad_state</code></td><td>422</td><td>There is no such state to look for.</td></tr><tr><td><code>bad_level</code></td><td>422</td><td>There is no such level of the log.</td></tr><tr><td><code>bad_kind</code></td><td>422</td><td>There is no such kind of job, or it lacks what it needs.</td></tr><tr><td><code>bad_expiry</code></td><td>422</td><td>The token would end in the past or too late.</td></tr><tr><td><code>bad_idempotency_key</code></td><td>422</td><td>The key is empty, too long, or has odd characters.</td></tr><tr><td><code>idempotency_key_reused</code></td><td>409</td><td>The same key came with another body: make a new key.</td></tr><tr><td><code>internal</code></td><td>500</td><td>A defect of the service; its log says why.</td></tr><tr><td><code>disk_full</code></td><td>507</td><td>The disk is full: make room. Jobs wait for it, and go on by themselves.</td></tr><tr><td><code>worker_busy</code></td><td>503</td><td>Too many requests wait for a process that works: come again as <code>Retry-After</code> says.</td></tr><tr><td><code>worker_died</code></td><td>503</td><td>The process that worked on the request died: send it once more, then another picture.</td></tr><tr><td><code>worker_timeout</code></td><td>503</td><td>The process that worked on the request took too long: send less, or when there is less to do.</td></tr><tr><td><code>worker_missing</code></td><td>503</td><td>The process that works could not be started: see the log, and <code>volery doctor</code>.</td></tr></tbody></table></div>
<h2 id="photos-and-uploads">Photos and uploads</h2>
<p>Answered for each file: the others of the same upload are kept. A photo that is a request by itself, as the picture of a
query, is refused with these and 422.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>no_files</code></td><td>422</td><td>The form holds no files.</td></tr><tr><td><code>empty_file</code></td><td>422</td><td>The file holds nothing.</td></tr><tr><td><code>not_an_image</code></td><td></td><td>Neither JPEG nor PNG, whatever its name says.</td></tr><tr><td><code>truncated</code></td><td></td><td>The file ends too early: upload it again.</td></tr><tr><td><code>damaged</code></td><td></td><td>The bytes cannot be decoded.</td></tr><tr><td><code>unsupported</code></td><td></td><td>A kind of JPEG or PNG that is not read, as CMYK or 12 bits.</td></tr><tr><td><code>name_taken</code></td><td></td><td>The set has another image of this name: rename the file.</td></tr><tr><td><code>imageset_full</code></td><td></td><td>The set holds as many images as it may: begin another one.</td></tr><tr><td><code>bad_size</code></td><td>422</td><td>No such size of a thumbnail.</td></tr><tr><td><code>bad_hash</code></td><td>422</td><td>The SHA-256 of an upload is not 64 lower-case hex digits.</td></tr><tr><td><code>wrong_offset</code></td><td>409</td><td>The part does not begin where the upload ends: <code>GET</code> it and go on at its <code>offset</code>.</td></tr><tr><td><code>upload_busy</code></td><td>409</td><td>Another request works on the upload, maybe one whose connection broke: come again.</td></tr><tr><td><code>upload_incomplete</code></td><td>409</td><td>Parts of the upload are missing.</td></tr><tr><td><code>upload_finished</code></td><td>409</td><td>The photos of the upload are in their set.</td></tr><tr><td><code>wrong_hash</code></td><td>422</td><td>What came is not the file that was announced: delete the upload and begin again.</td></tr><tr><td><code>too_many_uploads</code></td><td>429</td><td>Too many uploads are under way: come again as <code>Retry-After</code> says.</td></tr><tr><td><code>unsafe_name</code></td><td></td><td>A path in the archive would leave its folder.</td></tr><tr><td><code>archive_link</code></td><td></td><td>The archive holds a link.</td></tr><tr><td><code>archive_ratio</code></td><td></td><td>The archive unpacks to far more than it is.</td></tr><tr><td><code>archive_entry_unreadable</code></td><td></td><td>A file of the archive cannot be unpacked.</td></tr><tr><td><code>bad_camera</code></td><td>422</td><td>The intrinsics make no sense: size, number or range of the parameters.</td></tr><tr><td><code>unknown_camera</code></td><td>404, 422</td><td>No camera of this id; for a query, nothing is known of its lens: name a camera.</td></tr><tr><td><code>camera_size_mismatch</code></td><td></td><td>The photo has another size or shape than its camera.</td></tr><tr><td><code>several_cameras</code></td><td></td><td>The photos are of several cameras where one is needed.</td></tr><tr><td><code>bad_prior</code></td><td>422</td><td>A prior is not finite or has no deviation.</td></tr><tr><td><code>bad_telemetry</code></td><td>422</td><td>The telemetry cannot be read.</td></tr><tr><td><code>not_an_archive</code></td><td>422</td><td>The body is no zip archive, or a damaged one.</td></tr><tr><td><code>too_many_entries</code></td><td>422</td><td>The archive holds more files than <code>archive_entries</code> of <code>/v1/info</code>: split it.</td></tr><tr><td><code>bad_model</code></td><td>422</td><td>The model of another program cannot be read; <code>detail</code> names the file and the line.</td></tr></tbody></table></div>
<h2 id="jobs-and-maps">Jobs and maps</h2>
<p>Of a job, in <code>error</code> or <code>warnings</code>, or of a photo that joins a map; with the figures in <code>detail</code>.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>queue_full</code></td><td>429</td><td>Too many jobs wait: come again as <code>Retry-After</code> says.</td></tr><tr><td><code>job_active</code></td><td>409</td><td>The job still runs.</td></tr><tr><td><code>job_finished</code></td><td>409</td><td>The job is over: it cannot be cancelled.</td></tr><tr><td><code>job_not_retryable</code></td><td>409</td><td>Only failed, cancelled and partial jobs are done again.</td></tr><tr><td><code>bad_stage</code></td><td>422</td><td>There is no such stage to do anew.</td></tr><tr><td><code>bad_option</code></td><td>422</td><td>A number in <code>options</code> is out of its range: see <code>GET /v1/options</code>.</td></tr><tr><td><code>job_timeout</code></td><td></td><td>The job took longer than it may.</td></tr><tr><td><code>failed</code></td><td></td><td>The process that worked did not say why; the log of the job may.</td></tr><tr><td><code>worker_crashed</code></td><td></td><td>The process that worked died; the job is tried again.</td></tr><tr><td><code>worker_lost</code></td><td></td><td>The process that worked did not answer any more.</td></tr><tr><td><code>cancelled</code></td><td></td><td>Somebody asked to stop.</td></tr><tr><td><code>no_images</code></td><td>422</td><td>The image sets hold no images.</td></tr><tr><td><code>unknown_imageset</code></td><td>422</td><td>There is no image set of this id.</td></tr><tr><td><code>repeated_imageset</code></td><td>422</td><td>An image set is named twice.</td></tr><tr><td><code>too_many_imagesets</code></td><td>422</td><td>The job names too many image sets: do it in parts.</td></tr><tr><td><code>unused_imagesets</code></td><td>422</td><td>Maps are joined without image sets: leave them out.</td></tr><tr><td><code>no_map</code></td><td>422</td><td>No <code>map_id</code> says which map the photos join.</td></tr><tr><td><code>unknown_map</code></td><td>422</td><td>There is no map of this id.</td></tr><tr><td><code>repeated_map</code></td><td>422</td><td>A map is named twice.</td></tr><tr><td><code>bad_distance</code></td><td>422</td><td>A known distance is not a positive number of meters.</td></tr><tr><td><code>bad_pose</code></td><td>422</td><td>The pose to look from is not finite, or not a rotation.</td></tr><tr><td><code>no_given_poses</code></td><td></td><td>Poses were to be given, and fewer than two images have one: <code>PUT</code> the model, or estimate.</td></tr><tr><td><code>too_few_images</code></td><td></td><td>Fewer than two images could be decoded.</td></tr><tr><td><code>undecodable_images</code></td><td></td><td>Some images could not be decoded, and are left out: export them again.</td></tr><tr><td><code>unreadable</code></td><td></td><td>The file of a photo could not be read from the disk.</td></tr><tr><td><code>duplicate_images</code></td><td></td><td>Some images repeat another one, and have its pose.</td></tr><tr><td><code>blurred_images</code></td><td></td><td>Some images are blurred, and used all the same: stop before each photo.</td></tr><tr><td><code>odd_exif</code></td><td></td><td>Some images have odd EXIF, which is ignored.</td></tr><tr><td><code>too_few_features</code></td><td></td><td>The images show too little to hold on to: add texture or light.</td></tr><tr><td><code>no_overlap</code></td><td></td><td>No two images show the same, or maps share no part: see the <a href="/docs/capture">capture guide</a>.</td></tr><tr><td><code>no_parallax</code></td><td></td><td>The camera only turned: walk while turning.</td></tr><tr><td><code>no_model</code></td><td></td><td>Images match, and yet nothing could be built.</td></tr><tr><td><code>images_unplaced</code></td><td></td><td>Some images found no place; the report says which and why.</td></tr><tr><td><code>known_distance_unused</code></td><td></td><td>The two photos of a known distance are not both placed.</td></tr><tr><td><code>too_few_views</code></td><td></td><td>No image has another one that could tell its depth.</td></tr><tr><td><code>no_dense_points</code></td><td></td><td>Depth maps do not confirm each other anywhere.</td></tr><tr><td><code>too_few_points</code></td><td></td><td>Too few points for a surface or for joining.</td></tr><tr><td><code>empty_mesh</code></td><td></td><td>Nothing is left of the surface where points support it.</td></tr><tr><td><code>mesh_failed</code></td><td></td><td>The surface could not be made.</td></tr><tr><td><code>no_mesh</code></td><td></td><td>The map has no surface: make it with more stages.</td></tr><tr><td><code>no_photos</code></td><td></td><td>The photos for painting are not there.</td></tr><tr><td><code>photos_gone</code></td><td></td><td>Photos of the map were deleted: it is not painted with them.</td></tr><tr><td><code>texture_failed</code></td><td></td><td>The surface is there, but not painted.</td></tr><tr><td><code>bad_input</code></td><td></td><td>An argument makes no sense.</td></tr><tr><td><code>bad_map</code></td><td></td><td>The folder of the map is damaged or of another kind.</td></tr><tr><td><code>io</code></td><td></td><td>A file could not be read or written.</td></tr><tr><td><code>no_report</code></td><td>409</td><td>The job has no report: it did not come that far.</td></tr><tr><td><code>bad_alignment</code></td><td>422</td><td>The alignment names nothing or too much.</td></tr><tr><td><code>unknown_image</code></td><td>422</td><td>The image has no pose in the map.</td></tr><tr><td><code>degenerate</code></td><td>422</td><td>The points are too few, or on a line: the alignment is not determined.</td></tr><tr><td><code>maps_unjoined</code></td><td></td><td>Some of the maps found no place beside the others.</td></tr><tr><td><code>nothing_new</code></td><td></td><td>All these photos are in the map already.</td></tr><tr><td><code>already_in_map</code></td><td></td><td>The photo is in the map already.</td></tr><tr><td><code>repeated</code></td><td></td><td>The photo is the same as another one of the job.</td></tr><tr><td><code>underconstrained</code></td><td></td><td>The shared surfaces leave a direction free, as a bare corridor does.</td></tr><tr><td><code>no_dense_cloud</code></td><td></td><td>The map has no dense cloud to be joined by: reconstruct it with the stage <code>dense</code>.</td></tr><tr><td><code>no_scale</code></td><td></td><td>Maps are joined by surfaces only if they have meters: tell a known distance.</td></tr><tr><td><code>invalid</code></td><td></td><td>An option or a point is not a number that can be used.</td></tr><tr><td><code>not_metric</code></td><td></td><td>The map has no meters, and the work needs them.</td></tr></tbody></table></div>
<h2 id="doubts-about-a-map">Doubts about a map</h2>
<p><code>reasons</code> of the <code>quality</code> in a report, beside a verdict of <code>suspect</code> or <code>failed</code>; a job that fails for one has it in
<code>error</code>. Those above of a failed job may stand there, too.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>few_points</code></td><td></td><td>The map is of very few points: take more photos of places with texture.</td></tr><tr><td><code>few_images</code></td><td></td><td>Many photos match others and have no place all the same: overlap more.</td></tr><tr><td><code>weak_support</code></td><td></td><td>Many photos see few points of the map: overlap more.</td></tr><tr><td><code>high_reprojection_error</code></td><td></td><td>The points do not lie where the photos show them: take sharper photos, check the calibration.</td></tr><tr><td><code>contradicting_rotations</code></td><td></td><td>Pairs of photos disagree with the map: places that look alike may be taken for one.</td></tr><tr><td><code>loop_disagreement</code></td><td></td><td>The photos before one and those after it may be joined wrongly: overlap more there.</td></tr><tr><td><code>merged_places</code></td><td></td><td>Places that look alike may have been merged: give telemetry or positions, or make them look different.</td></tr><tr><td><code>zone</code></td><td></td><td>The part that this map is of is tied to the rest by nothing: take photos that show both.</td></tr><tr><td><code>weakly_tied</code></td><td></td><td>A part hardly hangs together with the rest: take a few photos that show both.</td></tr><tr><td><code>drift</code></td><td></td><td>Errors may add up on the way: come back to places seen before, or overlap more.</td></tr><tr><td><code>wrong_calibration</code></td><td></td><td>The photos contradict the calibration: is it of this camera, lens setting and size? Else leave it out.</td></tr><tr><td><code>absurd_intrinsics</code></td><td></td><td>The lens could not be told from the photos: give the calibration, or move sideways.</td></tr><tr><td><code>contradicting_gravity</code></td><td></td><td>Two sources disagree about up; <code>detail</code> says which one the map follows. Check both.</td></tr><tr><td><code>contradicting_scale</code></td><td></td><td>Two sources disagree about the meter; <code>detail</code> says which one the map follows. Check both.</td></tr><tr><td><code>gravity_disagreement</code></td><td></td><td>Joined maps disagree about up; the first is followed.</td></tr><tr><td><code>scale_disagreement</code></td><td></td><td>Joined maps disagree about the meter; the first is followed.</td></tr></tbody></table></div>
<h2 id="photos-without-a-place">Photos without a place</h2>
<p>Why an image of a map, or a query, has no pose.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>undecodable</code></td><td></td><td>The bytes are no picture.</td></tr><tr><td><code>blurred</code></td><td></td><td>The picture is too blurred.</td></tr><tr><td><code>other_zone</code></td><td></td><td>It belongs to a part that does not hold together with the rest.</td></tr><tr><td><code>no_given_pose</code></td><td></td><td>The map is made at given poses, and the photo has none: see <code>extend_map</code>.</td></tr><tr><td><code>ambiguous</code></td><td></td><td>Several places fit about as well.</td></tr><tr><td><code>several_maps</code></td><td></td><td>More than one of the maps fits about as well: name one.</td></tr><tr><td><code>too_few_matches</code></td><td></td><td>Too little of the photo is in the map.</td></tr><tr><td><code>too_few_inliers</code></td><td></td><td>Too few matches agree on one place.</td></tr><tr><td><code>poor_spread</code></td><td></td><td>What matches lies in one corner of the picture.</td></tr><tr><td><code>uncertain</code></td><td></td><td>The pose would be off by more than may be.</td></tr><tr><td><code>no_prior</code></td><td></td><td>This method needs to know about where it is.</td></tr><tr><td><code>too_small</code></td><td></td><td>The picture is too small.</td></tr><tr><td><code>nothing_in_view</code></td><td></td><td>The map shows nothing from there.</td></tr><tr><td><code>not_alike</code></td><td></td><td>The photo is not like the view of the map from there.</td></tr><tr><td><code>far_from_prior</code></td><td></td><td>The best place is not where the camera was said to be.</td></tr><tr><td><code>bad_map_ids</code></td><td>422</td><td>No maps are named, or too many.</td></tr></tbody></table></div>
<h2 id="frames-of-a-camera-stream">Frames of a camera stream</h2>
<p><code>reason</code> and <code>fault</code> of a tracked frame, <code>reason</code> of a dropped one, and refusals of <code>stream.open</code>.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>bad_frame</code></td><td>422</td><td>The frame cannot be read.</td></tr><tr><td><code>unconfirmed</code></td><td></td><td>A place was found, and is not believed yet.</td></tr><tr><td><code>contradicted</code></td><td></td><td>The pose is where the camera cannot have come.</td></tr><tr><td><code>frozen</code></td><td></td><td>The same picture again and again.</td></tr><tr><td><code>out_of_order</code></td><td></td><td>Older than the frame before.</td></tr><tr><td><code>wrong_size</code></td><td></td><td>Not the size of its camera.</td></tr><tr><td><code>no_contrast</code></td><td></td><td>All of one gray.</td></tr><tr><td><code>dark</code></td><td></td><td>Noise outweighs the picture.</td></tr><tr><td><code>superseded</code></td><td></td><td>A newer frame came before this one was looked at: send fewer, or keep to the newest.</td></tr><tr><td><code>overload</code></td><td></td><td>More frames wait than may, or nobody had time for this one: send fewer.</td></tr><tr><td><code>decode_error</code></td><td></td><td>The picture of the frame cannot be used; <code>detail</code> says why.</td></tr><tr><td><code>bad_topic</code></td><td>422</td><td>There is no such topic.</td></tr><tr><td><code>too_many</code></td><td>429</td><td>The socket has too many topics or streams.</td></tr><tr><td><code>not_tracked</code></td><td>409</td><td>Poses are fed by streams with <code>track</code> only.</td></tr><tr><td><code>bad_drone_id</code></td><td>422</td><td>A stream that feeds names a drone by its number.</td></tr></tbody></table></div>
<h2 id="drones">Drones</h2>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>no_mavlink</code></td><td>409</td><td>The service runs without a link to drones: start it with <code>--mavlink</code>.</td></tr><tr><td><code>unknown_vehicle</code></td><td>409</td><td>No such drone was heard.</td></tr><tr><td><code>not_linked</code></td><td>409</td><td>The drone is not heard now.</td></tr><tr><td><code>not_ready</code></td><td>409</td><td>Its estimator does not follow the poses yet: wait for <code>feed</code> to be <code>ready</code>.</td></tr><tr><td><code>flying</code></td><td>409</td><td>It flies, and the command is for the ground.</td></tr><tr><td><code>not_flying</code></td><td>409</td><td>It stands, and the command is for the air.</td></tr><tr><td><code>not_in_control</code></td><td>409</td><td>Somebody else, or its failsafe, flies it. As an alert: it holds what they say.</td></tr><tr><td><code>address_conflict</code></td><td>409</td><td>Two drones use the same number or address.</td></tr><tr><td><code>bad_number</code></td><td>422</td><td>A number of the command is not finite or out of range.</td></tr><tr><td><code>bad_system_id</code></td><td>422</td><td>Drones have the numbers 1 to 254.</td></tr><tr><td><code>bad_signing_key</code></td><td>422</td><td>A key is 64 hexadecimal digits.</td></tr><tr><td><code>bad_camera_mount</code></td><td>422</td><td>The mount is not finite, or not a rotation.</td></tr><tr><td><code>bad_lease</code></td><td>422</td><td>The lease names no drones, or its time is out of range.</td></tr><tr><td><code>camera_host_refused</code></td><td>422</td><td>The camera is none of those that may be pulled: start the service with <code>--camera-host HOST</code>. A name may lead to this machine or to a link-local address only if that is allowed as an address.</td></tr><tr><td><code>bad_camera_url</code></td><td>422</td><td>The address of a camera is plain <code>http://</code>, without user and password.</td></tr><tr><td><code>too_many_cameras</code></td><td>409</td><td>So many cameras are pulled already: <code>DELETE /v1/drones/{id}/camera</code>.</td></tr><tr><td><code>camera_unreachable</code></td><td></td><td>No connection, or no answer: it is tried again, after five seconds at most.</td></tr><tr><td><code>camera_status</code></td><td></td><td>The camera answers with another status than 200: look at its address, and whether it wants a password. Tried again every ten seconds, as the next three.</td></tr><tr><td><code>camera_redirect</code></td><td></td><td>The camera sends elsewhere, which is not followed: name the address that it sends to.</td></tr><tr><td><code>camera_not_mjpeg</code></td><td></td><td>The answer is not <code>multipart/x-mixed-replace</code>: a single picture or a page is no stream.</td></tr><tr><td><code>camera_frame_too_large</code></td><td></td><td>A picture is above <code>image_bytes</code> of <code>/v1/info</code>.</td></tr><tr><td><code>camera_stream_broken</code></td><td></td><td>The stream broke off, or its parts cannot be told apart.</td></tr><tr><td><code>camera_silent</code></td><td></td><td>The camera sent nothing for five seconds.</td></tr><tr><td><code>camera_too_slow</code></td><td></td><td>The camera sent no whole picture in ten seconds.</td></tr><tr><td><code>camera_ended</code></td><td></td><td>The camera ended the stream.</td></tr><tr><td><code>camera_clock</code></td><td></td><td><code>X-Timestamp</code> of the pictures goes backward, or only some have it: the camera starts anew.</td></tr><tr><td><code>recording_runs</code></td><td>409</td><td>The drone is being recorded already; <code>detail</code> names the recording.</td></tr><tr><td><code>drone_leased</code></td><td>409</td><td>Somebody else holds a lease of the drone; <code>detail</code> names them.</td></tr><tr><td><code>not_lease_holder</code></td><td>403, 409</td><td>The lease is another token&#39;s.</td></tr><tr><td><code>bad_reading</code></td><td>422</td><td>A reading of a beacon is not finite.</td></tr><tr><td><code>too_few_ranges</code></td><td>422</td><td>A position needs three beacons.</td></tr><tr><td><code>beacons_collinear</code></td><td>422</td><td>The beacons stand on a line.</td></tr><tr><td><code>not_converged</code></td><td>422</td><td>The readings fit no place.</td></tr></tbody></table></div>
<h2 id="alerts">Alerts</h2>
<p>Topic <code>alerts</code>: what the service does about it is on the <a href="/docs/safety">safety page</a>.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>pose_stale</code></td><td></td><td>No fresh pose.</td></tr><tr><td><code>relocating</code></td><td></td><td>The source of the poses gave up the drone&#39;s place for another, which is not proven yet.</td></tr><tr><td><code>link_lost</code></td><td></td><td>The drone is silent.</td></tr><tr><td><code>lease_over</code></td><td></td><td>Nobody commands.</td></tr><tr><td><code>battery_low</code></td><td></td><td>The battery is low.</td></tr><tr><td><code>pose_refused</code></td><td></td><td>A pose is not believed and not passed on; <code>detail</code> says why. Told once, until one is believed.</td></tr><tr><td><code>relocated</code></td><td></td><td>The drone is elsewhere than was believed, as the source of its poses announced; <code>detail</code> says how far.</td></tr><tr><td><code>control_taken</code></td><td></td><td>The drone left the mode it was told to be in: its failsafe or a pilot took over.</td></tr><tr><td><code>impostor</code></td><td></td><td>Somebody else sends with the drone&#39;s number; <code>detail</code> names the address.</td></tr><tr><td><code>shared_address</code></td><td></td><td>Two drones have the same address: give each its own.</td></tr><tr><td><code>signing_clock</code></td><td></td><td>What the drone signs is more than a minute behind, and not taken: its clock is wrong, or it is played again.</td></tr><tr><td><code>aborted</code></td><td></td><td>The flight was aborted: the drone lands.</td></tr></tbody></table></div>
<h2 id="flights-and-fences">Flights and fences</h2>
<p>A refused plan names the drones, the time and the place in <code>detail</code>.</p>
<div class="wide" tabindex="0"><table><thead><tr><th>Code</th><th>Status</th><th>Meaning, and what to do</th></tr></thead><tbody><tr><td><code>map_not_metric</code></td><td>409</td><td>The map has no meters: set its scale.</td></tr><tr><td><code>no_geofence</code></td><td>409</td><td>The map has neither fence nor bounds.</td></tr><tr><td><code>bad_geofence</code></td><td>422</td><td>The outline crosses itself, has no area or no height, or the margin leaves no room.</td></tr><tr><td><code>out_of_fence</code></td><td>422</td><td>A way leaves the fence.</td></tr><tr><td><code>outside</code></td><td></td><td>… sideways.</td></tr><tr><td><code>below_floor</code></td><td></td><td>… downward.</td></tr><tr><td><code>above_ceiling</code></td><td></td><td>… upward.</td></tr><tr><td><code>keep_out</code></td><td></td><td>… into a block to keep out of.</td></tr><tr><td><code>too_close</code></td><td>422</td><td>Two drones come nearer than the separation; in flight, an alert.</td></tr><tr><td><code>not_free</code></td><td>422</td><td>A way meets an obstacle, or space that no camera has seen (<code>allow_unseen</code>).</td></tr><tr><td><code>too_fast</code></td><td>422</td><td>A way is faster than the limits.</td></tr><tr><td><code>jump</code></td><td>422</td><td>A way is not in one piece.</td></tr><tr><td><code>no_way</code></td><td>422</td><td>No order of ways and waits was found that keeps all apart.</td></tr><tr><td><code>no_vehicles</code></td><td>422</td><td>The flight names no drones.</td></tr><tr><td><code>drone_twice</code></td><td>422</td><td>The flight names a drone twice.</td></tr><tr><td><code>bad_rules</code></td><td>422</td><td>Speed, separation or margin is not positive.</td></tr><tr><td><code>not_finite</code></td><td>422</td><td>A goal is not finite.</td></tr><tr><td><code>place_unknown</code></td><td>409</td><td>A drone does not hover and has no <code>start</code>, or its place is not known.</td></tr><tr><td><code>not_at_start</code></td><td>409</td><td>A drone is not where its way starts.</td></tr><tr><td><code>not_airborne</code></td><td>409</td><td>A drone is not in the air.</td></tr><tr><td><code>not_fit</code></td><td>409</td><td>A drone is not fit to fly: link, poses, control or battery.</td></tr><tr><td><code>no_takeoff</code></td><td>409</td><td>A drone cannot take off.</td></tr><tr><td><code>drone_busy</code></td><td>409</td><td>A drone flies in another flight.</td></tr><tr><td><code>flight_state</code></td><td>409</td><td>The flight is not in a state for it.</td></tr><tr><td><code>too_many_flights</code></td><td>409</td><td>Too many flights are not over.</td></tr></tbody></table></div>
`}].map(t=>({...t,html:g(t.html)})),w=i(()=>h(()=>import("./routes-CPAqWyR6.js"),__vite__mapDeps([0,1,2])).then(t=>t.Routes)),b=[["Shift+Space, or Escape twice","All stop, from every view"],["Arrow keys, + and −","Move and zoom the map that has the focus"],["Tab, Enter, Escape","Next control, use it, close a dialog"]];function v({name:t}){const o=r.find(d=>d.name===t),a=[...r.map(({name:d,title:n})=>({name:d,title:n})),{name:"routes",title:"Routes"},{name:"keys",title:"Keys"}];return s(()=>{location.hash&&document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView()},[t]),e("div",{class:"page book",children:[e("nav",{"aria-label":"Documents",children:a.map(d=>e("a",{href:`/docs/${d.name}`,"aria-current":d.name===t?"page":void 0,children:d.title},d.name))}),e(y,{page:o,name:t})]})}function y({page:t,name:o}){return t?e("article",{class:"prose",dangerouslySetInnerHTML:{__html:t.html}},o):o==="routes"?e(w,{}):o==="keys"?e("article",{class:"prose",children:[e("h1",{children:"Keys"}),e("table",{children:e("tbody",{children:b.map(([a,d])=>e("tr",{children:[e("th",{scope:"row",children:a}),e("td",{children:d})]},a))})})]}):e(c,{title:"There is no such document",icon:"docs"})}export{v as Book};
