import { allStop, stopReport, stopWords } from '../state/all-stop';
import { nameOf } from '../state/fleet';
import { explain } from '../api/client';
import { Icon } from './icons';

/** Always there, one click, no question asked: every drone that is armed holds where it is. */
export function StopButton() {
  return (
    <button
      type="button"
      class="all-stop"
      title="Every drone holds where it is: Shift+Space, or Escape twice"
      aria-keyshortcuts="Shift+Space"
      onClick={() => void allStop()}
    >
      <Icon name="stop" />
      All stop
    </button>
  );
}

export function AllStop() {
  return (
    <>
      <StopButton />
      <Report />
    </>
  );
}

/** What came of it, drone by drone, until it is closed. */
function Report() {
  const report = stopReport.value;
  if (!report) return null;
  const { state, commands, at } = report;
  return (
    <section class={`stop-report ${state}`} role="alert" aria-label="All stop">
      <header class="row">
        <Icon name="stop" />
        <strong class="grow">{HEADS[state]}</strong>
        <time class="num">{at.toLocaleTimeString()}</time>
        <button type="button" class="quiet icon-only" aria-label="Close" onClick={() => (stopReport.value = null)}>
          <Icon name="close" />
        </button>
      </header>
      {state === 'failed' && (
        <p>
          {explain(report.error).text}. <strong>Use the remote controls.</strong>{' '}
          <button type="button" onClick={() => void allStop()}>Again</button>
        </p>
      )}
      {state === 'answered' && commands.length === 0 && <p>No drone is armed.</p>}
      {commands.length > 0 && (
        <ul>
          {commands.map((command) => (
            <li key={command.id} data-drone={command.drone}>
              <span>{nameOf(command.drone)}</span> {stopWords(command)}
            </li>
          ))}
        </ul>
      )}
    </section>
  );
}

const HEADS = {
  asked: 'All stop: telling the drones …',
  answered: 'All stop',
  failed: 'ALL STOP DID NOT ARRIVE',
} as const;
