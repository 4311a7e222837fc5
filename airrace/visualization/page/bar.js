// The bar below: time, speed, jumps to laps and gates, and the cameras.
import { CAMERAS } from "airrace/cameras.js";
import { fitted } from "airrace/minimap.js";
import { minutes, seconds } from "airrace/standing.js";

const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
const RACE_RATES = [0, 0.25, 0.5, 1, 2, 4]; // of a simulation; 0 is as fast as it can
const BEFORE = 1.0; // s, before what is jumped to
const ROOM = 17; // px, that the number of a gate takes

const element = (id) => document.getElementById(id);

export class Bar {
  // feed: the LiveFeed of a live race, or null.
  constructor(timeline, player, cameras, config, feed) {
    Object.assign(this, { timeline, player, cameras, config, feed, laps: -1 });
    element("play").onclick = () => this.togglePlay();
    element("live").onclick = () => player.follow();
    element("time").oninput = (event) => player.jump(Number(event.target.value));
    element("gate-before").onclick = () => this.jumpGate(-1);
    element("gate-after").onclick = () => this.jumpGate(1);
    element("lap").onchange = (event) => this.jumpLap(Number(event.target.value));
    element("rate").onchange = (event) => this.setRate(Number(event.target.value));
    for (const [view, [text, code]] of Object.entries(CAMERAS)) {
      const button = document.createElement("button");
      button.textContent = text;
      button.title = `${text} (${code.at(-1)})`;
      button.dataset.view = view;
      button.onclick = () => cameras.choose(view);
      element("views").append(button);
      element("view").append(new Option(text, view));
    }
    element("view").onchange = (event) => cameras.choose(event.target.value);
    cameras.addEventListener("change", () => this.showView());
    player.addEventListener("change", () => this.showState());
    feed?.addEventListener("change", () => this.showState());
    this.showView();
    this.showState();
  }

  // Whether what is shown is the race as it is simulated now.
  get atEdge() {
    return this.feed?.open && this.feed.controls && this.player.following;
  }

  // At the newest, the race itself pauses; else what is shown.
  togglePlay() {
    if (this.atEdge) this.feed.ask({ pause: !this.feed.controls.paused });
    else this.player.toggle();
  }

  setRate(rate) {
    if (this.atEdge) this.feed.ask({ rate });
    else this.player.setRate(rate);
  }

  jumpLap(lap) {
    const start = this.timeline.crossings.filter((each) => each.gate === 1)[lap - 1];
    this.player.jump(lap ? start.t - BEFORE : this.timeline.start);
  }

  jumpGate(step) {
    const times = this.timeline.crossings.map((each) => each.t - BEFORE), { time } = this.player;
    const target = step > 0 ? times.find((t) => t > time + 0.05)
      : times.findLast((t) => t < time - 0.05);
    if (target !== undefined) this.player.jump(target);
  }

  showView() {
    element("view").value = this.cameras.view;
    for (const button of element("views").children) {
      button.ariaPressed = String(button.dataset.view === this.cameras.view);
    }
  }

  showState() {
    const { player, feed } = this;
    const paused = this.atEdge ? feed.controls.paused : !player.playing;
    element("play").textContent = paused ? "\u25b6" : "\u275a\u275a";
    element("live").hidden = !feed;
    element("live").classList.toggle("on", player.following);
    // A race that keeps its own time has no speed to choose.
    element("rate").disabled = Boolean(player.following && !this.atEdge);
    const rates = this.atEdge ? RACE_RATES : RATES;
    const rate = this.atEdge ? feed.controls.rate : player.rate;
    const key = `${rates} ${rate}`;
    if (key === this.rates) return;
    this.rates = key;
    const choices = rates.includes(rate) ? rates : [...rates, rate];
    element("rate").replaceChildren(...choices.map((each) => {
      const name = each === 0 ? "as fast as it can" : `${each} x`;
      return new Option(name, each, false, each === rate);
    }));
  }

  draw() {
    const { timeline, player } = this, range = element("time");
    range.min = timeline.start;
    range.max = Math.max(timeline.end, timeline.start + 0.1);
    range.value = player.time;
    element("now").textContent = minutes(player.time);
    this.drawMarks();
    const starts = timeline.crossings.filter((each) => each.gate === 1);
    if (starts.length === this.laps) return;
    this.laps = starts.length;
    const laps = starts.slice(0, this.config.laps).map((start, k) => {
      const end = starts[k + 1]?.t;
      return new Option(`lap ${k + 1}` + (end ? `, ${seconds(end - start.t)} s` : ""), k + 1);
    });
    element("lap").replaceChildren(new Option("go to lap", "", true, true),
      new Option("take-off", 0), ...laps);
    element("lap").options[0].disabled = true;
  }

  // Laps as numbered blocks, gates as ticks.
  drawMarks() {
    const { timeline } = this;
    const { context, width, text, dim, font } = fitted(element("marks"));
    const span = Math.max(timeline.end - timeline.start, 0.1), knob = 8;
    const at = (t) => knob + ((width - 2 * knob) * (t - timeline.start)) / span;
    context.font = `600 10px ${font}`;
    context.textBaseline = "top";
    const pixels = at(timeline.end) / span;
    for (const [k, { t, gate }] of timeline.crossings.entries()) {
      const lap = gate === 1;
      context.fillStyle = lap ? text : dim;
      if (!lap && pixels < 0.25) continue; // too close to tell apart
      context.fillRect(at(t), lap ? 0 : 8, lap ? 2 : 1, lap ? 14 : 6);
      if (!lap && k && at(t) - at(timeline.crossings[k - 1].t) > ROOM) {
        context.font = `9px ${font}`;
        context.textAlign = "center";
        context.fillText(String(gate), at(t), -1);
        context.font = `600 10px ${font}`;
        context.textAlign = "left";
      }
      const closes = k + 1 === timeline.crossings.length && timeline.over;
      if (lap && !closes) {
        context.fillText(String(1 + k / this.config.gates.length), at(t) + 4, 0);
      }
    }
  }
}
