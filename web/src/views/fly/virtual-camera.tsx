import { useEffect, useState } from 'preact/hooks';
import { explain, request } from '../../api/client';
import type { CameraPose } from '../../api/types';
import { quaternion, UP, vector, wxyz, xyz } from '../../map3d/frames';
import { Quaternion } from 'three';
import { fleet, fleetTick, freshFix, nameOf, type LiveDrone } from '../../state/fleet';
import { Icon } from '../../ui/icons';
import type { Desk } from './desk';

const EVERY_MS = 1000;

/** What the map looks like from where the chosen drone is, once a second. */
export function VirtualCamera({ desk }: { desk: Desk }) {
  const [open, setOpen] = useState(false);
  const [picture, setPicture] = useState<string | null>(null);
  const [failure, setFailure] = useState<string | null>(null);
  const drone = desk.chosen.value;
  // Names come and change.
  fleetTick.value;
  useEffect(() => {
    if (!open || drone === null) return undefined;
    const abort = new AbortController();
    let timer: ReturnType<typeof setTimeout>;
    let shown: string | null = null;
    let last = '';
    const draw = async () => {
      const live = fleet.get(drone);
      const pose = live && cameraOf(live, desk.mapId);
      const body = pose && JSON.stringify({ pose });
      if (!pose) setFailure('its place is not known');
      else if (body !== last && !document.hidden) {
        try {
          const answer = await request('POST', '/v1/maps/{id}/render', body, {
            at: { id: desk.mapId },
            headers: { 'Content-Type': 'application/json' },
            signal: abort.signal,
          });
          const next = URL.createObjectURL(await answer.blob());
          if (shown) URL.revokeObjectURL(shown);
          shown = next;
          last = body ?? '';
          setPicture(next);
          setFailure(null);
        } catch (error) {
          if (!abort.signal.aborted) setFailure(explain(error).text);
        }
      }
      if (!abort.signal.aborted) timer = setTimeout(() => void draw(), EVERY_MS);
    };
    void draw();
    return () => {
      abort.abort();
      clearTimeout(timer);
      if (shown) URL.revokeObjectURL(shown);
      setPicture(null);
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
    <figure class="drone-camera">
      <figcaption>
        Map as {nameOf(drone)} should see it
        <button type="button" class="quiet icon-only" aria-label="Close the view" onClick={() => setOpen(false)}>
          <Icon name="close" />
        </button>
      </figcaption>
      {picture ? <img src={picture} alt={`The map from the place of ${nameOf(drone)}`} /> : <p class="muted">{failure ?? 'Drawing …'}</p>}
    </figure>
  );
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
