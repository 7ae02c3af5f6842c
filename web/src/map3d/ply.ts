// Point clouds as the service writes them: binary little-endian PLY of scalars.

export interface Points {
  positions: Float32Array;
  /** Red, green, blue of each point, 0 to 255. */
  colors: Uint8Array;
}

const SIZES: Record<string, number> = {
  char: 1, uchar: 1, short: 2, ushort: 2, int: 4, uint: 4, float: 4, double: 8,
};

/** Reads x, y, z and red, green, blue of the first element, which holds the vertices. */
export function readPoints(buffer: ArrayBuffer): Points {
  const head = new TextDecoder('latin1').decode(new Uint8Array(buffer, 0, Math.min(buffer.byteLength, 4096)));
  const end = head.indexOf('end_header\n');
  if (!head.startsWith('ply\nformat binary_little_endian') || end < 0) {
    throw new Error('the cloud is not a binary PLY file');
  }
  let count = 0;
  let stride = 0;
  let elements = 0;
  const offsets: Record<string, number> = {};
  for (const line of head.slice(0, end).split('\n')) {
    const [word, first, second] = line.split(' ');
    if (word === 'element' && ++elements === 1) count = Number(second);
    if (word === 'property' && elements === 1) {
      offsets[second ?? ''] = stride;
      stride += SIZES[first ?? ''] ?? NaN;
    }
  }
  const start = end + 'end_header\n'.length;
  if (!(start + count * stride <= buffer.byteLength)) throw new Error('the cloud is cut off');
  const { x = NaN, red = NaN } = offsets;
  if (Number.isNaN(x + red)) throw new Error('the cloud has no positions or no colors');
  const view = new DataView(buffer);
  const bytes = new Uint8Array(buffer);
  const positions = new Float32Array(count * 3);
  const colors = new Uint8Array(count * 3);
  for (let i = 0, at = start; i < count; i++, at += stride) {
    for (let k = 0; k < 3; k++) {
      positions[i * 3 + k] = view.getFloat32(at + x + 4 * k, true);
      colors[i * 3 + k] = bytes[at + red + k]!;
    }
  }
  return { positions, colors };
}
