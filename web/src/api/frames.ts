// Binary frames of the socket: magic u16 | version u8 | kind u8 | header_len u32, then a JSON
// header, then the payload; numbers are little-endian.

const MAGIC = 0x5956;
const VERSION = 1;
const PREFIX = 8;

export const IMAGE_QUERY = 1;

export interface Frame {
  kind: number;
  header: unknown;
  payload: Uint8Array;
}

export function joinFrame(kind: number, header: unknown, payload: Uint8Array): ArrayBuffer {
  const text = new TextEncoder().encode(JSON.stringify(header));
  const frame = new ArrayBuffer(PREFIX + text.length + payload.length);
  const view = new DataView(frame);
  view.setUint16(0, MAGIC, true);
  view.setUint8(2, VERSION);
  view.setUint8(3, kind);
  view.setUint32(4, text.length, true);
  const bytes = new Uint8Array(frame);
  bytes.set(text, PREFIX);
  bytes.set(payload, PREFIX + text.length);
  return frame;
}

/** `null` when it is not a frame. */
export function splitFrame(frame: ArrayBuffer): Frame | null {
  if (frame.byteLength < PREFIX) return null;
  const view = new DataView(frame);
  const headerEnd = PREFIX + view.getUint32(4, true);
  const known = view.getUint16(0, true) === MAGIC && view.getUint8(2) === VERSION;
  if (!known || headerEnd > frame.byteLength) return null;
  const text = new TextDecoder().decode(new Uint8Array(frame, PREFIX, headerEnd - PREFIX));
  return {
    kind: view.getUint8(3),
    header: JSON.parse(text) as unknown,
    payload: new Uint8Array(frame, headerEnd),
  };
}
