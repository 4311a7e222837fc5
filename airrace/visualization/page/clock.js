// The lap clock, the split at the last gate, and the table of laps.
import { phase, seconds, signed, words } from "airrace/standing.js";

const ROWS = 6; // laps shown, the newest first
const SPLIT_TIME = 4; // s, for which a split is shown

const element = (id) => document.getElementById(id);

export function drawClock(standing, config) {
  const { lapTime, laps, lap, over, t } = standing;
  element("doing").textContent = words(standing, config);
  const lastLap = laps.at(-1);
  let time = lapTime ?? lastLap?.time ?? null;
  let what = laps.length ? `lap ${lap} of ${config.laps}` : phase(standing);
  if (time === null) time = t;
  else if (over) what = `last lap of ${laps.length}`;
  const runs = lapTime !== null || !laps.length;
  element("lap-time").textContent = seconds(time, runs ? 1 : 2);
  element("lap-of").textContent = what;
  drawSplit(standing, config);
}

function drawSplit({ split, t }, config) {
  const box = element("split");
  box.hidden = !split || split.split === undefined || t - split.at > SPLIT_TIME;
  if (box.hidden) return;
  const gate = `gate ${(split.gate % config.gates.length) + 1}`;
  const delta = split.delta === null ? "" : `${signed(split.delta)} s to best`;
  box.className = `split ${split.kind}`;
  const small = document.createElement("small");
  small.textContent = delta;
  box.replaceChildren(`${gate}: ${seconds(split.split)} s `, small);
}

export function drawLaps({ laps, lapTime }) {
  const rows = laps.slice(-ROWS).reverse().map((lap) => {
    const row = document.createElement("tr");
    row.className = lap.best ? "top" : "";
    const running = lap.time === null;
    const { delta, kind } = lap.compared;
    const comparable = delta !== null && lap.splits.length > 1;
    const cells = [
      [String(lap.lap), ""],
      [running ? seconds(lapTime, 1) : seconds(lap.time), lap.best ? "best" : ""],
      [comparable ? signed(delta) : "", kind],
      [lap.best ? "best" : lap.plan ? `plan of lap ${lap.plan}` : "", ""],
    ];
    for (const [text, name] of cells) {
      const cell = row.insertCell();
      cell.textContent = text;
      cell.className = name;
    }
    return row;
  });
  document.querySelector("#laps thead").hidden = !rows.length;
  document.querySelector("#laps tbody").replaceChildren(...rows);
}
