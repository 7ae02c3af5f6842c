import { useEffect, useState } from 'preact/hooks';
import { get, list } from '../api/client';
import { isOver } from '../state/jobs';
import { hasDrones } from '../state/session';
import { Fly, isMetric } from './fly/fly';
import { Jobs } from './jobs/jobs';
import { Photos } from './photos/photos';

const ASK_EVERY_MS = 2000;

interface Now {
  job?: string;
  /** Drones fly by it. */
  map?: string;
}

/** What goes on now: drones in the air, else a job at work; where nothing does, all begins with photos. */
export function Start() {
  const [now, setNow] = useState<Now>({});
  useEffect(() => {
    if (now.map) return undefined;
    // What cannot be asked is told by the view that is shown.
    const look = () => void findOut().then((next) => (next.map ?? next.job) && setNow(next), () => {});
    look();
    const timer = setInterval(look, ASK_EVERY_MS);
    return () => clearInterval(timer);
  }, [now.map]);
  if (now.map) return <Fly rest={[now.map]} />;
  if (now.job) return <Jobs rest={[now.job]} />;
  return <Photos rest={[]} />;
}

async function findOut(): Promise<Now> {
  const [inAir, jobs, maps] = await Promise.all([flying(), list('/v1/jobs'), list('/v1/maps')]);
  const job = jobs.findLast((job) => !isOver(job))?.id;
  const map = inAir && maps.findLast(isMetric)?.id;
  return { ...(job && { job }), ...(map && { map }) };
}

async function flying(): Promise<boolean> {
  return hasDrones() && (await get('/v1/drones')).items.some(({ state }) => state?.flying);
}
