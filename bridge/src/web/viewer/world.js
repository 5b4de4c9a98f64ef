// Where the drawing's zero lies. World coordinates stay in doubles; what goes to the graphics card is relative to an
// origin near the vehicle. The origin moves when the vehicle is 500 m away from it: everything keeps its own origin
// in doubles, so nothing has to be sent again.

const RANGE_M = 500;

export class World {
  constructor() {
    this.origin = null;
    this.zone = null;
  }

  // True where the zone changed: what was drawn before means another place.
  vehicleAt(place, zone) {
    const far = !this.origin || Math.hypot(place[0] - this.origin[0], place[1] - this.origin[1]) > RANGE_M;
    const crossed = this.zone !== null && this.zone !== zone;
    if (far || crossed) this.origin = place.map(Math.round);
    this.zone = zone;
    return crossed;
  }

  // Before the first pose, the first frame's own origin is as good as any.
  toLocal(place) {
    this.origin ??= place.map(Math.round);
    return [0, 1, 2].map((axis) => place[axis] - this.origin[axis]);
  }
}
