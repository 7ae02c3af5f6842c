/** A picture that takes no longer is a graphics card's, milliseconds: up to two frames until the card says so. */
const FAST_MS = 40;
/** Part of the time that slower pictures may take: the processor draws them, and others need it. */
const SHARE = 1 / 3;

/** Tells when the next picture may be drawn, by how long the last one took. */
export class Pace {
  private fence: WebGLSync | null = null;
  private begun = 0;
  private free = 0;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Whether a picture may be drawn at this time, milliseconds. */
  ready(now: number): boolean {
    if (this.fence) {
      if (this.gl.clientWaitSync(this.fence, 0, 0) === this.gl.TIMEOUT_EXPIRED) return false;
      this.gl.deleteSync(this.fence);
      this.fence = null;
      const took = now - this.begun;
      this.free = took > FAST_MS ? this.begun + took / SHARE : now;
    }
    return now >= this.free;
  }

  /** To be called after each picture. */
  drawn(now: number): void {
    if (this.fence) this.gl.deleteSync(this.fence);
    this.begun = now;
    this.fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
  }
}
