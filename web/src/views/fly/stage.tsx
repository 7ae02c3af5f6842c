import { effect, useSignalEffect } from '@preact/signals';
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { FrontSide, Mesh, Plane, Raycaster, Vector2, Vector3, type Intersection, type Material } from 'three';
import type { MapVersion, PlaceMap } from '../../api/types';
import { DroneMarks, type DroneView } from '../../map3d/drones';
import { showAims, showFence, showOutline, showPlan } from '../../map3d/flight-layers';
import { boundsOf, firstLayer, showLayer } from '../../map3d/map-layers';
import type { MapScene } from '../../map3d/scene';
import { SceneView } from '../../map3d/scene-view';
import { fleet, fleetTick, freshFix, linkOf, nameOf, onFleet, poseOf, type LiveDrone } from '../../state/fleet';
import { navigate } from '../../state/router';
import { toastError } from '../../state/toasts';
import { Icon } from '../../ui/icons';
import { Tabs } from '../../ui/tabs';
import '../../styles/fly.css';
import { Desk } from './desk';
import { DronesPanel } from './drones-panel';
import { FencePanel } from './fence-panel';
import { FlightPanel } from './flight-panel';
import { isMetric } from './fly';
import { VirtualCamera } from './virtual-camera';

const TABS = [
  { name: 'drones', title: 'Drones' },
  { name: 'flight', title: 'Flight' },
  { name: 'fence', title: 'Fence' },
] as const;

export function Stage({ version, maps }: { version: MapVersion; maps: PlaceMap[] }) {
  const desk = useMemo(() => new Desk(version), []);
  const overlay = useRef<HTMLDivElement>(null);
  const [scene, setScene] = useState<MapScene | null>(null);
  useEffect(() => {
    const abort = new AbortController();
    desk.load(abort.signal).catch((error: unknown) => abort.signal.aborted || toastError(error));
    return () => abort.abort();
  }, []);
  useSignalEffect(() => {
    fleetTick.value;
    if (desk.chosen.value === null && fleet.size > 0) desk.chosen.value = Math.min(...fleet.keys());
  });

  const ready = (scene: MapScene) => {
    setScene(scene);
    const abort = new AbortController();
    const layer = firstLayer(version);
    if (layer) {
      showLayer(scene, version, layer, abort.signal)
        .then(() => openWalls(scene))
        .catch((error: unknown) => abort.signal.aborted || toastError(error));
    }
    scene.fit(boundsOf(version));
    const marks = new DroneMarks(scene, overlay.current!, desk.floor);
    const drawDrones = () => marks.update([...fleet.values()].flatMap((live) => viewOf(live, version.map_id)));
    const ends = [
      onFleet(drawDrones),
      scene.onClick(({ hits, event }) => clicked(desk, scene, hits, event)),
      effect(() => showAims(scene, desk.aims.value, desk.floor)),
      effect(() => showPlan(scene, desk.ways.value)),
      effect(() => showFence(scene, desk.draft.value ?? desk.fence.value)),
      effect(() => showOutline(scene, desk.drawing.value?.corners ?? [], desk.floor)),
    ];
    drawDrones();
    // Trust ages without messages.
    const timer = setInterval(drawDrones, 500);
    return () => {
      abort.abort();
      clearInterval(timer);
      for (const end of ends) end();
      marks.dispose();
    };
  };

  const tab = desk.tab.value;
  const metric = maps.some((map) => map.id === version.map_id && isMetric(map));
  return (
    <div class="stage fly">
      <h1 class="visually-hidden">Fly</h1>
      <SceneView onReady={ready}>
        <div ref={overlay} class="overlay" />
        <Hint desk={desk} />
        <button type="button" class="fit icon-only" title="The whole map" aria-label="Show the whole map" onClick={() => scene?.fit(boundsOf(version))}>
          <Icon name="home" />
        </button>
        <VirtualCamera desk={desk} />
      </SceneView>
      <aside class="panel" aria-label="Drones">
        <label>
          Map
          <select value={version.map_id} onChange={(event) => navigate(`/fly/${event.currentTarget.value}`)}>
            {maps.map((map) => <option key={map.id} value={map.id}>{map.name}{isMetric(map) ? '' : ' (not metric)'}</option>)}
          </select>
        </label>
        {!metric && (
          <p class="note bad" role="alert">
            <Icon name="warn" />
            <span>This map has no scale in meters: no drone flies by it. <a href={`/maps/${version.map_id}`}>Set its scale</a></span>
          </p>
        )}
        <Tabs label="Work" tabs={TABS} chosen={tab} onChoose={(name) => (desk.tab.value = name)}>
          {tab === 'drones' && <DronesPanel desk={desk} />}
          {tab === 'flight' && <FlightPanel desk={desk} />}
          {tab === 'fence' && <FencePanel desk={desk} />}
        </Tabs>
      </aside>
    </div>
  );
}

/** What a click in the scene would do now. */
function Hint({ desk }: { desk: Desk }) {
  fleetTick.value;
  const drawing = desk.drawing.value;
  const chosen = desk.chosen.value;
  let words: string | null = null;
  if (drawing) {
    words = drawing.shape === 'box' ? 'Click two opposite corners' : 'Click the corners, then close the outline';
  } else if (desk.tab.value !== 'fence' && chosen !== null && !desk.active.value) {
    words = `Click where ${nameOf(chosen)} shall go: ${desk.height.value} m above the floor`;
  }
  return words ? <p class="hint">{words}</p> : null;
}

/** A drone as the scene draws it: where its camera says, else where its estimator says. */
function viewOf(live: LiveDrone, mapId: string): DroneView[] {
  const { drone, state } = live;
  const estimate = state?.estimate;
  if (!estimate) return [];
  const fix = freshFix(live, mapId);
  const cov = fix?.frame.covariance;
  const covariance = cov ? [0, 1, 2].map((row) => cov.slice(6 * row, 6 * row + 3)) : null;
  const link = linkOf(live).level;
  const trust = link === 'bad' ? 'lost' : poseOf(live).level === 'good' ? 'fresh' : 'stale';
  return [{
    id: drone.id,
    label: nameOf(drone.id),
    position: estimate.position,
    yaw: estimate.yaw,
    camera: fix ? fix.pose.orientation : null,
    mount: drone.body_from_camera,
    covariance,
    target: state.target?.position ?? null,
    trust,
  }];
}

function clicked(desk: Desk, scene: MapScene, hits: Intersection[], event: PointerEvent): boolean {
  const seen = hits.map((hit) => ({ place: hit.point, normal: normalOf(hit) }));
  // What is seen from behind is not drawn and not meant.
  const hit = seen.find(({ place, normal }) => !normal || normal.dot(scene.camera.position.clone().sub(place)) > 0);
  const place = hit?.place ?? onFloor(scene, event, desk.floor);
  if (!place) return false;
  if (desk.drawing.value) desk.corner(place.x, place.y);
  else if (desk.tab.value !== 'fence') desk.aimAt(place, hit?.normal ?? null);
  return true;
}

const normalOf = ({ face, object }: Intersection): Vector3 | null =>
  face ? face.normal.clone().transformDirection(object.matrixWorld) : null;

/** Walls are seen from inside only, so that one can look into a room from outside. */
function openWalls(scene: MapScene): void {
  scene.layer('mesh').traverse((part) => {
    if (part instanceof Mesh) (part.material as Material).side = FrontSide;
  });
  scene.invalidate();
}

/** Where the floor lies under the pointer when the map shows nothing there. */
function onFloor(scene: MapScene, event: PointerEvent, floor: number): Vector3 | null {
  const box = scene.renderer.domElement.getBoundingClientRect();
  const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
  const ray = new Raycaster();
  ray.setFromCamera(at, scene.camera);
  return ray.ray.intersectPlane(new Plane(new Vector3(0, 0, 1), -floor), new Vector3());
}
