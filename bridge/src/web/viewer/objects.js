// Objects of the knowledge store as translucent cylinders, and candidates as rings: detections of the newest snapshot
// that the store does not report (yet). What is believed and what was merely seen are not drawn alike.

import { add, project } from "./matrix.js";
import { CANDIDATE, CLASS_COLOURS, OBJECT, rgb } from "./colours.js";

// A detection closer than this to a reported object is that object, seen again.
const KNOWN_M = 0.5;
const HEIGHT_SHOWN_M = 3, FLAT_M = 0.15, RADIUS_MIN_M = 0.22, LABELS_MAX = 48, PICK_PX = 14;

const COLOURS = { tree: OBJECT, rock: CLASS_COLOURS.obstacle, wall: CLASS_COLOURS.obstacle, drop: CLASS_COLOURS.drop, brush: CLASS_COLOURS.brush };

export class Objects {
  constructor(solids, labels) {
    this.solids = solids;
    this.labels = labels;
    this.list = [];
    this.seen = [];
    this.chosen = null;
    this.stored = 0;
  }

  put(frame) {
    this.stored = frame.stored;
    this.truncated = frame.truncated;
    this.list = frame.list.map((object) => ({ ...object, place: add(frame.origin, object.at) }));
  }

  putDetections(frame) {
    this.seen = frame.list.map((seen) => ({ ...seen, place: add(frame.origin, seen.at) }));
  }

  get candidates() {
    const known = (seen) => this.list.some(({ place }) => Math.hypot(place[0] - seen.place[0], place[1] - seen.place[1]) < KNOWN_M);
    return this.seen.filter((seen) => seen.what === "tree" && !known(seen));
  }

  clear() {
    this.list = this.seen = [];
  }

  // A trunk's cylinder is a little wider than the trunk, so that both can be seen; anything else is as wide as it reaches.
  radius(object) {
    if (object.what !== "tree") return Math.max(RADIUS_MIN_M, (object.dbhM || 0) * 0.5);
    return Math.max(RADIUS_MIN_M, (object.dbhM || 0) * 0.5 * 1.25 + 0.06);
  }

  height(object) {
    return Number.isFinite(object.heightM) ? Math.min(object.heightM, HEIGHT_SHOWN_M) : object.what === "tree" ? HEIGHT_SHOWN_M : FLAT_M;
  }

  draw(view, world, layers) {
    const { solids } = this, candidate = [...rgb(CANDIDATE), 0.85];
    solids.begin(view);
    const far = (object) => -distance(view.eye, world.toLocal(object.place));
    if (layers.detections)
      for (const seen of this.candidates) {
        const radius = Math.max(0.3, (seen.dbhM || 0.3) * 0.5 + 0.25);
        solids.draw(solids.ring, shift(world.toLocal(seen.place), 1.3), [radius, radius, 1], candidate);
      }
    if (!layers.objects) return;
    for (const object of [...this.list].sort((a, b) => far(a) - far(b))) {
      const at = world.toLocal(object.place), radius = this.radius(object), height = this.height(object);
      const [r, g, b] = rgb(COLOURS[object.what] ?? OBJECT);
      const chosen = object.id === this.chosen, alpha = chosen ? 0.85 : 0.3 + 0.25 * Math.min(1, object.confidence / 5);
      solids.draw(solids.cylinder, shift(at, 0), [radius, radius, height], [r, g, b, alpha], chosen ? 0 : 0.35);
      solids.draw(solids.ring, shift(at, 0.18), [radius * 1.9, radius * 1.9, 1], [r, g, b, 0.9]);
      solids.draw(solids.ring, shift(at, height), [radius * 1.15, radius * 1.15, 1], [r * 0.8, g * 0.75, b * 0.5, 1]);
    }
  }

  // Ids over the nearest objects, as text of the page.
  drawLabels(view, world, on) {
    const near = on ? this.list.map((object) => this.top(object, view, world)).filter(Boolean) : [];
    near.sort((a, b) => a.w - b.w).splice(LABELS_MAX);
    while (this.labels.children.length < near.length) this.labels.append(document.createElement("span"));
    [...this.labels.children].forEach((label, i) => {
      const shown = near[i];
      label.hidden = !shown;
      if (!shown) return;
      label.textContent = shown.object.id;
      label.style.transform = `translate(${shown.x.toFixed(1)}px, ${shown.y.toFixed(1)}px) translate(-50%, -115%)`;
      label.style.zIndex = Math.max(0, Math.round(1000 - shown.w));
      label.style.opacity = shown.object.id === this.chosen ? 1 : Math.max(0.55, 1.2 - shown.w / 80);
    });
  }

  top(object, view, world) {
    const at = project(view.matrix, add(world.toLocal(object.place), [0, 0, this.height(object)]), view.width, view.height);
    return at && at.x > 0 && at.y > 0 && at.x < view.width && at.y < view.height ? { ...at, object } : null;
  }

  // The nearest object whose axis passes under the pointer.
  pick(view, world, x, y) {
    let best = null;
    for (const object of this.list) {
      const foot = world.toLocal(object.place);
      const [a, b] = [0, this.height(object)].map((up) => project(view.matrix, add(foot, [0, 0, up]), view.width, view.height));
      if (!a || !b) continue;
      const wide = Math.max(PICK_PX, (this.radius(object) / a.w) * view.height);
      if (toSegment(x, y, a, b) < wide && (!best || a.w < best.w)) best = { object, w: a.w };
    }
    return best?.object ?? null;
  }
}

const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
const shift = ([x, y, z], up) => new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z + up, 1]);

function toSegment(x, y, a, b) {
  const [dx, dy] = [b.x - a.x, b.y - a.y];
  const t = Math.max(0, Math.min(1, ((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy || 1)));
  return Math.hypot(x - a.x - t * dx, y - a.y - t * dy);
}
