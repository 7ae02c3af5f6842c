// Jobs as they go on: asked for once, then kept up to date by the events of the socket.
import { get } from '../api/client';
import { subscribe, type MessageOf } from '../api/socket';
import type { Job, JobEvent } from '../api/types';

export const isOver = (job: Job): boolean => !['queued', 'running'].includes(job.state);

interface StepData {
  stage: string;
  done: number;
  total: number;
  unit: string;
  fraction: number;
  eta_s?: number | null;
}

interface StateData {
  state: Job['state'];
  error?: Job['error'];
  outputs?: Job['outputs'];
}

/** The job after something happened to it. */
export function after(job: Job, event: JobEvent): Job {
  if (event.seq <= job.last_event) return job;
  const next: Job = { ...job, last_event: event.seq };
  if (event.type === 'job.state') {
    const { state, error, outputs } = event.data as StateData;
    Object.assign(next, { state, error: error ?? null, outputs: outputs ?? job.outputs });
    if (state === 'running' && !job.started) next.started = event.time;
    if (isOver(next)) {
      next.finished = event.time;
      next.stages = close(job.stages, event.time);
      if (state === 'succeeded') next.progress = { ...job.progress, fraction: 1, eta_s: null };
    }
  } else if (event.type === 'job.stage' || event.type === 'job.progress') {
    const { stage, done, total, unit, fraction, eta_s = null } = event.data as StepData;
    next.stage = stage;
    next.progress = { fraction, done, total, unit, eta_s };
    const known = job.stages.some(({ name }) => name === stage);
    const stages = known ? job.stages : [
      ...close(job.stages, event.time),
      { name: stage, state: 'running', started: event.time, done, total, unit, cached: 0 },
    ];
    next.stages = stages.map((one) => (one.name === stage ? { ...one, done, total, unit } : one));
  }
  return next;
}

const close = (stages: Job['stages'], time: string): Job['stages'] =>
  stages.map((stage) => (stage.state === 'done' ? stage : { ...stage, state: 'done', ended: time }));

/** Calls `tell` with each event of a job or of all; `stale` when events were lost. */
export function follow(
  topic: 'jobs' | `job:${string}`,
  tell: (id: string, event: JobEvent) => void,
  stale: () => void,
  last?: number,
): () => void {
  return subscribe(topic, (message) => {
    if (message.type === 'event') {
      const { job_id, event } = message as MessageOf<'event'>;
      tell(job_id, event);
    } else if (message.type === 'resync') stale();
  }, last);
}

export const loadJob = (id: string): Promise<Job> => get('/v1/jobs/{id}', { at: { id } });
