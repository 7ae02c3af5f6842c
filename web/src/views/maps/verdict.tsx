import { words } from '../../ui/format';
import { TONES, type MapInfo } from './map-info';

export function VerdictBadge({ info }: { info: MapInfo }) {
  const verdict = info.quality?.verdict;
  return verdict ? <span class={`badge ${TONES[verdict]}`}>{verdict}</span> : null;
}

/** Without a scale, no drone may fly by a map. */
export function ScaleBadge({ info }: { info: MapInfo }) {
  const scale = info.scale;
  if (!scale?.metric) return <span class="badge bad">not metric</span>;
  const part = scale.sigma_rel === null ? '' : ` ± ${(scale.sigma_rel * 100).toFixed(1)} %`;
  return <span class="badge" title={`by ${words(scale.source)}`}>metric{part}</span>;
}

export function Reasons({ info }: { info: MapInfo }) {
  const { verdict, reasons = [] } = info.quality ?? {};
  if (!verdict || reasons.length === 0) return null;
  return (
    <div class={`note ${TONES[verdict]}`}>
      <ul>
        {reasons.map(({ code, detail }) => <li key={code}>{detail}</li>)}
      </ul>
    </div>
  );
}
