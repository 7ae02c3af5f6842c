import { useEffect, useState } from 'preact/hooks';

const EVERY_MS = 1000;

/** Draws again each second while something goes on whose time is told. */
export function useTicking(goesOn: boolean): void {
  const [, tick] = useState(0);
  useEffect(() => {
    if (!goesOn) return undefined;
    const timer = setInterval(() => tick((ticks) => ticks + 1), EVERY_MS);
    return () => clearInterval(timer);
  }, [goesOn]);
}
