// One scale of colours for speed, the same as in Python: see airrace/common/colors.py.

let scale = [[0, 0, 1], [1, 0, 0]];
let most = 20; // m/s, at its end

// Takes the scale from Python: RGB from 0 to 1, from slow to fast, and the speed at its end.
export function setSpeedScale(colors, limit) {
  scale = colors;
  most = limit;
}

export const speedLimit = () => most;

export function speedColor(speed) {
  const k = Math.round(Math.min(Math.max(speed / most, 0), 1) * (scale.length - 1));
  return scale[k];
}

export const css = ([r, g, b], alpha = 1) =>
  `rgba(${Math.round(255 * r)},${Math.round(255 * g)},${Math.round(255 * b)},${alpha})`;

// Opacity of what was replaced; age: how many times since. It falls every time, but slowly, so
// that nothing is lost.
export const faded = (age) => (age <= 0 ? 1 : 0.5 / (1 + 0.4 * (age - 1)));
