// Other runs of the same track, beside the one that is shown, and how far they are behind it.
import { css } from "airrace/colors.js";
import { countUntil, Timeline } from "airrace/timeline.js";
import { Halo } from "airrace/dress.js";
import { Line } from "airrace/lines.js";
import { signed } from "airrace/standing.js";

const STRIDE = 3; // frames a point of its path
const REACH = 12; // m, farther away from the other's path there is no gap to tell

export class Ghost {
  // run: has name, color (RGB from 0 to 1), path of its body, shift (s, added to the time of the
  // page gives its own), and record, a batch.
  constructor(stage, run) {
    Object.assign(this, run, { stage, timeline: new Timeline() });
    this.timeline.add(run.record);
    const points = [];
    for (let i = 0; i < this.timeline.count; i += STRIDE) {
      points.push([...this.timeline.row(i).subarray(1, 4)]);
    }
    this.line = new Line(stage, { width: 2, capacity: Math.max(points.length, 1), opacity: 0.7 });
    this.line.add(points, run.color);
    this.halo = new Halo(stage, css(run.color));
  }

  draw(t, visible, near) {
    this.now = this.timeline.sample(t + this.shift);
    this.stage.place(this.body, this.now);
    this.halo.place(this.now, near);
    this.line.visible = visible;
    this.line.draw(this.timeline.index(t + this.shift) / STRIDE);
  }

  // Returns by how many seconds it is behind (positive) or ahead, where the other drone is now;
  // shift: of the other drone, as ours. Null if it was not there on this lap, and before the first
  // gate, where it may have explored another way.
  gap(t, p, crossings) {
    const { timeline } = this, k = crossings.length;
    const from = timeline.crossings[k - 1]?.t;
    const to = timeline.crossings[k]?.t ?? timeline.end;
    if (from === undefined) return null;
    let best = REACH, there = null;
    for (let i = timeline.index(from); i <= timeline.index(to); i++) {
      const [time, x, y, z] = timeline.row(i);
      const away = Math.hypot(x - p[0], y - p[1], z - p[2]);
      if (away < best) [best, there] = [away, time];
    }
    return there === null ? null : there - this.shift - t;
  }
}

// Lists the runs with their colours, and by how much each is behind the first, or ahead of it.
export function drawGaps(first, ghosts, t, now, standing) {
  const box = document.getElementById("others");
  box.hidden = false;
  const { crossings } = standing;
  const rows = [[first.color, first.text], ...ghosts.map((ghost) => {
    const gap = now && ghost.gap(t, now.p, crossings);
    const count = countUntil(ghost.timeline.crossings, t + ghost.shift);
    const behind = gap == null ? `${count} gates so far` : `${signed(gap)} s`;
    return [ghost.color, `${ghost.name}: ${behind}`];
  })];
  box.replaceChildren(...rows.map(([color, words]) => {
    const line = document.createElement("div"), dot = document.createElement("i");
    dot.style.background = css(color);
    line.append(dot, words);
    return line;
  }));
}
