import { session } from './state/session';
import { place } from './state/router';
import { Layout } from './ui/layout';
import { Empty } from './ui/empty';
import { Gate } from './ui/gate';
import { Docs } from './views/docs/docs';
import { Fly } from './views/fly/fly';
import { Jobs } from './views/jobs/jobs';
import { Maps } from './views/maps/maps';
import { Photos } from './views/photos/photos';
import { Start } from './views/start';

export function App() {
  return (
    <Layout>{session.state.value === 'open' || place.value.area === 'docs' ? <View /> : <Gate />}</Layout>
  );
}

function View() {
  const { area, rest } = place.value;
  switch (area) {
    case 'start':
      return <Start />;
    case 'photos':
      return <Photos rest={rest} />;
    case 'jobs':
      return <Jobs rest={rest} />;
    case 'maps':
      return <Maps rest={rest} />;
    case 'fly':
      return <Fly rest={rest} />;
    case 'docs':
      return <Docs rest={rest} />;
    case null:
      return (
        <Empty title="There is no such page">
          <a class="button" href="/">To the start</a>
        </Empty>
      );
  }
}
