import { words } from '../../ui/format';
import type { MapViewer } from './viewer';

/** What to do about a photo without a pose. */
const ADVICE: Record<string, string> = {
  undecodable: 'the file is damaged: take it again',
  too_few_features: 'bare walls or darkness: add posters or light, step back',
  blurred: 'stop before shooting, or turn slower than 10° per second',
  no_overlap: 'take two or three photos between this one and its neighbors',
  no_parallax: 'move while turning: a circle of 0.3 m is enough',
  ambiguous: 'the place looks like another: take photos that lead there',
  other_zone: 'take photos that connect this part with the rest',
};

/** Photos without a pose and why, then those with one. */
export function PhotosPanel({ viewer }: { viewer: MapViewer }) {
  const { placed, unplaced } = viewer.data;
  const chosen = viewer.chosen.value;
  return (
    <>
      {unplaced.length > 0 && (
        <section class="stack tight">
          <h3>Not placed: {unplaced.length}</h3>
          <ul class="lines">
            {unplaced.map(({ name, reason, detail }) => (
              <li key={name}>
                <div class="row">
                  <span class="grow ellipsis" title={name}>{name}</span>
                  <span class="badge warn">{words(reason ?? 'unknown')}</span>
                </div>
                <p class="field-help">{detail ?? ADVICE[reason ?? '']}</p>
              </li>
            ))}
          </ul>
        </section>
      )}
      <section class="stack tight">
        <h3>Placed: {placed.length}</h3>
        {placed.length > 0 && (
          <p class="field-help">Choose one here or click its camera in the scene.</p>
        )}
        <ul class="lines">
          {placed.map(({ name }, index) => (
            <li key={name}>
              <button
                type="button"
                class="link"
                aria-pressed={chosen === index}
                onClick={() => viewer.choose(chosen === index ? null : index)}
                onDblClick={() => void viewer.lookThrough(index)}
              >
                {name}
              </button>
            </li>
          ))}
        </ul>
      </section>
    </>
  );
}
