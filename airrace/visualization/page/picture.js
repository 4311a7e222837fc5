// What the camera saw: the picture that the detector was given, with the markers that it found,
// and in the scene, what it can see and where the markers are.
import { last, rotated } from "airrace/timeline.js";
import { Line } from "airrace/lines.js";

const OLDEST = 3; // s, of a picture that is shown as it is
const RAY_TIME = 0.5; // s, for which rays to markers are shown
const DEPTH = 2; // m, of the pyramid that the camera sees
const WHITE = [1, 1, 1], GREEN = [0.16, 1, 0.31];

export class CameraPicture {
  constructor(stage, timeline, config) {
    this.timeline = timeline;
    this.lens = config.camera;
    this.box = document.getElementById("picture");
    this.canvas = document.getElementById("camera");
    this.caption = document.getElementById("caption");
    this.shown = null;
    this.rays = new Line(stage, { width: 2, capacity: 256, opacity: 0.9 });
    this.pyramid = new Line(stage, { width: 1, capacity: 16, opacity: 0.8 });
    this.resizable();
  }

  // Draws what the camera can see as a pyramid in the scene.
  drawPyramid(now, visible) {
    this.pyramid.visible = visible;
    if (!visible) return;
    const { p, x, y, z, fov, aspect } = this.lens;
    const half = DEPTH * Math.tan((fov * Math.PI) / 360);
    const at = (u, v) => {
      const ray = p.map((each, k) => each + u * aspect * half * x[k] + v * half * y[k] + DEPTH * z[k]);
      return rotated(now.q, ray).map((each, k) => each + now.p[k]);
    };
    const eye = rotated(now.q, p).map((each, k) => each + now.p[k]);
    const [a, b, c, d] = [at(-1, -1), at(1, -1), at(1, 1), at(-1, 1)];
    this.pyramid.clear();
    this.pyramid.add([eye, a, b, eye, c, d, eye, a, d, c, b], WHITE);
  }

  draw(t, now, visible) {
    const picture = last(this.timeline.pictures, t);
    this.box.hidden = !picture;
    this.drawPyramid(now, Boolean(visible && picture));
    if (!picture) return;
    this.box.style.opacity = t - picture.t > OLDEST ? 0.5 : 1;
    if (picture !== this.shown) this.show(picture);
    const fresh = visible && now && t - picture.t < RAY_TIME;
    this.rays.visible = fresh;
    if (!fresh) return;
    this.rays.clear();
    for (const { p } of picture.markers) {
      // There and back, so that the next ray does not start where this one ends.
      this.rays.add([now.p, p, now.p], GREEN);
    }
  }

  async show(picture) {
    this.shown = picture;
    const image = new Image();
    image.src = `data:image/jpeg;base64,${picture.jpeg}`;
    try {
      await image.decode();
    } catch {
      return; // a newer one is on its way
    }
    if (this.shown !== picture) return;
    const { canvas } = this, { naturalWidth: w, naturalHeight: h } = image;
    [canvas.width, canvas.height] = [2 * w, 2 * h];
    canvas.style.aspectRatio = `${w} / ${h}`;
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0, 2 * w, 2 * h);
    context.strokeStyle = "#28ff50";
    context.fillStyle = "#28ff50";
    context.lineWidth = 2;
    context.font = "600 15px system-ui, sans-serif";
    for (const { id, corners } of picture.markers) {
      context.beginPath();
      for (let k = 0; k < 8; k += 2) context.lineTo(2 * w * corners[k], 2 * h * corners[k + 1]);
      context.closePath();
      context.stroke();
      const x = 2 * w * Math.max(corners[0], corners[2], corners[4], corners[6]);
      context.fillText(String(id), x + 4, 2 * h * corners[1]);
    }
    const count = picture.markers.length;
    const found = count ? `${count} marker${count > 1 ? "s" : ""}` : "no markers";
    this.caption.textContent = `camera, ${picture.t.toFixed(1)} s, ${found}`;
  }

  // Its upper right corner is dragged: the picture stands on its lower left one.
  resizable() {
    const handle = document.getElementById("resize");
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      const start = event.clientX, width = this.box.offsetWidth;
      handle.onpointermove = (move) => {
        const most = 0.7 * window.innerWidth;
        this.box.style.width = `${Math.min(Math.max(width + move.clientX - start, 120), most)}px`;
      };
    });
    handle.addEventListener("pointerup", () => (handle.onpointermove = null));
    handle.addEventListener("keydown", ({ code }) => {
      const step = { ArrowUp: 40, ArrowDown: -40 }[code];
      if (step) this.box.style.width = `${Math.max(this.box.offsetWidth + step, 120)}px`;
    });
  }
}
