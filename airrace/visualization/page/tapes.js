// Speed and thrust as tapes: a scale that fills up.
import { css, speedColor, speedLimit } from "airrace/colors.js";
import { fitted } from "airrace/minimap.js";

const TOP = 36, BOTTOM = 6, WIDTH = 16; // px

export function drawTapes(now, config) {
  const place = fitted(document.getElementById("tape"));
  const speed = now?.speed ?? 0, thrust = now?.thrust ?? 0;
  tape(place, 0, "speed", `${speed.toFixed(1)} m/s`, speed / speedLimit(), css(speedColor(speed)),
    [0, 0.25, 0.5, 0.75, 1].map((share) => [share, String(Math.round(share * speedLimit()))]));
  const most = config.maxThrust;
  const ticks = Array.from({ length: Math.floor(most) + 1 }, (_, k) => [k / most, `${k} g`]);
  tape(place, place.width / 2, "thrust", `${thrust.toFixed(2)} g`, thrust / most, place.accent,
    ticks);
}

function tape({ context, height, text, dim, font }, left, name, value, share, color, ticks) {
  const length = height - TOP - BOTTOM, x = left + 30;
  context.font = `500 11px ${font}`;
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
  context.fillStyle = dim;
  context.fillText(name, left, 11);
  context.font = `700 13px ${font}`;
  context.fillStyle = text;
  context.fillText(value, left, 27);
  context.fillStyle = "rgba(128, 140, 150, 0.25)";
  context.fillRect(x, TOP, WIDTH, length);
  const filled = length * Math.min(Math.max(share, 0), 1);
  context.fillStyle = color;
  context.fillRect(x, TOP + length - filled, WIDTH, filled);
  context.font = `500 10px ${font}`;
  context.fillStyle = dim;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const [at, label] of ticks) {
    const y = TOP + length * (1 - at);
    context.fillRect(x - 4, y - 0.5, 4, 1);
    context.fillText(label, x - 6, y);
  }
}
