import { useState } from 'preact/hooks';
import type { Vector3 } from 'three';
import { post } from '../../api/client';
import type { Schema } from '../../api/types';
import { yawOf } from '../../map3d/frames';
import { navigate } from '../../state/router';
import { toast, toastError } from '../../state/toasts';
import { length } from '../../ui/format';
import { Icon } from '../../ui/icons';
import { infoOf } from './map-info';
import type { MapViewer } from './viewer';

type Sim3 = Schema<'Sim3'>;

/** Lengths, the scale, and the frame of the map. */
export function MeasurePanel({ viewer }: { viewer: MapViewer }) {
  const tool = viewer.tool.value;
  return (
    <>
      <div class="row">
        <button type="button" class="grow" aria-pressed={tool === 'ruler'} onClick={() => viewer.use('ruler')}>
          <Icon name="ruler" /> Ruler
        </button>
        <button type="button" class="grow" aria-pressed={tool === 'frame'} onClick={() => viewer.use('frame')}>
          <Icon name="axes" /> Origin
        </button>
      </div>
      {tool === 'look' && (
        <p class="muted">
          Measure with two clicks into the map, or choose where its origin is and where forward
          points. Both make a new version; the old one stays.
        </p>
      )}
      {tool === 'ruler' && <Ruler viewer={viewer} />}
      {tool === 'frame' && <Frame viewer={viewer} />}
    </>
  );
}

/** How close a click comes to what it means. */
const CLICK_M = 0.01;

/** Makes a version in another frame and shows it. */
async function align(viewer: MapViewer, sim3: Sim3, done: string): Promise<void> {
  const { map_id, version } = viewer.data.version;
  try {
    const made = await post('/v1/maps/{id}/align', { sim3 }, { at: { id: map_id }, query: { version } });
    toast('good', `${done}: version ${made.version.version}`);
    navigate(`/maps/${map_id}/${made.version.version}`);
  } catch (error) {
    toastError(error);
  }
}

function Ruler({ viewer }: { viewer: MapViewer }) {
  const [known, setKnown] = useState('');
  const [busy, setBusy] = useState(false);
  const metric = infoOf(viewer.data.version).scale?.metric === true;
  const [from, to] = viewer.marks.value;
  if (!from || !to) {
    return <p class="muted" role="status">Click {from ? 'the second' : 'the first'} place in the map.</p>;
  }
  const along = to.clone().sub(from);
  const measured = along.length();
  const meters = Number(known.replace(',', '.'));
  const good = meters > 0 && Number.isFinite(meters) && measured > 0;
  const apply = async () => {
    setBusy(true);
    const scale = meters / measured;
    await align(
      viewer,
      { rotation: [1, 0, 0, 0], translation: [0, 0, 0], scale, metric: true, sigma_rel: CLICK_M / meters },
      `The scale is set, × ${scale.toFixed(4)}`,
    );
    setBusy(false);
  };
  return (
    <>
      <dl class="facts" aria-live="polite">
        <dt>Distance</dt>
        <dd class="num big" data-testid="distance">{length(measured, metric)}</dd>
        <dt>Level</dt>
        <dd class="num">{length(Math.hypot(along.x, along.y), metric)}</dd>
        <dt>Height</dt>
        <dd class="num">{length(along.z, metric)}</dd>
      </dl>
      <form
        class="stack tight"
        onSubmit={(event) => {
          event.preventDefault();
          void apply();
        }}
      >
        <h3>Set the scale</h3>
        <label>
          True length, meters
          <input inputMode="decimal" value={known} onInput={(event) => setKnown(event.currentTarget.value)} />
          <span class="field-help">
            The longer the distance, the better: a click is rarely closer than a centimeter.
          </span>
        </label>
        <button class="primary" disabled={!good || busy}>Set the scale</button>
      </form>
    </>
  );
}

function Frame({ viewer }: { viewer: MapViewer }) {
  const [level, setLevel] = useState(true);
  const [busy, setBusy] = useState(false);
  const [origin, ahead] = viewer.marks.value;
  const yaw = origin && ahead ? yawOf(ahead.clone().sub(origin)) : 0;
  const apply = async () => {
    if (!origin) return;
    setBusy(true);
    const metric = infoOf(viewer.data.version).scale?.metric === true;
    await align(viewer, { ...toOrigin(origin, yaw, level), metric }, 'The frame is set');
    setBusy(false);
  };
  return (
    <>
      <p class="muted" role="status">
        {!origin
          ? 'Click the place that becomes the origin.'
          : !ahead
            ? 'Click a place ahead: x will point there. Without it, forward stays as it is.'
            : `Forward turns by ${((yaw * 180) / Math.PI).toFixed(1)}°.`}
      </p>
      {origin && (
        <>
          <label class="check">
            <input type="checkbox" checked={level} onChange={(event) => setLevel(event.currentTarget.checked)} />
            Height zero is here, too
          </label>
          <div class="row">
            <button type="button" class="primary" disabled={busy} onClick={() => void apply()}>
              Set origin and forward
            </button>
            <button type="button" onClick={() => (viewer.marks.value = [])}>Again</button>
          </div>
        </>
      )}
    </>
  );
}

/** New from map: `x_new = R (x - origin)` with `R` the turn by `-yaw` about z. */
export function toOrigin(origin: Vector3, yaw: number, level: boolean): Sim3 {
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const x = cos * origin.x + sin * origin.y;
  const y = -sin * origin.x + cos * origin.y;
  return {
    rotation: [Math.cos(yaw / 2), 0, 0, -Math.sin(yaw / 2)],
    translation: [-x, -y, level ? -origin.z : 0],
    scale: 1,
  } as Sim3;
}
