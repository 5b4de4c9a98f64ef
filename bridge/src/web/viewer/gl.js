// WebGL2, the few parts of it that are needed.

export function context(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "low-power" });
  if (!gl) throw new Error("This browser offers no WebGL2: the map cannot be drawn. Try a current Firefox or Chromium.");
  // A lost card (sleep, driver restart) took all buffers with it; the bridge sends everything to a fresh page.
  canvas.addEventListener("webglcontextlost", () => setTimeout(() => location.reload(), 1000));
  return gl;
}

export function program(gl, vertexText, fragmentText) {
  const head = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n";
  const compile = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, head + text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) + "\n" + text);
    return shader;
  };
  const handle = gl.createProgram();
  gl.attachShader(handle, compile(gl.VERTEX_SHADER, vertexText));
  gl.attachShader(handle, compile(gl.FRAGMENT_SHADER, fragmentText));
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle));
  const at = {};
  for (let i = 0; i < gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(handle, i);
    at[name] = gl.getUniformLocation(handle, name);
  }
  return { handle, at };
}

// Buffers and textures alive, so that a test can see that none leaks.
export const alive = { buffers: 0, textures: 0 };

export function createBuffer(gl) {
  alive.buffers++;
  return gl.createBuffer();
}

export function deleteBuffer(gl, buffer) {
  alive.buffers--;
  gl.deleteBuffer(buffer);
}

// A texture of plain values: read by index, never filtered.
export function createTexture(gl) {
  alive.textures++;
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  return texture;
}

export function deleteTexture(gl, texture) {
  alive.textures--;
  gl.deleteTexture(texture);
}

// Everything fades into the background with distance, so that the edge of the map is no cliff.
export const FOG = `
const vec3 BACKGROUND = vec3(0.914, 0.933, 0.941);
vec3 fogged(vec3 colour, float distance_m) { return mix(colour, BACKGROUND, smoothstep(70.0, 200.0, distance_m)); }
`;
