import { useState } from 'preact/hooks';
import { list, post } from '../../api/client';
import { useLoad } from '../../state/load';
import { navigate } from '../../state/router';
import { Dialog } from '../../ui/dialog';
import { Failure } from '../../ui/failure';
import { Presets, type Preset } from './presets';

/** Maps that share a part become one, in the frame of the first. */
export function JoinMaps({ onClose }: { onClose: () => void }) {
  const { data, error, reload } = useLoad(() => list('/v1/maps'), []);
  const [chosen, setChosen] = useState<string[]>([]);
  const [preset, setPreset] = useState<Preset>('balanced');
  const [refused, setRefused] = useState<unknown>(null);
  const toggle = (id: string) =>
    setChosen(chosen.includes(id) ? chosen.filter((one) => one !== id) : [...chosen, id]);
  const start = async () => {
    try {
      const names = chosen.map((id) => data?.find((map) => map.id === id)?.name);
      const body = { kind: 'register_maps', map_ids: chosen, preset, map_name: names.join(' + ').slice(0, 200) } as const;
      const job = await post('/v1/jobs', body);
      onClose();
      navigate(`/jobs/${job.id}`);
    } catch (error) {
      setRefused(error);
    }
  };
  return (
    <Dialog title="Join maps" onClose={onClose}>
      <div class="stack">
        <p class="muted">Maps that share a part become one, in the frame of the one chosen first.</p>
        {error !== null && <Failure error={error} retry={reload} />}
        {data && data.length < 2 && <p class="note">There are no two maps yet.</p>}
        <div>
          {data?.map((map) => (
            <label key={map.id} class="check">
              <input type="checkbox" checked={chosen.includes(map.id)} onChange={() => toggle(map.id)} />
              <span class="grow">{map.name}</span>
              {chosen[0] === map.id && <span class="badge info">keeps its frame</span>}
            </label>
          ))}
        </div>
        <Presets chosen={preset} choose={setPreset} />
        {refused !== null && <Failure error={refused} />}
        <footer class="row end">
          <button type="button" onClick={onClose}>Cancel</button>
          <button type="button" class="primary" disabled={chosen.length < 2} onClick={() => void start()}>Join</button>
        </footer>
      </div>
    </Dialog>
  );
}
