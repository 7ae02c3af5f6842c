import type { Job } from '../../api/types';
import { duration, plural, words } from '../../ui/format';

const TONES: Partial<Record<Job['state'], string>> = {
  running: 'info',
  succeeded: 'good',
  partial: 'warn',
  failed: 'bad',
};

export const StateBadge = ({ job }: { job: Job }) => (
  <span class={`badge ${TONES[job.state] ?? ''}`}>
    {job.cancel_requested && job.state === 'running' ? 'stopping' : job.state}
  </span>
);

const KINDS: Record<Job['kind'], string> = {
  reconstruct: 'Map of photos',
  register_maps: 'Joined maps',
  extend_map: 'More photos for a map',
};

/** What a job is for. */
export const titleOf = (job: Job): string => job.request.map_name ?? KINDS[job.kind];

export const kindOf = (job: Job): string => KINDS[job.kind];

/** Where it stands, in one line. */
export function lineOf(job: Job): string {
  if (job.state === 'queued') {
    return job.queue_position ? `after ${plural(job.queue_position, 'other job')}` : 'starts at once';
  }
  if (job.state !== 'running') return job.error?.detail ?? '';
  const { done, total, unit, eta_s } = job.progress;
  const eta = eta_s != null ? `, about ${duration(eta_s)} left in this stage` : '';
  return `${words(job.stage ?? 'starting')}: ${done} of ${total} ${unit}${eta}`;
}

export const tookOf = (job: Job): string => (job.started ? timeBetween(job.started, job.finished) : '');

/** Without an end, until now. */
export const timeBetween = (start: string, end?: string | null): string =>
  duration(Math.max((end ? Date.parse(end) : Date.now()) - Date.parse(start), 0) / 1000);

export const Progress = ({ job }: { job: Job }) => (
  <progress aria-label={`Progress of ${titleOf(job)}`} max={1} value={job.progress.fraction} />
);
