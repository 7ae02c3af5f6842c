import { alerts, dismissAlert, meaningOf, type AlertLine } from '../state/alerts';
import { fleetTick, nameOf } from '../state/fleet';
import { dismiss, toasts } from '../state/toasts';
import { Icon } from './icons';

function Dismiss({ onClick }: { onClick: () => void }) {
  return (
    <button type="button" class="quiet icon-only" aria-label="Dismiss" onClick={onClick}>
      <Icon name="close" />
    </button>
  );
}

/** Under the header, above every view: what somebody has to know now. */
export function AlertStrip() {
  if (alerts.value.length === 0) return null;
  return (
    <section class="alerts" aria-label="Alerts" role="alert">
      {alerts.value.map((line) => <Alert key={`${line.drone}/${line.code}`} line={line} />)}
    </section>
  );
}

function Alert({ line }: { line: AlertLine }) {
  const { drone, code, detail, times, t_ns } = line;
  const [tone, meaning] = meaningOf(line);
  // Names come and change.
  fleetTick.value;
  return (
    <div class={`alert ${tone}`}>
      <Icon name="warn" />
      <div>
        <span class="num">{new Date(t_ns / 1e6).toLocaleTimeString()}</span>{' '}
        {nameOf(drone)} {meaning}{detail && `: ${detail}`}{' '}
        {times > 1 && <span class="badge num">{times} times</span>} <code>{code}</code>
      </div>
      <Dismiss onClick={() => dismissAlert(line)} />
    </div>
  );
}

export function Toasts() {
  return (
    <section class="toasts" aria-label="Messages" role="status" aria-live="polite">
      {toasts.value.map((message) => (
        <div key={message.id} class={`toast ${message.tone}`}>
          <div>
            {message.text} {message.code && <code>{message.code}</code>}
            {message.hint && <div class="muted">{message.hint}</div>}
          </div>
          <Dismiss onClick={() => dismiss(message.id)} />
        </div>
      ))}
    </section>
  );
}
