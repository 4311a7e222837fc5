// A map of the track with the drone on it.
import { css, speedColor } from "airrace/colors.js";
import { rotated } from "airrace/timeline.js";

const MARGIN = 18, EDGE = 7, ASIDE = 9; // px, around pylons, around numbers, and between them
const STRIDE = 4; // frames a stretch
const BEFORE = 60; // s, that the flown line reaches back

// Fits a canvas to its place, with the screen's own pixels; returns its context and size.
export function fitted(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  const style = getComputedStyle(canvas);
  const [rim, next, dim, accent] = ["rim", "next", "dim", "accent"].map(
    (name) => style.getPropertyValue(`--${name}`));
  return { context, width, height, text: style.color, font: style.fontFamily, rim, next, dim, accent };
}

export class Minimap {
  constructor(timeline, config) {
    Object.assign(this, { timeline, config, canvas: document.getElementById("minimap") });
    const points = config.gates.flatMap((gate) => gate.pylons).concat([config.start]);
    const [xs, ys] = [0, 1].map((k) => points.map((point) => point[k]));
    this.box = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  }

  // others: ghosts, each {p, color}.
  draw(t, now, nextGate, shifts, others) {
    const place = fitted(this.canvas), { context, width, height } = place;
    const [x0, x1, y0, y1] = this.box;
    const scale = Math.min((width - 2 * MARGIN) / Math.max(x1 - x0, 1),
      (height - 2 * MARGIN) / Math.max(y1 - y0, 1));
    const at = ([x, y]) => [width / 2 + scale * (x - (x0 + x1) / 2),
      height / 2 - scale * (y - (y0 + y1) / 2)];
    this.drawPath(context, at, t);
    for (const other of others) this.drawDot(context, at(other.p), other.color, 4);
    if (now) this.drawDrone(place, at, now);
    this.drawGates(place, at, nextGate, shifts);
  }

  drawPath(context, at, t) {
    const { timeline } = this, end = timeline.index(t);
    context.lineWidth = 2;
    let before = null;
    for (let i = timeline.index(t - BEFORE); i <= end; i += STRIDE) {
      const row = timeline.row(i), point = at([row[1], row[2]]);
      if (before) {
        context.strokeStyle = css(speedColor(row[8]));
        context.beginPath();
        context.moveTo(...before);
        context.lineTo(...point);
        context.stroke();
      }
      before = point;
    }
  }

  drawGates({ context, width, height, text, next, rim, font }, at, nextGate, shifts) {
    this.config.gates.forEach((gate, i) => {
      const moved = shifts ? [shifts[i][0] - gate.middle[0], shifts[i][1] - gate.middle[1]] : [0, 0];
      const [a, b] = gate.pylons.map(([x, y]) => at([x + moved[0], y + moved[1]]));
      const isNext = i + 1 === nextGate;
      context.strokeStyle = isNext ? next : text;
      context.lineWidth = isNext ? 4 : 2;
      context.beginPath();
      context.moveTo(...a);
      context.lineTo(...b);
      context.stroke();
      // The number stands beside the right pylon, where nothing is flown, and has a rim.
      const far = ASIDE / Math.max(Math.hypot(b[0] - a[0], b[1] - a[1]), 1e-6);
      const inside = (k, size) => Math.min(Math.max(b[k] + far * (b[k] - a[k]), EDGE), size - EDGE);
      const place = [inside(0, width), inside(1, height)];
      context.fillStyle = isNext ? next : text;
      context.font = `${isNext ? 700 : 500} 11px ${font}`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.lineWidth = 3;
      context.strokeStyle = rim;
      context.strokeText(String(i + 1), ...place);
      context.fillText(String(i + 1), ...place);
    });
  }

  drawDrone({ context, text }, at, now) {
    const [x, y] = at(now.p), [fx, fy] = rotated(now.q, [1, 0, 0]);
    const angle = Math.atan2(-fy, fx);
    context.save();
    context.translate(x, y);
    context.rotate(angle);
    context.beginPath();
    context.moveTo(8, 0);
    context.lineTo(-5, 5);
    context.lineTo(-5, -5);
    context.closePath();
    context.fillStyle = "#ffd21f";
    context.strokeStyle = text;
    context.lineWidth = 1.5;
    context.fill();
    context.stroke();
    context.restore();
  }

  drawDot(context, [x, y], color, radius) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = css(color);
    context.fill();
  }
}
