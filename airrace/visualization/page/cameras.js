// From where the race is seen.
import { rotated, countUntil } from "airrace/timeline.js";

export const OVERVIEW = "overview", CHASE = "chase", ONBOARD = "onboard", GATE = "gate",
  FREE = "free";
// What the buttons say, and the keys that click them.
export const CAMERAS = {
  [OVERVIEW]: ["Overview", "KeyO"],
  [CHASE]: ["Chase", "KeyC"],
  [ONBOARD]: ["On board", "KeyB"],
  [GATE]: ["Gate", "KeyG"],
  [FREE]: ["Free", "KeyF"],
};
const BEHIND = 5.0, ABOVE = 1.7, AHEAD = 3.0; // m, of the chasing camera
const TURN = 0.7; // s, over which its heading is averaged
const FOV = 75; // degrees, of the overview
const CUT = 0.9; // s, from a gate to the next gate's camera

const sum = (a, b, factor = 1) => a.map((each, i) => each + factor * b[i]);
const distance = (a, b) => Math.hypot(...sum(a, b, -1));

// How much of the window's width the column of panels takes (px); on a phone, it is but a corner.
function columnWidth() {
  const { offsetWidth, offsetHeight } = document.getElementById("side");
  return offsetHeight > 0.5 * window.innerHeight ? offsetWidth + 12 : 0;
}

export class Cameras extends EventTarget {
  constructor(stage, timeline, config) {
    super();
    // held: whether a hand has moved the overview.
    Object.assign(this, { stage, timeline, config, view: OVERVIEW, held: false });
    // A hand on the picture takes the camera.
    for (const kind of ["pointerdown", "wheel"]) {
      stage.canvas.addEventListener(kind, () => this.hold(), { passive: true });
    }
    window.addEventListener("resize", () => {
      if (this.view === OVERVIEW) this.overview();
    });
    this.overview();
  }

  hold() {
    this.held = true;
    if (this.view !== OVERVIEW) this.choose(FREE);
  }

  choose(view) {
    [this.view, this.held] = [view, false];
    this.stage.viewer.controls.enabled = this.mouse;
    if (view === OVERVIEW) this.overview();
    if (view === FREE) this.free();
    this.stage.redraw();
    this.dispatchEvent(new Event("change"));
  }

  // Whether the mouse moves the camera.
  get mouse() {
    return this.view === OVERVIEW || this.view === FREE;
  }

  overview() {
    const { eye, middle } = this.config.overview, back = sum(eye, middle, -1);
    const { clientWidth: width, clientHeight: height } = this.stage.canvas;
    // The track is about this wide. In a narrow window, step back; and to the side, so that it is
    // beside the column of panels.
    const wide = 1.25 * height, free = width - columnWidth();
    const factor = Math.max(1, wide / free);
    const covered = wide / factor / 2 - (free - width / 2);
    const aside = Math.min(Math.max(covered, 0), (width - free) / 2);
    const far = factor * Math.hypot(...back) * Math.tan((FOV * Math.PI) / 360);
    const scale = (2 * far * aside) / Math.max(height, 1) / Math.hypot(back[0], back[1]);
    const target = sum(middle, [-back[1], back[0], 0], scale);
    this.stage.look({ eye: sum(target, back, factor), target, fov: FOV });
  }

  // Keeps the view, upright, as a start for the mouse.
  free() {
    const { camera, controls } = this.stage.viewer;
    const here = camera.position.clone();
    camera.up.set(0, 1, 0);
    camera.fov = FOV;
    camera.updateProjectionMatrix();
    if (here.distanceTo(controls.target) < 2) {
      const ahead = new this.stage.THREE.Vector3();
      camera.getWorldDirection(ahead);
      controls.target.copy(here).addScaledVector(ahead, 10);
    }
  }

  // Moves the camera to where it belongs at a time.
  update(now, gate) {
    if (!now) return;
    // Drake's server says from where it would look, when it likes.
    if (this.view === OVERVIEW && !this.held) this.overview();
    else if (this.view === CHASE) this.stage.look(this.chase(now));
    else if (this.view === ONBOARD) this.stage.look(this.onboard(now));
    else if (this.view === GATE) this.stage.look(this.gate(now, gate));
  }

  // Behind the drone, whose heading it follows later.
  chase(now) {
    let forward = [0, 0, 0], p = [0, 0, 0];
    const steps = 8;
    for (let k = 0; k < steps; k++) {
      const then = this.timeline.sample(now.t - (TURN * k) / (steps - 1));
      const [x, y] = rotated(then.q, [1, 0, 0]);
      forward = sum(forward, [x, y, 0]);
      p = sum(p, [0, 0, then.p[2]], 1 / steps);
    }
    const length = Math.hypot(...forward) || 1;
    forward = forward.map((each) => each / length);
    const eye = sum(now.p, forward, -BEHIND);
    eye[2] = Math.max(0.5 * (now.p[2] + p[2]) + ABOVE, 0.6);
    return { eye, target: sum(now.p, forward, AHEAD), fov: 70 };
  }

  // Where the drone's camera is, as it leans.
  onboard(now) {
    const { p, z, y } = this.config.camera;
    const eye = sum(now.p, rotated(now.q, p)), ahead = rotated(now.q, z);
    return {
      eye,
      target: sum(eye, ahead, 10),
      up: rotated(now.q, y).map((each) => -each),
      fov: this.config.camera.fov,
    };
  }

  // Beyond a gate, looking back at the drone that comes.
  gate(now, gate) {
    const { middle, forward } = this.gateAt(now.t, gate);
    const right = [forward[1], -forward[0], 0];
    const eye = sum(sum(middle, forward, 13), right, 5);
    eye[2] = 4;
    const far = distance(eye, now.p);
    const fov = Math.min(Math.max((2 * Math.atan(9 / far) * 180) / Math.PI, 22), 65);
    return { eye, target: now.p, fov };
  }

  // The gate that the drone flew to a moment ago; in a search, the newest.
  gateAt(t, gate) {
    const { gates } = this.config;
    const crossed = countUntil(this.timeline.crossings, t - CUT);
    return gates[crossed ? crossed % gates.length : Math.max((gate ?? 1) - 1, 0)];
  }
}
