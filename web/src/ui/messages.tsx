import { alerts, dismiss, toasts, type Message } from '../state/toasts';
import { Icon } from './icons';

function Text({ message }: { message: Message }) {
  return (
    <>
      <div>
        {message.text} {message.code && <code>{message.code}</code>}
        {message.hint && <div class="muted">{message.hint}</div>}
      </div>
      <button
        type="button"
        class="quiet icon-only"
        aria-label="Dismiss"
        onClick={() => dismiss(message.id)}
      >
        <Icon name="close" />
      </button>
    </>
  );
}

/** Under the header, above every view. */
export function AlertStrip() {
  if (alerts.value.length === 0) return null;
  return (
    <section class="alerts" aria-label="Alerts" role="alert">
      {alerts.value.map((message) => (
        <div key={message.id} class={`alert ${message.tone}`}>
          <Icon name="warn" />
          <Text message={message} />
        </div>
      ))}
    </section>
  );
}

export function Toasts() {
  return (
    <section class="toasts" aria-label="Messages" role="status" aria-live="polite">
      {toasts.value.map((message) => (
        <div key={message.id} class={`toast ${message.tone}`}>
          <Text message={message} />
        </div>
      ))}
    </section>
  );
}
