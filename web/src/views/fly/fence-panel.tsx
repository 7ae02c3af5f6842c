import { useState } from 'preact/hooks';
import type { FenceBlock, Geofence } from '../../api/types';
import { Confirm } from '../../ui/dialog';
import { Icon } from '../../ui/icons';
import { outlineOf, type Desk } from './desk';

export function FencePanel({ desk }: { desk: Desk }) {
  const [leaving, setLeaving] = useState(false);
  const drawing = desk.drawing.value;
  const draft = desk.draft.value;
  const fence = draft ?? desk.fence.value;
  const change = (next: Geofence) => (desk.draft.value = next);
  const start = (kind: 'area' | 'keep_out', shape: 'box' | 'polygon') =>
    (desk.drawing.value = { kind, shape, corners: [] });
  if (drawing) return <Outline desk={desk} />;
  return (
    <>
      <p class="muted">
        {desk.fence.value
          ? 'Flights stay inside the green area and outside the red ones.'
          : 'Without a fence, flights keep 0.5 m inside the bounds of the map.'}
      </p>
      {fence && (
        <>
          <Block title="Area" block={fence.area} onChange={(area) => change({ ...fence, area })} />
          {(fence.keep_out ?? []).map((block, k) => (
            <Block
              key={k}
              title={`Keep out ${k + 1}`}
              block={block}
              onChange={(next) => change({ ...fence, keep_out: fence.keep_out!.map((old, i) => (i === k ? next : old)) })}
              onDelete={() => change({ ...fence, keep_out: fence.keep_out!.filter((_, i) => i !== k) })}
            />
          ))}
          <label>
            Distance kept to all of it, meters
            <input
              type="number"
              min={0}
              step={0.1}
              value={fence.margin_m}
              onChange={(event) => change({ ...fence, margin_m: event.currentTarget.valueAsNumber || 0 })}
            />
          </label>
        </>
      )}
      {draft && (
        <div class="row">
          <button type="button" class="primary" onClick={() => void desk.saveFence(draft)}><Icon name="check" /> Save the fence</button>
          <button type="button" onClick={() => (desk.draft.value = null)}>Discard</button>
        </div>
      )}
      {desk.fence.value && !draft && (
        <div class="row">
          <button type="button" onClick={() => setLeaving(true)}><Icon name="trash" /> Delete the fence</button>
        </div>
      )}
      {leaving && (
        <Confirm
          title="Delete the fence of this map?"
          action="Delete"
          onClose={() => setLeaving(false)}
          onYes={() => void desk.deleteFence()}
        >
          Flights planned from now on keep 0.5 m inside the bounds of the map.
        </Confirm>
      )}
      <fieldset class="row">
        <legend>Draw the area</legend>
        <button type="button" onClick={() => start('area', 'box')}>Box</button>
        <button type="button" onClick={() => start('area', 'polygon')}>Polygon</button>
        <button type="button" onClick={() => change(desk.blank())}>Bounds of the map</button>
      </fieldset>
      <fieldset class="row">
        <legend>Draw a place to keep out of</legend>
        <button type="button" onClick={() => start('keep_out', 'box')}>Box</button>
        <button type="button" onClick={() => start('keep_out', 'polygon')}>Polygon</button>
      </fieldset>
    </>
  );
}

function Outline({ desk }: { desk: Desk }) {
  const drawing = desk.drawing.value!;
  const { kind, shape, corners } = drawing;
  return (
    <>
      <h2>{kind === 'area' ? 'Area' : 'Keep out'}: {shape}</h2>
      <p class="muted">Click in the map, or type the corners. {corners.length} set.</p>
      <form
        class="row"
        onSubmit={(event) => {
          event.preventDefault();
          const form = event.currentTarget;
          const value = (name: string) => (form.elements.namedItem(name) as HTMLInputElement).valueAsNumber;
          desk.corner(value('x'), value('y'));
          form.reset();
        }}
      >
        <label class="grow">x<input name="x" type="number" step="any" required /></label>
        <label class="grow">y<input name="y" type="number" step="any" required /></label>
        <button>Add corner</button>
      </form>
      <div class="row">
        {shape === 'polygon' && (
          <button type="button" class="primary" disabled={!outlineOf(drawing)} onClick={() => desk.closeOutline()}>
            Close the outline
          </button>
        )}
        <button type="button" disabled={corners.length === 0} onClick={() => (desk.drawing.value = { ...drawing, corners: corners.slice(0, -1) })}>
          Undo
        </button>
        <button type="button" onClick={() => (desk.drawing.value = null)}>Cancel</button>
      </div>
    </>
  );
}

function Block(props: {
  title: string;
  block: FenceBlock;
  onChange: (block: FenceBlock) => void;
  onDelete?: () => void;
}) {
  const { title, block, onChange, onDelete } = props;
  const height = (words: string, key: 'floor' | 'ceiling') => (
    <label class="grow">
      {words}
      <input
        type="number"
        step={0.1}
        aria-label={`${words} of ${title}, meters`}
        value={Math.round(block[key] * 100) / 100}
        onChange={(event) => {
          const value = event.currentTarget.valueAsNumber;
          if (!Number.isNaN(value)) onChange({ ...block, [key]: value });
        }}
      />
    </label>
  );
  return (
    <section class="card block" aria-label={title}>
      <div class="row">
        <h3 class="grow">{title}</h3>
        {onDelete && (
          <button type="button" class="quiet icon-only" aria-label={`Delete ${title}`} onClick={onDelete}>
            <Icon name="trash" />
          </button>
        )}
      </div>
      <div class="row">
        {height('From height', 'floor')}
        {height('to height', 'ceiling')}
      </div>
      <label>
        Corners x y, one a line
        <textarea
          class="mono"
          rows={Math.min(block.outline.length, 6)}
          value={block.outline.map((corner) => corner.map((value) => value.toFixed(2)).join(' ')).join('\n')}
          onChange={(event) => {
            const outline = event.currentTarget.value.trim().split('\n').map((line) => line.trim().split(/[\s,]+/).map(Number));
            const good = outline.length >= 3 && outline.every((corner) => corner.length === 2 && corner.every(Number.isFinite));
            event.currentTarget.setCustomValidity(good ? '' : 'at least three lines of two numbers');
            if (good) onChange({ ...block, outline });
            else event.currentTarget.reportValidity();
          }}
        />
      </label>
    </section>
  );
}
