// The Smart Sensor Grid: a texture that the voxels ask for their class, and a surface draped over the ground in the
// colours of the chosen layer. Unknown cells are kept apart: hatched grey, never a cost.

import { FOG, createBuffer, createTexture, program } from "./gl.js";
import { CLASS_COLOURS, COST_RAMP, EVIDENCE_COLOURS, LETHAL, UNKNOWN, VEGETATION_RAMP, glsl, glslRamp } from "./colours.js";
import { CELL_CLASSES, COST_LETHAL, COST_UNKNOWN, EVIDENCE, REASONS } from "./protocol.js";

export const VEGETATION_MAX_M = 3;
const GROUND_UNKNOWN = -32768;
// Most vertices of the surface along an edge.
const MESH_MAX = 100;
const OVERLAYS = { none: 0, cost: 1, vegetation: 2, evidence: 3, class: 4, density: 5 };
const DENSITY_UNKNOWN = 255;

// x ground height, y vegetation, z class + 16 evidence + 256 density in percent, w: 0 outside or without ground, else 1 + cost.
export const GRID_LOOKUP = `
uniform sampler2D grid;
uniform vec3 grid_corner;
uniform float cell_m;
uniform ivec2 grid_size;
vec4 grid_at(vec2 place) {
  ivec2 at = ivec2(floor((place - grid_corner.xy) / cell_m));
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, grid_size))) return vec4(0.0);
  vec4 cell = texelFetch(grid, at, 0);
  return vec4(cell.x + grid_corner.z, cell.yzw);
}
`;

const VERTEX = `
layout(location = 0) in float height;
uniform mat4 matrix;
uniform vec3 eye;
uniform float lift_m;
uniform ivec2 mesh;
out vec3 place;
${GRID_LOOKUP}
void main() {
  vec2 at = vec2(gl_VertexID % mesh.x, gl_VertexID / mesh.x) * float(mesh.y) + 0.5;
  place = grid_corner + vec3(at * cell_m, height + lift_m);
  // Drawn a little nearer than it is, so that the tops of ground voxels do not poke through.
  vec3 nearer = place + (lift_m > 0.0 ? 0.25 : 0.0) * normalize(eye - place);
  vec4 biased = matrix * vec4(nearer, 1.0);
  gl_Position = matrix * vec4(place, 1.0);
  gl_Position.z = biased.z / biased.w * gl_Position.w;
}`;

const FRAGMENT = `
in vec3 place;
uniform vec3 eye;
uniform int overlay;
out vec4 pixel;
${FOG}
${GRID_LOOKUP}
${glslRamp("cost_colour", COST_RAMP)}
${glslRamp("vegetation_colour", VEGETATION_RAMP)}
const vec3 CLASSES[6] = vec3[6](${CELL_CLASSES.map((c) => glsl(CLASS_COLOURS[c] ?? UNKNOWN)).join(", ")});
const vec3 EVIDENCES[5] = vec3[5](${EVIDENCE_COLOURS.map(glsl).join(", ")});

vec4 hatched(float alpha) {
  float stripe = step(0.5, fract((place.x + place.y) / 0.6));
  return vec4(${glsl(UNKNOWN)} * (0.92 + 0.16 * stripe), alpha * (0.45 + 0.4 * stripe));
}

void main() {
  vec4 cell = grid_at(place.xy);
  bool known = cell.w > 0.5;
  int what = int(cell.z) & 15, evidence = int(cell.z) >> 4 & 15, density = int(cell.z) >> 8;
  int cost = int(cell.w) - 1;
  vec4 colour;
  if (overlay == 0) {
    if (!known) discard;
    colour = vec4(mix(${glsl(CLASS_COLOURS.ground)}, vec3(0.9, 0.92, 0.86), evidence == 1 ? 0.25 : evidence == 3 ? 0.8 : 0.55), 1.0);
  } else if (overlay == 1) {
    colour = !known || cost == ${COST_UNKNOWN} ? hatched(0.8) : cost == ${COST_LETHAL} ? vec4(${glsl(LETHAL)}, 0.9)
      : vec4(cost_colour(float(cost) / 253.0), 0.82);
  } else if (overlay == 2) {
    colour = known ? vec4(vegetation_colour(cell.y / ${VEGETATION_MAX_M.toFixed(1)}), 0.85) : hatched(0.8);
  } else if (overlay == 3) {
    colour = known && evidence > 0 ? vec4(EVIDENCES[min(evidence, 4)], 0.85) : hatched(0.8);
  } else if (overlay == 5) {
    colour = known && density != ${DENSITY_UNKNOWN} ? vec4(vegetation_colour(float(density) / 100.0), 0.85) : hatched(0.8);
  } else {
    colour = known && what > 0 ? vec4(CLASSES[min(what, 5)], 0.88) : hatched(0.8);
  }
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float light = 0.78 + 0.22 * clamp(abs(dot(normal, normalize(vec3(-0.4, 0.3, 0.85)))), 0.0, 1.0);
  pixel = vec4(fogged(colour.rgb * light, distance(place, eye)), colour.a);
}`;

export class Grid {
  constructor(gl) {
    this.gl = gl;
    this.program = program(gl, VERTEX, FRAGMENT);
    this.texture = createTexture(gl);
    this.heights = createBuffer(gl);
    this.indices = createBuffer(gl);
    this.array = gl.createVertexArray();
    this.frame = null;
    this.size = [0, 0];
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 1, 1, 0, gl.RGBA, gl.FLOAT, new Float32Array(4));
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.heights);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 1, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices);
    gl.bindVertexArray(null);
  }

  put(frame) {
    const { gl } = this, { width, height } = frame;
    if (width < 2 || height < 2) return this.clear();
    this.frame = frame;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    const texels = texelsOf(frame);
    if (this.size[0] !== width || this.size[1] !== height) this.resize(width, height, texels);
    else gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, texels);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.heights);
    gl.bufferData(gl.ARRAY_BUFFER, thinned(filledHeights(frame), this.mesh), gl.DYNAMIC_DRAW);
  }

  // The surface needs no vertex a cell: its colours come from the texture.
  resize(width, height, texels) {
    const { gl } = this;
    this.size = [width, height];
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, texels);
    const step = Math.max(1, Math.ceil(Math.max(width, height) / MESH_MAX));
    const [columns, rows] = [width, height].map((cells) => Math.floor((cells - 1) / step) + 1);
    this.mesh = { step, columns, rows, width };
    const indices = new Uint32Array(6 * (columns - 1) * (rows - 1));
    let next = 0;
    for (let row = 0; row + 1 < rows; row++)
      for (let i = row * columns; i + 1 < (row + 1) * columns; i++) {
        indices.set([i, i + 1, i + columns, i + 1, i + columns + 1, i + columns], next);
        next += 6;
      }
    this.count = indices.length;
    gl.bindVertexArray(this.array);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  clear() {
    this.frame = null;
  }

  // Sets the uniforms of GRID_LOOKUP; without a grid every place is outside.
  bind(at, world) {
    const { gl, frame } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.uniform1i(at.grid, 0);
    gl.uniform3fv(at.grid_corner, frame ? world.toLocal(frame.origin) : [0, 0, 0]);
    gl.uniform1f(at.cell_m, frame ? frame.cellM : 1);
    gl.uniform2iv(at.grid_size, frame ? [frame.width, frame.height] : [0, 0]);
  }

  draw(view, world, overlay) {
    if (!this.frame) return;
    const { gl, program: { handle, at } } = this;
    gl.useProgram(handle);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform3fv(at.eye, view.eye);
    gl.uniform1i(at.overlay, OVERLAYS[overlay]);
    gl.uniform2i(at.mesh, this.mesh.columns, this.mesh.step);
    gl.uniform1f(at.lift_m, overlay === "none" ? -0.03 : 0.1);
    this.bind(at, world);
    gl.bindVertexArray(this.array);
    if (overlay !== "none") gl.enable(gl.BLEND);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
  }

  // What the grid says of a place in world coordinates, or null.
  cellAt(east, north) {
    const f = this.frame;
    if (!f) return null;
    const [column, row] = [Math.floor((east - f.origin[0]) / f.cellM), Math.floor((north - f.origin[1]) / f.cellM)];
    if (column < 0 || row < 0 || column >= f.width || row >= f.height) return null;
    const i = row * f.width + column, cm = f.groundCm[i];
    return {
      ground: cm === GROUND_UNKNOWN ? null : f.origin[2] + cm / 100, vegetation: f.vegetationDm[i] / 10, cost: f.cost[i],
      density: f.densityPct[i] === DENSITY_UNKNOWN ? null : f.densityPct[i],
      reason: REASONS[f.reason[i]] ?? "unknown", what: CELL_CLASSES[f.classes[i] & 15] ?? "unknown",
      evidence: EVIDENCE[f.classes[i] >> 4] ?? "unknown",
    };
  }
}

function texelsOf(frame) {
  const texels = new Float32Array(4 * frame.groundCm.length);
  frame.groundCm.forEach((cm, i) => {
    texels[4 * i] = cm / 100;
    texels[4 * i + 1] = frame.vegetationDm[i] / 10;
    texels[4 * i + 2] = frame.classes[i] + 256 * frame.densityPct[i];
    texels[4 * i + 3] = cm === GROUND_UNKNOWN ? 0 : 1 + frame.cost[i];
  });
  return texels;
}

// Heights for the surface: cells without ground take a neighbour's, so that the hatching lies near the ground.
function filledHeights({ groundCm, width, height }) {
  const out = Float32Array.from(groundCm, (cm) => (cm === GROUND_UNKNOWN ? NaN : cm / 100));
  const fill = (i, from) => { if (Number.isNaN(out[i]) && from >= 0 && from < out.length) out[i] = out[from]; };
  for (let row = 0; row < height; row++) {
    for (let i = row * width + 1; i < (row + 1) * width; i++) fill(i, i - 1);
    for (let i = (row + 1) * width - 2; i >= row * width; i--) fill(i, i + 1);
  }
  for (let i = width; i < out.length; i++) fill(i, i - width);
  for (let i = out.length - 1 - width; i >= 0; i--) fill(i, i + width);
  return out.map((z) => (Number.isNaN(z) ? 0 : z));
}

// Every step-th height of every step-th row.
function thinned(heights, { step, columns, rows, width }) {
  return Float32Array.from({ length: columns * rows }, (_, i) => heights[Math.floor(i / columns) * step * width + (i % columns) * step]);
}
