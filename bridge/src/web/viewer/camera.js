// An orbit camera: it looks at a target from an azimuth, an elevation and a distance. Following means that the target
// moves with the vehicle; what the viewer moved it away from the vehicle stays.

import { add, cross, lookAt, multiply, perspective, scale, sub, unit } from "./matrix.js";

const FOV_RAD = 0.78, NEAR_M = 0.3, FAR_M = 400;
const START = { azimuth: -0.62, elevation: 0.52, distance: 30 };

export class Camera {
  constructor(onChange) {
    this.onChange = onChange;
    this.anchor = [0, 0, 0];
    this.follow = true;
    this.reset();
  }

  reset() {
    Object.assign(this, START, { offset: [0, 0, 0.8], follow: true });
    this.onChange();
  }

  fromAbove() {
    Object.assign(this, { azimuth: 0, elevation: 1.5707, distance: Math.max(this.distance, 38) });
    this.onChange();
  }

  // The vehicle is here now. Without following, the offset takes the difference and the view stays.
  anchorAt(at) {
    if (!this.follow) this.offset = add(this.offset, sub(this.anchor, at));
    this.anchor = at;
    this.onChange();
  }

  setFollow(follow) {
    this.follow = follow;
    if (follow) this.offset = [0, 0, 0.8];
    this.onChange();
  }

  turn(azimuthRad, elevationRad) {
    this.azimuth += azimuthRad;
    this.elevation = Math.min(1.5707, Math.max(-0.2, this.elevation + elevationRad));
    this.onChange();
  }

  zoom(factor) {
    this.distance = Math.min(160, Math.max(2, this.distance * factor));
    this.onChange();
  }

  // Moves the target along the ground: right and ahead on the screen, in parts of the distance.
  move(right, ahead) {
    const [s, c] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const step = this.distance * 0.9;
    this.offset = add(this.offset, [step * (right * c + ahead * s), step * (ahead * c - right * s), 0]);
    this.onChange();
  }

  get target() { return add(this.anchor, this.offset); }

  // Azimuth 0 looks north.
  get eye() {
    const c = Math.cos(this.elevation);
    const back = [-Math.sin(this.azimuth) * c, -Math.cos(this.azimuth) * c, Math.sin(this.elevation)];
    return add(this.target, scale(back, this.distance));
  }

  view(width, height) {
    const eye = this.eye;
    const ahead = unit(sub(this.target, eye));
    const right = [Math.cos(this.azimuth), -Math.sin(this.azimuth), 0];
    const aspect = width / height;
    const viewMatrix = lookAt(eye, this.target, cross(right, ahead));
    const matrix = multiply(perspective(FOV_RAD, aspect, NEAR_M, FAR_M), viewMatrix);
    return { matrix, eye, ahead, right, up: cross(right, ahead), aspect, tanHalf: Math.tan(FOV_RAD / 2), width, height };
  }
}

// Direction of the ray through a pixel.
export function rayThrough(view, x, y) {
  const [u, v] = [(2 * x) / view.width - 1, 1 - (2 * y) / view.height];
  const side = scale(view.right, u * view.tanHalf * view.aspect);
  return unit(add(view.ahead, add(side, scale(view.up, v * view.tanHalf))));
}
