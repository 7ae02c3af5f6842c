import { useState } from 'preact/hooks';
import { enterWith } from '../state/enter';
import { session } from '../state/session';
import { Empty } from './empty';

/** Before the service has let us in. */
export function Gate() {
  switch (session.state.value) {
    case 'checking':
      return <p class="muted center">Connecting …</p>;
    case 'unreachable':
      return (
        <Empty title="The ground station does not answer" icon="warn">
          <p>{session.reason}. Trying again every few seconds.</p>
        </Empty>
      );
    default:
      return <TokenForm />;
  }
}

function TokenForm() {
  const [token, setToken] = useState('');
  return (
    <form
      class="card gate"
      onSubmit={(event) => {
        event.preventDefault();
        void enterWith(token.trim());
      }}
    >
      <h1>Enter your token</h1>
      <p class="muted">
        The first admin token was printed when the ground station started for the first time; an
        admin makes others. It is kept in this tab only.
      </p>
      {session.reason.value && (
        <p class="note bad" role="alert">
          {session.reason}
        </p>
      )}
      <label>
        Token
        <input
          name="token"
          type="password"
          autocomplete="off"
          spellcheck={false}
          placeholder="vly_…"
          value={token}
          onInput={(event) => setToken(event.currentTarget.value)}
        />
      </label>
      <button class="primary" disabled={token.trim() === ''}>
        Enter
      </button>
    </form>
  );
}
