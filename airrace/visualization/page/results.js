// The card with the result of a race, and where to go from there.
import { seconds } from "airrace/standing.js";

function element(name, text, className = "") {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = className;
  return made;
}

export class Results {
  // bar: to jump with.
  constructor(bar) {
    this.box = document.getElementById("results");
    this.bar = bar;
    this.links = [];
    this.closed = false;
    this.key = null;
  }

  // Shows links, pairs of text and address.
  setLinks(links) {
    this.links = links;
    this.key = null;
    // On the bar there is little room.
    const anchors = this.anchors().filter((link) => link.textContent !== "race.json");
    document.getElementById("links").replaceChildren(...anchors);
  }

  anchors() {
    return this.links.map(([text, address]) => {
      const link = element("a", text);
      Object.assign(link, { href: address, target: "_blank", rel: "noopener" });
      return link;
    });
  }

  draw({ over, laps }) {
    if (!over) this.closed = false;
    this.box.hidden = !over || this.closed;
    const key = over ? `${over.t} ${laps.length}` : null;
    if (this.box.hidden || key === this.key) return;
    this.key = key;
    const times = laps.filter((lap) => lap.time !== null).map((lap) => lap.time);
    const parts = [element("h2", over.finished ? "Finished" : "Did not finish")];
    if (!over.finished) parts.push(element("p", over.reason));
    let best = 0;
    if (times.length) {
      best = times.indexOf(Math.min(...times)) + 1;
      const mean = times.reduce((a, b) => a + b) / times.length;
      parts.push(element("div", `${seconds(times[best - 1])} s`, "big best"));
      parts.push(element("div", `best lap, number ${best} of ${times.length}`));
      parts.push(element("div", `mean lap ${seconds(mean)} s`));
    }
    if (over.exploration != null) {
      parts.push(element("div", `explored in ${over.exploration.toFixed(1)} s`));
    }
    parts.push(this.buttons(best));
    this.box.replaceChildren(...parts);
  }

  buttons(best) {
    const row = element("div", "", "row");
    const act = (text, action) => {
      const button = element("button", text);
      button.onclick = () => {
        this.closed = true;
        action();
        if (text !== "Close") this.bar.player.play();
      };
      row.append(button);
    };
    if (best) act("Watch the best lap", () => this.bar.jumpLap(best));
    act("Watch from the start", () => this.bar.jumpLap(0));
    act("Close", () => {});
    row.append(...this.anchors());
    return row;
  }
}
