// The newest scan of each ladar: its echoes as points, its beams as a faint fan.

import { FOG, createBuffer, deleteBuffer, program } from "./gl.js";
import { SCAN, glsl } from "./colours.js";

const VERTEX = `
layout(location = 0) in vec3 end;
layout(location = 1) in uint kind;
uniform mat4 matrix;
uniform vec3 origin, eye;
uniform float pixels;
uniform int fan;
out float distance_m;
void main() {
  vec3 place = origin + end;
  distance_m = distance(place, eye);
  // An echo lies inside the voxel it made: drawn a voxel nearer, it shows.
  vec3 nearer = fan == 1 ? place : place + 0.22 * normalize(eye - place);
  bool echo = (kind & 255u) == 0u;
  gl_Position = fan == 0 && !echo ? vec4(2.0, 2.0, 2.0, 1.0) : matrix * vec4(nearer, 1.0);
  gl_PointSize = clamp(pixels / distance_m, 2.0, 9.0);
}`;

const FRAGMENT = `
in float distance_m;
uniform int fan;
out vec4 pixel;
${FOG}
void main() {
  if (fan == 1) { pixel = vec4(${glsl(SCAN)}, 0.075); return; }
  float r = length(gl_PointCoord - 0.5);
  if (r > 0.5) discard;
  pixel = vec4(fogged(mix(${glsl(SCAN)}, vec3(1.0, 0.86, 0.4), smoothstep(0.3, 0.0, r) * 0.5), distance_m), 1.0);
}`;

export class Scans {
  constructor(gl) {
    this.gl = gl;
    this.program = program(gl, VERTEX, FRAGMENT);
    this.ladars = new Map();
  }

  put(frame) {
    const { gl } = this;
    let ladar = this.ladars.get(frame.ladar);
    if (!ladar) this.ladars.set(frame.ladar, (ladar = this.create()));
    // The ladar itself is vertex 0, the centre of the fan.
    const data = new Float32Array(4 * (frame.count + 1));
    data.set(frame.ladarAt);
    data.set(frame.beams, 4);
    let echoes = 0;
    for (let i = 3; i < frame.kinds.length; i += 4) echoes += (frame.kinds[i] & 255) === 0;
    Object.assign(ladar, { origin: frame.origin, at: frame.ladarAt, count: frame.count, echoes });
    gl.bindBuffer(gl.ARRAY_BUFFER, ladar.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  }

  create() {
    const { gl } = this;
    const ladar = { buffer: createBuffer(gl), array: gl.createVertexArray() };
    gl.bindVertexArray(ladar.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, ladar.buffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 16, 0);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_INT, 16, 12);
    gl.bindVertexArray(null);
    return ladar;
  }

  clear() {
    for (const ladar of this.ladars.values()) {
      deleteBuffer(this.gl, ladar.buffer);
      this.gl.deleteVertexArray(ladar.array);
    }
    this.ladars.clear();
  }

  // Echoes first and opaque; the fan comes last, over everything that is solid.
  draw(view, world, fan) {
    const { gl, program: { handle, at } } = this;
    gl.useProgram(handle);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform3fv(at.eye, view.eye);
    gl.uniform1f(at.pixels, 0.11 * view.height);
    gl.uniform1i(at.fan, fan ? 1 : 0);
    for (const ladar of this.ladars.values()) {
      gl.uniform3fv(at.origin, world.toLocal(ladar.origin));
      gl.bindVertexArray(ladar.array);
      if (fan) gl.drawArrays(gl.TRIANGLE_FAN, 0, ladar.count + 1);
      else gl.drawArrays(gl.POINTS, 1, ladar.count);
    }
    gl.bindVertexArray(null);
  }
}
