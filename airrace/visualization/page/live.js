// The connection to a race that goes on: batches come, requests go.

export class LiveFeed extends EventTarget {
  constructor(timeline, player) {
    super();
    this.timeline = timeline;
    this.player = player;
    this.open = false;
    this.controls = null; // how fast the race is simulated, if that can be asked for
    this.connect();
  }

  connect() {
    // Relative to the page, which a proxy may have put below a path of its own.
    const address = new URL("race", location.href.replace(/^http/, "ws"));
    this.socket = new WebSocket(address);
    this.socket.onmessage = (message) => this.receive(JSON.parse(message.data));
    this.socket.onopen = () => this.set({ open: true });
    // After the end everything stays as it is: there is nothing to connect to again.
    this.socket.onclose = () => this.set({ open: false });
  }

  receive(batch) {
    this.timeline.add(batch);
    if (batch.frames) this.player.arrived(performance.now() / 1000);
    if ("controls" in batch) this.set({ controls: batch.controls });
    this.dispatchEvent(new CustomEvent("batch", { detail: batch }));
  }

  set(values) {
    Object.assign(this, values);
    this.dispatchEvent(new Event("change"));
  }

  // Asks for something: {pause: true}, or {rate: 0.5}, which is 0 for as fast as it can.
  ask(request) {
    if (this.open && this.controls) this.socket.send(JSON.stringify(request));
  }
}
