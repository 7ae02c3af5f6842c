import type { ComponentType } from 'preact';
import { useEffect, useState } from 'preact/hooks';
import { Failure } from './failure';

/** A view whose code comes when it is first shown. */
export function lazyView<P extends object>(load: () => Promise<ComponentType<P>>): ComponentType<P> {
  let loaded: ComponentType<P> | null = null;
  return function Lazy(props: P) {
    const [, setReady] = useState(loaded !== null);
    const [error, setError] = useState<unknown>(null);
    useEffect(() => {
      if (loaded) return;
      load().then((view) => {
        loaded = view;
        setReady(true);
      }, setError);
    }, []);
    if (error !== null) return <Failure error={error} retry={() => location.reload()} />;
    const View = loaded;
    return View ? <View {...props} /> : <p class="muted center">Loading …</p>;
  };
}
