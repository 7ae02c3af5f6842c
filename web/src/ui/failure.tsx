import { explain } from '../api/client';
import { Icon } from './icons';

/** What went wrong, its code, and what to do about it. */
export function Failure({ error, retry }: { error: unknown; retry?: () => void }) {
  const { text, code, hint } = explain(error);
  return (
    <div class="note bad" role="alert">
      <Icon name="warn" />
      <div>
        <p>
          {text} {code && <code>{code}</code>}
        </p>
        {hint && <p class="muted">{hint}</p>}
        {retry && (
          <button type="button" onClick={retry}>
            Try again
          </button>
        )}
      </div>
    </div>
  );
}
