// Frames of the WebSocket, decoded. The bytes are written by bridge/src/web/frames/ and documented in
// docs/viewer-protocol.md. In: an ArrayBuffer. Out: a plain object, its large parts as views of that buffer.

export const VERSION = 2;
const HEADER_BYTES = 40;
const KINDS = ["hello", "block", "commit", "points", "grid", "objects", "vehicle", "processes", "counters", "detections"];
export const CLASSES = ["unknown", "tree", "rock", "drop", "wall", "brush"];
export const CELL_CLASSES = ["unknown", "ground", "brush", "tree", "obstacle", "drop"];
export const EVIDENCE = ["unknown", "measured", "interpolated", "extrapolated", "vehicle plane"];
export const REASONS = ["unknown", "clear", "slope", "roughness", "step", "brush", "tree", "obstacle", "clearance", "drop", "moving"];
export const QUALITIES = ["invalid", "degraded", "single", "differential", "RTK float", "RTK fixed"];
export const COST_LETHAL = 254, COST_UNKNOWN = 255;

export function decode(buffer) {
  if (buffer.byteLength < HEADER_BYTES) throw new Error(`${buffer.byteLength} bytes are no frame`);
  const view = new DataView(buffer);
  const kind = KINDS[view.getUint8(0)];
  if (view.getUint8(1) !== VERSION || !kind) throw new Error("another protocol version: reload the page");
  if (view.getUint32(4, true) !== buffer.byteLength - HEADER_BYTES) throw new Error("a frame of another length");
  const frame = {
    kind,
    zone: view.getUint8(2), south: view.getUint8(3),
    stampMs: Number(view.getBigInt64(8, true) / 1000n) / 1000,
    origin: [16, 24, 32].map((at) => view.getFloat64(at, true)),
  };
  return Object.assign(frame, decoders[kind](view, buffer));
}

const u32 = (view, at) => view.getUint32(HEADER_BYTES + at, true);
const f32 = (view, at) => view.getFloat32(HEADER_BYTES + at, true);
const f32s = (view, at, count) => Array.from({ length: count }, (_, i) => f32(view, at + 4 * i));
const key = (view, at) => [0, 4, 8].map((d) => view.getInt32(HEADER_BYTES + at + d, true)).join(" ");
const json = (_, buffer) => ({ json: JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, HEADER_BYTES))) });

const decoders = {
  hello: json,
  processes: json,
  counters: json,

  block: (view, buffer) => ({
    key: key(view, 0), version: u32(view, 12), voxelM: f32(view, 16),
    words: new Uint32Array(buffer, HEADER_BYTES + 24, u32(view, 20)),
  }),

  commit: (view) => ({
    snapshot: Number(view.getBigUint64(HEADER_BYTES + 8, true)), voxels: u32(view, 20),
    keys: new Set(Array.from({ length: u32(view, 16) }, (_, i) => key(view, 24 + 16 * i))),
  }),

  // Four 32-bit words a beam: x, y, z and its kind.
  points: (view, buffer) => ({
    ladarAt: f32s(view, 0, 3), ladar: u32(view, 12), count: u32(view, 16),
    beams: new Float32Array(buffer, HEADER_BYTES + 24, 4 * u32(view, 16)),
    kinds: new Uint32Array(buffer, HEADER_BYTES + 24, 4 * u32(view, 16)),
  }),

  grid: (view, buffer) => {
    const [width, height] = [u32(view, 4), u32(view, 8)];
    const cells = width * height, start = HEADER_BYTES + 16;
    const bytes = (i) => new Uint8Array(buffer, start + (2 + i) * cells, cells);
    return {
      cellM: f32(view, 0), width, height,
      groundCm: new Int16Array(buffer, start, cells), vegetationDm: bytes(0), cost: bytes(1), reason: bytes(2), classes: bytes(3), densityPct: bytes(4),
    };
  },

  objects: (view) => ({
    truncated: u32(view, 4) === 1, stored: Number(view.getBigUint64(HEADER_BYTES + 8, true)),
    list: Array.from({ length: u32(view, 0) }, (_, i) => object(view, 16 + 56 * i)),
  }),

  detections: (view) => ({
    list: Array.from({ length: u32(view, 0) }, (_, i) => ({
      at: f32s(view, 8 + 24 * i, 3), dbhM: f32(view, 20 + 24 * i), confidence: f32(view, 24 + 24 * i),
      what: CLASSES[u32(view, 28 + 24 * i)] ?? "unknown",
    })),
  }),

  vehicle: (view) => ({
    at: f32s(view, 0, 3), attitude: f32s(view, 12, 3), velocity: f32s(view, 24, 3), std: f32s(view, 36, 3),
    pan: f32(view, 48), tilt: f32(view, 52), quality: QUALITIES[view.getUint8(HEADER_BYTES + 56)] ?? "invalid",
    flags: view.getUint8(HEADER_BYTES + 57), hasJoint: view.getUint8(HEADER_BYTES + 59) === 1, sweep: u32(view, 60),
  }),
};

function object(view, at) {
  const [stdM, dbhM, dbhStdM, heightM, confidence, ageS] = f32s(view, at + 20, 6);
  return {
    id: view.getBigUint64(HEADER_BYTES + at, true).toString(), at: f32s(view, at + 8, 3),
    stdM, dbhM, dbhStdM, heightM, confidence, ageS, sightings: u32(view, at + 44),
    what: CLASSES[view.getUint8(HEADER_BYTES + at + 48)] ?? "unknown",
  };
}
