import type { ComponentChildren } from 'preact';
import { useEffect, useId, useRef } from 'preact/hooks';
import { StopButton } from './all-stop';
import { Icon } from './icons';

/** A modal dialog: the browser keeps the focus inside and closes it by Escape. */
export function Dialog(props: { title: string; onClose: () => void; children: ComponentChildren }) {
  const element = useRef<HTMLDialogElement>(null);
  const title = useId();
  useEffect(() => {
    const dialog = element.current!;
    dialog.showModal();
    return () => dialog.close();
  }, []);
  return (
    <dialog
      ref={element}
      aria-labelledby={title}
      onCancel={(event) => {
        event.preventDefault();
        props.onClose();
      }}
    >
      <header class="row">
        <h2 id={title} class="grow">{props.title}</h2>
        {/* A modal dialog shuts out the one of the page. */}
        <StopButton />
        <button type="button" class="quiet icon-only" aria-label="Close" onClick={props.onClose}>
          <Icon name="close" />
        </button>
      </header>
      {props.children}
    </dialog>
  );
}

/** Asks before something is lost. */
export function Confirm(props: {
  title: string;
  action: string;
  onYes: () => void;
  onClose: () => void;
  children: ComponentChildren;
}) {
  return (
    <Dialog title={props.title} onClose={props.onClose}>
      <p>{props.children}</p>
      <footer class="row end">
        <button type="button" onClick={props.onClose}>
          Keep
        </button>
        <button
          type="button"
          class="danger"
          onClick={() => {
            props.onClose();
            props.onYes();
          }}
        >
          {props.action}
        </button>
      </footer>
    </Dialog>
  );
}
