import { ApiError, request } from '../../api/client';
import type { Job } from '../../api/types';
import { useLoad } from '../../state/load';
import { toastError } from '../../state/toasts';
import { download } from '../../ui/download';
import { duration, words } from '../../ui/format';
import { Icon } from '../../ui/icons';
import type { Report } from '../maps/map-info';

/** What came of a job: photos placed and not placed, warnings, advice. */
export function JobReport({ job }: { job: Job }) {
  const options = { at: { id: job.id } };
  const { data: report } = useLoad(async (signal): Promise<Report | null> => {
    try {
      const headers = { Accept: 'application/json' };
      const response = await request('GET', '/v1/jobs/{id}/report', null, { ...options, headers, signal });
      return (await response.json()) as Report;
    } catch (error) {
      if (error instanceof ApiError && error.problem.status === 409) return null;
      throw error;
    }
  }, [job.id, job.state]);
  if (!report) return null;
  const images = report.images ?? [];
  const out = images.filter(({ registered }) => !registered);
  const save = () => {
    const headers = { Accept: 'text/html' };
    download('/v1/jobs/{id}/report', { ...options, headers }, 'report.html').catch(toastError);
  };
  return (
    <section class="stack" aria-label="Report">
      <header class="row">
        <h2 class="grow">Report</h2>
        <button type="button" onClick={save}><Icon name="download" /> With pictures, as HTML</button>
      </header>
      <div class="figures">
        <Figure value={`${report.num_registered ?? images.length - out.length} / ${report.num_images ?? images.length}`} name="photos placed" />
        {report.mean_reprojection_px != null && (
          <Figure value={`${report.mean_reprojection_px.toFixed(2)} px`} name="mean reprojection error" />
        )}
        {report.mean_track_length != null && (
          <Figure value={report.mean_track_length.toFixed(1)} name="photos per point" />
        )}
        {report.wall_s != null && <Figure value={duration(report.wall_s)} name="time" />}
      </div>
      {report.warnings?.map(({ code, detail, hint }) => (
        <div key={code} class="note warn">
          <div>
            <p>{detail} <code>{code}</code></p>
            {hint && <p class="muted">{hint}</p>}
          </div>
        </div>
      ))}
      {report.advice?.map((text) => <p key={text} class="note">{text}</p>)}
      {images.length > 0 && (
        <details class="card" open={out.length > 0}>
          <summary>
            {out.length > 0 ? `${out.length} photos were not placed` : 'All photos were placed'}
          </summary>
          <table>
            <thead>
              <tr>
                <th>Photo</th>
                <th>Placed</th>
                <th class="end">Features</th>
                <th class="end">In the map</th>
                <th class="end">Error</th>
              </tr>
            </thead>
            <tbody>
              {[...out, ...images.filter(({ registered }) => registered)].map((image) => (
                <tr key={image.name}>
                  <td>{image.name}</td>
                  <td>
                    {image.registered
                      ? <span class="badge good">yes</span>
                      : <span class="badge warn">{words(image.reason ?? (image.duplicate_of ? 'duplicate' : 'no'))}</span>}
                    {image.detail && <div class="field-help">{image.detail}</div>}
                  </td>
                  <td class="end num">{image.num_features}</td>
                  <td class="end num">{image.num_observations}</td>
                  <td class="end num">{image.reprojection_px?.toFixed(2)}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </details>
      )}
    </section>
  );
}

const Figure = ({ value, name }: { value: string; name: string }) => (
  <div class="card figure">
    <strong class="num">{value}</strong>
    <span class="muted">{name}</span>
  </div>
);
