import type { CreateJob } from '../../api/types';

export type Preset = NonNullable<CreateJob['preset']>;

const PRESETS = [
  { name: 'fast', title: 'Fast', text: 'Sparse map: enough to localize and to fly' },
  { name: 'balanced', title: 'Balanced', text: 'With a textured surface; minutes' },
  { name: 'best', title: 'Best', text: 'Finer surface; several times longer' },
] as const;

/** How much work goes into a map. */
export function Presets({ chosen, choose }: { chosen: Preset; choose: (preset: Preset) => void }) {
  return (
    <fieldset>
      <legend>Preset</legend>
      {PRESETS.map(({ name, title, text }) => (
        <label key={name} class="check choice">
          <input type="radio" name="preset" value={name} checked={chosen === name} onChange={() => choose(name)} />
          <span><strong>{title}</strong> <span class="muted">{text}</span></span>
        </label>
      ))}
    </fieldset>
  );
}
