import { useEffect, useState } from 'preact/hooks';
import { list } from '../../api/client';
import type { Job } from '../../api/types';
import { after, follow, isOver, loadJob } from '../../state/jobs';
import { useLoad } from '../../state/load';
import { Empty } from '../../ui/empty';
import { Failure } from '../../ui/failure';
import { when } from '../../ui/format';
import { useTicking } from '../../ui/ticking';
import { JoinMaps } from './join-maps';
import { kindOf, lineOf, Progress, StateBadge, titleOf, tookOf } from './job-words';
import '../../styles/jobs.css';

export function JobList() {
  const { data, error, reload, change } = useLoad(() => list('/v1/jobs'), []);
  const [joining, setJoining] = useState(false);
  const loaded = data !== null;
  useEffect(() => {
    if (!loaded) return undefined;
    const add = (job: Job) => change((jobs) => [...jobs.filter(({ id }) => id !== job.id), job]);
    return follow('jobs', (id, event) => {
      // A new job says so first.
      if (event.seq === 1) loadJob(id).then(add, () => {});
      else change((jobs) => jobs.map((job) => (job.id === id ? after(job, event) : job)));
    }, reload);
  }, [loaded]);
  if (error !== null) return <div class="page"><Failure error={error} retry={reload} /></div>;
  if (data === null) return <p class="muted center">Loading …</p>;
  if (data.length === 0) {
    return (
      <Empty title="No jobs yet" icon="jobs">
        <p>A job makes a map of photos. Upload a set of photos, then choose “Make a map”.</p>
        <a class="button primary" href="/photos">To the photos</a>
      </Empty>
    );
  }
  return (
    <div class="page">
      <header class="page-head">
        <h1>Jobs</h1>
        <button type="button" onClick={() => setJoining(true)}>Join maps</button>
        <a class="button primary" href="/photos">Make a map</a>
      </header>
      <div class="card flush">
        <table class="jobs">
          <thead>
            <tr>
              <th>Job</th>
              <th>State</th>
              <th>Progress</th>
              <th class="end">Took</th>
              <th>Queued</th>
            </tr>
          </thead>
          <tbody>
            {[...data].reverse().map((job) => <Row key={job.id} job={job} />)}
          </tbody>
        </table>
      </div>
      {joining && <JoinMaps onClose={() => setJoining(false)} />}
    </div>
  );
}

function Row({ job }: { job: Job }) {
  useTicking(!isOver(job));
  return (
    <tr>
      <td>
        <a class="strong" href={`/jobs/${job.id}`}>{titleOf(job)}</a>
        <div class="muted">{[kindOf(job), job.request.preset].filter(Boolean).join(', ')}</div>
      </td>
      <td><StateBadge job={job} /></td>
      <td class="line">
        {!isOver(job) && <Progress job={job} />}
        <div class="muted num">{lineOf(job)}</div>
        {job.outputs && <a href={`/maps/${job.outputs.map_id}/${job.outputs.version}`}>Open the map</a>}
      </td>
      <td class="end num">{tookOf(job)}</td>
      <td class="muted">{when(job.created)}</td>
    </tr>
  );
}
