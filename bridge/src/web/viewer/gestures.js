// Mouse, touch and keys to camera motion. Two fingers zoom and move.

const TURN_PER_PX = 0.0055;

export function attachGestures(canvas, camera, actions) {
  const pointers = new Map();
  let spread = 0;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event);
    canvas.classList.add("moving");
    canvas.focus({ preventScroll: true });
    spread = 0;
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => {
      pointers.delete(event.pointerId);
      canvas.classList.toggle("moving", pointers.size > 0);
    });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return actions.hover(event.clientX, event.clientY);
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    pointers.set(event.pointerId, event);
    if (pointers.size === 2) return pinch(dx, dy);
    if (event.buttons & 6 || event.shiftKey) camera.move(-dx / canvas.clientHeight, dy / canvas.clientHeight);
    else camera.turn(dx * TURN_PER_PX, dy * TURN_PER_PX);
  });
  canvas.addEventListener("pointerleave", () => actions.hover(-1, -1));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.002));
  }, { passive: false });
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT/.test(event.target.tagName)) return;
    if (key(event.key)) event.preventDefault();
  });

  function pinch(dx, dy) {
    const [a, b] = [...pointers.values()];
    const now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    if (spread > 0) camera.zoom(spread / Math.max(now, 1));
    spread = now;
    camera.move(-dx / 2 / canvas.clientHeight, dy / 2 / canvas.clientHeight);
  }

  function key(name) {
    const motion = {
      ArrowLeft: () => camera.move(-0.06, 0), ArrowRight: () => camera.move(0.06, 0),
      ArrowUp: () => camera.move(0, 0.06), ArrowDown: () => camera.move(0, -0.06),
      "+": () => camera.zoom(0.88), "=": () => camera.zoom(0.88), "-": () => camera.zoom(1.14),
      q: () => camera.turn(-0.1, 0), e: () => camera.turn(0.1, 0),
      PageUp: () => camera.turn(0, 0.08), PageDown: () => camera.turn(0, -0.08),
    }[name.length === 1 ? name.toLowerCase() : name];
    if (motion) return motion(), true;
    return actions.key(name.toLowerCase());
  }
}
