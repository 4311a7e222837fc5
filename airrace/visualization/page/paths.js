// The path that was flown, coloured by speed, and the plans; earlier laps are fainter.
import { faded, speedColor } from "airrace/colors.js";
import { decodeFloats, countUntil } from "airrace/timeline.js";
import { Line } from "airrace/lines.js";

const STRIDE = 3; // frames a point of the path
const PIECE = 400; // points
const WHITE = [1, 1, 1], ORANGE = [1, 0.5, 0];

// Returns the lap that is flown at a time, 0 before the first.
const lapAt = (timeline, gates, t) =>
  Math.ceil(countUntil(timeline.crossings, t) / gates);

// What was flown, in pieces that end at the latest with a lap.
export class FlownPath {
  constructor(stage, timeline, config) {
    Object.assign(this, { stage, timeline, gates: config.gates.length, next: 0, pieces: [] });
  }

  extend() {
    for (; this.next < this.timeline.count; this.next += STRIDE) {
      const row = this.timeline.row(this.next);
      const lap = lapAt(this.timeline, this.gates, row[0]);
      const point = [row[1], row[2], row[3]], color = speedColor(row[8]);
      let piece = this.pieces.at(-1);
      if (piece) {
        piece.line.add([point], color);
        piece.times.push(row[0]);
      }
      if (!piece || piece.line.full || piece.lap !== lap) {
        piece = { lap, times: [row[0]], line: new Line(this.stage, { width: 3, capacity: PIECE }) };
        piece.line.add([point], color);
        this.pieces.push(piece);
      }
    }
  }

  draw(t, visible) {
    this.extend();
    const lap = lapAt(this.timeline, this.gates, t);
    for (const piece of this.pieces) {
      piece.line.visible = visible && piece.times[0] <= t;
      piece.line.opacity = faded(lap - piece.lap);
      let count = piece.times.length;
      if (piece.times[count - 1] > t) count = piece.times.findIndex((time) => time > t);
      piece.line.draw(count);
    }
  }
}

// The plan in force in white, with the arrows that Meshcat has, and those before it in orange.
export class Plans {
  constructor(stage, timeline) {
    Object.assign(this, { stage, timeline, lines: [] });
  }

  draw(t, visible, arrows) {
    const { plans } = this.timeline, now = countUntil(plans, t) - 1;
    while (this.lines.length < plans.length) {
      const floats = decodeFloats(plans[this.lines.length].points), points = [];
      for (let k = 0; k < floats.length; k += 3) points.push([...floats.subarray(k, k + 3)]);
      const pair = [WHITE, ORANGE].map((color, earlier) => {
        const line = new Line(this.stage, { width: earlier ? 2 : 3, capacity: points.length });
        line.add(points, color);
        return line;
      });
      this.lines.push(pair);
    }
    this.lines.forEach(([inForce, earlier], k) => {
      inForce.visible = visible && k === now;
      inForce.opacity = 0.85;
      earlier.visible = visible && k < now;
      earlier.opacity = faded(now - k);
      this.stage.show(`drake/plans/lap_${plans[k].lap}`, arrows && k === now);
    });
  }
}
