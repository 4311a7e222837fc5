// How the race stands at a time: the lap, its clock, the splits, and what to compare them with.
import { countUntil, last } from "airrace/timeline.js";

export const BEST = "best", BETTER = "better", SLOWER = "slower";

// Returns the times between crossings of gate 1, and the splits at the gates of each lap.
function lapsOf(crossings, gates) {
  const laps = [];
  for (let k = 0; k < crossings.length; k += gates) {
    const start = crossings[k].t, ended = k + gates < crossings.length;
    const splits = crossings.slice(k, k + gates + 1).map((each) => each.t - start);
    laps.push({ lap: laps.length + 1, start, splits, time: ended ? splits[gates] : null });
  }
  return laps;
}

// Returns the smallest of numbers; Infinity if there is none.
const least = (numbers) => Math.min(Infinity, ...numbers);

// Compares the time at a gate with the laps before: against their best, and the lap before.
function compared(laps, k, gate) {
  const split = laps[k].splits[gate];
  const before = laps.slice(0, k).filter((lap) => lap.time !== null);
  if (!before.length || split === undefined) return { gate, split, delta: null, kind: "" };
  const best = before.reduce((a, b) => (b.time < a.time ? b : a));
  let kind = SLOWER;
  if (split < before.at(-1).splits[gate]) kind = BETTER;
  if (split < least(before.map((lap) => lap.splits[gate]))) kind = BEST;
  return { gate, split, delta: split - best.splits[gate], kind };
}

export function standing(timeline, config, t) {
  const gates = config.gates.length;
  const over = timeline.over !== null && t >= timeline.over.t - 0.05;
  // The last crossing is a little later than the last frame.
  const until = over ? Math.max(t, timeline.over.t) : t;
  const crossings = timeline.crossings.slice(0, countUntil(timeline.crossings, until));
  const laps = lapsOf(crossings, gates);
  const status = last(timeline.status, t) ?? { state: "CALIBRATE", gates: 0, done: false };
  const flown = laps.filter((lap) => lap.time !== null);
  const bestTime = least(flown.map((lap) => lap.time));
  for (const [k, lap] of laps.entries()) {
    lap.compared = compared(laps, k, lap.splits.length - 1);
    lap.best = lap.time === bestTime;
    lap.plan = planOf(timeline, lap.lap, t);
  }
  const current = laps.at(-1);
  const running = current && current.time === null && !over;
  // A lap's last crossing opens the next lap, which shows the delta for a while.
  let split = null;
  if (current) {
    const k = current.splits.length > 1 ? laps.length - 1 : laps.length - 2;
    if (k >= 0) split = { ...compared(laps, k, laps[k].splits.length - 1), at: crossings.at(-1).t };
  }
  return {
    t,
    status,
    over: over ? timeline.over : null,
    laps: laps.filter((lap) => lap.time !== null || running),
    lap: Math.min(laps.length, config.laps),
    lapTime: running ? t - current.start : null,
    split,
    crossings,
    best: flown.length ? bestTime : null,
    nextGate: nextGate(crossings, status, gates, over),
  };
}

// Returns the number of the gate that the drone flies to, from 1; null if there is none.
function nextGate(crossings, status, gates, over) {
  if (over) return null;
  if (crossings.length || status.done) return (crossings.length % gates) + 1;
  return status.state === "FLY_TO_GATE" ? Math.max(status.gates, 1) : null;
}

// Returns the first lap that flew the plan of a lap, if that is an earlier one.
function planOf(timeline, lap, t) {
  const plans = timeline.plans.filter((plan) => plan.t <= t && plan.lap <= lap);
  const first = Math.max(0, ...plans.map((plan) => plan.lap));
  return first && first < lap ? first : null;
}

// Whether a client flies, which tells nobody what it knows of the track.
export const isClients = (status) => ["ON_PAD", "RACE"].includes(status?.state);

const TO_GATE_1 = "Flying to gate 1 to start the first lap";

// What the drone does, in words; a client's drone is on the pad, and then races.
const DOING = {
  CALIBRATE: "On the pad, waiting until it is level and at rest",
  TAKE_OFF: "Taking off",
  HOVER: "Hovering, looking at the picture",
  TURN_TO_GATE: "Turning to gate 1",
  AVOID: "Flying around an obstacle",
  RETURN: "All gates are found: flying back to the start",
  DONE: "The map is ready: planning the first lap",
  ON_PAD: "On the pad, waiting for the client to arm",
  RACE: TO_GATE_1,
};

export function words({ over, status, crossings, lap, nextGate }, config) {
  if (over?.finished) return `Finished ${config.laps} ${config.laps === 1 ? "lap" : "laps"}`;
  if (over) return `Did not finish: ${over.reason}`;
  if (crossings.length) return `Racing lap ${lap} of ${config.laps}, next gate ${nextGate}`;
  if (status.done && status.racing) return TO_GATE_1;
  if (status.state === "FLY_TO_GATE") return `Flying to gate ${Math.max(status.gates, 1)}`;
  return DOING[status.state] ?? "Looking for the next gate";
}

// Returns what goes on before the first lap, in words.
export function phase({ status }) {
  if (status.state === "ON_PAD") return "before the start";
  return status.done ? "before gate 1" : "exploring the track";
}

export const seconds = (time, digits = 2) => (time == null ? "-" : time.toFixed(digits));
export const signed = (time) => (time < 0 ? "\u2212" : "+") + Math.abs(time).toFixed(2);

export function minutes(time) {
  const m = Math.floor(time / 60);
  return `${m}:${(time - 60 * m).toFixed(1).padStart(4, "0")}`;
}
