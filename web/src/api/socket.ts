// One socket for the whole page: topics are subscribed while someone listens, and again after
// every reconnection.
import { signal } from '@preact/signals';
import type { Schema } from './types';
import { joinFrame, splitFrame, type Frame } from './frames';
import { session } from '../state/session';

export type ServerMessage = Schema<'ServerMessage'>;
export type MessageOf<T extends ServerMessage['type']> = Extract<ServerMessage, { type: T }>;
type ClientBody = Schema<'ClientBody'>;
type Listener = (message: ServerMessage) => void;

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 8000;
const ANSWER_MS = 10_000;

interface Topic {
  listeners: Set<Listener>;
  /** Number of the last event of a job, so that none is missed. */
  last: number | undefined;
}

interface Waiting {
  resolve: (message: ServerMessage) => void;
  reject: (error: Error) => void;
}

/** `idle` until something is subscribed. */
export const link = signal<'idle' | 'connecting' | 'open' | 'lost'>('idle');

const topics = new Map<string, Topic>();
const everything = new Set<Listener>();
const frames = new Set<(frame: Frame) => void>();
const waiting = new Map<string, Waiting>();
const opened = new Set<() => void>();
let socket: WebSocket | null = null;
let failures = 0;
let retry: ReturnType<typeof setTimeout> | undefined;
let nextId = 1;

function connect(): void {
  if (socket || retry !== undefined) return;
  link.value = failures === 0 ? 'connecting' : 'lost';
  const token = session.token.value;
  const protocols = token ? ['volery', `bearer.${token}`] : ['volery'];
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  const made = new WebSocket(`${scheme}://${location.host}/v1/ws`, protocols);
  made.binaryType = 'arraybuffer';
  socket = made;
  made.onopen = () => {
    failures = 0;
    link.value = 'open';
    for (const [name, topic] of topics) sendSubscribe(name, topic);
    for (const call of opened) call();
  };
  made.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
    if (typeof data === 'string') take(JSON.parse(data) as ServerMessage);
    else {
      const frame = splitFrame(data);
      if (frame) for (const call of frames) call(frame);
    }
  };
  made.onclose = () => {
    socket = null;
    for (const { reject } of waiting.values()) reject(new Error('the connection was lost'));
    waiting.clear();
    if (session.state.value === 'locked') {
      link.value = 'idle';
      return;
    }
    link.value = 'lost';
    const wait = Math.min(FIRST_WAIT_MS * 2 ** failures, LONGEST_WAIT_MS);
    failures += 1;
    retry = setTimeout(() => {
      retry = undefined;
      connect();
    }, wait * (0.75 + Math.random() / 2));
  };
}

function sendSubscribe(topic: string, { last }: Topic): void {
  send(last === undefined ? { type: 'subscribe', topic } : { type: 'subscribe', topic, after: last });
}

function send(message: ClientBody & { id?: string }): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function take(message: ServerMessage): void {
  const answered = message.re ? waiting.get(message.re) : undefined;
  if (message.re && answered) {
    waiting.delete(message.re);
    if (message.type === 'error') answered.reject(new Error(message.detail));
    else answered.resolve(message);
  }
  for (const name of topicsOf(message)) {
    const topic = topics.get(name);
    if (!topic) continue;
    if (message.type === 'event' && name.startsWith('job:')) topic.last = message.event.seq;
    for (const call of topic.listeners) call(message);
  }
  for (const call of everything) call(message);
}

function topicsOf(message: ServerMessage): string[] {
  if (message.type === 'pose') return [`pose:${message.drone_id}`, 'pose:*'];
  return 'topic' in message ? [message.topic] : [];
}

/**
 * Calls `listener` with every message of a topic until the returned function is called. `after`:
 * past events of a job, too, from the one after this number.
 */
export function subscribe(topic: string, listener: Listener, after?: number): () => void {
  let entry = topics.get(topic);
  if (!entry) {
    entry = { listeners: new Set(), last: after };
    topics.set(topic, entry);
    sendSubscribe(topic, entry);
  }
  entry.listeners.add(listener);
  connect();
  return () => {
    entry.listeners.delete(listener);
    if (entry.listeners.size === 0 && topics.get(topic) === entry) {
      topics.delete(topic);
      send({ type: 'unsubscribe', topic });
    }
  };
}

function listen<T>(set: Set<T>, listener: T): () => void {
  set.add(listener);
  connect();
  return () => void set.delete(listener);
}

/** Every message, whatever its topic: frames of streams, answers. */
export const onMessage = (listener: Listener) => listen(everything, listener);
export const onFrame = (listener: (frame: Frame) => void) => listen(frames, listener);
/** Each time the socket has opened: streams have to be opened again. */
export const onOpen = (listener: () => void) => listen(opened, listener);

/** Sends a message and waits for its answer. */
export function ask(body: ClientBody): Promise<ServerMessage> {
  const id = `w${nextId++}`;
  return new Promise((resolve, reject) => {
    if (socket?.readyState !== WebSocket.OPEN) {
      reject(new Error('the socket is not open'));
      return;
    }
    const timer = setTimeout(() => {
      waiting.delete(id);
      reject(new Error('the ground station does not answer'));
    }, ANSWER_MS);
    const end = <A>(call: (value: A) => void) => (value: A) => {
      clearTimeout(timer);
      call(value);
    };
    waiting.set(id, { resolve: end(resolve), reject: end(reject) });
    send({ ...body, id });
  });
}

export function sendFrame(kind: number, header: Schema<'FrameHeader'>, payload: Uint8Array): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(joinFrame(kind, header, payload));
}

/** Ends the connection, as when the token changes. */
export function disconnect(): void {
  clearTimeout(retry);
  retry = undefined;
  failures = 0;
  socket?.close();
}
