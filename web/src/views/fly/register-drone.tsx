import { useState } from 'preact/hooks';
import { Quaternion, Vector3 } from 'three';
import { patch, put, remove } from '../../api/client';
import type { Schema } from '../../api/types';
import { quaternion, wxyz } from '../../map3d/frames';
import { reloadFleet, type LiveDrone } from '../../state/fleet';
import { toast, toastError } from '../../state/toasts';
import { Dialog } from '../../ui/dialog';

type Mount = Schema<'CameraMount'>;

/** A camera that looks ahead: its z is the body's x, its x the body's right. */
const AHEAD = new Quaternion(-0.5, 0.5, -0.5, 0.5);
const LEFT = new Vector3(0, 1, 0);
const UP = new Vector3(0, 0, 1);
const RAD = Math.PI / 180;

/** Where it looks, in degrees: to the left, and down. */
function looksOf(mount: Mount): { left: number; down: number } {
  const ahead = new Vector3(0, 0, 1).applyQuaternion(quaternion(mount.orientation));
  const round = (radians: number) => Math.round((radians / RAD) * 10) / 10 + 0;
  return { left: round(Math.atan2(ahead.y, ahead.x)), down: round(-Math.asin(Math.max(-1, Math.min(1, ahead.z)))) };
}

function orientation(left: number, down: number): number[] {
  const turn = new Quaternion().setFromAxisAngle(UP, left * RAD);
  return wxyz(turn.multiply(new Quaternion().setFromAxisAngle(LEFT, down * RAD)).multiply(AHEAD));
}

export function RegisterDrone({ live: { drone }, onClose }: { live: LiveDrone; onClose: () => void }) {
  const mount = drone.body_from_camera;
  const looks = looksOf(mount);
  const [name, setName] = useState(drone.name ?? '');
  const [vision, setVision] = useState(drone.vision);
  const [at, setAt] = useState([...mount.position]);
  const [left, setLeft] = useState(looks.left);
  const [down, setDown] = useState(looks.down);
  const number = (words: string, value: number, take: (value: number) => void, step: number) => (
    <label class="grow">
      {words}
      <input type="number" step={step} value={value} onInput={(event) => take(event.currentTarget.valueAsNumber || 0)} />
    </label>
  );
  const save = async () => {
    try {
      // Untouched, it stays to the last digit.
      const looksSame = left === looks.left && down === looks.down;
      const body_from_camera = { position: at, orientation: looksSame ? mount.orientation : orientation(left, down) };
      const mountSame = looksSame && at.every((value, k) => value === mount.position[k]);
      const options = { at: { id: drone.id } };
      if (drone.name) {
        // What is not named stays, also its key.
        await patch('/v1/drones/{id}', {
          ...(name.trim() !== drone.name && { name: name.trim() }),
          ...(vision !== drone.vision && { vision }),
          ...(!mountSame && { body_from_camera }),
        }, options);
      } else {
        await put('/v1/drones/{id}', { name: name.trim(), vision, body_from_camera }, options);
      }
      await reloadFleet();
      toast('good', `${name.trim()} is registered`);
      onClose();
    } catch (error) {
      toastError(error);
    }
  };
  const forget = async () => {
    try {
      await remove('/v1/drones/{id}', { at: { id: drone.id } });
      await reloadFleet();
      onClose();
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <Dialog title={`Drone ${drone.id}`} onClose={onClose}>
      <form
        class="stack"
        onSubmit={(event) => {
          event.preventDefault();
          void save();
        }}
      >
        <label>
          Name
          <input required maxLength={200} value={name} onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        <label>
          Takes poses as
          <select value={vision} onChange={(event) => setVision(event.currentTarget.value as typeof vision)}>
            <option value="position_estimate">VISION_POSITION_ESTIMATE</option>
            <option value="odometry">ODOMETRY</option>
          </select>
        </label>
        <fieldset class="row">
          <legend>Where the camera sits, meters from the middle</legend>
          {['forward', 'left', 'up'].map((words, k) =>
            number(words, at[k] ?? 0, (value) => setAt(at.map((old, i) => (i === k ? value : old))), 0.005))}
        </fieldset>
        <fieldset class="row">
          <legend>Where it looks, degrees</legend>
          {number('to the left', left, setLeft, 1)}
          {number('down', down, setDown, 1)}
        </fieldset>
        {drone.has_own_key && <p class="muted">It has a signing key of its own, which stays.</p>}
        <footer class="row end">
          {drone.name && <button type="button" onClick={() => void forget()}>Forget</button>}
          <button class="primary" disabled={name.trim() === ''}>Save</button>
        </footer>
      </form>
    </Dialog>
  );
}
