import { forget, uploads } from '../../state/uploads';
import { bytes, plural, words } from '../../ui/format';
import { Icon } from '../../ui/icons';

/** How far the files are, and what became of each that is not simply there. */
export function UploadState({ set }: { set: string }) {
  const upload = uploads.value[set];
  if (!upload) return null;
  const { results } = upload;
  const rejected = results.filter(({ status }) => status === 'rejected');
  const odd = results.filter(({ status, warnings, detail }) =>
    status !== 'rejected' && ((warnings?.length ?? 0) > 0 || (detail && status === 'stored')));
  const stored = results.filter(({ status }) => status === 'stored').length;
  const known = results.filter(({ status }) => status === 'duplicate').length;
  return (
    <section class="card stack upload" aria-label="Upload">
      <header class="row">
        <strong class="grow" role="status">
          {upload.running
            ? `Uploading ${plural(upload.files, 'file')}: ${bytes(upload.sent)} of ${bytes(upload.bytes)}`
            : [
                `${plural(stored, 'file')} stored`,
                known > 0 && `${known} known already`,
                rejected.length > 0 && `${rejected.length} refused`,
              ].filter(Boolean).join(', ')}
        </strong>
        {!upload.running && (
          <button type="button" class="quiet icon-only" aria-label="Dismiss" onClick={() => forget(set)}>
            <Icon name="close" />
          </button>
        )}
      </header>
      {upload.running && (
        <progress aria-label="Upload" max={upload.bytes || 1} value={upload.sent} />
      )}
      {rejected.length > 0 && (
        <ul class="lines">
          {rejected.map(({ name, code, detail }) => (
            <li key={name} class="row refused">
              <Icon name="warn" />
              <strong class="ellipsis">{name}</strong>
              <span class="grow">{detail ?? words(code ?? 'refused')}</span>
              {code && <code>{code}</code>}
            </li>
          ))}
        </ul>
      )}
      {odd.length > 0 && (
        <ul class="lines">
          {odd.map(({ name, detail, warnings }) => (
            <li key={name} class="row">
              <strong class="ellipsis">{name}</strong>
              <span class="grow muted">{[detail, ...(warnings ?? [])].filter(Boolean).join('; ')}</span>
            </li>
          ))}
        </ul>
      )}
    </section>
  );
}
