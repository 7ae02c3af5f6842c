import { useEffect, useState } from 'preact/hooks';
import type { MapScene } from '../../map3d/scene';
import { SceneView } from '../../map3d/scene-view';
import { useLoad } from '../../state/load';
import { Failure } from '../../ui/failure';
import { Tabs } from '../../ui/tabs';
import '../../styles/map.css';
import { CameraCard } from './camera-card';
import { DownloadPanel } from './panel-download';
import { FindPanel } from './panel-find';
import { MeasurePanel } from './panel-measure';
import { OverviewPanel } from './panel-overview';
import { PhotosPanel } from './panel-photos';
import { loadMap, loadPhotos, type MapData } from './map-data';
import { SceneTools, WayBar } from './scene-tools';
import { MapViewer } from './viewer';

const TABS = [
  { name: 'overview', title: 'Overview' },
  { name: 'photos', title: 'Photos' },
  { name: 'measure', title: 'Measure' },
  { name: 'find', title: 'Locate' },
  { name: 'download', title: 'Export' },
] as const;

export function MapPage({ id, version }: { id: string; version?: number | undefined }) {
  const { data, error, reload } = useLoad((signal) => loadMap(id, version, signal), [id, version]);
  if (error !== null) return <div class="page"><Failure error={error} retry={reload} /></div>;
  if (data === null) return <p class="muted center">Loading …</p>;
  return <Stage data={data} reload={reload} />;
}

function Stage({ data, reload }: { data: MapData; reload: () => void }) {
  const [viewer, setViewer] = useState<MapViewer | null>(null);
  const [tab, setTab] = useState<(typeof TABS)[number]['name']>('overview');
  const onReady = (scene: MapScene) => {
    const made = new MapViewer(scene, data);
    setViewer(made);
    return () => made.dispose();
  };
  useEffect(() => {
    // Not urgent: the map is drawn before its photos are known.
    if (viewer) loadPhotos(data).then((photos) => (viewer.photos.value = photos), () => {});
  }, [viewer]);
  useEffect(() => {
    // Tools belong to their tab.
    if (viewer && tab !== 'measure') viewer.use('look');
  }, [tab]);
  return (
    <div class="stage">
      <SceneView onReady={onReady}>
        {viewer && (
          <>
            <SceneTools viewer={viewer} />
            <CameraCard viewer={viewer} />
            <WayBar viewer={viewer} />
          </>
        )}
      </SceneView>
      <aside class="panel" aria-label="Map">
        <Tabs label="Map" tabs={TABS} chosen={tab} onChoose={setTab}>
          {tab === 'overview' && <OverviewPanel data={data} reload={reload} />}
          {viewer && tab === 'photos' && <PhotosPanel viewer={viewer} />}
          {viewer && tab === 'measure' && <MeasurePanel viewer={viewer} />}
          {viewer && tab === 'find' && <FindPanel viewer={viewer} />}
          {tab === 'download' && <DownloadPanel data={data} />}
        </Tabs>
      </aside>
    </div>
  );
}
