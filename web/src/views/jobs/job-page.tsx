import { useEffect, useState } from 'preact/hooks';
import { post, remove, request } from '../../api/client';
import type { Job } from '../../api/types';
import { after, follow, isOver, loadJob } from '../../state/jobs';
import { useLoad } from '../../state/load';
import { navigate } from '../../state/router';
import { toastError } from '../../state/toasts';
import { Confirm } from '../../ui/dialog';
import { Failure } from '../../ui/failure';
import { when, words } from '../../ui/format';
import { Icon } from '../../ui/icons';
import { useTicking } from '../../ui/ticking';
import { JobReport } from './job-report';
import { kindOf, lineOf, Progress, StateBadge, timeBetween, titleOf, tookOf } from './job-words';
import '../../styles/jobs.css';

interface JobData {
  job: Job;
  log: string[];
}

async function load(id: string): Promise<JobData> {
  const job = await loadJob(id);
  const text = await (await request('GET', '/v1/jobs/{id}/log', null, { at: { id } })).text();
  return { job, log: text.split('\n').filter(Boolean) };
}

export function JobPage({ id }: { id: string }) {
  const { data, error, reload } = useLoad(() => load(id), [id]);
  const [live, setLive] = useState<JobData | null>(null);
  const [leaving, setLeaving] = useState(false);
  useTicking(live !== null && !isOver(live.job));
  useEffect(() => {
    if (data === null) return undefined;
    let now = data;
    let isLeft = false;
    setLive(now);
    // Events do not tell what was found finished.
    const ask = () => void loadJob(id).then((job) => {
      if (isLeft || job.last_event < now.job.last_event) return;
      now = { ...now, job };
      setLive(now);
    }, () => {});
    const end = follow(`job:${id}`, (_, event) => {
      if (event.seq <= now.job.last_event) return;
      now = { job: after(now.job, event), log: [...now.log, ...logLine(event).filter((line) => !now.log.includes(line))] };
      setLive(now);
      if (event.type !== 'job.progress' && event.type !== 'job.log') ask();
    }, reload, data.job.last_event);
    return () => {
      isLeft = true;
      end();
    };
  }, [data]);
  if (error !== null) return <div class="page"><Failure error={error} retry={reload} /></div>;
  if (live === null) return <p class="muted center">Loading …</p>;
  const { job, log } = live;
  const act = async (call: () => Promise<unknown>) => {
    try {
      await call();
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <div class="page">
      <header class="page-head">
        <a class="muted" href="/jobs">Jobs</a>
        <span class="muted" aria-hidden="true">/</span>
        <div class="row grow">
          <h1 class="ellipsis" style={{ marginRight: 0 }}>{titleOf(job)}</h1>
          <StateBadge job={job} />
        </div>
        {!isOver(job) && (
          <button
            type="button"
            disabled={job.cancel_requested}
            onClick={() => void act(() => post('/v1/jobs/{id}/cancel', undefined, { at: { id } }))}
          >
            Cancel
          </button>
        )}
        {['failed', 'cancelled', 'partial'].includes(job.state) && (
          <button type="button" onClick={() => void act(() => post('/v1/jobs/{id}/retry', undefined, { at: { id } }))}>
            Run again
          </button>
        )}
        {isOver(job) && (
          <button type="button" class="quiet icon-only" aria-label="Delete the job" onClick={() => setLeaving(true)}>
            <Icon name="trash" />
          </button>
        )}
        {job.outputs && (
          <a class="button primary" href={`/maps/${job.outputs.map_id}/${job.outputs.version}`}>
            <Icon name="maps" /> Open the map
          </a>
        )}
      </header>
      <p class="muted num">
        {[
          kindOf(job),
          job.request.preset && `preset ${job.request.preset}`,
          `queued ${when(job.created)}`,
          job.started && `${isOver(job) ? 'took' : 'running for'} ${tookOf(job)}`,
          job.attempt > 1 && `run ${job.attempt}`,
        ].filter(Boolean).join(' · ')}
      </p>
      {job.error && (
        <div class={`note ${job.state === 'failed' ? 'bad' : 'warn'}`} role="alert">
          <Icon name="warn" />
          <div>
            <p>{job.error.detail} <code>{job.error.code}</code></p>
            {job.error.hint && <p class="muted">{job.error.hint}</p>}
          </div>
        </div>
      )}
      {!isOver(job) && (
        <section class="card stack" aria-label="Progress">
          <Progress job={job} />
          <div class="num" role="status">{lineOf(job)}</div>
        </section>
      )}
      <div class="job-columns">
        {job.stages.length > 0 && <Stages job={job} />}
        <section class="stack tight">
          <h2>Log</h2>
          <pre class="card log" tabIndex={0} aria-label="Log">{log.map(readable).join('\n')}</pre>
        </section>
      </div>
      {isOver(job) && <JobReport job={job} />}
      {leaving && (
        <Confirm
          title="Delete this job?"
          action="Delete"
          onClose={() => setLeaving(false)}
          onYes={() => void act(async () => {
            await remove('/v1/jobs/{id}', { at: { id } });
            navigate('/jobs', 'replace');
          })}
        >
          Its log and its work folder go. Its map stays.
        </Confirm>
      )}
    </div>
  );
}

function Stages({ job }: { job: Job }) {
  return (
    <section class="stack tight">
      <h2>Stages</h2>
      <div class="card flush">
        <table>
          <thead>
            <tr>
              <th>Stage</th>
              <th class="end">Done</th>
              <th class="end">Time</th>
            </tr>
          </thead>
          <tbody>
            {job.stages.map((stage) => (
              <tr key={stage.name}>
                <td>
                  <span class={`stage-dot ${stage.state}`} />
                  {words(stage.name)}
                </td>
                <td class="end num">
                  {stage.done} / {stage.total} {stage.unit}
                  {stage.cached > 0 && <div class="muted">{stage.cached} found finished</div>}
                </td>
                <td class="end num">{timeBetween(stage.started, stage.ended)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </section>
  );
}

/** An event as the log has it. */
function logLine(event: { time: string; type: string; data: unknown }): string[] {
  const data = event.data as { level?: string; message?: string; state?: string; stage?: string };
  switch (event.type) {
    case 'job.log':
      return [`${event.time} ${data.level} ${data.message}`];
    case 'job.state':
      return [`${event.time} info job ${data.state}`];
    case 'job.stage':
      return [`${event.time} info stage ${data.stage}`];
    default:
      return [];
  }
}

/** The time of the day is enough; `info` goes without saying. */
function readable(line: string): string {
  const [time = '', level = '', ...rest] = line.split(' ');
  const at = new Date(time);
  const clock = Number.isNaN(at.valueOf()) ? time : at.toLocaleTimeString('en-GB');
  return [clock, level === 'info' ? '' : level, ...rest].filter(Boolean).join(' ');
}
