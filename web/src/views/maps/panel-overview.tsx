import { patch, post } from '../../api/client';
import { navigate } from '../../state/router';
import { toast, toastError } from '../../state/toasts';
import { count, when, words } from '../../ui/format';
import { Icon } from '../../ui/icons';
import { NameField } from '../../ui/name-field';
import { infoOf, sizeOf } from './map-info';
import type { MapData } from './map-data';
import { Reasons, ScaleBadge, VerdictBadge } from './verdict';

/** What the map is, how good it is, and its versions. */
export function OverviewPanel({ data, reload }: { data: MapData; reload: () => void }) {
  const { version, report } = data;
  const info = infoOf(version);
  const size = sizeOf(info);
  const unit = info.scale?.metric ? 'm' : 'units';
  const rename = async (name: string) => {
    try {
      await patch('/v1/maps/{id}', { name }, { at: { id: data.map.id } });
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <>
      <NameField name={data.map.name} label="Name of the map" onSave={rename} />
      <div class="row">
        <VerdictBadge info={info} />
        <ScaleBadge info={info} />
      </div>
      <Reasons info={info} />
      {!info.scale?.metric && (
        <div class="note bad">
          <Icon name="warn" />
          <p>
            The unit of this map is arbitrary: it localizes photos, but no drone flies by it. Measure
            a distance that you know under Measure, and say how long it is.
          </p>
        </div>
      )}
      <dl class="facts">
        {size && <Fact name="Size">{size.map((side) => side.toFixed(2)).join(' × ')} {unit}</Fact>}
        <Fact name="Photos">
          {report?.num_registered === undefined ? count(info.num_images ?? 0) : `${report.num_registered} of ${report.num_images} placed`}
        </Fact>
        {info.num_triangles ? <Fact name="Triangles">{count(info.num_triangles)}</Fact> : null}
        {info.num_dense_points ? <Fact name="Dense points">{count(info.num_dense_points)}</Fact> : null}
        {info.num_points ? <Fact name="Sparse points">{count(info.num_points)}</Fact> : null}
        {report?.mean_reprojection_px !== undefined && (
          <Fact name="Reprojection">{report.mean_reprojection_px.toFixed(2)} px</Fact>
        )}
        {info.scale && <Fact name="Scale by">{words(info.scale.source)}</Fact>}
        {info.gravity && (
          <Fact name="Level by">
            {words(info.gravity.source)}
            {info.gravity.sigma !== null && ` ± ${((info.gravity.sigma * 180) / Math.PI).toFixed(2)}°`}
          </Fact>
        )}
        {info.origin && <Fact name="Origin">{words(info.origin)}</Fact>}
        <Fact name="Made">{when(version.created)}</Fact>
      </dl>
      {version.job_id && <a href={`/jobs/${version.job_id}`}>Job and report</a>}
      <Versions data={data} reload={reload} />
    </>
  );
}

function Fact({ name, children }: { name: string; children: preact.ComponentChildren }) {
  return (
    <>
      <dt>{name}</dt>
      <dd class="num">{children}</dd>
    </>
  );
}

function Versions({ data, reload }: { data: MapData; reload: () => void }) {
  const { map, versions } = data;
  if (versions.length < 2) return null;
  const activate = async (version: number) => {
    try {
      await post('/v1/maps/{id}/activate', { version }, { at: { id: map.id } });
      toast('good', `Version ${version} answers from now on`);
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <section class="stack tight">
      <h3>Versions</h3>
      <ul class="lines">
        {versions.map(({ version, created }) => (
          <li key={version} class="row" aria-current={version === data.version.version}>
            <button type="button" class="link grow" onClick={() => navigate(`/maps/${map.id}/${version}`)}>
              {version} <span class="muted">{when(created)}</span>
            </button>
            {version === map.active_version ? (
              <span class="badge good">active</span>
            ) : (
              <button type="button" class="small" onClick={() => void activate(version)}>Activate</button>
            )}
          </li>
        ))}
      </ul>
    </section>
  );
}
