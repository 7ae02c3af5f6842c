// Short messages.
import { signal } from '@preact/signals';
import { explain } from '../api/client';

export type Tone = 'info' | 'good' | 'warn' | 'bad';

export interface Message {
  id: number;
  tone: Tone;
  text: string;
  code?: string | undefined;
  hint?: string | undefined;
}

const STAY_MS = 6000;
let nextId = 1;

export const toasts = signal<Message[]>([]);

export function toast(tone: Tone, text: string, more: Partial<Message> = {}): void {
  const message = { ...more, id: nextId++, tone, text };
  toasts.value = [...toasts.value.slice(-3), message];
  // What went wrong waits for its reader.
  if (tone !== 'bad') setTimeout(() => dismiss(message.id), STAY_MS);
}

/** Shows a failure with its code and advice. */
export function toastError(error: unknown): void {
  if (error instanceof DOMException && error.name === 'AbortError') return;
  const { text, code, hint } = explain(error);
  toast('bad', text, { code, hint });
}

export function dismiss(id: number): void {
  toasts.value = toasts.value.filter((message) => message.id !== id);
}
