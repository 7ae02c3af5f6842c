import { JobList } from './job-list';
import { JobPage } from './job-page';

/** `/jobs`, `/jobs/{id}`. */
export function Jobs({ rest }: { rest: string[] }) {
  const [id] = rest;
  return id === undefined ? <JobList /> : <JobPage key={id} id={id} />;
}
