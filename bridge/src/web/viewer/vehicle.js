// The vehicle with its mast and head, and the trail of where it was (its newest 1500 places).

import { add, fromAttitude, multiply } from "./matrix.js";

const BODY = [0.93, 0.72, 0.20, 1], TRACK = [0.24, 0.26, 0.27, 1], GLASS = [0.38, 0.50, 0.56, 1], MAST = [0.35, 0.37, 0.38, 1];
const HEAD = [0.16, 0.35, 0.56, 1], TRAIL = [0.87, 0.60, 0.10, 1];
const TRAIL_MAX = 1500, TRAIL_STEP_M = 0.4;

export class Vehicle {
  constructor(solids) {
    this.solids = solids;
    this.frame = null;
    this.size = { length_m: 3.2, width_m: 1.7, height_m: 1.1, origin_m: 0 };
    this.trail = [];
  }

  put(frame) {
    this.frame = frame;
    const place = this.place, last = this.trail.at(-1);
    if (last && Math.hypot(place[0] - last[0], place[1] - last[1]) < TRAIL_STEP_M) return;
    this.trail.push(place);
    if (this.trail.length > TRAIL_MAX) this.trail.shift();
  }

  clear() {
    this.trail = [];
  }

  // In world coordinates.
  get place() { return add(this.frame.origin, this.frame.at); }

  draw(view, world, scans) {
    if (!this.frame) return;
    const { solids, size } = this, model = fromAttitude(this.frame.attitude, world.toLocal(this.place));
    const { length_m: l, width_m: w, height_m: h, origin_m: o } = size;
    solids.begin(view);
    // Boxes in the vehicle's own frame: x forward, y right, z down, the ground at z = origin_m.
    const box = (at, extent, colour) => solids.draw(solids.box, multiply(model, shift([at[0], at[1], o - at[2]])), extent, colour);
    for (const side of [-1, 1]) {
      box([0, side * w * 0.4, h * 0.27], [l, w * 0.2, h * 0.54], TRACK);
      box([0, side * w * 0.4, h * 0.56], [l * 0.9, w * 0.2, h * 0.06], BODY);
    }
    box([0, 0, h * 0.44], [l * 0.92, w * 0.6, h * 0.42], BODY);
    box([-l * 0.12, 0, h * 0.78], [l * 0.5, w * 0.62, h * 0.3], BODY);
    box([l * 0.135, 0, h * 0.79], [l * 0.03, w * 0.5, h * 0.2], GLASS);
    box([l * 0.47, 0, h * 0.3], [l * 0.06, w, h * 0.36], TRACK);
    for (const ladar of scans.ladars.values()) this.drawHead(model, world.toLocal(add(ladar.origin, ladar.at)));
    this.drawTrail(world);
  }

  // The head sits where the scan says the ladar is, and looks where the joint says.
  drawHead(model, at) {
    const { solids, frame } = this;
    const [cp, sp, ct, st] = [Math.cos(frame.pan), Math.sin(frame.pan), Math.cos(frame.tilt), Math.sin(frame.tilt)];
    const turn = multiply(new Float32Array([cp, sp, 0, 0, -sp, cp, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
      new Float32Array([ct, 0, -st, 0, 0, 1, 0, 0, st, 0, ct, 0, 0, 0, 0, 1]));
    const oriented = multiply(model, turn);
    oriented.set(at, 12);
    solids.draw(solids.box, oriented, [0.16, 0.2, 0.2], HEAD);
    const upright = new Float32Array(model);
    upright.set(at, 12);
    const mast = Math.max(0.2, at[2] - model[14] - this.size.height_m * 0.6 + this.size.origin_m);
    solids.draw(solids.box, multiply(upright, shift([-0.08, 0, mast / 2 + 0.08])), [0.07, 0.07, mast], MAST);
  }

  drawTrail(world) {
    for (const place of this.trail) {
      const [x, y, z] = world.toLocal(place);
      this.solids.draw(this.solids.box, shift([x, y, z + 0.2 - this.size.origin_m]), [0.12, 0.12, 0.05], TRAIL);
    }
  }
}

const shift = ([x, y, z]) => new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1]);
