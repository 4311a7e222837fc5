// What the drone knows, in numbers, and what has happened lately, in words.
import { countUntil, last } from "airrace/timeline.js";
import { isClients, minutes } from "airrace/standing.js";

export function drawFacts(timeline, config, t, now) {
  const map = last(timeline.maps, t), status = last(timeline.status, t);
  const known = ["gates known", `${status?.gates ?? 0} of ${config.gates.length}`];
  const facts = isClients(status) ? [] : [known];
  if (map?.sigma != null) facts.push(["map, 1 \u03c3", `${(100 * map.sigma).toFixed(1)} cm`]);
  // An exact estimate has nothing to tell.
  if (now && now.error > 1e-4) {
    facts.push(["estimator error", `${(100 * now.error).toFixed(1)} cm`]);
  }
  const estimate = last(timeline.estimates, t);
  if (estimate) facts.push(["estimator, 1 \u03c3", `${(100 * estimate.sigma).toFixed(1)} cm`]);
  if (now) facts.push(["height", `${now.p[2].toFixed(1)} m`, "wide"]);
  const cells = facts.flatMap(([name, value, kind = ""]) => [name, value].map((text) => {
    const cell = document.createElement("span");
    cell.textContent = text;
    cell.className = kind;
    return cell;
  }));
  document.getElementById("facts").replaceChildren(...cells);
}

// All of them, the newest first; the list can be scrolled.
export function drawEvents(timeline, t) {
  const { events } = timeline, end = countUntil(events, t);
  const list = document.getElementById("events");
  const key = `${end} ${events.length}`;
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  const lines = events.slice(0, end).reverse().map((event) => {
    const line = document.createElement("li"), time = document.createElement("b");
    const text = document.createElement("span");
    time.textContent = minutes(event.t);
    text.textContent = event.text;
    line.append(time, text);
    return line;
  });
  list.replaceChildren(...lines);
}
