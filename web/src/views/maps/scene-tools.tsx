import { Icon } from '../../ui/icons';
import type { MapViewer } from './viewer';

const NAMES = {
  mesh: 'Surface',
  dense: 'Dense cloud',
  sparse: 'Sparse points',
  cameras: 'Cameras',
  grid: 'Grid, 1 m',
  axes: 'Axes',
} as const;

/** What is shown, and back to the whole. */
export function SceneTools({ viewer }: { viewer: MapViewer }) {
  const shown = viewer.shown.value;
  return (
    <div class="scene-tools" role="group" aria-label="Layers">
      {([...viewer.layers, 'cameras', 'grid', 'axes'] as const).map((layer) => (
        <button
          key={layer}
          type="button"
          aria-pressed={shown.has(layer)}
          onClick={() => void viewer.toggle(layer)}
        >
          {viewer.data.version.info && layer === 'grid' && !isMetric(viewer) ? 'Grid' : NAMES[layer]}
          {viewer.loading.value === layer && ' …'}
        </button>
      ))}
      <button type="button" class="icon-only" aria-label="Show the whole map" title="Show the whole map" onClick={() => viewer.home()}>
        <Icon name="home" />
      </button>
    </div>
  );
}

const isMetric = (viewer: MapViewer): boolean =>
  (viewer.data.version.info as { scale?: { metric?: boolean } }).scale?.metric === true;

/** Along the way of the cameras. */
export function WayBar({ viewer }: { viewer: MapViewer }) {
  const { tour, data } = viewer;
  const last = data.placed.length - 1;
  if (last < 1) return null;
  const playing = tour.playing.value;
  const at = tour.at.value;
  return (
    <div class="way-bar" role="group" aria-label="Along the way of the cameras">
      <button
        type="button"
        class="quiet icon-only"
        aria-label={playing ? 'Pause' : 'Fly along the way of the cameras'}
        title={playing ? 'Pause' : 'Fly along the way of the cameras'}
        onClick={() => {
          if (playing) tour.pause();
          else {
            viewer.chosen.value = null;
            tour.play();
          }
        }}
      >
        <Icon name={playing ? 'pause' : 'play'} />
      </button>
      <input
        type="range"
        aria-label="Place on the way"
        min={0}
        max={last}
        step={0.01}
        value={at}
        onInput={(event) => {
          viewer.choose(null);
          tour.seek(Number(event.currentTarget.value));
        }}
      />
      <span class="num muted">{Math.round(at) + 1} / {last + 1}</span>
    </div>
  );
}
