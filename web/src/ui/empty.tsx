import type { ComponentChildren } from 'preact';
import { Icon, type IconName } from './icons';

/** Nothing here yet: what it is for, and the next step. */
export function Empty(props: { title: string; icon?: IconName; children?: ComponentChildren }) {
  return (
    <div class="empty">
      {props.icon && <Icon name={props.icon} size={40} />}
      <h2>{props.title}</h2>
      {props.children}
    </div>
  );
}
