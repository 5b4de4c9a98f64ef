// Plain solids: boxes and cylinders in one colour each, for the vehicle and the objects.

import { FOG, createBuffer, program } from "./gl.js";

const VERTEX = `
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
uniform mat4 matrix, model;
uniform vec3 size, eye;
out vec3 turned;
out float distance_m, up;
void main() {
  vec4 place = model * vec4(position * size, 1.0);
  turned = mat3(model) * (normal / size);
  distance_m = distance(place.xyz, eye);
  up = position.z;
  gl_Position = matrix * place;
}`;

const FRAGMENT = `
in vec3 turned;
in float distance_m, up;
uniform vec4 colour;
uniform float fade;
out vec4 pixel;
${FOG}
void main() {
  float light = 0.7 + 0.3 * max(0.0, dot(normalize(turned), normalize(vec3(-0.45, -0.3, 0.84))));
  pixel = vec4(fogged(colour.rgb * light, distance_m), colour.a * mix(1.0, 1.0 - up, fade));
}`;

export class Solids {
  constructor(gl) {
    this.gl = gl;
    this.program = program(gl, VERTEX, FRAGMENT);
    this.box = this.mesh(boxTriangles());
    this.cylinder = this.mesh(cylinderTriangles(20));
    this.ring = this.mesh(ringTriangles(28, 0.82));
  }

  mesh(numbers) {
    const { gl } = this, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, createBuffer(gl));
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.STATIC_DRAW);
    for (const i of [0, 1]) {
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, 3, gl.FLOAT, false, 24, 12 * i);
    }
    gl.bindVertexArray(null);
    return { array, count: numbers.length / 6 };
  }

  begin(view) {
    const { gl, program: { handle, at } } = this;
    gl.useProgram(handle);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform3fv(at.eye, view.eye);
  }

  // `fade` 1 makes it transparent towards its top.
  draw(mesh, model, size, colour, fade = 0) {
    const { gl, program: { at } } = this;
    gl.uniformMatrix4fv(at.model, false, model);
    gl.uniform3fv(at.size, size);
    gl.uniform4fv(at.colour, colour);
    gl.uniform1f(at.fade, fade);
    gl.bindVertexArray(mesh.array);
    gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
  }
}

// A cube of edge 1 around zero.
function boxTriangles() {
  const out = [];
  for (let axis = 0; axis < 3; axis++)
    for (const side of [-0.5, 0.5])
      for (const [u, v] of [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) {
        const [at, normal] = [[0, 0, 0], [0, 0, 0]];
        [at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3], normal[axis]] = [side, u, v, 2 * side];
        out.push(...at, ...normal);
      }
  return out;
}

const circle = (i, parts) => [Math.cos((2 * Math.PI * i) / parts), Math.sin((2 * Math.PI * i) / parts)];

// Radius 1, from z 0 to 1, with a lid.
function cylinderTriangles(parts) {
  const out = [];
  for (let i = 0; i < parts; i++) {
    const [a, b] = [circle(i, parts), circle(i + 1, parts)];
    for (const [p, z] of [[a, 0], [b, 0], [a, 1], [b, 0], [b, 1], [a, 1]]) out.push(...p, z, ...p, 0);
    out.push(...a, 1, 0, 0, 1, ...b, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1);
  }
  return out;
}

// A flat ring of radius 1.
function ringTriangles(parts, inner) {
  const out = [];
  for (let i = 0; i < parts; i++) {
    const [a, b] = [circle(i, parts), circle(i + 1, parts)];
    const [c, d] = [a.map((x) => x * inner), b.map((x) => x * inner)];
    for (const p of [a, b, c, b, d, c]) out.push(...p, 0, 0, 0, 1);
  }
  return out;
}
