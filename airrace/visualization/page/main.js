// The page of a race, live or again: reads what Python left in the page, and draws every frame.
import { Bar } from "airrace/bar.js";
import { Cameras, CHASE, ONBOARD, OVERVIEW, FREE } from "airrace/cameras.js";
import { drawClock, drawLaps } from "airrace/clock.js";
import { css, setSpeedScale } from "airrace/colors.js";
import { drawShadows, GateNumbers, Halo, haze, light } from "airrace/dress.js";
import { drawEvents, drawFacts } from "airrace/facts.js";
import { Estimate } from "airrace/estimate.js";
import { Film } from "airrace/film.js";
import { drawGaps, Ghost } from "airrace/ghosts.js";
import { listen, makeHelp } from "airrace/keys.js";
import { LiveFeed } from "airrace/live.js";
import { MapMarkers } from "airrace/map.js";
import { Minimap } from "airrace/minimap.js";
import { FlownPath, Plans } from "airrace/paths.js";
import { CameraPicture } from "airrace/picture.js";
import { Player } from "airrace/player.js";
import { Results } from "airrace/results.js";
import { Stage } from "airrace/stage.js";
import { standing } from "airrace/standing.js";
import { drawTapes } from "airrace/tapes.js";
import { last, Timeline } from "airrace/timeline.js";

const PERIOD = 1 / 12; // s, between two drawings of what need not be smooth
const SHADOWS = 2; // s, between two looks whether something new throws a shadow

const element = (id) => document.getElementById(id);
const json = (id) => JSON.parse(element(id)?.textContent ?? "null");

const config = json("race-config"), record = json("race-record");
const live = config.mode === "live";
setSpeedScale(config.speedColors, config.maxSpeed);
element("scale").textContent = `flown, by speed: 0 to ${config.maxSpeed} m/s`;
const stops = config.speedColors.filter((_, k) => k % 6 === 0).map((color) => css(color));
document.documentElement.style.setProperty("--scale", stops.join(", "));
document.title = config.title;

const timeline = new Timeline();
if (record) timeline.add(record);
const stage = new Stage(viewer);
light(stage, config);
haze(stage, config);
const player = new Player(timeline, live);
const feed = live ? new LiveFeed(timeline, player) : null;
const cameras = new Cameras(stage, timeline, config);
const numbers = new GateNumbers(stage, config);
const halo = new Halo(stage, "#ffd21f");
const flown = new FlownPath(stage, timeline, config), plans = new Plans(stage, timeline);
const markers = new MapMarkers(stage, timeline);
const minimap = new Minimap(timeline, config);
const picture = new CameraPicture(stage, timeline, config);
const ghosts = (config.ghosts ?? []).map((run) => new Ghost(stage, run));
const estimate = new Estimate(stage, timeline, config.body);
const film = new Film(stage, player);
const bar = new Bar(timeline, player, cameras, config, feed);
const results = new Results(bar);
const help = makeHelp(live);
results.setLinks(config.links ?? []);
feed?.addEventListener("batch", ({ detail }) => detail.links && results.setLinks(detail.links));
feed?.addEventListener("change", () => (element("lost").hidden = feed.open || !timeline.count));

let paths = true, now = null, stands = standing(timeline, config, 0), slow = 0, shadows = 0;

const toggle = (id) => (element(id).hidden = !element(id).hidden);
listen({
  togglePaths: () => (paths = !paths),
  toggleLegend: () => toggle("legend"),
  toggleOverlay: () => {
    for (const box of document.querySelectorAll("#race > .panel, #side")) {
      box.style.visibility = box.style.visibility === "hidden" ? "" : "hidden";
    }
  },
  stepLap: (step) => {
    const starts = timeline.crossings.filter((each) => each.gate === 1);
    const flying = starts.filter((each) => each.t - 1.05 <= player.time).length;
    const lap = Math.min(Math.max(flying + step, 0), starts.length);
    bar.jumpLap(lap);
  },
  stepRate: (step) => {
    const select = element("rate");
    const k = Math.min(Math.max(select.selectedIndex + step, 0), select.options.length - 1);
    bar.setRate(Number(select.options[k].value));
  },
}, bar, player, cameras, help);
element("legend-button").onclick = () => toggle("legend");
element("events-button").onclick = () => element("events").classList.toggle("open");
if (ghosts.length) halo.paint(css(config.name.color));
element("race").hidden = false;
cameras.choose(cameras.view); // now that panels take their room
// What stands above the bar makes room for it, however many rows it takes.
new ResizeObserver(([{ target }]) => {
  document.documentElement.style.setProperty("--bar", `${target.offsetHeight}px`);
}).observe(element("bar"));
// Drake's page would load itself again when another race begins here, and lose this one.
window.do_reconnect = false;
if (config.begin) player.jump(config.begin);

// What changes with every frame.
function drawScene() {
  const { time } = player, inside = cameras.view === ONBOARD;
  const far = cameras.view === OVERVIEW || cameras.view === FREE;
  stage.place(config.body, now);
  stage.show(config.body, !inside);
  halo.place(now, !far);
  const shifts = last(timeline.shifts, time)?.gates;
  numbers.show(stands.nextGate, shifts);
  // From on board, what was flown is where the camera is; behind the drone, arrows hide it.
  flown.draw(time, paths && !inside);
  plans.draw(time, paths, paths && cameras.view !== ONBOARD && cameras.view !== CHASE);
  markers.draw(time, !inside);
  estimate.draw(now, !inside, performance.now() / 1000);
  for (const ghost of ghosts) ghost.draw(time, paths && !inside, !far);
  cameras.update(now, stands.status.gates);
  placeGates(shifts);
  stage.redraw();
}

function placeGates(shifts) {
  if (!shifts || !config.movingGates) return;
  shifts.forEach(([x, y], i) => {
    const { middle } = config.gates[i];
    const p = [x - middle[0], y - middle[1], 0];
    stage.place(`drake/visualizer/gates/gate_${i + 1}`, { p, q: [0, 0, 0, 1] });
  });
}

function drawOverlay() {
  drawLaps(stands);
  drawFacts(timeline, config, player.time, now);
  drawEvents(timeline, player.time);
  const shifts = last(timeline.shifts, player.time)?.gates;
  const others = ghosts.filter((ghost) => ghost.now)
    .map((ghost) => ({ p: ghost.now.p, color: ghost.color }));
  minimap.draw(player.time, now, stands.nextGate, shifts, others);
  drawTapes(now, config);
  bar.draw();
  results.draw(stands);
  if (ghosts.length) drawGaps(config.name, ghosts, player.time, now, stands);
}

stage.onFrame((wall, dt) => {
  player.advance(dt);
  now = timeline.sample(player.time);
  if (!now) return;
  stands = standing(timeline, config, player.time);
  const state = `${player.time} ${cameras.view} ${paths}`;
  if (state !== stage.state) drawScene();
  stage.state = state;
  numbers.fit(); // a hand may have moved the camera, or the window has another size
  drawClock(stands, config);
  picture.draw(player.time, now, paths && cameras.view !== ONBOARD);
  if (wall > slow) {
    slow = wall + PERIOD;
    drawOverlay();
  }
  if (wall > shadows) {
    shadows = wall + SHADOWS;
    drawShadows(stage, [config.body, "drake/plans", ...ghosts.map((ghost) => ghost.body)]);
  }
});
stage.onDrawn = () => film.take(stands);

// For tests, and for those who want to know more.
window.airrace = { bar, cameras, config, estimate, feed, film, ghosts, halo, numbers, player, stage,
  timeline };
