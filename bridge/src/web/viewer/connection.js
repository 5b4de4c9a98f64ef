// The WebSocket to the bridge: reconnects by itself, doubling the pause from 0.5 s to 8 s. The bridge sends counters
// twice a second, so a stream that is silent for 6 s is dead even where the socket does not know it yet.

const PAUSE_MIN_MS = 500, PAUSE_MAX_MS = 8000, SILENT_CHECKS_MAX = 6, CHECK_MS = 1000;

export class Connection {
  constructor(onFrame, onState) {
    this.onFrame = onFrame;
    this.onState = onState;
    this.pauseMs = PAUSE_MIN_MS;
    this.heardMs = 0;
    this.wanted = null;
    this.silentChecks = 0;
    setInterval(() => this.watch(), CHECK_MS);
    this.open();
  }

  open() {
    this.onState({ state: "starting", text: "connecting" });
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/ws`);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.heardMs = Date.now();
      this.silentChecks = 0;
      if (this.wanted) this.subscribe(this.wanted);
    };
    socket.onmessage = (event) => {
      if (socket !== this.socket) return;
      this.heardMs = Date.now();
      this.silentChecks = 0;
      this.pauseMs = PAUSE_MIN_MS;
      this.onState({ state: "running", text: "connected" });
      this.onFrame(event.data);
    };
    socket.onclose = () => { if (socket === this.socket) this.retry("no connection to the bridge"); };
  }

  retry(reason) {
    const old = this.socket;
    this.socket = null;
    old?.close();
    this.onState({ state: "failed", text: reason, retryAtMs: Date.now() + this.pauseMs, heardMs: this.heardMs });
    setTimeout(() => this.open(), this.pauseMs);
    this.pauseMs = Math.min(2 * this.pauseMs, PAUSE_MAX_MS);
  }

  // Counts checks, not time: while a slow picture holds the page up, frames wait unread and no check comes either.
  watch() {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    if (++this.silentChecks > SILENT_CHECKS_MAX) this.retry("the bridge is silent");
  }

  // Layers to be sent; the bridge sends a layer that was off in full.
  subscribe(layers) {
    this.wanted = layers;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ want: layers }));
  }
}
