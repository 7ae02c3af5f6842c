import { useState } from 'preact/hooks';
import { list, post } from '../../api/client';
import type { CreateJob, Image, ImageSet } from '../../api/types';
import { useLoad } from '../../state/load';
import { navigate } from '../../state/router';
import { Dialog } from '../../ui/dialog';
import { Failure } from '../../ui/failure';
import { plural } from '../../ui/format';
import { Presets, type Preset } from './presets';

type Scale = 'telemetry' | 'distance' | 'later';

/** What is to be made of the photos of a set. */
export function StartJob(props: { sets: ImageSet[]; images: Image[]; onClose: () => void }) {
  const { images } = props;
  const withPrior = images.filter(({ prior }) => prior).length;
  const maps = useLoad(() => list('/v1/maps'), []);
  const [name, setName] = useState(props.sets[0]?.name ?? '');
  const [preset, setPreset] = useState<Preset>('balanced');
  const [scale, setScale] = useState<Scale>(withPrior > 0 ? 'telemetry' : 'later');
  const [a, setA] = useState(images[0]?.name ?? '');
  const [b, setB] = useState(images.at(-1)?.name ?? '');
  const [meters, setMeters] = useState('');
  const [origin, setOrigin] = useState<'last_camera' | 'mean_cameras' | 'given'>('last_camera');
  const [joins, setJoins] = useState('');
  const [error, setError] = useState<unknown>(null);
  const [busy, setBusy] = useState(false);
  const distance = Number(meters.replace(',', '.'));
  const ready = name.trim() !== '' && (scale !== 'distance' || joins !== '' || (distance > 0 && a !== b));
  const start = async () => {
    setBusy(true);
    setError(null);
    const sets = { imageset_ids: props.sets.map(({ id }) => id) };
    const body: CreateJob = joins
      ? { ...sets, kind: 'extend_map', map_id: joins }
      : {
          ...sets,
          kind: 'reconstruct',
          map_name: name.trim(),
          preset,
          origin,
          ...(scale === 'distance' && { known_distances: [{ image_a: a, image_b: b, meters: distance }] }),
        };
    try {
      const job = await post('/v1/jobs', body);
      props.onClose();
      navigate(`/jobs/${job.id}`);
    } catch (error) {
      setError(error);
      setBusy(false);
    }
  };
  return (
    <Dialog title={`Make a map of ${plural(images.length, 'photo')}`} onClose={props.onClose}>
      <form
        class="stack"
        onSubmit={(event) => {
          event.preventDefault();
          void start();
        }}
      >
        {maps.data && maps.data.length > 0 && (
          <label>
            Result
            <select value={joins} onChange={(event) => setJoins(event.currentTarget.value)}>
              <option value="">A new map</option>
              {maps.data.map((map) => <option key={map.id} value={map.id}>The photos join {map.name}</option>)}
            </select>
          </label>
        )}
        {joins === '' && (
          <>
            <label>
              Name of the map
              <input value={name} maxLength={200} onInput={(event) => setName(event.currentTarget.value)} />
            </label>
            <Presets chosen={preset} choose={setPreset} />
            <fieldset>
              <legend>What gives the scale</legend>
              {withPrior > 0 && (
                <Choice now={scale} mine="telemetry" choose={setScale} title="Telemetry" text={`height or position of ${plural(withPrior, 'photo')}`} />
              )}
              <Choice now={scale} mine="distance" choose={setScale} title="A known distance" text="between the places of two photos" />
              <Choice now={scale} mine="later" choose={setScale} title="Later" text="by the ruler in the finished map" />
              {scale === 'distance' && (
                <div class="distance">
                  <PhotoSelect label="From" value={a} images={images} onChange={setA} />
                  <PhotoSelect label="To" value={b} images={images} onChange={setB} />
                  <label>
                    Meters
                    <input inputMode="decimal" value={meters} onInput={(event) => setMeters(event.currentTarget.value)} />
                  </label>
                </div>
              )}
            </fieldset>
            <details>
              <summary>More</summary>
              <label>
                Origin
                <select value={origin} onChange={(event) => setOrigin(event.currentTarget.value as typeof origin)}>
                  <option value="last_camera">Where the last photo was taken</option>
                  <option value="mean_cameras">The middle of all cameras</option>
                  <option value="given">As given positions have it</option>
                </select>
              </label>
            </details>
          </>
        )}
        {error !== null && <Failure error={error} />}
        <footer class="row end">
          <button type="button" onClick={props.onClose}>Cancel</button>
          <button class="primary" disabled={!ready || busy}>Start</button>
        </footer>
      </form>
    </Dialog>
  );
}

function Choice(props: { now: Scale; mine: Scale; choose: (scale: Scale) => void; title: string; text: string }) {
  return (
    <label class="check choice">
      <input type="radio" name="scale" checked={props.now === props.mine} onChange={() => props.choose(props.mine)} />
      <span><strong>{props.title}</strong> <span class="muted">{props.text}</span></span>
    </label>
  );
}

function PhotoSelect(props: { label: string; value: string; images: Image[]; onChange: (name: string) => void }) {
  return (
    <label>
      {props.label}
      <select value={props.value} onChange={(event) => props.onChange(event.currentTarget.value)}>
        {props.images.map(({ id, name }) => <option key={id}>{name}</option>)}
      </select>
    </label>
  );
}
