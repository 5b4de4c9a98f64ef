// The voxel map: only faces that no occupied voxel covers, one 32-bit word a face in a texture a block, from which the
// vertex shader makes four corners (instances of four vertices are slow everywhere, and hopeless in software). Faces are
// sorted by direction, and a direction that looks away from the camera is not drawn: half of all faces. A block that
// comes again replaces its texture's content; one that left the map gives its texture back.

import { FOG, createBuffer, createTexture, deleteTexture, program } from "./gl.js";
import { CLASS_COLOURS, HEIGHT_RAMP, glsl, glslRamp } from "./colours.js";
import { GRID_LOOKUP } from "./grid.js";

const VERTEX = `
uniform highp usampler2D words;
uniform mat4 matrix;
uniform vec3 corner, eye;
uniform float voxel_m, cut_m;
uniform vec2 heights;
uniform int face, by_height;
flat out vec3 colour;
out vec2 uv;
out float distance_m;
${GRID_LOOKUP}
${glslRamp("height_colour", HEIGHT_RAMP)}
const float SHADE[6] = float[6](0.80, 0.86, 0.90, 0.74, 0.55, 1.0);

// Thesis: ground green, brush dark green, trunks purple. What hangs above or is not classified is pale and drawn
// small, so that one looks through it at what matters.
vec3 class_colour(vec3 centre, vec4 cell, out float extent) {
  extent = 0.62;
  if (cell.w < 0.5) return ${glsl(CLASS_COLOURS.unseen)};
  float above = centre.z - cell.x;
  int what = int(cell.z) & 15;
  bool canopy = above > cell.y + 2.0 * voxel_m && (what < 3 || (what == 4 && above > 3.0)) && above > 1.6 * voxel_m;
  if (canopy) return ${glsl(CLASS_COLOURS.canopy)};
  extent = 1.0;
  if (what == 5) return ${glsl(CLASS_COLOURS.drop)};
  if (above < 1.6 * voxel_m) return ${glsl(CLASS_COLOURS.ground)};
  if (what == 3) return ${glsl(CLASS_COLOURS.tree)};
  return what == 4 ? ${glsl(CLASS_COLOURS.obstacle)} : ${glsl(CLASS_COLOURS.brush)};
}

void main() {
  int index = gl_VertexID >> 2;
  uint word = texelFetch(words, ivec2(index & 1023, index >> 10), 0).x;
  vec3 voxel = vec3(word & 127u, word >> 7 & 127u, word >> 14 & 63u);
  float crowd = float(word >> 26 & 31u) / 26.0;
  vec3 centre = corner + (voxel + 0.5) * voxel_m;
  vec4 cell = grid_at(centre.xy);
  float above = cell.w < 0.5 ? centre.z - heights.x - 2.0 : centre.z - cell.x;
  uv = vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1);
  float side = float(face & 1);
  float t = (centre.z - heights.x) / (heights.y - heights.x), extent = 1.0;
  vec3 plain = by_height == 1 ? height_colour(t) : class_colour(centre, cell, extent);
  vec3 at = face < 2 ? vec3(side, uv) : face < 4 ? vec3(uv.x, side, uv.y) : vec3(uv, side);
  vec3 place = centre + (at - 0.5) * extent * voxel_m;
  // A little of the height in every class colour gives the ground its relief.
  float relief = by_height == 1 ? 1.0 : 0.94 + 0.14 * fract(centre.z * 0.5);
  colour = plain * SHADE[face] * mix(1.08, 0.74, crowd) * relief;
  distance_m = distance(place, eye);
  gl_Position = above > cut_m ? vec4(2.0, 2.0, 2.0, 1.0) : matrix * vec4(place, 1.0);
}`;

const FRAGMENT = `
flat in vec3 colour;
in vec2 uv;
in float distance_m;
out vec4 pixel;
${FOG}
void main() {
  vec2 edge = min(uv, 1.0 - uv);
  float line = smoothstep(0.0, 0.09, min(edge.x, edge.y));
  float near = 1.0 - smoothstep(14.0, 34.0, distance_m);
  pixel = vec4(fogged(colour * mix(1.0, mix(0.84, 1.0, line), near), distance_m), 1.0);
}`;

// Texels of a row of a block's texture.
const ROW = 1024;

export class Voxels {
  constructor(gl) {
    this.gl = gl;
    this.program = program(gl, VERTEX, FRAGMENT);
    this.blocks = new Map();
    this.blockVoxels = [100, 100, 40];
    this.voxels = this.faces = this.drawnFaces = 0;
    this.array = gl.createVertexArray();
    this.indices = createBuffer(gl);
    this.indexed = 0;
  }

  put(frame) {
    const faces = facesByDirection(frame.words);
    let block = this.blocks.get(frame.key);
    if (!block) this.blocks.set(frame.key, (block = { texture: createTexture(this.gl), rows: 0, faces: 0, voxels: 0 }));
    this.faces += faces.count - block.faces;
    this.voxels += frame.words.length - block.voxels;
    Object.assign(block, {
      origin: frame.origin, voxelM: frame.voxelM, starts: faces.starts, faces: faces.count, voxels: frame.words.length,
    });
    this.upload(block, faces.words);
    if (faces.count > this.indexed) this.index(faces.count);
  }

  upload(block, words) {
    const { gl } = this, rows = words.length / ROW;
    gl.bindTexture(gl.TEXTURE_2D, block.texture);
    if (rows === block.rows) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ROW, rows, gl.RED_INTEGER, gl.UNSIGNED_INT, words);
    else gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32UI, ROW, rows, 0, gl.RED_INTEGER, gl.UNSIGNED_INT, words);
    block.rows = rows;
  }

  // Two triangles a face, for as many faces as the largest block has: shared by all blocks.
  index(faces) {
    const { gl } = this;
    this.indexed = Math.ceil(faces / 16384) * 16384;
    const indices = new Uint32Array(6 * this.indexed);
    for (let face = 0; face < this.indexed; face++)
      for (let i = 0; i < 6; i++) indices[6 * face + i] = 4 * face + (i < 3 ? i : 6 - i);
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  // Drops every block that the snapshot's table does not list.
  keep(keys) {
    for (const key of this.blocks.keys()) if (!keys.has(key)) this.remove(key);
  }

  remove(key) {
    const block = this.blocks.get(key);
    this.faces -= block.faces;
    this.voxels -= block.voxels;
    deleteTexture(this.gl, block.texture);
    this.blocks.delete(key);
  }

  clear() {
    this.keep(new Set());
  }

  draw(view, world, look) {
    const { gl, program: { handle, at } } = this;
    gl.useProgram(handle);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform3fv(at.eye, view.eye);
    gl.uniform1f(at.cut_m, look.cutM);
    gl.uniform2fv(at.heights, look.heights);
    gl.uniform1i(at.by_height, look.byHeight ? 1 : 0);
    gl.uniform1i(at.words, 1);
    look.grid.bind(at, world);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindVertexArray(this.array);
    this.drawnFaces = 0;
    for (const block of this.blocks.values()) this.drawBlock(block, view, world.toLocal(block.origin), at);
    gl.bindVertexArray(null);
    gl.activeTexture(gl.TEXTURE0);
  }

  drawBlock(block, view, corner, at) {
    const { gl } = this;
    const far = corner.map((c, axis) => c + this.blockVoxels[axis] * block.voxelM);
    if (block.faces === 0 || !boxInView(view.matrix, corner, far)) return;
    gl.bindTexture(gl.TEXTURE_2D, block.texture);
    gl.uniform3fv(at.corner, corner);
    gl.uniform1f(at.voxel_m, block.voxelM);
    for (let face = 0; face < 6; face++) {
      const axis = face >> 1, count = block.starts[face + 1] - block.starts[face];
      const seen = face & 1 ? view.eye[axis] > corner[axis] : view.eye[axis] < far[axis];
      if (count === 0 || !seen) continue;
      gl.uniform1i(at.face, face);
      gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 24 * block.starts[face]);
      this.drawnFaces += count;
    }
  }
}

// A word for each open face, sorted by direction, in whole rows; `starts[d]` is where direction d begins.
function facesByDirection(words) {
  const counts = new Uint32Array(6);
  for (const word of words) for (let face = 0; face < 6; face++) counts[face] += (word >>> (20 + face)) & 1;
  const starts = [0];
  for (let face = 0; face < 6; face++) starts.push(starts[face] + counts[face]);
  const out = new Uint32Array(Math.max(1, Math.ceil(starts[6] / ROW)) * ROW), next = starts.slice(0, 6);
  for (const word of words) for (let face = 0; face < 6; face++) if ((word >>> (20 + face)) & 1) out[next[face]++] = word;
  return { words: out, starts, count: starts[6] };
}

// False where all eight corners lie beyond one side of the view.
function boxInView(m, low, high) {
  const outside = [0, 0, 0, 0, 0];
  for (let i = 0; i < 8; i++) {
    const p = [i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]];
    const [x, y, , w] = [0, 1, 2, 3].map((row) => m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row]);
    [x > w, x < -w, y > w, y < -w, w < 0].forEach((is, side) => (outside[side] += is));
  }
  return !outside.includes(8);
}
