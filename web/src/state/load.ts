// Data of a view: loaded when it appears, again on demand.
import { useCallback, useEffect, useState } from 'preact/hooks';

export interface Loaded<T> {
  data: T | null;
  error: unknown;
  loading: boolean;
  reload: () => void;
  /** Puts in what is known without asking. */
  change: (how: (data: T) => T) => void;
}

/** Loads again whenever one of `keys` changes; the answer to an old question is dropped. */
export function useLoad<T>(load: (signal: AbortSignal) => Promise<T>, keys: unknown[]): Loaded<T> {
  const [state, setState] = useState<{ data: T | null; error: unknown; loading: boolean }>(
    { data: null, error: null, loading: true });
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    const abort = new AbortController();
    setState((old) => ({ ...old, loading: true }));
    load(abort.signal).then(
      (data) => abort.signal.aborted || setState({ data, error: null, loading: false }),
      (error: unknown) =>
        abort.signal.aborted || setState((old) => ({ ...old, error, loading: false })),
    );
    return () => abort.abort();
  }, [...keys, turn]);
  const reload = useCallback(() => setTurn((turn) => turn + 1), []);
  const change = useCallback((how: (data: T) => T) =>
    setState((old) => (old.data === null ? old : { ...old, data: how(old.data) })), []);
  return { ...state, reload, change };
}
