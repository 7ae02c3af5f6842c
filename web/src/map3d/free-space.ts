// Where the air of a map is free, as `GET /v1/maps/{id}/freespace` says it.
import { Quaternion, Vector3 } from 'three';
import { quaternion, vector } from './frames';

const MAGIC = 'VOLOCC01';

/** Of a place: nobody saw it, air, or something solid. */
export type Air = 'unseen' | 'free' | 'occupied';
const STATES: readonly Air[] = ['unseen', 'free', 'occupied'];

export class FreeSpace {
  private readonly gridFromMap: Quaternion;
  private readonly origin: Vector3;
  private readonly edge: number;
  private readonly counts: readonly [number, number, number];
  private readonly states: Uint8Array;

  constructor(buffer: ArrayBuffer) {
    const bytes = new Uint8Array(buffer);
    const view = new DataView(buffer);
    const number = (k: number) => view.getFloat64(8 + 8 * k, true);
    if (new TextDecoder('latin1').decode(bytes.subarray(0, 8)) !== MAGIC) throw new Error('this is no grid of free space');
    this.gridFromMap = quaternion([number(0), number(1), number(2), number(3)]).invert();
    this.origin = vector([number(4), number(5), number(6)]);
    this.edge = number(7);
    const count = (k: number) => view.getUint32(72 + 4 * k, true);
    this.counts = [count(0), count(1), count(2)];
    this.states = new Uint8Array(this.counts[0] * this.counts[1] * this.counts[2]);
    let filled = 0;
    for (let at = 84; at < bytes.length && filled < this.states.length; ) {
      const state = bytes[at++]!;
      let run = 0;
      for (let shift = 1; ; shift *= 128) {
        const part = bytes[at++] ?? 0;
        run += (part & 127) * shift;
        if (part < 128) break;
      }
      this.states.fill(state, filled, filled + run);
      filled += run;
    }
  }

  at(place: Vector3): Air {
    const [nx, ny, nz] = this.counts;
    const local = place.clone().sub(this.origin).applyQuaternion(this.gridFromMap).divideScalar(this.edge).floor();
    const inside = local.x >= 0 && local.y >= 0 && local.z >= 0 && local.x < nx && local.y < ny && local.z < nz;
    return inside ? STATES[this.states[local.x + nx * (local.y + ny * local.z)]!] ?? 'unseen' : 'unseen';
  }

  /** The worst within `radius` of a straight way, and where it is first. */
  along(from: Vector3, to: Vector3, radius: number): { air: Air; place: Vector3 | null } {
    const steps = Math.max(1, Math.ceil(from.distanceTo(to) / this.edge));
    let worst: { air: Air; place: Vector3 | null } = { air: 'free', place: null };
    const reach = Math.ceil(radius / this.edge);
    for (let step = 0; step <= steps; step++) {
      const place = from.clone().lerp(to, step / steps);
      for (let i = -reach; i <= reach; i++) {
        for (let j = -reach; j <= reach; j++) {
          for (let k = -reach; k <= reach; k++) {
            if (i * i + j * j + k * k > reach * reach) continue;
            const near = new Vector3(i, j, k).multiplyScalar(this.edge).add(place);
            const air = this.at(near);
            if (air === 'occupied') return { air, place: near };
            if (air === 'unseen' && worst.air === 'free') worst = { air, place: near };
          }
        }
      }
    }
    return worst;
  }
}
