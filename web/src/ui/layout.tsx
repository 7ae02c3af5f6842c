import type { ComponentChildren } from 'preact';
import { link } from '../api/socket';
import { leave } from '../state/enter';
import { AREAS, place, type Area } from '../state/router';
import { session } from '../state/session';
import { switchTheme, theme } from '../state/theme';
import { AllStop } from './all-stop';
import { Icon } from './icons';
import { AlertStrip, Toasts } from './messages';

const TITLES: Record<Area, string> = {
  photos: 'Photos',
  jobs: 'Jobs',
  maps: 'Maps',
  fly: 'Fly',
  docs: 'Docs',
};

export function Layout({ children }: { children: ComponentChildren }) {
  const { area } = place.value;
  return (
    <>
      <a class="skip" href="#main">
        Skip to content
      </a>
      <header class="top">
        <a class="brand" href="/" aria-label="Volery, start" aria-current={area === 'start' ? 'page' : undefined}>
          <svg width="22" height="22" viewBox="0 0 32 32" aria-hidden="true">
            <path d="M4 7l12 19L28 7l-12 6z" />
          </svg>
          <span>Volery</span>
        </a>
        <nav aria-label="Areas">
          {AREAS.map((name) => (
            <a key={name} href={`/${name}`} aria-current={name === area ? 'page' : undefined}>
              <Icon name={name} />
              <span>{TITLES[name]}</span>
            </a>
          ))}
        </nav>
        <div class="tools">
          <LinkState />
          <button
            type="button"
            class="quiet icon-only"
            aria-label={theme.value === 'dark' ? 'Light theme' : 'Dark theme'}
            onClick={switchTheme}
          >
            <Icon name={theme.value === 'dark' ? 'sun' : 'moon'} />
          </button>
          {session.token.value && (
            <button
              type="button"
              class="quiet icon-only"
              aria-label="Forget the token"
              title="Forget the token"
              onClick={leave}
            >
              <Icon name="key" />
            </button>
          )}
          <AllStop />
        </div>
      </header>
      <AlertStrip />
      <main id="main" tabIndex={-1}>
        {children}
      </main>
      <Toasts />
    </>
  );
}

const LINK_WORDS = {
  idle: '',
  connecting: 'Connecting',
  open: 'Live',
  lost: 'Reconnecting',
} as const;

function LinkState() {
  const words = LINK_WORDS[link.value];
  return (
    <span class={`link-state ${link.value}`} role="status">
      {words}
    </span>
  );
}
