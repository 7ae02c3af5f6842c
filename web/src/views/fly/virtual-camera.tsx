import { useEffect, useRef, useState } from 'preact/hooks';
import { Quaternion } from 'three';
import { ApiError, explain, request } from '../../api/client';
import type { CameraPose } from '../../api/types';
import { quaternion, UP, vector, wxyz, xyz } from '../../map3d/frames';
import { fleet, fleetTick, freshFix, nameOf, type LiveDrone } from '../../state/fleet';
import { Icon } from '../../ui/icons';
import type { Desk } from './desk';

const EVERY_MS = 1000;

/** What the chosen drone sees, beside what the map looks like from there, once a second. */
export function VirtualCamera({ desk }: { desk: Desk }) {
  const [open, setOpen] = useState(false);
  const [photo, showPhoto] = usePicture();
  const [view, showView] = usePicture();
  const [failure, setFailure] = useState<string | null>(null);
  const drone = desk.chosen.value;
  // Names come and change.
  fleetTick.value;
  useEffect(() => {
    if (!open || drone === null) return undefined;
    const abort = new AbortController();
    let timer: ReturnType<typeof setTimeout>;
    let last = '';
    const { signal } = abort;
    // Pictures of a stream of raw pixels are not kept.
    let isKept = true;
    const take = async () => {
      try {
        const answer = await request('GET', '/v1/drones/{id}/frame', null, { at: { id: drone }, signal });
        showPhoto(await answer.blob());
      } catch (error) {
        if (!(error instanceof ApiError && error.problem.status === 404)) throw error;
        isKept = false;
      }
    };
    const draw = async (pose: CameraPose) => {
      const body = JSON.stringify({ pose });
      if (body === last) return;
      const headers = { 'Content-Type': 'application/json' };
      const answer = await request('POST', '/v1/maps/{id}/render', body, { at: { id: desk.mapId }, headers, signal });
      showView(await answer.blob());
      last = body;
    };
    const look = async () => {
      const live = fleet.get(drone);
      const pose = live && cameraOf(live, desk.mapId);
      try {
        if (!document.hidden) await Promise.all([live?.films && isKept && take(), pose && draw(pose)]);
        setFailure(pose ? null : 'its place is not known');
      } catch (error) {
        if (!signal.aborted) setFailure(explain(error).text);
      }
      if (!signal.aborted) timer = setTimeout(() => void look(), EVERY_MS);
    };
    void look();
    return () => {
      abort.abort();
      clearTimeout(timer);
      showPhoto(null);
      showView(null);
    };
  }, [open, drone]);

  if (drone === null) return null;
  if (!open) {
    return (
      <button type="button" class="camera-toggle" onClick={() => setOpen(true)}>
        <Icon name="photos" /> View from {nameOf(drone)}
      </button>
    );
  }
  return (
    <section class={`drone-camera ${photo ? 'pair' : ''}`} aria-label={`View from ${nameOf(drone)}`}>
      {photo && (
        <figure>
          <figcaption>Camera of {nameOf(drone)}</figcaption>
          <img src={photo} alt={`What ${nameOf(drone)} sees`} />
        </figure>
      )}
      <figure>
        <figcaption>Map as {nameOf(drone)} should see it</figcaption>
        {view ? <img src={view} alt={`The map from the place of ${nameOf(drone)}`} /> : <p class="muted">{failure ?? 'Drawing …'}</p>}
      </figure>
      <button type="button" class="quiet icon-only" aria-label="Close the view" onClick={() => setOpen(false)}>
        <Icon name="close" />
      </button>
    </section>
  );
}

/** An address of the newest picture, and how to change it. */
function usePicture(): [string | null, (picture: Blob | null) => void] {
  const [address, setAddress] = useState<string | null>(null);
  const held = useRef<string | null>(null);
  const show = (picture: Blob | null) => {
    if (held.current) URL.revokeObjectURL(held.current);
    held.current = picture && URL.createObjectURL(picture);
    setAddress(held.current);
  };
  return [address, show];
}

/** `map_from_camera`: as its camera found it, else by the estimator and the mount. */
function cameraOf(live: LiveDrone, mapId: string): CameraPose | null {
  const fix = freshFix(live, mapId);
  if (fix) return fix.pose;
  const estimate = live.state?.estimate;
  if (!estimate) return null;
  const { position, orientation } = live.drone.body_from_camera;
  const turn = new Quaternion().setFromAxisAngle(UP, estimate.yaw);
  return {
    position: xyz(vector(position).applyQuaternion(turn).add(vector(estimate.position))),
    orientation: wxyz(turn.clone().multiply(quaternion(orientation))),
  };
}
