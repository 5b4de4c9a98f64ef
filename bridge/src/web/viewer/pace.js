// When to draw: on request, never before the last picture is finished, and where a picture takes long (a slow or
// software renderer), after a pause of the same length, in which the page listens and answers.

const SLOW_PICTURE_MS = 120, PAUSE_MAX_MS = 1500;

// Returns the function that asks for a picture; many requests make one.
export function pacer(gl, draw) {
  let wanted = false, busy = false;

  function request() {
    wanted = true;
    if (!busy) start();
  }

  function start() {
    busy = true;
    requestAnimationFrame(() => {
      wanted = false;
      const started = performance.now();
      draw();
      const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      gl.flush();
      requestAnimationFrame(() => finish(fence, started));
    });
  }

  function finish(fence, started) {
    if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return requestAnimationFrame(() => finish(fence, started));
    gl.deleteSync(fence);
    const tookMs = performance.now() - started;
    setTimeout(rest, tookMs > SLOW_PICTURE_MS ? Math.min(tookMs, PAUSE_MAX_MS) : 0);
  }

  function rest() {
    busy = false;
    if (wanted) start();
  }

  return request;
}
