// `window.tsense`: what a test, or a person at the console, may ask. Nothing of the page depends on it.

import { alive } from "./gl.js";

export function installHook({ gl, canvas, state, voxels, grid, scans, objects, camera, layers, draw, setLook, setLayer }) {
  window.tsense = {
    camera, layers, setLook, setLayer,
    // Pictures drawn so far.
    get frameDone() { return state.frames; },
    // Number of the snapshot in the picture, null before there is one.
    get drawnSnapshot() { return state.drawnSnapshot; },
    get connection() { return state.connection?.state; },
    get counts() {
      let [points, echoes] = [0, 0];
      for (const ladar of scans.ladars.values()) [points, echoes] = [points + ladar.count, echoes + ladar.echoes];
      return {
        blocks: voxels.blocks.size, voxels: voxels.voxels, faces: voxels.faces, drawnFaces: voxels.drawnFaces,
        objects: objects.list.length, detections: objects.seen.length, points, echoes,
        cells: grid.frame ? grid.frame.width * grid.frame.height : 0, buffers: alive.buffers, textures: alive.textures, decodeErrors: state.decodeErrors,
      };
    },
    // Draws now; milliseconds until the picture is finished.
    timeDraw() {
      const start = performance.now();
      draw();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      return performance.now() - start;
    },
    // Draws now, and counts pixels that look like a colour (#rrggbb), by hue and strength rather than by shade.
    pixelsLike(hex, tolerance = 0.07) {
      draw();
      const [width, height] = [canvas.width, canvas.height], pixels = new Uint8Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      const wanted = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
      const share = (r, g, b) => { const sum = r + g + b || 1; return [r / sum, g / sum, b / sum]; };
      const [wr, wg, wb] = share(...wanted);
      let count = 0;
      for (let i = 0; i < pixels.length; i += 4) {
        const [r, g, b] = share(pixels[i], pixels[i + 1], pixels[i + 2]);
        count += Math.abs(r - wr) + Math.abs(g - wg) + Math.abs(b - wb) < tolerance;
      }
      return count;
    },
  };
}
