// The keys, and the help that lists them.
import { CAMERAS } from "airrace/cameras.js";

const STEP = 1.0, FINE = 1 / 30; // s

const HELP = [
  ["O, C, B, G, F", "camera: overview, chase, on board, gate, free. In overview and free, drag " +
    "to turn, drag with the right button to move, and use the wheel to come nearer"],
  ["Space", "pause, and go on"],
  ["\u2190 \u2192", "one second back or ahead; with Shift, to the gate before or after; with Alt, " +
    "one picture"],
  ["Page Up, Page Down", "to the lap before or after"],
  ["\u2191 \u2193", "faster, slower"],
  ["L", "back to the newest of a live race"],
  ["P", "show or hide path and plans"],
  ["E", "legend"],
  ["H", "show or hide everything but the scene"],
  ["?", "this help"],
  ["With fingers", "in overview and free: one turns, two move and come nearer"],
];

export function makeHelp(live) {
  const dialog = document.getElementById("help");
  const title = document.createElement("h3"), table = document.createElement("table");
  const close = document.createElement("button"), head = document.createElement("header");
  title.textContent = live ? "Watching a race" : "Watching a replay";
  for (const [keys, text] of HELP) {
    const row = table.insertRow(), key = document.createElement("kbd");
    key.textContent = keys;
    row.insertCell().append(key);
    row.insertCell().textContent = text;
  }
  const note = document.createElement("p");
  note.textContent = "Nothing that you do here changes what happens in the race.";
  close.textContent = "Close";
  close.onclick = () => dialog.close();
  head.append(title, close);
  dialog.replaceChildren(head, table, note);
  dialog.onclick = () => dialog.close();
  document.getElementById("help-button").onclick = () => dialog.showModal();
  return dialog;
}

// actions: an object of functions, see main.js.
export function listen(actions, bar, player, cameras, help) {
  const views = Object.entries(CAMERAS).map(([view, [, code]]) => [code, view]);
  const codes = {
    ...Object.fromEntries(views.map(([code, view]) => [code, () => cameras.choose(view)])),
    Space: () => bar.togglePlay(),
    KeyL: () => player.follow(),
    KeyP: actions.togglePaths,
    KeyE: actions.toggleLegend,
    KeyH: actions.toggleOverlay,
    PageUp: () => actions.stepLap(-1),
    PageDown: () => actions.stepLap(1),
    ArrowUp: () => actions.stepRate(1),
    ArrowDown: () => actions.stepRate(-1),
    ArrowLeft: (event) => arrow(event, -1),
    ArrowRight: (event) => arrow(event, 1),
  };
  const arrow = (event, sign) => {
    if (event.shiftKey) bar.jumpGate(sign);
    else player.step(sign * (event.altKey ? FINE : STEP));
  };
  // Before Meshcat, whose mouse listens for arrow keys, and before a button that has the focus.
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.target.matches?.("select, #resize")) return;
    if (event.key === "?") {
      help.open ? help.close() : help.showModal();
    } else if (codes[event.code] && !help.open) {
      codes[event.code](event);
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }, true);
  // A button that was clicked by the space bar's release would act twice.
  window.addEventListener("keyup", (event) => {
    if (event.code === "Space" && !event.target.matches?.("select")) event.preventDefault();
  }, true);
}
