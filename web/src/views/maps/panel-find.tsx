import { useEffect, useState } from 'preact/hooks';
import { request } from '../../api/client';
import type { CameraPose, LocalizeAnswer } from '../../api/types';
import { quaternion, yawOf } from '../../map3d/frames';
import { Vector3 } from 'three';
import { DropZone } from '../../ui/drop-zone';
import { Failure } from '../../ui/failure';
import { length, words } from '../../ui/format';
import { Picture } from '../../ui/picture';
import { infoOf } from './map-info';
import type { MapViewer } from './viewer';

interface Found {
  photo: File;
  answer: LocalizeAnswer;
}

/** Where a photo was taken. */
export function FindPanel({ viewer }: { viewer: MapViewer }) {
  const [found, setFound] = useState<Found | null>(null);
  const [busy, setBusy] = useState(false);
  const [error, setError] = useState<unknown>(null);
  const camera = viewer.data.placed[0]?.camera;
  useEffect(() => () => viewer.showLocated(null, camera), []);
  const find = async (photo: File) => {
    setBusy(true);
    setError(null);
    try {
      const { map_id, version } = viewer.data.version;
      const response = await request('POST', '/v1/maps/{id}/localize', photo, {
        at: { id: map_id },
        query: { version },
        headers: { 'Content-Type': photo.type || 'image/jpeg' },
      });
      const answer = (await response.json()) as LocalizeAnswer;
      setFound({ photo, answer });
      viewer.choose(null);
      viewer.showLocated(answer, camera);
    } catch (error) {
      setFound(null);
      setError(error);
    }
    setBusy(false);
  };
  const look = () => {
    if (!found?.answer.pose || !camera) return;
    const { photo, answer } = found;
    void viewer.tour.lookThrough({ name: photo.name, pose: found.answer.pose, camera }, answer.pose ? photo : null);
  };
  return (
    <>
      <DropZone label="Drop a photo, or choose one" accept="image/jpeg,image/png" disabled={busy} onFiles={([photo]) => photo && void find(photo)}>
        <p class="field-help">Its pose in this map is looked for.</p>
      </DropZone>
      {busy && <p class="muted" role="status">Looking for its place …</p>}
      {error !== null && <Failure error={error} />}
      {found && <Answer key={found.photo.name} found={found} viewer={viewer} look={look} />}
    </>
  );
}

function Answer({ found: { photo, answer }, viewer, look }: { found: Found; viewer: MapViewer; look: () => void }) {
  const tone = { ok: 'good', ambiguous: 'warn', not_found: 'bad' }[answer.status];
  const metric = infoOf(viewer.data.version).scale?.metric === true;
  const { pose } = answer;
  return (
    <section class="stack" role="status">
      <div class="row">
        <strong class="grow ellipsis">{photo.name}</strong>
        <span class={`badge ${tone}`}>{words(answer.status)}</span>
      </div>
      {answer.reason && <p class="note warn">{words(answer.reason)}</p>}
      <Picture name={photo.name} alt={`Photo ${photo.name}`} load={async () => photo} />
      {pose && (
        <>
          <dl class="facts">
            <dt>Position</dt>
            <dd class="num">{pose.position.map((x) => x.toFixed(3)).join(', ')}</dd>
            <dt>Uncertain by</dt>
            <dd class="num">{sigmas(answer.covariance, metric)}</dd>
            <dt>Looks to</dt>
            <dd class="num">{headingText(pose)}</dd>
            <dt>Inliers</dt>
            <dd class="num">{answer.num_inliers}</dd>
            {answer.reprojection_px != null && (
              <>
                <dt>Reprojection</dt>
                <dd class="num">{answer.reprojection_px.toFixed(2)} px</dd>
              </>
            )}
            {answer.render_score && (
              <>
                <dt>Map agrees</dt>
                <dd class="num">{(answer.render_score.agreement * 100).toFixed(0)} %</dd>
              </>
            )}
            {answer.timings?.total_ms != null && (
              <>
                <dt>Took</dt>
                <dd class="num">{answer.timings.total_ms.toFixed(0)} ms</dd>
              </>
            )}
          </dl>
          <button type="button" onClick={look}>Look through</button>
        </>
      )}
    </section>
  );
}

/** Standard deviations of the position and of the worst angle. */
function sigmas(covariance: readonly number[] | null | undefined, metric: boolean): string {
  if (covariance?.length !== 36) return 'unknown';
  const sd = [0, 1, 2, 3, 4, 5].map((axis) => Math.sqrt(covariance[axis * 7]!));
  const angle = (Math.max(sd[3]!, sd[4]!, sd[5]!) * 180) / Math.PI;
  return `${length(Math.hypot(sd[0]!, sd[1]!, sd[2]!), metric)}, ${angle.toFixed(2)}°`;
}

function headingText(pose: CameraPose): string {
  const forward = new Vector3(0, 0, 1).applyQuaternion(quaternion(pose.orientation));
  const yaw = (yawOf(forward) * 180) / Math.PI;
  const pitch = (Math.asin(Math.min(Math.max(forward.z, -1), 1)) * 180) / Math.PI;
  return `yaw ${yaw.toFixed(1)}°, pitch ${pitch.toFixed(1)}°`;
}
