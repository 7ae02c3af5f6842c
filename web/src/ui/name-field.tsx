import { useState } from 'preact/hooks';
import { Icon } from './icons';

/** The name of the thing a page is about, to be changed in place. */
export function NameField(props: { name: string; label: string; onSave: (name: string) => Promise<void> }) {
  const [text, setText] = useState<string | null>(null);
  if (text === null) {
    return (
      <div class="row name-field grow">
        <h1 class="ellipsis">{props.name}</h1>
        <button type="button" class="quiet icon-only" aria-label="Rename" onClick={() => setText(props.name)}>
          <Icon name="edit" />
        </button>
      </div>
    );
  }
  return (
    <form
      class="row name-field grow"
      onSubmit={(event) => {
        event.preventDefault();
        void props.onSave(text.trim()).then(() => setText(null));
      }}
    >
      <input
        class="grow"
        aria-label={props.label}
        value={text}
        maxLength={200}
        ref={(input) => input?.focus()}
        onInput={(event) => setText(event.currentTarget.value)}
        onKeyDown={(event) => event.key === 'Escape' && setText(null)}
      />
      <button class="primary" disabled={text.trim() === ''}>Save</button>
    </form>
  );
}
